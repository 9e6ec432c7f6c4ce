"""The implicit sample in the modes' unknowns: the answers of the square system and of other programs, for all n."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import nnls

import graspfx as gx
from graspfx.compile.kernel import source_function
from graspfx.cones.friction import UNRESOLVED
from graspfx.coupling import coulomb, frictionless
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.rules import Rules
from graspfx.coupling.sample import sample
from graspfx.objects.body import NativeBody
from graspfx.surfaces.closed_form.shape import Box, Sphere
from tests.support.grasps import INERTIA, grasped, law, respond

CASES: dict[str, dict[str, Any]] = {
    "attached": {"attached": True},
    "frictionless": {},
    "frictionless, at the contact": {"at_contact": True},
    "frictionless, gradual": {"damping_depth": 0.002},
    "stick": {"stick": True},
    "stick, gradual": {"stick": True, "damping_depth": 0.002},
    "rough": {"friction": 0.6},
    "rough, at the contact": {"friction": 0.6, "at_contact": True},
    "rough, gradual": {"friction": 0.4, "damping_depth": 0.002},
    "rough, gradual, at the contact": {"friction": 0.4, "damping_depth": 0.002, "at_contact": True},
    "soft": {"friction": 0.6, "patch": 0.006},
    "soft, at the contact": {"friction": 0.6, "patch": 0.006, "at_contact": True},
    "soft, gradual": {"friction": 0.6, "patch": 0.006, "damping_depth": 0.002},
    "soft, sticking": {"stick": True, "patch": 0.006},
    "padded": {"friction": 0.6, "pad": 1e5},
}
GAINS = {  # kep, kip, ked, kid
    "equal": (100.0, 100.0, 0.4, 0.4),
    "kep < kip": (40.0, 160.0, 0.2, 0.6),
    "kep > kip": (160.0, 40.0, 0.6, 0.2),
    "mixed": (160.0, 40.0, 0.2, 0.6),
    "ked = 0": (40.0, 160.0, 0.0, 0.6),
    "kid = 0": (57.0, 54.0, 1.92, 0.0),
    "no damping": (40.0, 160.0, 0.0, 0.0),
}


def random_grasp(rng: np.random.Generator, case: str, gains: str, most: int) -> GraspedObject:
    n, d = int(rng.integers(1, most + 1)), 3 if "patch" in CASES[case] else int(rng.integers(1, 4))
    free = [True] * d + [True] * (0, 1, 3)[d - 1]
    if rng.random() < 0.4:
        free = (rng.random(len(free)) < 0.7).tolist()
    mass = float(10.0 ** rng.uniform(-2.5, 0.0))

    kep, kip, ked, kid = GAINS[gains] if "pad" not in CASES[case] else (*GAINS[gains][:2], 0.0, 0.0)
    rules = Rules(fade=(0.002, 0.01) if rng.random() < 0.7 else None, **CASES[case])
    shape: Any = Box((0.05,) * d) if rng.random() < 0.6 else Sphere(0.03)
    return grasped(
        n, d, law(kep, kip, ked, kid), rules, period=10.0 ** rng.uniform(-3.3, -2.0), shape=shape, mass=mass,
        inertia=INERTIA[d], rotational_viscosity=0.0, free=free, integrator="implicit", viscosity=0.5,
    )  # fmt: skip


def square_sample(g: GraspedObject) -> tuple[int, GraspState]:
    """Sample a copy of the block by the square, as matrices take it, from no start; give the fault and the copy."""
    state = GraspState(np.array(g.block))
    state.recoils = state.rays = False
    if state.problem.offset != state.damping_problem.offset:
        for problem in (state.problem, state.damping_problem):
            problem.flexible = False
            problem.started = 0
            for unknown in problem.unknowns:
                unknown.value = 0.0
    return sample(GraspState(memoryview(state.buffer))), state


@pytest.mark.parametrize("gains", GAINS)
@pytest.mark.parametrize("case", CASES)
def test_forces_are_those_of_the_square(case: str, gains: str) -> None:
    """Fingers that touch, that hover and that slip, objects light or heavy: 1e-12 of the largest force, 1e-9 with a
    damping of zero beside another one."""
    rng = np.random.default_rng([*map(ord, case + gains)])
    count = 0
    for k in (0, 1, 5):
        g = random_grasp(rng, case, gains, 5 if k < 5 else 12)
        n, d = g.fingers, g.dimensions
        out = rng.normal(size=(n, d))
        if k == 1 and d > 1:
            out[:, 1:] = 1e-9 * out[:, 1:] + 0.1
        out /= np.linalg.norm(out, axis=1, keepdims=True)
        g.meet(0.05 * out)
        if CASES[case].get("attached"):
            g.attach(0.025 * out)
        body = NativeBody(g.body_state)
        for depth in (0.032, 0.025, 0.02, 0.027):
            g.finger_position[:] = depth * out + rng.normal(size=(n, d)) * 0.002
            g.finger_velocity[:] = rng.normal(size=(n, d)) * 0.1
            body.free_motion(g.state.period)
            fault, state = square_sample(g)
            assert g.sample() == fault == 0
            if "friction" in CASES[case] and state.law != g.state.law:
                continue  # Coulomb's law was found by one of them alone
            f, expected = g.array(FingerState.local), state.fingers.array(FingerState.local)
            near = 1e-9 if gains.endswith("= 0") else 1e-12  # what frees a motion only just has its digits alone
            np.testing.assert_allclose(f, expected, rtol=0.0, atol=near * max(np.abs(expected).max(), 1e-300))
            np.testing.assert_array_equal(g.touching, state.fingers.array(FingerState.touching))
            count += bool(np.abs(expected).max() > 0.0)
    assert count >= 4


@pytest.mark.parametrize("n", [2, 5, 10, 20])
@pytest.mark.parametrize(("kep", "kip"), [(40.0, 160.0), (160.0, 40.0), (90.0, 90.0)])
def test_many_normals_against_scipy(n: int, kep: float, kip: float) -> None:
    """min 1/2 f'(K^-1 + G'CG) f - f'e over the normals f_n >= 0, by nnls of the analysis' matrices in space."""
    T, m, b = 0.005, 0.1, 1e-4
    rng = np.random.default_rng(n)
    for _ in range(5):
        p = rng.normal(size=(n, 3))
        p *= (0.03 + rng.normal(size=(n, 1)) * 0.003) / np.linalg.norm(p, axis=1, keepdims=True)
        gains, rules = law(kep, kip), Rules(fade=None, blend=(1e-9, 2e-9))
        g = grasped(n, 3, gains, rules, shape=Sphere(0.03), integrator="implicit", inertia=INERTIA[3])
        NativeBody(g.body_state).free_motion(T)
        f = respond(g, p)
        c, inward = g.contact_position, g.inward()
        K = gains.stiffness(gx.Grasp(c).split(tolerance=1e-12))
        give = np.diag([T * T / m] * 3 + [T * T / (j + T * b) for j in (1e-5, 2e-5, 3e-5)])
        G = gx.grasp_matrix(c)
        N = np.zeros((3 * n, n))
        for i in range(n):
            N[3 * i : 3 * i + 3, i] = inward[i]
        M = N.T @ (np.linalg.inv(K) + G.T @ give @ G) @ N
        L = np.linalg.cholesky(0.5 * (M + M.T))
        normal, _ = nnls(L.T, np.linalg.solve(L, N.T @ (p - c).ravel()))
        np.testing.assert_allclose(f.ravel(), N @ normal, rtol=0.0, atol=1e-12 * normal.max())


@pytest.mark.parametrize("friction", [0.0, 0.2])
def test_where_the_modes_do_not_settle_the_square_is_asked(friction: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """A search that gives up in the modes' unknowns leaves the forces of the square, not zero and not its own."""
    rng = np.random.default_rng(4)

    rules, gains = Rules(friction=friction, fade=None), law(160.0, 40.0, 0.6, 0.2)
    p, v = rng.normal(size=(4, 3)), 0.1 * rng.normal(size=(4, 3))
    p *= 0.028 / np.linalg.norm(p, axis=1, keepdims=True)

    def forces() -> np.ndarray:
        g = grasped(4, 3, gains, rules, shape=Sphere(0.03), integrator="implicit", inertia=INERTIA[3])
        NativeBody(g.body_state).free_motion(0.005)
        respond(g, p)
        return respond(g, p + shear, v)  # most fingers slip

    shear = 0.003 * rng.normal(size=(4, 3))
    expected = forces()
    calls = []

    def lost(*arguments: Any) -> tuple[int, float, int]:
        calls.append(arguments)
        return UNRESOLVED, 0.0, 100

    kernels: list[Any] = [coulomb.force_of_recoil, frictionless.force_along_normals]
    for kernel in kernels:
        monkeypatch.setitem(source_function(kernel).__globals__, "friction_force_flexible_k", lost)
    kernels = [coulomb.damping_of_recoil, frictionless.frictionless_force]
    for kernel in kernels:
        monkeypatch.setitem(source_function(kernel).__globals__, "damping_in_columns_k", lambda *_: UNRESOLVED)
    np.testing.assert_allclose(forces(), expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())
    assert calls and expected.any()


