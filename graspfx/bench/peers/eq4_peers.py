"""Eq. (4) as a reader of the paper would write it: a grasp matrix, and a library's way to project on its row space."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Project = Callable[[FloatArray, FloatArray], FloatArray]

EPS = float(np.finfo(float).eps)


SKEW = np.zeros((3, 3, 3))  # r -> the matrix [r x]
SKEW[[0, 0, 1, 1, 2, 2], [1, 2, 0, 2, 0, 1], [2, 1, 2, 0, 1, 0]] = [-1.0, 1.0, 1.0, -1.0, -1.0, 1.0]


class GraspMatrix:
    """G of n point contacts in space, (6, 3 n): forces, then moments about the origin (eq. 2), made anew in place.

    The identities never change; the moments' part is one product of the points with a constant.
    """

    def __init__(self, n: int) -> None:
        self._G = np.zeros((6, 3 * n))
        self._G[:3] = np.tile(np.eye(3), (1, n))
        self._product = np.empty((n, 9))
        self._moments, self._turned = self._G[3:].reshape(3, n, 3), self._product.reshape(n, 3, 3).transpose(1, 0, 2)

    def __call__(self, points: FloatArray) -> FloatArray:
        np.matmul(points, SKEW.reshape(9, 3).T, out=self._product)
        self._moments[...] = self._turned
        return self._G


def grasp_matrix(points: FloatArray) -> FloatArray:
    """Form G of point contacts, an array of its own."""
    return GraspMatrix(len(points))(points)


def by_pinv(G: FloatArray, x: FloatArray) -> FloatArray:
    """Compute P x with P = G^+ G (eq. 3), from the right, so that P is not formed."""
    return np.asarray(np.linalg.pinv(G) @ (G @ x))


def by_solve(G: FloatArray, x: FloatArray) -> FloatArray:
    """Solve the normal equations G G' v = G x; ValueError where G G' is singular."""
    return np.asarray(np.linalg.solve(G @ G.T, G @ x) @ G)


def by_lstsq(G: FloatArray, x: FloatArray) -> FloatArray:
    """Fit the rigid motion G' v to x."""
    return np.asarray(G.T @ np.linalg.lstsq(G.T, x)[0])


def by_svd(G: FloatArray, x: FloatArray) -> FloatArray:
    """Use the right singular vectors that count."""
    s, V = np.linalg.svd(G, full_matrices=False)[1:]
    V = V[s > max(G.shape) * EPS * s[0]]
    return np.asarray(V.T @ (V @ x))


def by_qr(G: FloatArray, x: FloatArray) -> FloatArray:
    """Use orthonormal columns of G' in their order, all six."""
    Q = np.linalg.qr(G.T)[0]
    return np.asarray(Q @ (Q.T @ x))


def by_pivoted_qr(G: FloatArray, x: FloatArray) -> FloatArray:
    """Use orthonormal columns of G', the largest first, as many as count."""
    from scipy.linalg import qr

    Q, R, _ = qr(G.T, mode="economic", pivoting=True, check_finite=False)
    sizes = np.abs(np.diag(R))
    Q = Q[:, sizes > max(G.shape) * EPS * sizes[0]]
    return np.asarray(Q @ (Q.T @ x))


def by_gelsd(G: FloatArray, x: FloatArray) -> FloatArray:
    """Use LAPACK's least squares by a divided singular value decomposition."""
    from scipy.linalg import lstsq

    return np.asarray(G.T @ lstsq(G.T, x, cond=max(G.shape) * EPS, lapack_driver="gelsd", check_finite=False)[0])


def by_gelsy(G: FloatArray, x: FloatArray) -> FloatArray:
    """Use LAPACK's least squares by a complete orthogonal factorisation."""
    from scipy.linalg import lstsq

    return np.asarray(G.T @ lstsq(G.T, x, cond=max(G.shape) * EPS, lapack_driver="gelsy", check_finite=False)[0])


def by_posv(G: FloatArray, x: FloatArray) -> FloatArray:
    """Solve the normal equations G G' v = G x by Cholesky; ValueError where G G' is not positive definite."""
    from scipy.linalg.lapack import dposv

    _, v, info = dposv(G @ G.T, G @ x)
    if info:
        raise ValueError("G G' is not positive definite")
    return np.asarray(G.T @ v)


PEERS: dict[str, Project] = {
    "numpy pinv": by_pinv,
    "numpy lstsq": by_lstsq,
    "numpy solve": by_solve,
    "numpy svd": by_svd,
    "numpy QR": by_qr,
    "scipy QR, pivoted": by_pivoted_qr,
    "scipy gelsd": by_gelsd,
    "scipy gelsy": by_gelsy,
    "scipy posv": by_posv,
}


def closed_form(points: FloatArray, x: FloatArray) -> FloatArray:
    """Compute P x without G: the mean shift and the turn w about the centroid, J w = sum r x d, by cofactors; (n, 3).

    ZeroDivisionError where the contacts are exactly on a line.
    """
    n = len(points)
    mean = np.full(n, 1.0 / n)
    r = points - mean @ points
    moments, squares = (r.T @ x).tolist(), (r.T @ r).tolist()
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = squares
    a, b, c = yy + zz, xx + zz, xx + yy
    m0, m1, m2 = moments[1][2] - moments[2][1], moments[2][0] - moments[0][2], moments[0][1] - moments[1][0]
    c00, c11, c22 = b * c - yz * yz, a * c - xz * xz, a * b - xy * xy
    c01, c02, c12 = xz * yz + xy * c, xy * yz + xz * b, a * yz + xy * xz
    d = 1.0 / (a * c00 - xy * c01 - xz * c02)
    p, q, s = (
        d * (c00 * m0 + c01 * m1 + c02 * m2),
        d * (c01 * m0 + c11 * m1 + c12 * m2),
        d * (c02 * m0 + c12 * m1 + c22 * m2),
    )
    return np.asarray(mean @ x + r @ np.array([[0.0, s, -q], [-s, 0.0, p], [q, -p, 0.0]]))
