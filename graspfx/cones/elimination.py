"""Solution of a linear system in place."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Table


@kernel
def eliminate(square: Table, vector: Floats, size: int) -> bool:
    """Solve H x = r of `size` rows in place, with row exchanges; return False if a pivot is zero."""
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