def test_a_gain_of_damping_that_is_zero_is_the_limit_of_small_ones() -> None:
    """kid = 0, two of four fingers touch: the forces are those of kid = 1e-6 ked to 1e-5, and all is finite."""
    rng = np.random.default_rng(6)
    p, v = np.array([[-0.024, 0.0], [0.024, 0.004], [0.0, 0.05], [0.01, -0.06]]), 0.1 * rng.normal(size=(4, 2))
    for ked, kid in ((0.5, 0.0), (0.0, 0.5)):
        forces = []
        for low in (0.0, 1e-6 * 0.5):
            gains = law(40.0, 160.0, max(ked, low), max(kid, low))
            g = grasped(4, 2, gains, Rules(friction=0.5, fade=None), shape=Box((0.05, 0.05)), integrator="implicit")
            NativeBody(g.body_state).free_motion(0.005)
            forces.append(respond(g, p, v))
        np.testing.assert_allclose(forces[0], forces[1], rtol=0.0, atol=1e-5 * np.abs(forces[1]).max())
        assert forces[1].any()


def test_room_is_linear_in_the_fingers_but_for_the_square() -> None:
    """The recoil's own entries do not depend on n."""
    sizes = []
    for n in (2, 20):
        g = grasped(n, 3, law(40.0, 160.0), Rules(), shape=Sphere(0.03), integrator="implicit", inertia=INERTIA[3])
        sizes.append(GraspState(g.block).recoil_entries)
    assert sizes[0] == sizes[1]
