"""Whittaker's smoother, from numpy alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

ORDER = 4  # of the differences, and of the blocks of q D D' + I, which is banded
SQUARED_DIFFERENCES = (70.0, -56.0, 28.0, -8.0, 1.0)  # the diagonals of D D'


def roughness(x: FloatArray, q: float) -> FloatArray:
    """Compute x - s, s minimising |x - s|^2 + q |D s|^2 with D the fourth differences: q D' (q D D' + I)^-1 D x.

    No difference of nearly equal numbers is taken: what is smooth is small to its own digits.

    Args:
        x: (N, k), k signals of N > 4 samples.
        q: of the penalty.
    """
    z = _solve(q, np.diff(x, ORDER, axis=0))
    rough: FloatArray = q * np.diff(np.pad(z, ((ORDER, ORDER), (0, 0))), ORDER, axis=0)
    return rough


def _solve(q: float, b: FloatArray) -> FloatArray:
    """Solve (q D D' + I) x = b by cyclic reduction of the Cholesky factorisation.

    Blocks of four rows are tridiagonal; every second one is eliminated at once, log2(N/4) times over: as stable as
    Cholesky's method in any order of the rows is, with one call of LAPACK's loops for each time.
    """
    rows, columns = b.shape
    m = -(-rows // ORDER)
    entries = np.zeros(2 * ORDER)
    entries[: ORDER + 1] = SQUARED_DIFFERENCES
    far = np.arange(ORDER)[:, None] - np.arange(ORDER)
    diagonal = np.broadcast_to(q * entries[abs(far)] + np.eye(ORDER), (m, ORDER, ORDER)).copy()
    below = np.broadcast_to(q * entries[far + ORDER], (max(m - 1, 0), ORDER, ORDER)).copy()
    left = rows - ORDER * (m - 1)  # of the last block; the rest of it is the identity
    diagonal[-1, left:], diagonal[-1, :, left:] = 0.0, 0.0
    diagonal[-1, range(left, ORDER), range(left, ORDER)] = 1.0
    below[-1:, left:] = 0.0
    right = np.zeros((m, ORDER, columns))
    right.reshape(-1, columns)[:rows] = b
    return _reduced(diagonal, below, right).reshape(-1, columns)[:rows]


def _reduced(A: FloatArray, B: FloatArray, R: FloatArray) -> FloatArray:
    """Solve A_i x_i + B_{i-1} x_{i-1} + B_i' x_{i+1} = R_i for x (m, b, k), symmetric and positive definite.

    Eliminating the odd blocks, A_i = L L', takes (L^-1 C)' (L^-1 C) from the even ones, C what joins it to them.
    """
    m, b, k = R.shape
    if m == 1:
        L = np.linalg.cholesky(A)
        return np.linalg.solve(np.swapaxes(L, 1, 2), np.linalg.solve(L, R))
    odd, after = m // 2, (m - 1) // 2  # how many blocks are odd, and how many of them have one after them
    joined = np.zeros((odd, b, 2 * b + k))
    joined[:, :, :b] = B[0::2]
    joined[:after, :, b : 2 * b] = np.swapaxes(B[1::2], 1, 2)
    joined[:, :, 2 * b :] = R[1::2]
    L = np.linalg.cholesky(A[1::2])
    joined = np.linalg.solve(L, joined)
    before, behind, constants = joined[:, :, :b], joined[:, :, b : 2 * b], joined[:, :, 2 * b :]
    A, R, x = A[0::2].copy(), R[0::2].copy(), np.empty_like(R)
    A[:odd] -= np.swapaxes(before, 1, 2) @ before
    R[:odd] -= np.swapaxes(before, 1, 2) @ constants
    if after:
        back = np.swapaxes(behind[:after], 1, 2)
        A[1:] -= back @ behind[:after]
        R[1:] -= back @ constants[:after]
        x[0::2] = _reduced(A, -back @ before[:after], R)
    else:
        x[0::2] = _reduced(A, B[:0], R)
    rest = constants - before @ x[0:-1:2]
    rest[:after] -= behind[:after] @ x[2::2]
    x[1::2] = np.linalg.solve(np.swapaxes(L, 1, 2), rest)
    return x
