"""Native rigid bodies with four integrators, free or on fixed planes."""

from __future__ import annotations

from collections.abc import Sequence

from graspfx.objects.body import NativeBody, create
from graspfx.objects.surroundings import Meeting, Member, Obstacle

__all__ = ["create", "create_world"]


def create_world(members: Sequence[Member], obstacles: Sequence[Obstacle], meeting: Meeting) -> NativeBody:
    """Return the body of one object in contact with half-spaces and planes.

    Native objects do not collide with one another, so that `members` contains one object.
    """
    from graspfx.objects.floor.floor import FloorBody  # friction cones are only needed in scenes with obstacles

    [member] = members
    return FloorBody(member, obstacles, meeting)
