"""Numbers of a run that is added up block by block."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

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
            peak, before = float(values.max()), self.values[i]
            self.values[i] = peak if before is None else float(np.maximum(before, peak))


class Parts(NamedTuple):
    """Peaks per finger and mean length of an internal or external force, while fingers touch."""

    peaks: Peaks
    mean: Mean

    def add(self, force: FloatArray, touching: BoolArray) -> None:
        size = lengths(force)
        for i in range(size.shape[1]):
            self.peaks.add(i, size[touching[:, i], i])
        self.mean.add(size[touching])


def lengths(vectors: FloatArray) -> FloatArray:
    """Compute the lengths of vectors (..., d)."""
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))


def internal_deformation(
    finger_position: FloatArray, contact_position: FloatArray, touching: BoolArray | None = None
) -> FloatArray:
    """Compute sqrt(mean_i |e_i - mean e|^2), e = p - c: how far touching fingers squeeze in against each other [m].

    e less its mean is (I - P) e with the object's rotation locked, eq. (3), so that moving the whole hand against the
    object does not count; for two opposed fingers, each d deep, it is d.

    Args:
        finger_position, contact_position: (N, n, d) of the fingers of one object [m].
        touching: (N, n); all if not given.

    Returns:
        One number for each tick in which at least two fingers touch.
    """
    e = finger_position - contact_position
    w = np.ones(e.shape[:2]) if touching is None else touching.astype(float)  # (N, n)
    grasped = w.sum(axis=1) >= 2.0
    e, w = e[grasped], w[grasped, :, None]
    count = w.sum(axis=1, keepdims=True)
    spread = w * (e - (w * e).sum(axis=1, keepdims=True) / count)
    mean_square: FloatArray = (spread**2).sum(axis=(1, 2)) / count[:, 0, 0]
    return np.sqrt(mean_square)


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
