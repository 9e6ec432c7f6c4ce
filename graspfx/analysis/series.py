"""Dampers in series: what a compliance at each coordinate leaves of a damping matrix."""

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
