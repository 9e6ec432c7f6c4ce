"""Native rigid bodies, with four integrators: each by itself, or on fixed planes."""

from __future__ import annotations

from collections.abc import Sequence

from graspfx.objects.body import NativeBody, create
from graspfx.objects.surroundings import Meeting, Member, Obstacle

__all__ = ["create", "create_world"]


def create_world(members: Sequence[Member], obstacles: Sequence[Obstacle], meeting: Meeting) -> NativeBody:
    """Make the body of one object on half-spaces and planes; native objects do not meet one another."""
    from graspfx.objects.floor.floor import FloorBody  # only scenes with obstacles need friction cones

    [member] = members
    return FloorBody(member, obstacles, meeting)
