"""Statistics instead of rows: first, last, smallest, largest, sum and sum of squares of each selected number."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import UnknownNameError

FloatArray = NDArray[np.float64]

FIRST, LAST, SUM, SQUARES, LOW, HIGH, LATE_LOW, LATE_HIGH = range(8)  # measures of a column; LATE_ is the second half
MEASURES = 8
STATISTICS = ("first", "last", "mean", "rms", "min", "max", "peak", "growth")


class Statistics(dict[str, FloatArray]):
    """Statistics of a quantity by name; errors for unknown names suggest the closest name."""

    def __missing__(self, name: str) -> FloatArray:
        raise UnknownNameError("statistic", str(name), self)


def take(rows: Any, columns: Any, measures: Any, count: int, width: int, numbers: int, low: int) -> None:
    """Update measures with rows.

    Args:
        rows: Buffer of rows.
        columns: Indices of the selected numbers of a row.
        measures: Measures, MEASURES of each number.
        count: Number of rows.
        width: Number of entries of a row.
        numbers: Number of selected numbers.
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
    """Make empty measures, (numbers, MEASURES)."""
    measures = np.zeros((numbers, MEASURES))
    measures[:, [LOW, LATE_LOW]] = np.inf
    measures[:, [HIGH, LATE_HIGH]] = -np.inf
    return measures


def statistic(name: str, measures: FloatArray, ticks: int) -> FloatArray:
    """Compute a statistic from measures (..., MEASURES) of a run of `ticks` ticks; NaN without finite numbers.

    The growth is the peak magnitude of the second half of the ticks over that of the first half, whose number of
    ticks is rounded down.
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
