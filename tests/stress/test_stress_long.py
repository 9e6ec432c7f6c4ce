"""Ten million ticks: drift of energy, norm of the quaternion, memory."""

from __future__ import annotations

import gc
import math
import tracemalloc
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.build import build
from graspfx.compile.kernel import kernel, source_function
from graspfx.compile.machine import compiled
from graspfx.coupling.grasp_state import FingerState
from graspfx.objects import integrators as at
from graspfx.objects.body import fill_body
from graspfx.objects.body_state import BodyState
from tests.support.exact_bodies import spinning
from tests.support.families import efforts, family

DRIFT = family("long: energy and momentum of a free box, 'exact'", "their initial values")
STEADY = family("long: energy of a body with equal moments of inertia, 'exact'", "its initial value")
NORM = family("long: quaternion", "norm 1")
PLACE = family("long: a body that flies freely", "start + velocity x time")
REACH = family("long: scenes", "positions at which the hands hold the objects", "m")
MEMORY = family("long: memory of a scene", "memory after five hundred ticks", "bytes")

Q = at.QUATERNION
OF_FINGERS = (
    FingerState.contact, FingerState.normal, FingerState.weight, FingerState.frame, FingerState.position,
    FingerState.velocity, FingerState.gap, FingerState.displacement, FingerState.rate, FingerState.force,
    FingerState.contact_world, FingerState.local, FingerState.retained, FingerState.anchor, FingerState.twist_axis,
    FingerState.moment, FingerState.elastic,
)  # fmt: skip
PARTS = 4  # of a run whose memory is looked at after each


@kernel
def turned(body: BodyState, T: float, count: int) -> float:
    """Steps of a body, and how far its quaternion was from norm 1 at most."""
    worst = 0.0
    for _ in range(count):
        at.step(body, T)
        q = body.motion.quaternion
        norm = math.sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w)
        worst = max(worst, abs(norm - 1.0))
    return worst


@efforts(short=2000, full=10_000_000)
def test_ten_million_ticks_of_bodies(cases: int) -> None:
    T = 0.001
    loop: Any = compiled(turned) if cases > 10_000 else source_function(turned)
    rounding = 4.0 * np.finfo(float).eps  # a tick: turning into the body's axes and back
    for name, inertia, family_of, allowed in (
        ("box", (3e-5, 5e-5, 6e-5), DRIFT, rounding * cases),
        ("cube", (4e-5, 4e-5, 4e-5), STEADY, rounding),
    ):
        for spin in (0.3, 30.0):  # [rad/s]
            state = np.zeros(at.SIZE)
            w = np.array([0.6, -0.64, 0.48]) * spin
            fill_body(
                state, dimensions=3, mass=0.1, inertia=inertia, integrator="exact", velocity=[0.25, 0.0, -0.5],
                angular_velocity=w,
            )  # fmt: skip
            before = spinning(state)
            worst = loop(state if cases > 10_000 else state.data, 0, T, cases)
            after = spinning(state)
            label = f"{name}, {spin} rad/s, {cases} ticks of 1 ms"
            energy = abs(after[0] / before[0] - 1.0)
            momentum = float(np.linalg.norm(after[1] - before[1]) / np.linalg.norm(before[1]))
            # fourth order: what is lost a radian goes with the fourth power of what is turned in a sample
            share = allowed + 2e-2 * (spin * T) ** 4 * spin * T * cases * (name == "box")
            family_of.check(max(energy, momentum if name == "box" else 0.0), share, label)
            NORM.check(float(worst), 5e-16, label)
            path = T * cases
            off = np.abs(state[at.POSITION : at.POSITION + 3] - path * np.array([0.25, 0.0, -0.5])).max()
            # every step rounds the position once: together at most ticks eps/2 of it
            PLACE.check(float(off) / (0.5 * path), cases * np.finfo(float).eps, label)


def traced() -> int:
    """Bytes that are allocated."""
    gc.collect()
    return tracemalloc.get_traced_memory()[0]


@pytest.mark.parametrize("name", ["reference-1dof", "sphere-three-fingers", "knob"])
@efforts(short=40, full=10_000_000)
def test_ten_million_ticks_of_scenes(name: str, cases: int) -> None:
    """Nothing grows: neither memory nor what moves, long after the scene's own motion has come to its end."""
    engine = "compiled" if cases > 10_000 else "interpreted"
    with build(gx.load(name, {"engine": engine}), record=False) as servo:
        servo.run(50, None)
        gc.collect()
        tracemalloc.start()
        try:
            servo.run(50, None)
            sizes = [traced()]
            for _ in range(PARTS):
                servo.run(-(-cases // PARTS), None)
                sizes.append(traced())
        finally:
            tracemalloc.stop()
        assert not servo.faulted
        for held in servo.objects:
            state = held.grasped.body_state
            assert all(np.isfinite(held.grasped.array(field)).all() for field in OF_FINGERS)
            if held.grasped.dimensions == 3:
                NORM.check(abs(float(np.linalg.norm(state[Q : Q + 4])) - 1.0), 5e-16, f"{name}, {cases} ticks")
            REACH.check(float(np.abs(state[at.POSITION : at.POSITION + 3]).max()), 0.2, f"{name}, {cases} ticks")
    # other threads of the tests' process allocate at times: what grows by itself does so in every part
    growth = min(after - before for before, after in pairwise(sizes))
    MEMORY.check(max(0, growth), 10_000 / PARTS, f"{name}, {cases} ticks")
