"""Books of energy that are added up block by block."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


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
