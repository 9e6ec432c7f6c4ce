"""Limits on force: conservative inside the projection; scaling keeps cones, limits and the wrench's direction."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from graspfx.compile.machine import compiled
from graspfx.compile.native import compiled as machine_code
from graspfx.compile.program import Program
from graspfx.cones.problem import STICK
from graspfx.coupling.grasp_state import FingerState
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.law import react
from graspfx.coupling.limit import scale
from graspfx.coupling.rules import Rules
from graspfx.coupling.sample import sample
from graspfx.surfaces.closed_form.shape import Box
from tests.support.closed_paths import gain_per_loop
from tests.support.grasps import ON_A_LINE, RIGID, grasped, law
from tests.support.pushed_grasps import KINDS, depth, push, random_grasp, wrench_rows

# Scaling ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_scaling_keeps_cones_limits_and_the_wrench(kind: str) -> None:
    """4200 random states each, 25 200 in all: limits, cones and the direction of the wrench to 4e-15 of the forces.

    No finger pulls, a free one stays free, and the whole wrench is there wherever the fingers can hold it.
    """
    dimensions, rules = KINDS[kind]
    rng = np.random.default_rng(sum(map(ord, kind)))
    kernel = compiled(scale)
    whole = less = 0
    worst = np.zeros(3)
    for _ in range(210):
        g = random_grasp(rng, int(rng.integers(1, 6)), int(rng.choice(dimensions)), rules)
        limits = g.limit
        assert limits is not None
        G = wrench_rows(g, rules)
        for _ in range(20):
            push(rng, g, rules)
            before = g.array(FingerState.local).copy()
            kernel(g.block, 0, False)
            f = g.array(FingerState.local)
            size = np.linalg.norm(before[:, :3], axis=1)
            if (size <= limits * (1.0 - 1e-13)).all():
                assert np.array_equal(f, before)
                continue
            scale_of = float(np.abs(before).max())
            over = float((np.linalg.norm(f[:, :3], axis=1) / limits).max() - 1.0)
            w, w0 = G @ f.ravel(), G @ before.ravel()
            alpha = float(w @ w0 / (w0 @ w0)) if len(w0) and w0 @ w0 > 0.0 else 1.0
            turned = float(np.abs(w - alpha * w0).max(initial=0.0)) / scale_of
            worst = np.maximum(worst, [over, turned, -depth(g, rules, f) / scale_of])
            assert 0.0 <= alpha <= 1.0 + 1e-13
            assert not f[size == 0.0].any()
            whole, less = whole + (alpha > 1.0 - 1e-13), less + (alpha <= 1.0 - 1e-13)
    assert worst.max() <= 4e-15
    assert less > 500 and whole > 30


def test_scaling_gives_up_squeezing_first() -> None:
    """Two fingers on a line at 1.5 N and 0.6 N, at most 1 N: 1.0 and 0.1 N move the object with the same 0.9 N."""
    g = grasped(2, 1, law(40.0, 160.0), Rules(stick=True), shape=Box((0.05,)), limit=1.0, **ON_A_LINE)
    g.array(FingerState.normal)[:, 0] = 1.0, -1.0
    g.touching[:] = 1.0
    g.array(FingerState.local)[:, 0] = 1.5, -0.6
    scale(g.state, False)
    np.testing.assert_allclose(g.array(FingerState.local)[:, 0], [1.0, -0.1], rtol=0.0, atol=1e-13)
    g.array(FingerState.local)[:, 0] = 1.5, -0.1  # 1.4 N of wrench exceeds one finger: the other stops pushing first
    scale(g.state, False)
    np.testing.assert_allclose(g.array(FingerState.local)[:, 0], [1.0, 0.0], rtol=0.0, atol=1e-13)


# Inside the projection --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rules", [Rules(friction=3.0, fade=None), Rules(stick=True, fade=None)], ids=["mu", "stick"])
@pytest.mark.parametrize(("kep", "kip"), [(40.0, 160.0), (90.0, 90.0)])
def test_fingers_that_stick_at_their_limits_make_no_energy(kep: float, kip: float, rules: Rules) -> None:
    """Four fingers 8 mm in a box that moves, at 0.15 N nearly always: 2e-6 of the peak, and 64 times that at 256 steps.

    The limit slips, the contacts do not: they stick where they touched.
    """
    start = 0.022 * np.array([[1.0, 0.1, 0.2], [-1.0, 0.2, -0.1], [0.1, 1.0, 0.1], [-0.2, -1.0, 0.1]])
    g = grasped(4, 3, law(kep, kip), rules, shape=Box((0.06,) * 3), limit=0.15)
    g.meet(1.5 * start)
    run, shares, sticks = program(sample, g), [], []

    def ask(g: GraspedObject) -> int:
        fault = run()
        shares.append(g.array(FingerState.saturated).mean())
        sticks.append(((g.array(FingerState.status) == STICK) | rules.stick).all() and g.touching.all())
        return fault

    for share in np.linspace(1.5, 1.0, 50):
        g.finger_position[:] = share * start
        assert run() == 0
    assert abs(gain_per_loop(g, start, 0, steps=2048, ask=ask)) < 2e-6
    assert np.mean(shares) > 0.9
    assert all(sticks)


def program(kernel: Any, g: GraspedObject) -> Callable[[], int]:
    """A kernel compiled for one object."""
    made = Program()
    made.add_text("def run():\n    return kernel(MEM, 0)", {"kernel": kernel}, ["MEM"])
    run: Callable[[], int] = machine_code(made.source()).bind(g.block).brief
    return run


@pytest.mark.parametrize(("kep", "kip"), [(40.0, 160.0), (160.0, 40.0), (90.0, 90.0)])
def test_saturated_closed_motions_make_no_energy(kep: float, kip: float) -> None:
    """Object and four fingers in space, at their limits in most samples: 1e-5 of the peak, the integration's error.

    It falls with the square of the step: at 256 steps it is 3e-4. Where gains are unequal, a clamp of each finished
    force, which the object receives too, leaves more than 1e-2.
    """
    limit, cut, count = 0.08, 0, 0
    start = np.random.default_rng(3).uniform(-0.03, 0.03, (4, 3))
    g, free = (grasped(4, 3, law(kep, kip), RIGID, contacts=start, limit=most) for most in (limit, None))
    run, run_free, again = program(sample, g), program(sample, free), program(react, free)

    def inside(g: GraspedObject) -> int:
        nonlocal cut, count
        fault = run()
        cut, count = cut + int(g.array(FingerState.saturated).sum()), count + 4
        return fault

    def clamp(g: GraspedObject) -> int:
        run_free()
        f = g.array(FingerState.local)[:, :3]
        f *= np.minimum(1.0, limit / np.linalg.norm(f, axis=1).clip(1e-300))[:, None]
        return again()

    assert max(abs(gain_per_loop(g, start, seed, steps=2048, ask=inside)) for seed in range(2)) < 1e-5
    assert cut > 0.5 * count
    if kep != kip:
        assert abs(gain_per_loop(free, start, 0, ask=clamp)) > 1e-2
