"""Friction cones: conditions in 50 digits, a conic solver, closed forms, passivity, and no failure that is not said."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

import graspfx as gx
from graspfx.compile.records import Many, Table
from graspfx.cones.friction import (
    ASSOCIATED,
    COULOMB,
    UNRESOLVED,
    turn_modes,
)
from graspfx.cones.problem import Answer, ConeContact, ModePart, Unknown, problem_size, set_up
from graspfx.spatial import Matrix
from tests.support.cone_problems import DEEP, Problem

RATIOS = [0.01, 0.1, 2.0, 100.0, 1000.0]  # kip/kep; the geometric mean is 100 N/m


def random_problem(rng: np.random.Generator, ratio: float, largest: int) -> Problem:
    n, d = int(rng.integers(1, largest + 1)), int(rng.integers(1, 4))
    return Problem(rng, n, d, ratio, float(rng.choice([0.1, 0.5, 1.5])))


def violation(problem: Problem, f: np.ndarray, law: int) -> float:
    """max |f - R(f - kip s)|, s = K^-1 f - e, in 50 digits: zero where f fulfils the law [N]."""
    with mpmath.workdps(50):
        Q, kep, kip = mpmath.matrix(problem.Q.tolist()), mpmath.mpf(problem.external), mpmath.mpf(problem.internal)
        K = kip * mpmath.eye(problem.m) + (kep - kip) * Q * Q.T
        s = mpmath.lu_solve(K, mpmath.matrix(f.tolist())) - mpmath.matrix(problem.e.tolist())
        theta = 1 if law == ASSOCIATED else 0
        worst = mpmath.mpf(0)
        for i in range(problem.n):
            mine = range(i * problem.d, (i + 1) * problem.d)
            t = [mpmath.mpf(float(f[p])) - kip * s[p] for p in mine]
            mu, length = mpmath.mpf(float(problem.mu[i])), mpmath.norm(t[1:]) if problem.d > 1 else mpmath.mpf(0)
            if t[0] + theta * mu * length <= 0:
                y = [mpmath.mpf(0)] * problem.d
            elif length <= mu * t[0]:
                y = t
            else:
                normal = (t[0] + theta * mu * length) / (1 + theta * mu**2)
                y = [normal] + [mu * normal * x / length for x in t[1:]]
            worst = max(worst, *(abs(mpmath.mpf(float(f[p])) - x) for p, x in zip(mine, y, strict=True)))
        return float(worst)


@pytest.mark.parametrize("ratio", RATIOS)
def test_conditions_hold_in_fifty_digits(ratio: float) -> None:
    """1e-13 x max(kip/kep, kep/kip) of the largest gain times the largest displacement, either law."""
    rng = np.random.default_rng(int(100 * ratio))
    for _ in range(25):
        problem = random_problem(rng, ratio, 5)
        for coulomb in (False, True):
            answer = problem.solve(coulomb)
            assert answer.law != UNRESOLVED
            assert violation(problem, problem.force, answer.law) <= 1e-13 * max(ratio, 1.0 / ratio) * problem.size
            assert answer.residual <= 1e-13 * max(ratio, 1.0 / ratio) * problem.size


@pytest.mark.parametrize("zero", ["external", "internal"])
@pytest.mark.parametrize("mu", [0.0, 0.5])
@pytest.mark.parametrize("compliant", [False, True])
def test_a_gain_of_zero_is_zero(zero: str, mu: float, compliant: bool) -> None:
    """f = f0 + (K^+ + C)^-1 (e + s) of the K that has a zero, f in the cones and s in their duals, f's = 0."""
    rng = np.random.default_rng(11)
    for _ in range(25):
        n, d = int(rng.integers(1, 7)), int(rng.integers(1, 4))
        problem = Problem(rng, n, d, 1.0, mu, rng.uniform(0.3, 3.0, n))
        problem.external = 0.0 if zero == "external" else 50.0
        problem.internal = 0.0 if zero == "internal" else 50.0
        f0 = np.zeros((n, d))
        f0[:, 0] = rng.uniform(0.1, 1.0, n)
        problem.base_force[:] = f0
        C = rng.uniform(0.0, 0.05, n) if compliant else np.zeros(n)
        problem.cones.compliant = compliant
        problem.cones.contacts.array(ConeContact.compliance)[:] = C
        assert problem.solve(False).law == ASSOCIATED
        f, s, x = problem.force.reshape(n, d), problem.slip.reshape(n, d), problem.e
        series = problem.K @ np.linalg.inv(np.eye(n * d) + np.diag(np.repeat(C, d) / problem.root**2) @ problem.K)
        wrong = np.abs(f0.ravel() + series @ (x + problem.slip) - problem.force).max()
        assert wrong <= 1e-7 * problem.size
        np.testing.assert_allclose(problem.base_force, f0, rtol=0.0, atol=1e-14)
        np.testing.assert_allclose(problem.displacement.ravel(), x, rtol=0.0, atol=1e-14)
        assert (np.linalg.norm(f[:, 1:], axis=1) <= mu * f[:, 0] * (1 + 1e-15) + 1e-300).all()
        lost = np.abs(s).max() + DEEP
        assert (s[:, 0] >= mu * np.linalg.norm(s[:, 1:], axis=1) - 1e-7 * lost).all()
        assert abs((f * s).sum()) <= 1e-7 * problem.size * lost


