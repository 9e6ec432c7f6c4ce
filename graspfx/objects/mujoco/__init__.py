"""Rigid bodies simulated by MuJoCo, semi-implicit in position, with exact viscosity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from graspfx.objects.mujoco.mujoco import create
from graspfx.objects.surroundings import Meeting, Member, Obstacle

if TYPE_CHECKING:
    from graspfx.objects.mujoco.mujoco_world import MujocoWorld

__all__ = ["create", "create_world"]


def create_world(members: Sequence[Member], obstacles: Sequence[Obstacle], meeting: Meeting) -> MujocoWorld:
    """Return the MuJoCo world of objects that touch obstacles or one another."""
    from graspfx.objects.mujoco.mujoco_world import MujocoWorld

    return MujocoWorld(members, obstacles, meeting)
