"""Factors of symmetric matrices, among them signed sums of squares sum_k h_k l_k l_k', and linear systems."""

from __future__ import annotations

import math

from graspfx import elementary
from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Table

ROUNDING = 1e-15  # relative to a diagonal entry: a smaller pivot is zero
SETTLED = 1e-24  # relative to |t|^2: t'A'A t below this is rounding
PAIR = (1.0 + math.sqrt(17.0)) / 8.0  # smallest ratio of a diagonal pivot to an off-diagonal entry


@kernel
def factor_definite(M: Table, size: int) -> None:
    """Replace M >= 0 by its lower triangular factor L, M = L L'; the column of a pivot of rounding size is zero."""
    for j in range(size):
        own = M[j, j]
        left = own
        for k in range(j):
            left -= M[j, k] * M[j, k]
        if not left > ROUNDING * own:
            for i in range(j, size):
                M[i, j] = 0.0
        else:
            root = math.sqrt(left)
            inverse = 1.0 / root
            M[j, j] = root
            for i in range(j + 1, size):
                total = M[i, j]
                for k in range(j):
                    total -= M[i, k] * M[j, k]
                M[i, j] = total * inverse
        for i in range(j):
            M[i, j] = 0.0


@kernel
def solve_factored(L: Table, x: Floats, size: int) -> None:
    """Solve L L'x = b in place, where L is from `factor_definite` and has no zero pivot."""
    lower(L, x, size)
    for i in range(size - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, size):
            total -= L[k, i] * x[k]
        x[i] = total / L[i, i]


@kernel
def lower(L: Table, x: Floats, size: int) -> None:
    """Solve L x = b in place, where L is lower triangular."""
    for i in range(size):
        total = x[i]
        for k in range(i):
            total -= L[i, k] * x[k]
        x[i] = total / L[i, i]


@kernel
def invert_part(M: Table, kept: Floats, size: int, least: float) -> None:
    """Replace M >= 0 by the inverse of its largest non-singular principal submatrix, with zeros elsewhere.

    The largest pivot is eliminated first. When no pivot exceeds `least`, the remaining rows are treated as zero. `kept`
    is work space.
    """
    for i in range(size):
        kept[i] = 0.0
    for _ in range(size):
        p = -1
        top = least
        for i in range(size):
            if kept[i] == 0.0 and M[i, i] > top:
                p = i
                top = M[i, i]
        if p < 0:
            break
        kept[p] = 1.0
        inverse = 1.0 / top
        for i in range(size):
            factor = M[i, p] * inverse
            if i != p:
                for k in range(size):
                    if k != p:
                        M[i, k] -= factor * M[p, k]
        for i in range(size):
            M[i, p] *= inverse
            M[p, i] = M[i, p]
        M[p, p] = -inverse
    for i in range(size):
        for k in range(size):
            M[i, k] *= -kept[i] * kept[k]


@kernel
def take_square(A: Table, t: Floats, along: Floats, rest: float, size: int) -> None:
    """Subtract A'A t t'A'A / (rest + t'A'A t) from A'A by an update of A (Potter's square-root update); overwrite t.

    If `rest` is zero, A t becomes zero up to rounding errors, and a later call with the same t leaves A unchanged.
    """
    own = square = 0.0
    for i in range(size):
        total = 0.0
        for j in range(size):
            total += A[i, j] * t[j]
        along[i] = total
        own += t[i] * t[i]
        square += total * total
    if not square > SETTLED * own:
        return
    share = 1.0 / (square + rest)
    share /= 1.0 + math.sqrt(rest * share)
    for j in range(size):
        total = 0.0
        for i in range(size):
            total += A[i, j] * along[i]
        t[j] = share * total
    for i in range(size):
        for j in range(size):
            A[i, j] -= along[i] * t[j]


@kernel
def factor_signed(M: Table, size: int, columns: Table, signs: Floats) -> None:
    """Compute the vectors l_k and signs h_k of a symmetric M = sum_k h_k l_k l_k' by complete pivoting; overwrite M.

    The pivot is the largest diagonal entry, unless an off-diagonal entry is more than 1.56 times as large. In that case
    a 2 x 2 pivot is used, in the axes of its two eigenvectors; one of its signs is positive and the other negative
    (Bunch and Parlett 1971).

    Args:
        M: Matrix; only its lower triangle is read.
        size: Number of rows.
        columns: Output: vectors l_k as columns.
        signs: Output: signs h_k, 1 or -1.
    """
    k = 0
    while k < size:
        r = p = q = 0
        top = off = 0.0
        for i in range(size):
            if abs(M[i, i]) > top:
                top = abs(M[i, i])
                r = i
            for j in range(i):
                if abs(M[i, j]) > off:
                    off = abs(M[i, j])
                    p = i
                    q = j
        if top >= PAIR * off:
            take_pivot(M, size, r, columns, signs, k)
            k += 1
        else:
            take_pair(M, size, p, q, columns, signs, k)
            k += 2


