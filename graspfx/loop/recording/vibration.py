"""Vibration in a run: the part above 5 Hz of many signals at once, block after block of a run of any length."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, pi, sin

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.recording.growth.rough_program import rough_squares

FloatArray = NDArray[np.float64]

VIBRATION_FROM = 5.0  # [Hz]: an operator's own motion stays below
FINEST = 1e-3  # [s]: beyond it the smoother's equations are singular to rounding
REACH = 100.0  # over 2 sin(pi f T), samples: beyond it what a smoother of this penalty takes in is below 1e-16
CORE = 1 << 14  # samples that are smoothed together, at least


class Vibration:
    """Mean squares of |x - s|, s minimising |x - s|^2 + q |D s|^2, D fourth differences, over a run in blocks.

    A block is smoothed with as many samples before and behind it as reach into it (`REACH`), so that the division into
    blocks shows in rounding only. Samples are first averaged over 1 ms if they are closer.

    Args:
        period: between samples [s].
        samples: how many there are in all.
        above: [Hz].
    """

    def __init__(self, period: float, samples: int, above: float = VIBRATION_FROM) -> None:
        self._group = max(1, int(FINEST / period))
        period *= self._group
        self._count = samples // self._group
        self.is_long = 2.0 * above * period < 1.0 and self._count * period * above >= 2.0
        self._seen, self._first = 0, 0  # samples in groups so far, and those of the buffer that were counted
        self._rest: FloatArray | None = None  # of a group
        self._buffer: FloatArray | None = None
        self._used = 0
        self._squares: FloatArray | float = 0.0
        if self.is_long:
            slow = 2.0 * sin(pi * above * period)
            self._q, self._reach = slow**-8, ceil(REACH / slow)

    def add(self, x: FloatArray, places: Sequence[slice] = (slice(None),)) -> None:
        """Add samples of k signals.

        Args:
            x: (r, w).
            places: of the signals in a row.
        """
        if not self.is_long:
            return
        if self._group > 1:
            x, places = self._grouped(np.concatenate([x[:, place] for place in places], axis=1)), (slice(None),)
        if self._buffer is None:
            size = min(self._count, 2 * self._reach + max(CORE, 6 * self._reach))
            self._buffer = np.empty((size, sum(x[:1, place].size for place in places)))
        while len(x):
            part = x[: len(self._buffer) - self._used]
            start = 0
            for place in places:
                values = part[:, place]
                self._buffer[self._used : self._used + len(part), start : start + values.shape[1]] = values
                start += values.shape[1]
            self._used += len(part)
            self._seen += len(part)
            x = x[len(part) :]
            if self._used == len(self._buffer) and self._seen < self._count:
                self._count_up(self._used - self._reach)

    def mean_squares(self) -> FloatArray | None:
        """Compute the mean squares of each signal, (k,); None for a run that is too short, or sampled too slowly."""
        if not self.is_long or self._buffer is None:
            return None
        if self._used > self._first:
            self._count_up(self._used)
        return np.asarray(self._squares / self._count)

    def _count_up(self, stop: int) -> None:
        """Count the samples of the buffer up to one; keep those that reach beyond it."""
        assert self._buffer is not None
        self._squares = self._squares + rough_squares(self._buffer[: self._used], self._q, self._first, stop)
        low = max(stop - self._reach, 0)
        rest = self._buffer[low : self._used].copy()
        self._buffer[: len(rest)] = rest
        self._first, self._used = stop - low, len(rest)

    def _grouped(self, x: FloatArray) -> FloatArray:
        whole = x if self._rest is None else np.concatenate([self._rest, x])
        count = len(whole) // self._group
        self._rest = whole[count * self._group :].copy()
        return np.asarray(whole[: count * self._group].reshape(count, self._group, x.shape[1]).mean(axis=1))


def vibration(signal: FloatArray, period: float, above: float = VIBRATION_FROM) -> float | None:
    """Compute the RMS of |x - s| over ticks and rows of x, s minimising |x - s|^2 + q |D s|^2, D fourth differences.

    Whittaker's smoother: x - s is what a Butterworth high-pass of order 4 run forth and back leaves, x passed by
    1/(1 + (above/f)^8), but it takes polynomials up to the third degree away entirely and needs nothing beyond the ends
    (E. T. Whittaker, On a new method of graduation, Proc. Edinburgh Math. Soc. 41, 1923; P. H. C. Eilers, A perfect
    smoother, Analytical Chemistry 75(14), 2003). Ticks are first averaged over 1 ms if they are shorter.

    Args:
        signal: (N, k, d): k vectors of d components over time.
        period: T [s].
        above: [Hz].

    Returns:
        In the signal's unit; None for a signal shorter than two periods of `above`, or sampled too slowly to tell.
    """
    tally = Vibration(period, len(signal), above)
    if len(signal):
        tally.add(signal.reshape(len(signal), -1))
    squares = tally.mean_squares()
    return None if squares is None else float(np.sqrt(squares.sum() / signal.shape[1]))
