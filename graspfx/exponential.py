"""Matrix exponential e^A - I of a small matrix, without scipy.linalg, whose import takes as long as a short run.

The products and the solution that give the result avoid BLAS and LAPACK, whose code depends on the processor. Simulated
devices are discretised with this function, and a run must be bit-identical on other machines.
"""

from __future__ import annotations

from math import ceil, inf, log2

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError

FloatArray = NDArray[np.float64]

PADE = (  # b_0 ... b_13 of the diagonal approximant of degree 13, N. J. Higham (2005), eq. (2.3)
    64764752532480000.0,
    32382376266240000.0,
    7771770303897600.0,
    1187353796428800.0,
    129060195264000.0,
    10559470521600.0,
    670442572800.0,
    33522128640.0,
    1323241920.0,
    40840800.0,
    960960.0,
    16380.0,
    182.0,
    1.0,
)
LARGEST = 4.25  # largest norm estimate: theta_13 of A. H. Al-Mohy and N. J. Higham (2009), table 3.1
LEADING = 113250775606021113483283660800000000.0  # 1/|c_27|, leading term of the backward error
ROUNDING = 2.0**-53


def expm1(A: FloatArray) -> FloatArray:
    """Compute e^A - I by scaling and squaring.

    F = r_13(A / 2^s) - I is computed with the diagonal Pade approximant r_13 of degree 13, and F <- 2 F + F^2 is
    repeated s times.

    Because F excludes the identity, a small F keeps its relative accuracy in every squaring. s is chosen from norms of
    powers of A, so that a large nilpotent part (such as inputs held for a sample) costs no accuracy (N. J.
    Higham, The scaling and squaring method for the matrix exponential revisited, SIAM J. Matrix Anal. Appl. 26(4),
    2005; A. H. Al-Mohy and N. J. Higham, A new scaling and squaring algorithm for the matrix exponential, SIAM J.
    Matrix Anal. Appl. 31(3), 2009, with the norms themselves in place of estimates).

    Args:
        A: Matrix (k, k), finite.

    Returns:
        Matrix e^A - I (k, k), with a relative error in the 1-norm of a few 1e-16 times the condition number of e^A.

    Raises:
        InputError: If A is not square or not finite.
    """
    if A.ndim != 2 or A.shape[0] != A.shape[1]:
        raise InputError("A", A, "a square matrix")
    if not np.isfinite(A).all():
        raise InputError("A", A, "finite numbers")
    if not A.size:
        return np.zeros_like(A)
    b, eye = PADE, np.eye(len(A))
    with np.errstate(over="ignore", invalid="ignore"):  # powers may overflow; then the norm of A sets the scale
        s = _halvings(A)
    A = A * 0.5**s
    A2 = _product(A, A)
    A4 = _product(A2, A2)
    A6 = _product(A4, A2)
    odd = _product(A6, b[13] * A6 + b[11] * A4 + b[9] * A2)
    U = _product(A, odd + b[7] * A6 + b[5] * A4 + b[3] * A2 + b[1] * eye)
    even = _product(A6, b[12] * A6 + b[10] * A4 + b[8] * A2)
    V = even + b[6] * A6 + b[4] * A4 + b[2] * A2 + b[0] * eye
    F = _solution(V - U, 2.0 * U)
    for _ in range(s):
        F = 2.0 * F + _product(F, F)
    return np.asarray(F, dtype=np.float64)


def _product(A: FloatArray, B: FloatArray) -> FloatArray:
    """Compute A B."""
    product: FloatArray = np.einsum("ij,jk->ik", A, B)
    return product


def _solution(A: FloatArray, B: FloatArray) -> FloatArray:
    """Solve A X = B by Gaussian elimination with partial pivoting."""
    n = len(A)
    M = np.hstack([A, B])
    for k in range(n):
        pivot = k + int(np.abs(M[k:, k]).argmax())
        if pivot != k:
            M[[k, pivot]] = M[[pivot, k]]
        M[k + 1 :, k:] -= (M[k + 1 :, k] / M[k, k])[:, None] * M[k, k:]
    X = M[:, n:]
    for k in reversed(range(n)):
        X[k] /= M[k, k]
        X[:k] -= M[:k, k, None] * X[k]
    return X


def _halvings(A: FloatArray) -> int:
    """Choose s so that the backward error of r_13(A / 2^s), as an approximation of e^(A / 2^s), is below 2^-53."""
    A2 = _product(A, A)
    A4 = _product(A2, A2)
    A6 = _product(A4, A2)
    d6, d8, d10 = _norm(A6) ** (1 / 6), _norm(_product(A4, A4)) ** (1 / 8), _norm(_product(A4, A6)) ** (1 / 10)
    estimate = min(max(d6, d8), max(d8, d10), _norm(A))
    s = max(0, ceil(log2(estimate / LARGEST))) if estimate > LARGEST else 0
    scaled = np.abs(A) * 0.5**s
    row = np.ones((1, len(A)))
    for _ in range(27):
        row = _product(row, scaled)
    alpha = float(row.max()) / (LEADING * (_norm(scaled) or 1.0))  # |c_27| || |A|^27 || / ||A||
    return s + (max(0, ceil(log2(alpha / ROUNDING) / 26)) if alpha > 0.0 else 0)


def _norm(A: FloatArray) -> float:
    """Compute the 1-norm; infinity if an overflow makes the norm NaN."""
    norm = float(np.abs(A).sum(axis=0).max())
    return inf if norm != norm else norm
