"""Cones cut off at a limit: the answer's own conditions, with compliances too; no change where nothing is cut."""

from __future__ import annotations

import numpy as np
import pytest

from graspfx.compile.machine import compiled
from graspfx.cones.cone import HALF_SPACE, NO_CONE
from graspfx.cones.friction import (
    ASSOCIATED,
    COULOMB,
    RESTARTS,
    UNRESOLVED,
    friction_force,
)
from graspfx.cones.problem import ConeContact, Gains, ModePart, Unknown, problem_size, set_up
from tests.support.cone_problems import Problem

RATIOS = [0.01, 0.1, 2.0, 100.0]  # kip/kep


def return_map(t: np.ndarray, mu: float, limit: float, theta: float) -> tuple[np.ndarray, np.ndarray]:
    """The force of a trial force in its cone, and the one that the limit leaves of it."""
    y = t.copy()
    if mu == HALF_SPACE:
        y[0] = max(t[0], 0.0)
    elif mu >= 0.0:
        length = np.linalg.norm(t[1:])
        if t[0] + theta * mu * length <= 0.0:
            y[:] = 0.0
        elif length > mu * t[0]:
            y[0] = (t[0] + theta * mu * length) / (1.0 + theta * mu**2)
            y[1:] = mu * y[0] * t[1:] / length if length > 0.0 else 0.0
    counted = y[:3] if mu < 0.0 else y
    size = np.linalg.norm(counted)
    cut = y.copy()
    if size > limit:
        cut[: len(counted)] *= limit / size
    return y, cut


def violation(problem: Problem, f: np.ndarray, K: np.ndarray, c: float, limits: np.ndarray, law: int) -> float:
    """max |f - R(f - c s)|, s = K^-1 f - e, of the cut return map [N], in the scale of equal weights."""
    s = np.linalg.solve(K, f) - problem.e
    worst = 0.0
    for i in range(problem.n):
        mine = slice(i * problem.d, (i + 1) * problem.d)
        w = problem.root[i * problem.d] ** 2
        _, cut = return_map(f[mine] - c * w * s[mine], problem.mu[i], limits[i], float(law == ASSOCIATED))
        worst = max(worst, float(np.abs(f[mine] - cut).max()))
    return worst


def random_problem(rng: np.random.Generator, ratio: float, mu: float) -> tuple[Problem, np.ndarray]:
    """A random problem of two to six fingers with unequal weights, and limits that cut about half of the forces."""
    n, d = int(rng.integers(2, 7)), int(rng.integers(1, 4))
    problem = Problem(rng, n, d, ratio, mu, rng.uniform(0.5, 2.0, n))
    return problem, limit(problem, rng)


def limit(problem: Problem, rng: np.random.Generator) -> np.ndarray:
    """Adds limits to a problem, of the size of the forces that it has without any."""
    assert answer(problem, False, cut=False) == ASSOCIATED or problem.mu[0] < 0.0
    longest = np.abs(problem.force).max() if problem.mu[0] >= 0.0 else np.abs(problem.K @ problem.e).max()
    limits = max(longest, 1e-3 * problem.size) * rng.uniform(0.1, 1.0, problem.n)
    set_limits(problem, limits)
    problem.unknowns[:] = 0.0
    return limits


def set_limits(problem: Problem, limits: np.ndarray) -> None:
    problem.cones.contacts.array(ConeContact.limit)[:] = limits


def answer(problem: Problem, coulomb: bool, *, cut: bool = True) -> int:
    problem.cones.limited = cut
    law, _, _ = compiled(friction_force)(
        problem.block, 0, problem.d, problem.external, problem.internal, coulomb, RESTARTS
    )
    return int(law)


