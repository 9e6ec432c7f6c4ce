"""Kernels of the coupling as they are written, run by Python itself, give the bits of the lowered ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.compile.kernel import written
from graspfx.compile.records import numbers
from graspfx.coupling import contact_frames, sample
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.rules import Rules
from graspfx.objects.body import NativeBody
from graspfx.surfaces.closed_form.shape import Box, Sphere
from tests.support.grasps import INERTIA, ON_A_LINE, grasped, law
from tests.support.written import plain_python


def matrix(rng: np.random.Generator, size: int, low: float) -> np.ndarray:
    A = rng.normal(size=(size, size))
    return low * (0.5 * np.eye(size) + 0.5 * A @ A.T / size)


def coupling(rng: np.random.Generator, kind: str, n: int, d: int) -> gx.Coupling:
    if kind == "equal":
        return law(90.0, 90.0, 0.4, 0.4)
    if kind == "numbers":
        return law(*rng.permutation([40.0, 160.0]), *rng.choice([0.0, 0.3, 0.6], 2))
    form = "symmetric" if kind == "symmetric" else "literal"
    K, D = matrix(rng, d, 160.0), 0.3 if kind == "literal" else matrix(rng, n * d, 0.3)
    return law(matrix(rng, n * d, 40.0), K, D, 0.0, form)


CASES: dict[str, dict[str, Any]] = {
    "attached": {"attached": True},
    "free": {},
    "stick": {"stick": True},
    "rough": {"friction": 0.6},
    "rough, at the contact": {"friction": 0.6, "at_contact": True},
    "gradual": {"friction": 0.4, "damping_depth": 0.002},
    "frictionless, gradual": {"damping_depth": 0.002},
    "soft": {"friction": 0.6, "patch": 0.006},
    "soft, sticking": {"stick": True, "patch": 0.006},
}


def random_grasp(rng: np.random.Generator, case: str, kind: str) -> GraspedObject | None:
    """An object with fingers in any dimensions; None where a soft finger cannot be."""
    n, d = int(rng.integers(1, 5)), int(rng.integers(1, 4))
    settings = dict(CASES[case])
    if "patch" in settings:
        d = 3
        if kind in ("literal", "symmetric"):
            return None
    free = [True] * d + (rng.random({1: 0, 2: 1, 3: 3}[d]) < 0.7).tolist()
    integrator = str(rng.choice(["exact", "implicit"]))

    rules = Rules(fade=(0.002, 0.01) if rng.random() < 0.7 else None, axes=rng.choice(["object", "world"]), **settings)
    shape: Any = Box((0.05,) * d) if rng.random() < 0.6 else Sphere(0.03)
    limit = rng.uniform(0.2, 3.0, n) if rng.random() < 0.5 else None
    return grasped(
        n, d, coupling(rng, kind, n, d), rules, period=0.002, shape=shape, limit=limit, inertia=INERTIA[d],
        rotational_viscosity=0.0, free=free, integrator=integrator,
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", ["equal", "numbers", "literal", "symmetric"])
@pytest.mark.parametrize("case", CASES)
def test_samples(case: str, kind: str, seed: int) -> None:
    """Three samples of a motion into the object, with its energies watched or not: every entry of the block."""
    rng = np.random.default_rng([seed, *map(ord, case + kind)])
    g = random_grasp(rng, case, kind)
    if g is None:
        return
    n, d = g.fingers, g.dimensions
    out = rng.normal(size=(n, d))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    g.state.observed = bool(rng.random() < 0.5)
    g.meet(0.05 * out)
    if CASES[case].get("attached"):
        g.attach(0.025 * out)
    body = NativeBody(g.body_state)
    for depth in (0.032, 0.025, 0.02):
        g.finger_position[:] = depth * out + rng.normal(size=(n, d)) * 0.002
        g.finger_velocity[:] = rng.normal(size=(n, d)) * 0.1
        if g.implicit:
            body.free_motion(0.002)
        plain = GraspState(memoryview(g.block.copy()))
        with plain_python():
            fault = written(sample.sample)(plain)
        assert fault == g.sample()
        assert bytes(plain.buffer) == g.block.tobytes()


def test_limits_after_a_brake() -> None:
    """Forces that were added to after the limits: scaled again, with the law's own beside them."""
    from graspfx.coupling import limit

    rng = np.random.default_rng(1)
    for friction in (0.0, 0.6):
        gains, rules = law(40.0, 160.0, 0.1, 0.3), Rules(friction=friction)
        g = grasped(3, 3, gains, rules, period=0.002, shape=Box((0.05,) * 3), limit=0.3)
        g.meet(0.04 * np.eye(3))
        g.finger_position[:] = 0.02 * np.eye(3) + rng.normal(size=(3, 3)) * 0.001
        assert g.sample() == 0
        g.array(FingerState.local)[:, :3] += rng.normal(size=(3, 3)) * 0.2
        plain = GraspState(memoryview(g.block.copy()))
        limit.limit_again(GraspState(memoryview(g.block)))
        with plain_python():
            written(limit.limit_again)(plain)
        assert bytes(plain.buffer) == g.block.tobytes()


@pytest.mark.parametrize("d", [1, 2, 3])
def test_frames_there_and_back(d: int) -> None:
    """A vector in a contact's frame and back again is itself to rounding."""
    rng = np.random.default_rng(d)
    free = [True] * d + [False] * (0, 1, 3)[d - 1]
    g = grasped(1, d, law(40.0, 160.0), Rules(), shape=Sphere(0.03), free=free, **ON_A_LINE)
    for _ in range(50):
        out = rng.normal(size=(1, d))
        g.meet(0.04 * out / np.linalg.norm(out))
        g.array(FingerState.local)[0, :d] = rng.normal(size=d)
        finger = g.state.fingers[0]
        there = contact_frames.in_frame(g.state, finger, finger.local)
        back = contact_frames.out_of_frame(g.state, finger, there)
        np.testing.assert_allclose(list(numbers(back)), list(numbers(finger.local)), rtol=0.0, atol=1e-15 * 4)
