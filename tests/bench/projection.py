"""Forces in cones, without friction and with Coulomb's, beside clarabel and Gauss-Seidel compiled by numba."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

import graspfx as gx
from graspfx.bench.timing import Case, Method, each
from tests.bench.peers import imported

FloatArray = NDArray[np.float64]

TITLE = "Forces in cones"
LIMITS = """
The inputs are K and e in contact frames. clarabel and Gauss-Seidel receive the inverse of K, and its computation is
not included in their time. Clarabel's solver is created once and receives new numbers at each call; Gauss-Seidel is
compiled by numba. `gx.unilateral_force` is the public call, a Python program for any gain matrix; a tick solves such
problems in machine code, within the times of "Ticks of built-in scenes". Coulomb's law is not a convex problem, so
clarabel is missing there. Problems for which no solution of Coulomb's law was found are omitted; the table therefore
shows no failures. Errors are against 50 digits.
"""

INTERNAL, FRICTION = 70.0, 0.5  # [N/m]
DEPTH = 0.003  # of the fingers [m]
SWEEPS = 200_000
TOLERANCES = (1e-3, 1e-6, 1e-12)
WRONG = 0.1  # of the largest force
DIGITS = 50


@dataclass(frozen=True)
class Problem:
    """A grasp in contact frames, the normal first: K and its inverse W (m, m), e (m,), and the answer f (m,)."""

    K: FloatArray
    W: FloatArray
    e: FloatArray
    force: FloatArray


def cases(quick: bool) -> Iterator[Case]:
    """Yield both laws for gains near to one another and far apart."""
    for mu, ratios in ((0.0, (3.0, 1000.0)), (FRICTION, (3.0, 30.0))):
        for n, ratio in ((n, ratio) for n in (5,) for ratio in ratios):
            problems = drawn(np.random.default_rng([n, int(ratio)]), 4 if quick else 8, mu, n, ratio)
            law = "Coulomb's friction" if mu else "no friction"
            name = f"{law}, {n} fingers, gains {ratio:g} : 1"
            yield Case("projection", name, "relative", list(methods(problems, mu, n)), WRONG)


def methods(problems: Sequence[Problem], mu: float, n: int) -> Iterator[Method]:
    """List the public call and the peers."""
    normals = np.eye(3)[None, 0].repeat(n, axis=0)
    yield method(
        "GraspFX unilateral_force", lambda: lambda p: gx.unilateral_force(p.K, p.e, normals, mu).force, problems
    )
    if not mu:
        yield method("clarabel to 1e-12", partial(ByClarabel, n, 1e-12), problems)
    for tolerance in TOLERANCES:
        name = f"Gauss-Seidel by numba to {tolerance:.0e}"
        yield method(name, partial(by_gauss_seidel, mu, tolerance), problems)


def method(name: str, make: Callable[[], Callable[[Problem], FloatArray]], problems: Sequence[Problem]) -> Method:
    """Make a method whose solver is made when its error is asked for."""
    made: list[Callable[[Problem], FloatArray]] = []

    def solve(p: Problem) -> FloatArray:
        if not made:
            made.append(make())
        return made[0](p)

    def error() -> float:
        return max(float(np.abs(solve(p) - p.force).max() / np.abs(p.force).max()) for p in problems)

    return Method(name, each(solve, problems), error, calls=len(problems))


def drawn(rng: np.random.Generator, N: int, mu: float, n: int, ratio: float) -> list[Problem]:
    """Place fingers around a ball, most of them deep in it, until N problems have an answer."""
    problems: list[Problem] = []
    normals = np.eye(3)[None, 0].repeat(n, axis=0)
    while len(problems) < N:
        inward = rng.normal(size=(n, 3))
        frames = np.array([np.linalg.qr(np.column_stack([v, rng.normal(size=(3, 2))]))[0] for v in inward])
        frames[:, :, 0] *= np.sign(np.sum(frames[:, :, 0] * inward, axis=1))[:, None]
        blocks = gx.grasp_matrix(-0.05 * frames[:, :, 0]).reshape(6, n, 3)
        V = np.linalg.svd(np.einsum("wia,iab->wib", blocks, frames).reshape(6, 3 * n), full_matrices=False)[2]
        e = DEPTH * rng.normal(size=(n, 3))
        e[:, 0] += DEPTH
        external, P = INTERNAL / ratio, V.T @ V
        K = INTERNAL * np.eye(3 * n) + (external - INTERNAL) * P
        W = np.eye(3 * n) / INTERNAL + (1.0 / external - 1.0 / INTERNAL) * P
        near = gx.unilateral_force(K, e.ravel(), normals, mu).force
        force = exact_force(K, e.ravel(), mu, W @ near)
        if force is not None and force.any():
            problems.append(Problem(K, W, e.ravel(), force))
    return problems


def exact_force(K: FloatArray, e: FloatArray, mu: float, near: FloatArray) -> FloatArray | None:
    """Compute f = K w in friction cones (mu = 0: along normals), w = e + s, in contact frames; None if `near` is not.

    The law is g = K w - R(K w - c (w - e)) = 0 for any c > 0, R the radial return. Newton's method, g to 50 digits and
    its derivative to 16, from a w `near` the answer.
    """
    mp = imported("mpmath", "the oracle of 50 digits")
    n, c = len(e) // 3, float(np.abs(K).sum(axis=1).max())
    step, J, t = 1e-200, np.empty_like(K), K @ near - c * (near - e)
    for p in range(len(e)):
        moved = (t + 1j * step * (K[:, p] - c * np.eye(len(e))[p])).reshape(n, 3)
        J[:, p] = K[:, p] - np.array([_returned([complex(v) for v in row], mu) for row in moved]).ravel().imag / step
    with mp.workdps(DIGITS):
        exact_K, exact_e, x = mp.matrix(K.tolist()), mp.matrix(e.tolist()), mp.matrix(near.tolist())
        for _ in range(12):
            f = exact_K * x
            trial = f - mp.mpf(c) * (x - exact_e)
            back = [v for i in range(n) for v in _returned([trial[3 * i + a] for a in range(3)], mp.mpf(mu))]
            g = np.array([float(f[p] - back[p]) for p in range(len(e))])
            if np.abs(g).max() < 1e-30 * c * max(np.abs(near).max(), np.abs(e).max()):
                return np.array([float(v) for v in back])
            x -= mp.matrix(np.linalg.solve(J, g).tolist())
    return None


def _returned(t: list[Any], mu: Any) -> list[Any]:
    """Compute the radial return of one contact, in any arithmetic: branches ask for real parts only."""
    size = (t[1] * t[1] + t[2] * t[2]) ** 0.5
    if t[0].real <= 0:
        return [t[0] * 0] * 3
    if size.real <= (mu * t[0]).real and mu > 0:
        return t
    share = mu * t[0] / size if mu and size else 0 * t[0]
    return [t[0], share * t[1], share * t[2]]


class ByClarabel:
    """argmin 1/2 f'W f - e'f over forces along normals that push, W = K^-1: one solver, given new numbers.

    Args:
        n: fingers.
        tolerance: of the gaps and of feasibility.
    """

    def __init__(self, n: int, tolerance: float) -> None:
        clarabel = imported("clarabel", "the peer of clarabel")
        self._columns = np.repeat(np.arange(n), np.arange(1, n + 1))
        self._rows = np.concatenate([np.arange(j + 1) for j in range(n)])  # the upper triangle, column by column
        starts = np.concatenate([[0], np.cumsum(np.arange(1, n + 1))])
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.presolve_enable, settings.max_threads = False, False, 1
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
        pattern = sparse.csc_matrix((1.0 * (self._rows == self._columns), self._rows, starts), shape=(n, n))
        cones = [clarabel.NonnegativeConeT(n)]
        self._solver = clarabel.DefaultSolver(
            pattern, np.zeros(n), sparse.diags(-np.ones(n), format="csc"), np.zeros(n), cones, settings
        )
        self._solved = clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved

    def __call__(self, p: Problem) -> FloatArray:
        """Solve for forces (m,) in contact frames; RuntimeError if Clarabel does not say solved."""
        self._solver.update(P=p.W[3 * self._rows, 3 * self._columns], q=-p.e[::3])
        solution = self._solver.solve()
        if solution.status not in self._solved:
            raise RuntimeError(f"its status is {solution.status}")
        f = np.zeros(len(p.e))
        f[::3] = solution.x
        return f


def by_gauss_seidel(mu: float, tolerance: float) -> Callable[[Problem], FloatArray]:
    """Compile the sweeps; RuntimeError where they do not end."""
    sweep = imported("numba", "the peer of numba").njit(gauss_seidel)

    def solve(p: Problem) -> FloatArray:
        f = np.zeros(len(p.e))
        if sweep(p.W, p.e, f, mu, tolerance) == SWEEPS:
            raise RuntimeError(f"not done after {SWEEPS} sweeps")
        return f

    return solve


def gauss_seidel(W: FloatArray, e: FloatArray, f: FloatArray, mu: float, tolerance: float) -> int:
    """Iterate contact by contact f_i = R(f_i - (W f - e)_i / w_i), W = K^-1, until no force changes by a share.

    Written for numba; returns the number of sweeps.
    """
    m, sweep, change, largest = len(e), 0, 1.0, 0.0
    while sweep < SWEEPS and change > tolerance * largest:
        sweep += 1
        change = largest = 0.0
        for i in range(0, m, 3):
            r, t0, t1, t2 = 0.0, e[i], e[i + 1], e[i + 2]
            for a in range(3):
                total = 0.0
                for b in range(3):
                    total += abs(W[i + a, i + b])
                r = max(r, total)
            for q in range(m):
                t0 -= W[i, q] * f[q]
                t1 -= W[i + 1, q] * f[q]
                t2 -= W[i + 2, q] * f[q]
            t0, t1, t2 = f[i] + t0 / r, f[i + 1] + t1 / r, f[i + 2] + t2 / r
            slip = math.sqrt(t1 * t1 + t2 * t2)
            if t0 <= 0.0:
                t0 = t1 = t2 = 0.0
            elif mu == 0.0 or slip > mu * t0:
                share = mu * t0 / slip if slip > 0.0 else 0.0
                t1, t2 = share * t1, share * t2
            change = max(change, abs(t0 - f[i]), abs(t1 - f[i + 1]), abs(t2 - f[i + 2]))
            largest = max(largest, t0)
            f[i], f[i + 1], f[i + 2] = t0, t1, t2
    return sweep