@pytest.mark.parametrize("mu", [NO_CONE, HALF_SPACE, 0.0, 0.5, 1.5])
@pytest.mark.parametrize("ratio", RATIOS)
def test_the_force_is_the_nearest_one_in_the_cut_cones(ratio: float, mu: float) -> None:
    """f = R(f - c s) to 1e-12 of the largest force per ratio of gains, either law; limits are kept to rounding."""
    rng = np.random.default_rng(int(100 * ratio + 10 * mu) + 50)
    hits = 0
    for _ in range(40):
        problem, limits = random_problem(rng, ratio, mu)
        for coulomb in (False, True):
            law = answer(problem, coulomb)
            assert law in (ASSOCIATED, COULOMB)
            size = np.linalg.norm(problem.force.reshape(problem.n, -1)[:, :3], axis=1)
            assert (size <= limits * (1.0 + 4e-16)).all()
            hits += int((size >= limits * (1.0 - 1e-12)).sum())
            scale = 1e-12 * max(ratio, 1.0 / ratio) * problem.size
            assert violation(problem, problem.force.copy(), problem.K, problem.internal, limits, law) <= scale
    assert hits > 40


@pytest.mark.parametrize("mu", [NO_CONE, HALF_SPACE, 0.0, 0.5])
def test_a_square_gives_the_same_as_the_modes(mu: float) -> None:
    """1e-11 of the largest force, by the associated law, which has one answer."""
    rng = np.random.default_rng(7)
    for _ in range(40):
        problem, limits = random_problem(rng, 2.5, mu)
        problem.root = np.ones(problem.m)
        problem.pose()
        set_limits(problem, limits)
        assert answer(problem, False) == ASSOCIATED
        law, force = problem.solve_square(False)
        assert law == ASSOCIATED
        np.testing.assert_allclose(force, problem.force, rtol=0.0, atol=1e-11 * problem.size)


@pytest.mark.parametrize("mu", [0.3, 1.5])
@pytest.mark.parametrize("coulomb", [False, True])
def test_torsion_of_soft_fingers_is_cut_with_the_force(mu: float, coulomb: bool) -> None:
    """Four coordinates a finger, 60 problems: |(f, tau/rho)| within the limit, and the return map's conditions."""
    rng = np.random.default_rng(11)
    for _ in range(60):
        problem = Problem(rng, 4, 3, 3.0, mu)
        n, d, m = 4, 4, 16
        problem.n, problem.d, problem.m, problem.root = n, d, m, np.ones(m)
        problem.Q = np.linalg.qr(rng.normal(size=(m, 6)))[0]
        problem.e = rng.normal(size=m) * 0.01
        problem.pose()
        limits = limit(problem, rng)
        law = answer(problem, coulomb)
        assert law != UNRESOLVED
        assert (np.linalg.norm(problem.force.reshape(n, d), axis=1) <= limits * (1.0 + 4e-16)).all()
        f = problem.force.copy()
        assert violation(problem, f, problem.K, problem.internal, limits, law) <= 1e-11 * problem.size


@pytest.mark.parametrize("coulomb", [False, True])
def test_limits_that_do_not_bite_leave_every_bit(coulomb: bool) -> None:
    """Infinite limits, 100 problems: force, slip and unknowns are those without."""
    rng = np.random.default_rng(3)
    for _ in range(100):
        problem, _ = random_problem(rng, float(rng.choice(RATIOS)), float(rng.choice([0.0, 0.5, 1.5])))
        set_limits(problem, np.full(problem.n, np.inf))
        start = problem.block.copy()
        assert answer(problem, coulomb, cut=False) != UNRESOLVED
        whole = problem.block.copy()
        problem.block[:] = start
        answer(problem, coulomb)
        problem.cones.limited = False
        assert np.array_equal(problem.block, whole)


