"""Rigid bodies simulated by PyBullet, semi-implicit in position, with exact viscosity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from graspfx.objects.bullet.bullet import create
from graspfx.objects.surroundings import Meeting, Member, Obstacle

if TYPE_CHECKING:
    from graspfx.objects.bullet.bullet_world import BulletWorld

__all__ = ["create", "create_world"]


def create_world(members: Sequence[Member], obstacles: Sequence[Obstacle], meeting: Meeting) -> BulletWorld:
    """Return the PyBullet world of objects that touch obstacles or one another."""
    from graspfx.objects.bullet.bullet_world import BulletWorld

    return BulletWorld(members, obstacles, meeting)
