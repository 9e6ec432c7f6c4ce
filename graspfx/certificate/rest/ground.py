"""Ground of an object: the stiffness of native floors and walls under it, and which obstacles are left out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.preload import cross
from graspfx.build import encounters
from graspfx.build.resolve import Parts
from graspfx.certificate.rest.resting import Grip
from graspfx.certificate.scaled_gains import block_diagonal
from graspfx.objects import integrators as body
from graspfx.objects.body_state import BodyState
from graspfx.objects.floor.floor import FLAT_KINDS, FloorBody
from graspfx.objects.floor.planes import FloorState, PlaneContact
from graspfx.objects.floor.rest import meet
from graspfx.objects.surroundings import Meeting, Member
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

LOW = 2e-5  # [m]: an object of a scene starts up to 10 um inside its floor, or as far above it


@dataclass(frozen=True, eq=False)
class Ground:
    """Obstacles that an object stands on.

    Attributes:
        names: of the obstacles.
        stiffness, damping: K_g, B_g (r, r) on the object's free freedoms, all contact points sticking.
        points: how many there are.
    """

    names: tuple[str, ...]
    stiffness: FloatArray
    damping: FloatArray
    points: int


def ground_under(parts: Parts, index: int, grip: Grip, *, lower: float = 0.0) -> Ground | None:
    """Give the ground of an object where it is, or `lower` [m] along gravity; None for what no floor or wall bears.

    K_g = sum k J'J over the points that bear, J (d, r) the velocity of a point per motion of the object, k that of the
    world; B_g with b = 2 sqrt(k m). Only native objects on half-spaces and planes.
    """
    scene, part, obstacles = parts.scene, parts.objects[index], parts.obstacles
    table, d = part.table, scene.dimensions
    if table.dynamics != "native" or table.shape is None or not scene.obstacle:
        return None
    if any(obstacle.shape.kind not in FLAT_KINDS for obstacle in obstacles):
        return None
    state = grip.grasped.body_state.copy()
    if lower:
        if scene.gravity is None or not any(scene.gravity):
            return None
        state[body.POSITION : body.POSITION + d] += lower * np.array(scene.gravity) / np.linalg.norm(scene.gravity)
    world = scene.world
    meeting = Meeting(world.friction, 0.0, world.stiffness)
    floor = FloorBody(Member(state, part.solid.shape), obstacles, meeting)
    block, names = FloorState(floor.buffer), []
    K, B = np.zeros((grip.r, grip.r)), np.zeros((grip.r, grip.r))
    points = 0
    for i in range(meet(BodyState(state), block, 0.0)):
        contact = block.contacts[i]
        if contact.gap >= 0.0:
            continue
        arm = contact.array(PlaneContact.arm)
        J = np.hstack([np.eye(3), -cross(arm)])[:d, grip.axes]
        share = contact.share * J.T @ J
        K += block.stiffness * share
        B += block.damping * share
        points += 1
        names.append(obstacles[contact.plane].name)
    return Ground(tuple(dict.fromkeys(names)), K, B, points) if points else None


def bearers(scene: Scene, index: int) -> Iterator[str]:
    """Name whatever could carry an object besides its fingers."""
    table = scene.object[index]
    if table.shape is None:
        return
    yield from (obstacle.name for obstacle in scene.obstacle)
    for group in encounters.groups(scene):
        if index in group and encounters.in_world(scene, group) and encounters.collide(scene):
            yield from (scene.object[i].name for i in group if i != index)


def joined_ground(grounds: Sequence[Ground | None], sizes: Sequence[int]) -> tuple[FloatArray, FloatArray] | None:
    """Put stiffness and damping of the grounds of objects with these freedoms along a diagonal; None without any."""
    if all(ground is None for ground in grounds):
        return None
    none = [np.zeros((size, size)) for size in sizes]
    return (
        block_diagonal([zero if g is None else g.stiffness for zero, g in zip(none, grounds, strict=True)]),
        block_diagonal([zero if g is None else g.damping for zero, g in zip(none, grounds, strict=True)]),
    )
