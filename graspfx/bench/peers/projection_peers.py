"""Forces in cones by others: an interior-point solver for cones, and projected Gauss-Seidel as textbooks have it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Many, Record, Table, floats, table

FloatArray = NDArray[np.float64]

SWEEPS = 200_000


class ByClarabel:
    """argmin 1/2 f'W f - e'f over the cones, W = K^-1, in contact frames: one solver, given new numbers for each grasp.

    Args:
        m: three times the fingers.
        mu: coefficient; zero for forces along the normals.
        tolerance: of the gaps and of feasibility.
    """

    def __init__(self, m: int, mu: float, tolerance: float) -> None:
        import clarabel
        from scipy import sparse

        normals = np.arange(0, m, 3)
        self._m, self._entries = m, np.arange(m) if mu else normals
        count = len(self._entries)
        self._columns = np.repeat(np.arange(count), np.arange(1, count + 1))
        self._rows = np.concatenate([np.arange(j + 1) for j in range(count)])  # the upper triangle, column by column
        starts = np.concatenate([[0], np.cumsum(np.arange(1, count + 1))])
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.presolve_enable, settings.max_threads = False, False, 1
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
        scale = np.ones(count)
        if mu:
            scale[normals] = mu
        cones = [clarabel.SecondOrderConeT(3)] * (m // 3) if mu else [clarabel.NonnegativeConeT(m // 3)]
        first = sparse.csc_matrix(
            (1.0 * (self._rows == self._columns), self._rows, starts), shape=(count, count)
        )  # the pattern counts, the numbers come with each grasp
        self._solver = clarabel.DefaultSolver(
            first, np.zeros(count), sparse.diags(-scale, format="csc"), np.zeros(count), cones, settings
        )
        self._solved = clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved

    def __call__(self, W: FloatArray, e: FloatArray) -> FloatArray:
        """Solve for forces (m,) in contact frames; RuntimeError if Clarabel does not say solved."""
        entries = self._entries
        self._solver.update(P=W[entries[self._rows], entries[self._columns]], q=-e[entries])
        solution = self._solver.solve()
        if solution.status not in self._solved:
            raise RuntimeError(f"its status is {solution.status}")
        f = np.zeros(self._m)
        f[entries] = solution.x
        return f


class SweepProblem(Record):
    """One projection, its unknowns three for each contact: the normal force first."""

    size: int  # m
    W: Table = table("size", "size")  # K^-1
    e: Floats = floats("size")
    f: Floats = floats("size")  # the solution


@kernel
def gauss_seidel(problems: Many[SweepProblem], mu: float, theta: float, tolerance: float) -> int:
    """Iterate contact by contact f_i = R(f_i - (W f - e)_i / w_i), W = K^-1, until no force changes by a share.

    Each starts from f = 0. Returns the most sweeps that a problem took.
    """
    most = 0
    for problem in problems:
        sweeps = sweep_contacts(problem, mu, theta, tolerance)
        most = max(most, sweeps)
    return most


@kernel
def sweep_contacts(problem: SweepProblem, mu: float, theta: float, tolerance: float) -> int:
    """Iterate one problem; return the sweeps that it took."""
    m, W, e, f = problem.size, problem.W, problem.e, problem.f
    for i in range(m):
        f[i] = 0.0
    sweep, change, largest = 0, 1.0, 0.0
    while sweep < SWEEPS and change > tolerance * largest:
        sweep += 1
        change = largest = 0.0
        for i in range(0, m, 3):
            r = 0.0
            for a in range(3):
                total = 0.0
                for b in range(3):
                    total += abs(W[i + a, i + b])
                r = max(r, total)
            t0, t1, t2 = e[i], e[i + 1], e[i + 2]
            for q in range(m):
                t0 -= W[i, q] * f[q]
                t1 -= W[i + 1, q] * f[q]
                t2 -= W[i + 2, q] * f[q]
            t0, t1, t2 = f[i] + t0 / r, f[i + 1] + t1 / r, f[i + 2] + t2 / r
            slip = math.sqrt(t1 * t1 + t2 * t2)
            if t0 + theta * mu * slip <= 0.0:
                t0 = t1 = t2 = 0.0
            elif mu == 0.0 or slip > mu * t0:
                t0 = (t0 + theta * mu * slip) / (1.0 + theta * mu * mu)
                share = mu * t0 / slip if slip > 0.0 else 0.0
                t1, t2 = share * t1, share * t2
            change = max(change, abs(t0 - f[i]), abs(t1 - f[i + 1]), abs(t2 - f[i + 2]))
            largest = max(largest, t0)
            f[i], f[i + 1], f[i + 2] = t0, t1, t2
    return sweep
