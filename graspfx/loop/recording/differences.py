"""Differences between two recordings, column by column and to the bit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from graspfx.loop.recording.layout import TIMED
from graspfx.loop.recording.record import Recording

ROWS = 4096  # that are compared at once


class Difference(NamedTuple):
    """A column in which two recordings differ.

    Attributes:
        column: its name.
        largest: difference of two numbers, of either sign; infinite where one of them alone is no number.
        tick: the first in which they differ.
        unit: of the column.
    """

    column: str
    largest: float
    tick: int
    unit: str

    def __str__(self) -> str:
        return f"{self.column}: up to {self.largest:.3g} {self.unit}, from tick {self.tick} on"


def compared(one: Recording, other: Recording) -> list[str]:
    """List the columns that two recordings have, but for those that say when ticks were."""
    columns = [name for name in one.layout.columns if name in other.layout.columns]
    return [name for name in columns if name not in TIMED and not name.startswith("raw/")]


def differences(one: Recording, other: Recording) -> list[Difference]:
    """Compare the columns that two recordings of as many rows have, but for those that say when ticks were.

    Numbers differ where their bits do: zeros by their signs too, and no number from any other.
    """
    each = (_difference(one, other, name) for name in compared(one, other))
    return [difference for difference in each if difference is not None]


def _difference(one: Recording, other: Recording, name: str) -> Difference | None:
    first, largest = -1, 0.0
    for start in range(0, len(one), ROWS):
        stop = min(start + ROWS, len(one))
        a, b = (np.ascontiguousarray(each.read(name, start, stop)) for each in (one, other))
        differ = a.view(np.int64) != b.view(np.int64)
        if differ.any():
            rows = differ.reshape(len(a), -1).any(axis=1)
            if first < 0:
                first = (start + int(np.flatnonzero(rows)[0])) * one.header.every
            with np.errstate(invalid="ignore"):
                gaps = np.abs(a[differ] - b[differ])
            largest = max(largest, float(np.where(np.isnan(gaps), np.inf, gaps).max()))
    return None if first < 0 else Difference(name, largest, first, one.layout.columns[name].unit)