@pytest.mark.parametrize("ratio", RATIOS)
def test_no_failure_is_silent(ratio: float) -> None:
    """Up to 20 fingers: the associated law always found; Coulomb's found or said otherwise, 1 in 20 at most."""
    rng = np.random.default_rng(int(100 * ratio) + 1)
    fallen_back = 0
    for k in range(120):
        problem = random_problem(rng, ratio, 20)
        answer = problem.solve(k % 2 == 0)
        law, residual = answer.law, answer.residual
        assert law in ((COULOMB, ASSOCIATED) if k % 2 == 0 else (ASSOCIATED,))
        fallen_back += k % 2 == 0 and law == ASSOCIATED
        f, s, d = problem.force.reshape(-1, problem.d), problem.slip, problem.d
        assert np.abs(problem.K @ (problem.e + s) - problem.force).max() <= residual + 1e-14 * 20 * problem.size
        assert (np.linalg.norm(f[:, 1:], axis=1) <= problem.mu * f[:, 0] * (1 + 1e-15) + 1e-300).all()
        sn, st = s.reshape(-1, d)[:, 0], np.linalg.norm(s.reshape(-1, d)[:, 1:], axis=1)
        edge = problem.mu * st if law == ASSOCIATED else 0.0
        assert (sn >= edge - 1e-12 * (st + DEEP)).all()
        assert np.abs(problem.force @ s) <= 1e-13 * problem.size * DEEP * max(ratio, 1) or law == COULOMB
        assert (f * s.reshape(-1, d)).sum() <= 1e-13 * problem.size * DEEP * max(ratio, 1)  # slipping only dissipates
    assert fallen_back <= 3


@pytest.mark.parametrize("ratio", [0.01, 1.0, 1000.0])
def test_associated_law_against_a_conic_solver(ratio: float) -> None:
    """min 1/2 f'K^-1 f - e'f over second-order cones by Clarabel: equal to its own tolerance."""
    clarabel = pytest.importorskip("clarabel")
    from scipy import sparse

    rng = np.random.default_rng(5)
    for _ in range(15):
        problem = Problem(
            rng, int(rng.integers(1, 9)), int(rng.integers(2, 4)), ratio, float(rng.choice([0.1, 0.5, 1.5]))
        )
        assert problem.solve(False).law == ASSOCIATED
        d, unit = problem.d, problem.size
        scale = np.ones(problem.m)
        scale[::d] = problem.mu
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
        solution = clarabel.DefaultSolver(
            sparse.csc_matrix(np.triu(np.linalg.inv(problem.K) * 100.0)),
            -problem.e / unit * 100.0,
            sparse.csc_matrix(-np.diag(scale)),
            np.zeros(problem.m),
            [clarabel.SecondOrderConeT(d)] * problem.n,
            settings,
        ).solve()
        np.testing.assert_allclose(problem.force / unit, solution.x, atol=1e-5)


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("coulomb", [False, True])
def test_without_friction_it_is_the_projection_on_the_normals(ratio: float, coulomb: bool) -> None:
    """mu = 0: the pivoted answer to 1e-15 x max(kip/kep, kep/kip), at least 1e-15 x 10, both laws."""
    rng = np.random.default_rng(int(100 * ratio) + 2)
    for _ in range(10):
        n, d = int(rng.integers(1, 7)), int(rng.integers(1, 4))
        problem = Problem(rng, n, d, ratio, 0.0)
        problem.solve(coulomb)
        normals = np.tile(np.eye(d)[0], (n, 1))
        expected = gx.unilateral_force(problem.K, problem.e, normals).force
        bound = 1e-15 * max(10.0, ratio, 1.0 / ratio) * problem.size
        np.testing.assert_allclose(problem.force, expected, rtol=0.0, atol=bound)
        assert not problem.force.reshape(n, d)[:, 1:].any()


def test_large_coefficient_holds() -> None:
    """Fingers that push are held as mu grows: f = K e, exactly no slip."""
    rng = np.random.default_rng(8)
    for _ in range(20):
        problem = Problem(rng, 4, 3, 4.0, 1e6)
        problem.displacement[:, 0] = 0.1
        problem.e = problem.displacement.ravel()
        held = problem.K @ problem.e
        if (held.reshape(-1, 3)[:, 0] <= 1e-5).any():
            continue
        assert problem.solve(True).law == COULOMB
        np.testing.assert_allclose(problem.force, held, rtol=1e-13, atol=1e-14)
        assert not problem.slip.any()
        assert problem.status.tolist() == [1.0] * 4