@pytest.mark.parametrize("ratio", [0.1, 10.0])
@pytest.mark.parametrize("mu", [NO_CONE, HALF_SPACE, 0.0, 0.5])
def test_the_cut_force_is_a_gradient(mu: float, ratio: float) -> None:
    """Around 3 random triangles of displacements: 1e-6 of a side's work, the integration's error at 2000 steps.

    Clamping the finished force leaves 4 to 30 %: that is no gradient.
    """
    rng = np.random.default_rng(23)
    nodes, weights = np.polynomial.legendre.leggauss(2)

    def round_trip(problem: Problem, limits: np.ndarray, corners: np.ndarray, *, cut: bool) -> float:
        total = scale = 0.0
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            along = 0.0
            for k in range(2000):
                for node, weight in zip(nodes, weights, strict=True):
                    here = a + (k + 0.5 + 0.5 * node) / 2000 * (b - a)
                    problem.displacement[:] = here.reshape(problem.n, problem.d)
                    assert answer(problem, False, cut=cut) == ASSOCIATED
                    f = problem.force.reshape(problem.n, -1).copy()
                    if not cut:
                        f *= np.minimum(1.0, limits / np.linalg.norm(f, axis=1).clip(1e-300))[:, None]
                    along += 0.5 * weight / 2000 * float(f.ravel() @ (b - a))
            total += along
            scale = max(scale, abs(along))
        return abs(total) / scale

    left, clamped = [], []
    for _ in range(3):
        problem = Problem(rng, 3, 2, ratio, mu)
        limits = np.full(3, 0.3 * np.abs(problem.K @ problem.e).max())
        set_limits(problem, limits)
        corners = 0.01 * rng.normal(size=(3, problem.m))
        left.append(round_trip(problem, limits, corners, cut=True))
        if mu >= 0.0:
            clamped.append(round_trip(problem, limits, corners, cut=False))
    assert max(left) < 1e-6
    assert not clamped or max(clamped) > 1e-2


def test_the_force_is_the_nearest_one_in_the_cut_cones_with_compliances_in_series() -> None:
    """300 problems: f_i is nearest to f_i + x_i, x = e - (K^-1 + C)(f - f0) by numpy, to 1e-12."""
    rng = np.random.default_rng(0)
    cuts = 0
    for k in range(300):
        n, d = int(rng.integers(1, 6)), int(rng.integers(1, 4))
        m, mu = n * d, float(rng.choice([0.3, 0.6, 1.2]))
        external, internal = [(0.5, 2.0), (2.0, 0.5), (1.0, 1.0)][k % 3]
        count = int(rng.integers(1, min(6, m) + 1))
        Q = np.linalg.qr(rng.normal(size=(m, count)))[0]
        w, e = rng.uniform(0.4, 2.0, n), rng.normal(size=m) * 0.3
        C = np.where(rng.random(n) < 0.5, 0.0, 10.0 ** rng.uniform(-2.0, 2.0, n))
        limits = rng.uniform(0.1, 1.0, n)
        f0 = np.zeros((n, d))
        f0[:, 0] = rng.uniform(0.0, 1.0, n)
        if d > 1:
            side = rng.normal(size=(n, d - 1))
            f0[:, 1:] = side * (rng.random(n) * mu * f0[:, 0] / np.linalg.norm(side, axis=1))[:, None]
        f0 *= np.minimum(1.0, 0.99 * limits / np.linalg.norm(f0, axis=1))[:, None]
        problem = set_up(memoryview(np.zeros(problem_size(n))), 0, n)
        problem.limited = problem.compliant = True
        problem.modes = count
        contacts = problem.contacts
        contacts.array(ConeContact.weight)[:], contacts.array(ConeContact.coefficient)[:] = w, mu
        contacts.array(ConeContact.limit)[:], contacts.array(ConeContact.compliance)[:] = limits, C
        contacts.array(ConeContact.displacement)[:, :d] = e.reshape(n, d)
        contacts.array(ConeContact.base_force)[:, :d] = f0
        problem.unknowns.array(Unknown.share)[:count] = 1.0
        for i in range(n):
            contacts[i].modes.array(ModePart.motion)[:count, :d] = Q[i * d : i * d + d].T
        assert friction_force(problem, d, Gains(external, internal), False, 0).law == ASSOCIATED
        f = contacts.array(ConeContact.force)[:, :d].ravel()
        root = np.sqrt(np.repeat(w, d))
        K = root[:, None] * (internal * np.eye(m) + (external - internal) * Q @ Q.T) * root
        x = e - (np.linalg.inv(K) + np.diag(np.repeat(C / w, d))) @ (f - f0.ravel())
        for i in range(n):
            own = slice(i * d, i * d + d)
            _, expected = return_map(f[own] + x[own], mu, limits[i], 1.0)
            np.testing.assert_allclose(f[own], expected, rtol=0.0, atol=1e-12 * (1.0 + np.abs(x[own]).max()))
            cuts += bool(np.linalg.norm(f[own]) > 0.999999 * limits[i])
    assert cuts > 100
