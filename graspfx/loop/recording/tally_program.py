"""The sums and peaks of a block of rows that a summary is made of, as one program for all scenes.

Largest values begin at -1, which stands for none; what is not a number stays.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.demand import KernelOnDemand

FloatArray = NDArray[np.float64]


def larger(peak: float, size: float) -> float:
    """Choose the larger of two numbers; one that is not a number wins, as in numpy."""
    return peak if peak >= size or peak != peak else size


def measure_lengths(
    rows: Any, entries: Any, results: Any, count: int, width: int, n: int, d: int, at: int, mask: int
) -> None:
    """Find the largest length of each of n vectors in d axes, and add up the lengths.

    Args:
        rows: count x width numbers, the vectors from entry `at` of each on.
        entries: whether each row and vector counts, count x n numbers, if `mask` is not 0.
        results: of each vector the largest length, then the sum over all and how many there were.
        count, width: of the rows.
        n, d: of the vectors.
        at: entry of the first.
        mask: 0, or 1 for vectors that do not all count.
    """
    for row in range(count):
        for i in range(n):
            if mask == 0 or entries[row * n + i] != 0.0:
                start = row * width + at + i * d
                square = 0.0
                for j in range(d):
                    square += rows[start + j] * rows[start + j]
                size = math.sqrt(square)
                results[i] = larger(results[i], size)
                results[n] = results[n] + size
                results[n + 1] = results[n + 1] + 1.0


def measure_places(
    rows: Any, entries: Any, results: Any,
    count: int, width: int, n: int, d: int, at: int, touching: int, contact: int, centre: int,
) -> None:  # fmt: skip
    """Add up how far the fingers of one object squeeze, and how far it is from their centre.

    Args:
        rows: count x width numbers.
        entries: the numbers of the fingers, n.
        results: the largest squeeze, sqrt(mean |e - mean e|^2) over touching fingers where there are two and more, the
            sum of them and how many; and the sum of the squares of the distance from the centre.
        count, width: of the rows.
        n, d: how many fingers, and axes.
        at: entry of the fingers' positions.
        touching, contact: entries of whether fingers touch and of their contacts; below 0 if there is none.
        centre: entry of the object's position; below 0 if there is none.
    """
    for row in range(count):
        start = row * width
        if touching >= 0:
            touch = 0.0
            for i in range(n):
                if rows[start + touching + int(entries[i])] != 0.0:
                    touch += 1.0
            if touch >= 2.0:
                spread = 0.0
                for j in range(d):
                    mean = 0.0
                    for i in range(n):
                        f = int(entries[i])
                        if rows[start + touching + f] != 0.0:
                            mean += rows[start + at + f * d + j] - rows[start + contact + f * d + j]
                    mean /= touch
                    for i in range(n):
                        f = int(entries[i])
                        if rows[start + touching + f] != 0.0:
                            off = rows[start + at + f * d + j] - rows[start + contact + f * d + j] - mean
                            spread += off * off
                squeeze = math.sqrt(spread / touch)
                results[0] = larger(results[0], squeeze)
                results[1] = results[1] + squeeze
                results[2] = results[2] + 1.0
        if centre >= 0:
            for j in range(d):
                mean = 0.0
                for i in range(n):
                    mean += rows[start + at + int(entries[i]) * d + j]
                off = rows[start + centre + j] - mean / n
                results[3] = results[3] + off * off


# in rows, which Python looks at in some ten microseconds each
LENGTHS, PLACES = (
    KernelOnDemand(kernel, few=100, load=5_000, make=50_000) for kernel in (measure_lengths, measure_places)
)


class Measures:
    """Sums and peaks of blocks of rows (r, w), arrays that can be written.

    Args:
        rows: that there are in all.
    """

    def __init__(self, rows: int) -> None:
        self._lengths, self._places = LENGTHS.runner(rows), PLACES.runner(rows)

    def lengths(
        self, rows: FloatArray, at: int, n: int, d: int, counts: NDArray[Any] | None = None
    ) -> tuple[FloatArray, float, int]:
        """Measure n vectors (d,) from entry `at` of each row on: `measure_lengths`.

        Args:
            rows: (r, w).
            at: entry of the first vector.
            n, d: how many there are, of how many axes.
            counts: (r, n), which of them count, if not all.

        Returns:
            The largest length of each, -1 where none counts; the sum of the lengths; and how many there are.
        """
        results = np.array([*[-1.0] * n, 0.0, 0.0])
        entries = np.zeros(1) if counts is None else np.ascontiguousarray(counts, dtype=float).reshape(-1)
        flat = np.ascontiguousarray(rows).reshape(-1)
        self._lengths(flat, entries, results, *rows.shape, n, d, at, 0 if counts is None else 1)
        return results[:n], float(results[n]), int(results[n + 1])

    def places(
        self, rows: FloatArray, fingers: Sequence[int], d: int, at: int, touching: int, contact: int, centre: int
    ) -> tuple[float, float, int, float]:
        """Measure the places of an object's fingers: `measure_places`.

        Returns:
            The largest squeeze, -1 where there is none; the sum of them; how many; the sum of squared distances.
        """
        results = np.array([-1.0, 0.0, 0.0, 0.0])
        entries = np.array([*fingers, 0.0])
        flat = np.ascontiguousarray(rows).reshape(-1)
        self._places(flat, entries, results, *rows.shape, len(fingers), d, at, touching, contact, centre)
        return float(results[0]), float(results[1]), int(results[2]), float(results[3])
