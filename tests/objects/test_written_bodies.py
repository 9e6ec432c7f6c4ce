"""Kernels of bodies: as they are written, lowered and compiled they give the same bits."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspfx.compile.kernel import written
from graspfx.compile.machine import compiled
from graspfx.compile.records import size_of
from graspfx.objects import energy, guest, integrators
from graspfx.objects.body import INTEGRATORS, fill_body
from graspfx.objects.body_state import BodyState, Motion
from graspfx.objects.energy import SampleStart
from graspfx.objects.floor import floor, rest
from graspfx.objects.floor.floor import FloorBody
from graspfx.objects.floor.planes import FloorState
from graspfx.objects.guest import GuestState
from graspfx.objects.surroundings import Meeting, Member, placed
from graspfx.spatial import Quaternion, Vector
from graspfx.surfaces.closed_form.shape import Box, Cylinder, Ellipsoid, HalfSpace, Sphere

Array = NDArray[np.float64]
T = 0.004
THROWN = [True] * 3 + [False] * 3
FREE: dict[int, list[list[bool]]] = {
    1: [[True]],
    2: [[True] * 3, [True, False, False], [False, False, True]],
    3: [
        [True] * 6,
        [True, False, True, False, True, True],
        [False] * 3 + [True, False, False],
        [True] * 3 + [False] * 3,
    ],
}
CASES = [
    (d, integrator, free, moments)
    for d in (1, 2, 3)
    for integrator in INTEGRATORS
    for free in FREE[d]
    for moments in ([3e-4, 5e-4, 6e-4], [4e-4] * 3)
    if d == 3 or moments[0] == moments[1]
]


def random_body(d: int, integrator: str, free: list[bool], moments: list[float], rng: np.random.Generator) -> Array:
    """A body that moves and turns, with a wrench."""
    state = np.zeros(integrators.SIZE)
    movable = {1: [0], 2: [0, 1, 5], 3: [0, 1, 2, 3, 4, 5]}[d]
    mask = np.zeros(6)
    mask[movable] = free
    turn = rng.normal(size=4)
    fill_body(
        state, dimensions=d, mass=0.2, inertia=moments, viscosity=0.3, rotational_viscosity=1e-3,
        integrator=integrator, free=free, gravity=rng.normal(size=d), position=rng.normal(size=d),
        velocity=rng.normal(size=d) * mask[:d],
        orientation={1: None, 2: 0.3, 3: turn / np.linalg.norm(turn)}[d],
        angular_velocity={1: None, 2: 2.0 * mask[5], 3: 3.0 * rng.normal(size=3) * mask[3:]}[d],
    )  # fmt: skip
    body = BodyState(state)
    body.array(BodyState.force)[:d] = rng.normal(size=d)
    body.array(BodyState.moment)[:] = 1e-2 * rng.normal(size=3) if d == 3 else [0.0, 0.0, 1e-2 * float(d == 2)]
    return state


def same(kernel: Callable[..., Any], kinds: list[Any], blocks: list[Array], *numbers: float) -> Any:
    """Run a kernel in its three ways on copies of blocks; the blocks become what all of them leave."""
    results = []
    for way in ("written", "lowered", "compiled"):
        copies = [block.copy() for block in blocks]
        views = [kind(copy.data) for kind, copy in zip(kinds, copies, strict=True)]
        if way == "written":
            result = written(kernel)(*views, *numbers)
        elif way == "lowered":
            result = kernel(*views, *numbers)
        else:
            result = compiled(kernel)(*(part for copy in copies for part in (copy, 0)), *numbers)
        results.append((result, copies))
    for _, copies in results[1:]:
        for copy, first in zip(copies, results[0][1], strict=True):
            assert copy.tobytes() == first.tobytes()
    for block, copy in zip(blocks, results[0][1], strict=True):
        block[:] = copy
    assert results[0][0] == results[1][0]
    return results[0][0]


@pytest.mark.parametrize(("d", "integrator", "free", "moments"), CASES)
def test_steps_predictions_and_their_energy(d: int, integrator: str, free: list[bool], moments: list[float]) -> None:
    rng = np.random.default_rng(len(free) + d)
    state, start = random_body(d, integrator, free, moments, rng), np.zeros(size_of(SampleStart))
    for _ in range(3):
        same(energy.keep, [BodyState, SampleStart], [state, start])
        same(integrators.predict, [BodyState], [state], T)
        same(integrators.step, [BodyState], [state], T)
        SampleStart(start).contact_force = Vector(*rng.normal(size=3))
        same(energy.settle, [BodyState, SampleStart], [state, start], T)
    assert np.isfinite(state).all() and np.isfinite(start).all()


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize(
    "shape", [Box((0.05, 0.04, 0.03)), Sphere(0.02), Cylinder(0.02, 0.04), Ellipsoid((0.03, 0.02, 0.01))]
)
def test_bodies_on_planes(shape: Any, integrator: str) -> None:
    """Thrown into a corner of two planes, so that they slide, tip and come to rest."""
    rng = np.random.default_rng(5)
    state = random_body(3, integrator, [True] * 6, [4e-5, 5e-5, 6e-5], rng)
    motion = BodyState(state).motion
    motion.position, motion.velocity = Vector(0.03, 0.0, 0.03), Vector(-0.5, 0.2, -0.5)
    BodyState(state).gravity, BodyState(state).force = Vector(0.0, 0.0, -9.81), Vector(-0.2, 0.0, 0.0)
    planes = [placed("floor", HalfSpace((0, 0, 1)), 3), placed("wall", HalfSpace((1, 0, 0)), 3)]
    body = FloorBody(Member(state, shape), planes, Meeting(0.4, 0.0, 2e4))
    touched = 0
    for _ in range(25):
        assert same(floor.advance, [BodyState, FloorState], [state, body.buffer], T) == 0
        same(floor.expect, [BodyState, FloorState], [state, body.buffer], T)
        touched += body.touching
    assert touched > 10


@pytest.mark.parametrize("by_spin", [False, True])
@pytest.mark.parametrize(("d", "turns"), [(1, 0), (2, 1), (3, 0), (3, 1), (3, 3)])
def test_guests(d: int, turns: int, by_spin: bool) -> None:
    """A guest is handed random motions, and told of them after that."""
    rng = np.random.default_rng(turns)
    free = {1: [True], 2: [True] * 3, 3: [True] * 3 + [True] * turns + [False] * (3 - turns)}[d]
    state = random_body(d, "semi-implicit", free, [3e-4, 5e-4, 6e-4], rng)
    part = np.zeros(guest.SIZE)
    told, body = GuestState(part), BodyState(state)
    told.by_spin, told.turns, told.axis = by_spin, turns, 2 if d == 2 else 0
    told.free_translation, told.free_rotation = body.free_translation, body.free_rotation
    told.share, told.shares = 0.9, Vector(0.8, 0.85, 0.8) if turns == 3 else Vector(0.8, 0.8, 0.8)
    told.moments, told.start = Vector(3e-4, 5e-4, 6e-4), Quaternion(0.0, 0.0, 0.0, 1.0)
    for k in range(6):
        same(guest.hand_over, [BodyState, GuestState], [state, part], T)
        turn = rng.normal(size=4)
        told.velocity, told.place = Vector(*rng.normal(size=3)), Vector(*rng.normal(size=3))
        told.turn = Quaternion(*(turn / np.linalg.norm(turn)))
        told.spin = Vector(*rng.normal(size=3)) if k < 5 else Vector(math.pi / T, 0.0, 0.0)
        code = same(guest.take_over, [BodyState, GuestState], [state, part], T)
        assert code == (guest.TOO_FAST if k == 5 and turns else 0)


def test_a_prediction_on_planes_turns_what_the_floor_turns() -> None:
    state = random_body(3, "implicit", [True] * 6, [4e-5, 5e-5, 6e-5], np.random.default_rng(2))
    body = FloorBody(Member(state, Sphere(0.02)), [placed("floor", HalfSpace((0, 0, 1)), 3)], Meeting())
    block = FloorState(body.buffer)
    block.force, block.moment = Vector(0.1, -0.2, 1.0), Vector(1e-3, 2e-3, -1e-3)
    before = BodyState(state).next_motion.array(Motion.rotation).copy()
    same(rest.predict_on_planes, [BodyState, FloorState], [state, body.buffer], T)
    assert not np.array_equal(BodyState(state).next_motion.array(Motion.rotation), before)
