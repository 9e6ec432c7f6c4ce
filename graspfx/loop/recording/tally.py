"""Numbers of a run that is added up block by block."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.recording.tally_program import Measures

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class Mean:
    """Sums of values and of their squares, and how many there were."""

    def __init__(self) -> None:
        self.count, self.total, self.squares = 0, 0.0, 0.0

    def add(self, values: NDArray[Any], *, squares: bool = False) -> None:
        self.count += values.size
        if squares:
            flat = values.reshape(-1)
            self.squares += float(flat @ flat)
        else:
            self.total += float(values.sum())

    def add_sum(self, total: float, count: int) -> None:
        """Add the sum of so many values."""
        self.total, self.count = self.total + total, self.count + count

    def add_squares(self, squares: float, count: int) -> None:
        """Add the sum of the squares of so many values."""
        self.squares, self.count = self.squares + squares, self.count + count

    @property
    def mean(self) -> float | None:
        return self.total / self.count if self.count else None

    @property
    def rms(self) -> float | None:
        return float(np.sqrt(self.squares / self.count)) if self.count else None


class Peaks:
    """Largest values of some quantities; None for one that had none."""

    def __init__(self, count: int) -> None:
        self.values: list[float | None] = [None] * count

    def add(self, i: int, values: FloatArray) -> None:
        if values.size:
            self._add(i, float(values.max()))

    def add_peak(self, i: int, peak: float) -> None:
        """Add the peak of some values, none of which is below zero; below zero it is of none."""
        if not peak < 0.0:
            self._add(i, float(peak))

    def _add(self, i: int, peak: float) -> None:
        before = self.values[i]
        self.values[i] = peak if before is None else float(np.maximum(before, peak))


class Parts(NamedTuple):
    """Peaks per finger and mean length of an internal or external force, while fingers touch."""

    peaks: Peaks
    mean: Mean

    def add(self, measures: Measures, force: FloatArray, touching: BoolArray) -> None:
        count, n, d = force.shape
        peaks, total, number = measures.lengths(force.reshape(count, n * d), 0, n, d, touching)
        for i in range(n):
            self.peaks.add_peak(i, peaks[i])
        self.mean.add_sum(total, number)


def lengths(vectors: FloatArray) -> FloatArray:
    """Compute the lengths of vectors (..., d)."""
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))


class Ledger:
    """Peaks and ends of one object's ledger."""

    def __init__(self) -> None:
        self.leak: FloatArray | None = None
        self.braking: FloatArray | None = None
        self.braked: FloatArray | None = None
        self.gap = self.largest = 0.0

    def add(self, books: Iterable[tuple[str, FloatArray]]) -> None:
        for name, values in books:
            if not len(values):
                continue
            if name == "balance":
                self.leak = _larger(self.leak, np.maximum(-values, 0.0).max(axis=0))
            if name == "damping":
                self.braking = _larger(self.braking, values.max(axis=0))
                continue
            if name == "braked":
                self.braked = values[-1].copy()
            size = float(np.abs(values).max())
            if name == "gap":
                self.gap = max(self.gap, size)
            else:
                self.largest = max(self.largest, size)


def _larger(before: FloatArray | None, now: FloatArray) -> FloatArray:
    return now if before is None else np.maximum(before, now)


def books_of(ledgers: Sequence[Ledger]) -> Iterator[tuple[str, Any]]:
    """Sum ledgers up for a summary."""
    leaks, braking, braked = (
        [value for ledger in ledgers if (value := getattr(ledger, name)) is not None]
        for name in ("leak", "braking", "braked")
    )
    gaps = [ledger.gap / ledger.largest if ledger.largest > 0.0 else 0.0 for ledger in ledgers]
    yield "leak", np.max(leaks, axis=0).tolist() if leaks else None
    yield "braking", np.max(braking, axis=0).tolist() if braking else None
    yield "braked", np.sum(braked, axis=0).tolist() if braked else None
    yield "ledger_gap", max(gaps) if leaks else None
