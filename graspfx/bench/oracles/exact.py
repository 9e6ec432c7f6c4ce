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
    """Load mpmath; raise MissingPackageError without it."""
    if not is_installed("mpmath"):
        raise MissingPackageError("mpmath", "the oracle of 50 digits", "pip install mpmath")
    import mpmath

    return mpmath


def split_force(points: FloatArray, e: FloatArray, external: float, internal: float, tolerance: float) -> FloatArray:
    """Compute f = k_i e + (k_e - k_i) G'(G G')^+ G e of point contacts in space (eq. 4), rounded once, (n, 3).

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


def cone_force(K: FloatArray, e: FloatArray, mu: float, associated: bool, near: FloatArray) -> FloatArray | None:
    """Compute f = K w in friction cones (mu = 0: along normals), w = e + s, in contact frames; None if `near` is not.

    Both laws are g = K w - R(K w - c (w - e)) = 0 for any c > 0, R the projection on the cones (associated law) or the
    radial return (Coulomb's). Newton's method, g to 50 digits and its derivative to 16, from a w `near` the answer.
    """
    mp = digits()
    n = len(e) // 3
    c = float(np.abs(K).sum(axis=1).max())
    w = np.asarray(near, dtype=float)
    J = np.empty_like(K)
    t, step = K @ w - c * (w - e), 1e-200
    for p in range(len(e)):
        direction = K[:, p] - c * np.eye(len(e))[p]
        turned = [
            _returned([complex(v) for v in row], mu, associated) for row in (t + 1j * step * direction).reshape(n, 3)
        ]
        J[:, p] = K[:, p] - np.array(turned, dtype=complex).ravel().imag / step
    with mp.workdps(DIGITS):
        exact_K, exact_e = mp.matrix(K.tolist()), mp.matrix(e.tolist())
        x = mp.matrix(w.tolist())
        for _ in range(12):
            f = exact_K * x
            trial = f - mp.mpf(c) * (x - exact_e)
            back = [
                v for i in range(n) for v in _returned([trial[3 * i + a] for a in range(3)], mp.mpf(mu), associated)
            ]
            g = np.array([float(f[p] - back[p]) for p in range(len(e))])
            if np.abs(g).max() < 1e-30 * c * max(np.abs(w).max(), np.abs(e).max()):
                return np.array([float(v) for v in back])
            x -= mp.matrix(np.linalg.solve(J, g).tolist())
    return None


def _returned(t: list[Any], mu: Any, associated: bool) -> list[Any]:
    """Compute R of one contact, in any arithmetic: branches ask for real parts only."""
    size = (t[1] * t[1] + t[2] * t[2]) ** 0.5
    theta = 1 if associated else 0
    if (t[0] + theta * mu * size).real <= 0:
        return [t[0] * 0] * 3
    if size.real <= (mu * t[0]).real and mu > 0:
        return t
    push = (t[0] + theta * mu * size) / (1 + theta * mu * mu)
    share = mu * push / size if mu and size else 0 * push
    return [push, share * t[1], share * t[2]]
