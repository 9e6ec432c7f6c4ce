"""Dampers and springs in series: what compliances leave of a damping or a stiffness matrix."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis.pushing import condensed

FloatArray = NDArray[np.float64]


def in_series(damping: FloatArray, compliance: ArrayLike) -> FloatArray:
    """Put a compliant damper in series with each coordinate: D_s = (D^-1 + C)^-1, also of a singular D.

    Args:
        damping: D (m, m) [N s/m].
        compliance: the diagonal of C (m,) [m/(N s)]; an infinite one leaves its coordinate without any force.

    Returns:
        D_s (m, m), for C = 0 D itself.
    """
    C = np.asarray(compliance, dtype=float)
    if not C.any():
        return damping
    carries = np.isfinite(C)
    block = np.ix_(carries, carries)
    D = condensed(damping, carries)
    result = np.zeros_like(damping)
    result[block] = np.linalg.solve(np.eye(len(D)) + D * C[carries], D)  # (I + D C)^-1 D
    return result


def springs_in_series(stiffness: FloatArray, directions: FloatArray, springs: ArrayLike) -> FloatArray:
    """Put springs in series along unit directions: K_s = (K^-1 + sum_i n_i n_i'/s_i)^-1, also of a singular K.

    Args:
        stiffness: K (m, m) [N/m].
        directions: n_i as columns (m, p).
        springs: s_i (p,) [N/m]; where one is zero nothing is left along its direction.

    Returns:
        K - K N (S + N'K N)^-1 N'K (m, m).
    """
    N, S = directions, np.asarray(springs, dtype=float)
    along = N.T @ stiffness
    return np.asarray(stiffness - stiffness @ N @ np.linalg.lstsq(np.diag(S) + along @ N, along, rcond=None)[0])
