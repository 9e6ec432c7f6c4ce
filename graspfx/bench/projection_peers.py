"""Forces in cones by others: an interior-point solver for cones, and projected Gauss-Seidel as textbooks have it."""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

SWEEPS = 200_000


def by_clarabel(K: FloatArray, e: FloatArray, mu: float, tolerance: float) -> FloatArray:
    """argmin 1/2 f'K^-1 f - e'f over the cones, (m,) in contact frames; RuntimeError if it does not say solved."""
    import clarabel
    from scipy import sparse

    W = np.linalg.inv(K)
    m = len(e)
    normals = np.arange(0, m, 3)
    kept = np.arange(m) if mu else normals
    scale = np.ones(len(kept))
    if mu:
        scale[normals] = mu
    cones = [clarabel.SecondOrderConeT(3)] * (m // 3) if mu else [clarabel.NonnegativeConeT(m // 3)]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    P = sparse.csc_matrix(np.triu(W[np.ix_(kept, kept)]))
    A = sparse.diags(-scale, format="csc")
    solution = clarabel.DefaultSolver(P, -e[kept], A, np.zeros(len(kept)), cones, settings).solve()
    if solution.status not in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved):
        raise RuntimeError(f"its status is {solution.status}")
    f = np.zeros(m)
    f[kept] = solution.x
    return f


def gauss_seidel(W: Any, e: Any, f: Any, m: int, mu: float, theta: float, tolerance: float) -> int:
    """Contact by contact f_i = R(f_i - (W f - e)_i / w_i), W = K^-1, until no force changes by more than a share.

    W is flat, m x m. Returns the sweeps.
    """
    for sweep in range(SWEEPS):
        change = largest = 0.0
        for i in range(0, m, 3):
            r = 0.0
            for a in range(3):
                total = 0.0
                for b in range(3):
                    total += abs(W[(i + a) * m + i + b])
                r = max(r, total)
            t0, t1, t2 = f[i] + e[i] / r, f[i + 1] + e[i + 1] / r, f[i + 2] + e[i + 2] / r
            for q in range(m):
                t0 -= W[i * m + q] * f[q] / r
                t1 -= W[(i + 1) * m + q] * f[q] / r
                t2 -= W[(i + 2) * m + q] * f[q] / r
            size = sqrt(t1 * t1 + t2 * t2)
            if t0 + theta * mu * size <= 0.0:
                t0 = t1 = t2 = 0.0
            elif mu == 0.0 or size > mu * t0:
                t0 = (t0 + theta * mu * size) / (1.0 + theta * mu * mu)
                share = mu * t0 / size if size > 0.0 else 0.0
                t1, t2 = share * t1, share * t2
            change = max(change, abs(t0 - f[i]), abs(t1 - f[i + 1]), abs(t2 - f[i + 2]))
            largest = max(largest, t0)
            f[i], f[i + 1], f[i + 2] = t0, t1, t2
        if change <= tolerance * largest:
            return sweep + 1
    return SWEEPS


def by_gauss_seidel(
    sweep: Callable[..., int], K: FloatArray, e: FloatArray, mu: float, theta: float, tolerance: float
) -> FloatArray:
    """`gauss_seidel`, or its compiled twin, from zero."""
    f = np.zeros_like(e)
    if sweep(np.linalg.inv(K).ravel(), e, f, len(e), mu, theta, tolerance) == SWEEPS:
        raise RuntimeError(f"not done after {SWEEPS} sweeps")
    return f
