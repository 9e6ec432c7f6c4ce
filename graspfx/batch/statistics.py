"""Statistics instead of rows: first, last, least, largest, sums and squares of each number asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import UnknownNameError

FloatArray = NDArray[np.float64]

FIRST, LAST, SUM, SQUARES, LOW, HIGH, LATE_LOW, LATE_HIGH = range(8)  # of a column; LATE_: of the second half
MEASURES = 8
STATISTICS = ("first", "last", "mean", "rms", "min", "max", "peak", "growth")


class Statistics(dict[str, FloatArray]):
    """Statistics of a quantity by name; one that there is not is answered with the nearest."""

    def __missing__(self, name: str) -> FloatArray:
        raise UnknownNameError("statistic", str(name), self)


def take(rows: Any, columns: Any, measures: Any, count: int, width: int, numbers: int, low: int) -> None:
    """Take rows into measures.

    Args:
        rows: a buffer of rows.
        columns: the numbers of a row that are asked for.
        found: the measures, MEASURES of each.
        count: rows.
        width: numbers in a row.
        numbers: how many are asked for.
        low: LOW in the first half of a run, LATE_LOW in the second.
    """
    for r in range(count):
        for j in range(numbers):
            x = rows[r * width + int(columns[j])]
            o = j * MEASURES
            measures[o + LAST] = x
            measures[o + SUM] = measures[o + SUM] + x
            measures[o + SQUARES] = measures[o + SQUARES] + x * x
            if x < measures[o + low]:
                measures[o + low] = x
            if x > measures[o + low + 1]:
                measures[o + low + 1] = x


def empty(numbers: int) -> FloatArray:
    """Make measures of no row, (numbers, MEASURES)."""
    measures = np.zeros((numbers, MEASURES))
    measures[:, [LOW, LATE_LOW]] = np.inf
    measures[:, [HIGH, LATE_HIGH]] = -np.inf
    return measures


def statistic(name: str, measures: FloatArray, ticks: int) -> FloatArray:
    """Compute a statistic from measures (..., MEASURES) of a run of so many ticks; NaN where no number was one.

    growth is the peak magnitude of the second half of the ticks over that of the first (half of them, rounded down).
    """
    if name in ("first", "last"):
        return measures[..., FIRST if name == "first" else LAST]
    if name == "mean":
        return measures[..., SUM] / ticks
    if name == "rms":
        return np.asarray(np.sqrt(measures[..., SQUARES] / ticks))
    low, high = measures[..., [LOW, LATE_LOW]], measures[..., [HIGH, LATE_HIGH]]
    if name == "min":
        return _number(low.min(axis=-1))
    if name == "max":
        return _number(high.max(axis=-1))
    peaks = np.maximum(-low, high)
    if name == "peak":
        return _number(peaks.max(axis=-1))
    with np.errstate(divide="ignore", invalid="ignore"):
        return _number(peaks[..., 1]) / _number(peaks[..., 0])


def _number(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.nan)