@kernel
def take_pivot(M: Table, size: int, r: int, columns: Table, signs: Floats, k: int) -> None:
    """Subtract h l l' of the diagonal pivot r from M; write h and l as term k. If the pivot is zero, l is zero."""
    pivot = M[r, r]
    signs[k] = -1.0 if pivot < 0.0 else 1.0
    inverse = signs[k] / math.sqrt(abs(pivot)) if pivot != 0.0 else 0.0
    for i in range(size):
        columns[i, k] = inverse * (M[i, r] if i >= r else M[r, i])
    take_off(M, size, r, columns, signs[k], k)


@kernel
def take_pair(M: Table, size: int, p: int, q: int, columns: Table, signs: Floats, k: int) -> None:
    """Subtract the two terms of the 2 x 2 pivot of rows p > q from M; write these terms as terms k and k + 1."""
    a, b, c = M[q, q], M[p, q], M[p, p]
    half = 0.5 * (a - c)
    sine, cosine = elementary.sin_cos(0.5 * elementary.atan2(b, half))
    radius = math.sqrt(half * half + b * b)
    high, low = 0.5 * (a + c) + radius, 0.5 * (a + c) - radius  # eigenvalues, of opposite signs because b is large
    signs[k] = 1.0
    signs[k + 1] = -1.0
    for i in range(size):
        u = M[i, q] if i >= q else M[q, i]
        v = M[i, p] if i >= p else M[p, i]
        columns[i, k] = (cosine * u + sine * v) / math.sqrt(high)
        columns[i, k + 1] = (sine * u - cosine * v) / math.sqrt(-low)
    take_off(M, size, p, columns, 1.0, k)
    take_off(M, size, q, columns, -1.0, k + 1)
    for i in range(size):
        M[max(i, p), min(i, p)] = 0.0


@kernel
def take_off(M: Table, size: int, r: int, columns: Table, sign: float, k: int) -> None:
    """Subtract h l_k l_k' from the lower triangle of M, where h is `sign`, and set row and column r to zero."""
    for i in range(size):
        left = sign * columns[i, k]
        for j in range(i + 1):
            M[i, j] -= left * columns[j, k]
    for i in range(size):
        M[max(i, r), min(i, r)] = 0.0


@kernel
def eliminate_rows(A: Table, B: Table, size: int, columns: int) -> bool:
    """Solve A X = B in place by elimination with row exchanges; return False if a pivot is zero."""
    for p in range(size):
        top = p
        for i in range(p + 1, size):
            if abs(A[i, p]) > abs(A[top, p]):
                top = i
        if top != p:
            for j in range(p, size):
                A[p, j], A[top, j] = A[top, j], A[p, j]
            for j in range(columns):
                B[p, j], B[top, j] = B[top, j], B[p, j]
        if not abs(A[p, p]) > 0.0:
            return False
        inverse = 1.0 / A[p, p]
        for i in range(p + 1, size):
            factor = A[i, p] * inverse
            if factor != 0.0:
                for j in range(p + 1, size):
                    A[i, j] -= factor * A[p, j]
                for j in range(columns):
                    B[i, j] -= factor * B[p, j]
    for p in range(size - 1, -1, -1):
        inverse = 1.0 / A[p, p]
        for j in range(columns):
            total = B[p, j]
            for k in range(p + 1, size):
                total -= A[p, k] * B[k, j]
            B[p, j] = total * inverse
    return True


@kernel
def eliminate(square: Table, vector: Floats, size: int) -> bool:
    """Solve H x = r in place by elimination with row exchanges; return False if a pivot is zero.

    `square` contains H, and `vector` contains r.
    """
    for p in range(size):
        top = p
        for i in range(p + 1, size):
            if abs(square[i, p]) > abs(square[top, p]):
                top = i
        if top != p:
            for j in range(p, size):
                square[p, j], square[top, j] = square[top, j], square[p, j]
            vector[p], vector[top] = vector[top], vector[p]
        if not abs(square[p, p]) > 0.0:
            return False
        inverse = 1.0 / square[p, p]
        for i in range(p + 1, size):
            factor = square[i, p] * inverse
            if factor != 0.0:
                for j in range(p + 1, size):
                    square[i, j] -= factor * square[p, j]
                vector[i] -= factor * vector[p]
    for p in range(size - 1, -1, -1):
        total = vector[p]
        for j in range(p + 1, size):
            total -= square[p, j] * vector[j]
        vector[p] = total / square[p, p]
    return True