@pytest.mark.parametrize("coulomb", [False, True])
def test_warm_start_changes_nothing(coulomb: bool) -> None:
    """From the answer (in two evaluations at most), from nearby and from far away: the same force to 1e-13."""
    rng = np.random.default_rng(13)
    for _ in range(15):
        problem = random_problem(rng, 4.0, 6)
        problem.solve(coulomb)
        cold = problem.force.copy()
        assert problem.solve(coulomb).evaluations <= 2
        np.testing.assert_allclose(problem.force, cold, rtol=0.0, atol=1e-13 * problem.size)
        for far in (1e-4, 10.0):
            problem.unknowns[:] += far * problem.size * rng.normal(size=problem.count)
            problem.solve(coulomb)
            np.testing.assert_allclose(problem.force, cold, rtol=0.0, atol=1e-13 * problem.size)
    problem.unknowns[:] = np.nan
    problem.solve(coulomb)
    np.testing.assert_allclose(problem.force, cold, rtol=0.0, atol=1e-13 * problem.size)


@pytest.mark.parametrize("ratio", [0.01, 4.0, 100.0])
def test_square_gives_what_modes_give(ratio: float) -> None:
    """The problem as a matrix, with weights and unequal coefficients, has that answer; weight 0 has no force."""
    rng = np.random.default_rng(14)
    for _ in range(6):
        n, d = int(rng.integers(1, 5)), int(rng.integers(1, 4))
        weights = rng.uniform(0.05, 1.0, n)
        problem = Problem(rng, n, d, ratio, rng.uniform(0.0, 1.0, n), weights)
        assert problem.solve(False).law == ASSOCIATED
        law, force = problem.solve_square(False)
        assert law == ASSOCIATED
        bound = 1e-13 * max(ratio, 1 / ratio) * problem.size
        np.testing.assert_allclose(force, problem.force, rtol=0.0, atol=bound)

    problem = Problem(rng, 3, 3, ratio, 0.5)
    problem.root[3:6] = 0.0
    problem.Q[3:6] = 0.0
    problem.Q = np.linalg.qr(problem.Q)[0]
    problem.pose()
    assert problem.solve(True).law == COULOMB
    assert problem.force[3:6].tolist() == [0.0] * 3
    assert problem.status[1] == 0.0


@pytest.mark.parametrize(("external", "internal"), [(0.0, 100.0), (100.0, 0.0), (1e8, 1e-3)])
def test_singular_gains_are_raised(external: float, internal: float) -> None:
    """A gain of zero counts as 1e-6 of the other: always an answer, and f = K (e + s) to 1e-3 of the gain there is."""
    rng = np.random.default_rng(15)
    for _ in range(10):
        problem = random_problem(rng, 1.0, 6)
        problem.external, problem.internal = external, internal
        assert problem.solve(False).law == ASSOCIATED
        miss = np.abs(problem.K @ (problem.e + problem.slip) - problem.force).max()
        assert miss <= 1e-3 * problem.size
    problem.external = problem.internal = 0.0
    assert problem.solve(True) == Answer(COULOMB, 0.0, 0)
    assert not problem.force.any()
    problem.base_force[0, 0] = 1.0
    problem.solve(False)
    assert problem.force.tolist() == problem.base_force.ravel().tolist()


def test_not_finite_is_no_force() -> None:
    """A displacement that is NaN ends unresolved with zero forces, not with an exception."""
    problem = Problem(np.random.default_rng(0), 3, 3, 4.0, 0.5)
    problem.displacement[1, 1] = np.nan
    assert problem.solve(True).law == UNRESOLVED
    assert not problem.force.any()
    assert not problem.slip.any()


def test_modes_in_contact_frames() -> None:
    """Rows of frames times three-entry modes, the extra axes of the plane left out."""
    rng = np.random.default_rng(1)
    n, d, k = 3, 2, 2
    frames = [np.block([[np.linalg.qr(rng.normal(size=(2, 2)))[0], np.zeros((2, 1))]]) for _ in range(n)]
    modes = rng.normal(size=(k, 1 + 3 * n))
    rows = np.zeros((n, 9))
    rows[:, :6] = [frame.ravel() for frame in frames]
    problem = set_up(memoryview(np.zeros(problem_size(n))), 0, n)
    motions = Table(memoryview(modes.ravel()), 0, 1 + 3 * n)
    turn_modes(Many(Matrix, memoryview(rows.ravel()), 0, n), motions, problem, d, k)
    assert problem.modes == k
    np.testing.assert_array_equal(problem.unknowns.array(Unknown.share)[:k], modes[:, 0])
    for j, mode in enumerate(modes):
        for i in range(n):
            part = problem.contacts[i].modes.array(ModePart.motion)[j]
            np.testing.assert_allclose(part[:d], frames[i] @ mode[1 + 3 * i : 4 + 3 * i], rtol=0.0, atol=1e-15)
            assert not part[d:].any()
