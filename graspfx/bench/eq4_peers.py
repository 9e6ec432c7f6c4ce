"""Eq. (4) as a reader of the paper would write it: a grasp matrix, and a library's way to project on its row space."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Project = Callable[[FloatArray, FloatArray], FloatArray]

EPS = float(np.finfo(float).eps)


def grasp_matrix(points: FloatArray) -> FloatArray:
    """G of point contacts, (6, 3 n): forces, then moments about the origin (eq. 2)."""
    n = len(points)
    G = np.zeros((6, n, 3))
    G[[0, 1, 2], :, [0, 1, 2]] = 1.0
    x, y, z = points.T
    G[3, :, 1], G[3, :, 2] = -z, y
    G[4, :, 0], G[4, :, 2] = z, -x
    G[5, :, 0], G[5, :, 1] = -y, x
    return G.reshape(6, 3 * n)


def by_pinv(G: FloatArray, x: FloatArray) -> FloatArray:
    """P x with P = G^+ G, as eq. (3) stands."""
    return np.asarray(np.linalg.pinv(G) @ G @ x)


def by_lstsq(G: FloatArray, x: FloatArray) -> FloatArray:
    """The rigid motion G' v that fits x best."""
    return np.asarray(G.T @ np.linalg.lstsq(G.T, x)[0])


def by_svd(G: FloatArray, x: FloatArray) -> FloatArray:
    """Right singular vectors that count."""
    s, V = np.linalg.svd(G, full_matrices=False)[1:]
    V = V[s > max(G.shape) * EPS * s[0]]
    return np.asarray(V.T @ (V @ x))


def by_qr(G: FloatArray, x: FloatArray) -> FloatArray:
    """Orthonormal columns of G' in their order, all six."""
    Q = np.linalg.qr(G.T)[0]
    return np.asarray(Q @ (Q.T @ x))


def by_pivoted_qr(G: FloatArray, x: FloatArray) -> FloatArray:
    """Orthonormal columns of G', the largest first, as many as count."""
    from scipy.linalg import qr

    Q, R, _ = qr(G.T, mode="economic", pivoting=True, check_finite=False)
    sizes = np.abs(np.diag(R))
    Q = Q[:, sizes > max(G.shape) * EPS * sizes[0]]
    return np.asarray(Q @ (Q.T @ x))


def by_gelsd(G: FloatArray, x: FloatArray) -> FloatArray:
    """LAPACK's least squares by a divided singular value decomposition."""
    from scipy.linalg import lstsq

    return np.asarray(G.T @ lstsq(G.T, x, cond=max(G.shape) * EPS, lapack_driver="gelsd", check_finite=False)[0])


def by_gelsy(G: FloatArray, x: FloatArray) -> FloatArray:
    """LAPACK's least squares by a complete orthogonal factorisation."""
    from scipy.linalg import lstsq

    return np.asarray(G.T @ lstsq(G.T, x, cond=max(G.shape) * EPS, lapack_driver="gelsy", check_finite=False)[0])


def by_posv(G: FloatArray, x: FloatArray) -> FloatArray:
    """Normal equations G G' v = G x by Cholesky; ValueError where G G' is not positive definite."""
    from scipy.linalg.lapack import dposv

    _, v, info = dposv(G @ G.T, G @ x)
    if info:
        raise ValueError("G G' is not positive definite")
    return np.asarray(G.T @ v)


PEERS: dict[str, Project] = {
    "numpy pinv": by_pinv,
    "numpy lstsq": by_lstsq,
    "numpy svd": by_svd,
    "numpy QR": by_qr,
    "scipy QR, pivoted": by_pivoted_qr,
    "scipy gelsd": by_gelsd,
    "scipy gelsy": by_gelsy,
    "scipy posv": by_posv,
}
