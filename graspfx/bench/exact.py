"""Answers to 50 digits, for data taken as exact: what the errors of eq. (4) and of forces in cones are counted from."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.bench.case import is_installed
from graspfx.errors import MissingPackageError

FloatArray = NDArray[np.float64]

DIGITS = 50


def digits() -> Any:
    """mpmath; MissingPackageError without it."""
    if not is_installed("mpmath"):
        raise MissingPackageError("mpmath", "the oracle of 50 digits", "pip install mpmath")
    import mpmath

    return mpmath


def split_force(points: FloatArray, e: FloatArray, external: float, internal: float, tolerance: float) -> FloatArray:
    """f = k_i e + (k_e - k_i) G'(G G')^+ G e of point contacts in space (eq. 4), rounded once, (n, 3).

    Moments are about the centroid in units of the rms radius R; a rotation that moves the contacts by no more than
    `tolerance` R a radian is none.
    """
    mp = digits()
    with mp.workdps(DIGITS):
        n = len(points)
        x = [[mp.mpf(float(v)) for v in row] for row in points]
        d = [[mp.mpf(float(v)) for v in row] for row in e]
        centre = [sum(row[a] for row in x) / n for a in range(3)]
        r = [[row[a] - centre[a] for a in range(3)] for row in x]
        size = mp.sqrt(sum(v * v for row in r for v in row) / n) or mp.mpf(1)
        r = [[v / size for v in row] for row in r]
        shift = [sum(row[a] for row in d) / n for a in range(3)]
        # about the centroid shifts and turns are apart: the mean, and a turn w with J w = sum r x e
        J, moment = mp.zeros(3), mp.zeros(3, 1)
        for p, v in zip(r, d, strict=True):
            square = sum(c * c for c in p)
            for a in range(3):
                moment[a] += p[(a + 1) % 3] * v[(a + 2) % 3] - p[(a + 2) % 3] * v[(a + 1) % 3]
                for b in range(3):
                    J[a, b] += (square if a == b else 0) - p[a] * p[b]
        values, axes = mp.eigsy(J)
        turn = mp.zeros(3, 1)
        for k in range(3):
            if values[k] > n * mp.mpf(tolerance) ** 2:
                turn += axes[:, k] * ((axes[:, k].T * moment)[0] / values[k])
        ke, ki = mp.mpf(external), mp.mpf(internal)
        force = np.empty((n, 3))
        for i, (p, v) in enumerate(zip(r, d, strict=True)):
            for a in range(3):
                fitted = shift[a] + turn[(a + 1) % 3] * p[(a + 2) % 3] - turn[(a + 2) % 3] * p[(a + 1) % 3]
                force[i, a] = float(ki * v[a] + (ke - ki) * fitted)
    return force
