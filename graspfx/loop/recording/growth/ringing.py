"""Contacts that ring: fingers that let go and touch again in every cycle of an oscillation that does not die away."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.recording.growth.smoother import roughness

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LEAST_TOUCHES = 12  # of a finger, one after another
LONGEST_PAUSE = 3.0  # times the middle pause between two touches
STEADY = 0.7  # of the first half's size that the second half keeps
MOST_ROWS = 4096  # of them a frequency is found
CYCLES = 8  # of touches, the longest that a motion's cycle is taken to be
SLOWEST = 0.03  # 2 sin(pi f) of f cycles a row: below it the smoother's equations are singular to rounding


class Ringing(NamedTuple):
    """Rows from `first` up to `stop` in which contacts ring, cycles a tick, and the amplitudes of the motion (c,)."""

    first: int
    stop: int
    turn: float
    swing: NDArray[np.complex128]


def touches(touching: BoolArray) -> list[tuple[int, int, int]]:
    """Find each finger's longest row of touches without a long pause: (first, stop) of ticks, count; none of a few."""
    spans = []
    for column in touching.T:
        onsets = np.flatnonzero(column[1:] & ~column[:-1]) + 1
        if len(onsets) < LEAST_TOUCHES:
            continue
        pauses = np.diff(onsets)
        breaks = np.flatnonzero(pauses > LONGEST_PAUSE * np.median(pauses))
        edges = np.concatenate([[0], breaks + 1, [len(onsets)]])
        longest = int(np.argmax(np.diff(edges)))
        if edges[longest + 1] - edges[longest] >= LEAST_TOUCHES:
            count = int(edges[longest + 1] - edges[longest])
            spans.append((int(onsets[edges[longest]]), int(onsets[edges[longest + 1] - 1]), count))
    return spans


def ringing(displacement: FloatArray, first: int, count: int, noise: float) -> Ringing | None:
    """Find the oscillation of a motion that keeps its size and stands above the noise of sensors; None without one.

    Rows are first averaged in groups where cycles are long.

    Args:
        displacement: (M, c), rows from `first` on.
        count: of touches in them.
        noise: of the measured positions, RMS.
    """
    x = displacement[-MOST_ROWS:]
    slow = _slow(len(x), count * len(x) / len(displacement))
    group = max(1, int(np.ceil(SLOWEST / slow)))
    x = x[len(x) % group :].reshape(-1, group, x.shape[1]).mean(axis=1)
    M = len(x)
    fast = roughness(x, _slow(M, count * M * group / len(displacement)) ** -8)
    early, late = (float(np.sqrt((part**2).mean())) for part in (fast[: M // 2], fast[M // 2 :]))
    if late < STEADY * early or late <= 10.0 * noise or late <= 0.0:
        return None
    spectrum = np.fft.rfft(fast * np.hanning(M)[:, None], axis=0)
    peak = int(np.argmax((np.abs(spectrum) ** 2).sum(axis=1)))
    if peak == 0:
        return None
    swing = spectrum[peak] * (2.0 / np.hanning(M).sum())
    return Ringing(first + len(displacement) - M * group, first + len(displacement), peak / (M * group), swing)


def _slow(rows: int, count: float) -> float:
    """Compute 2 sin(pi f) of the slowest cycles that may ring: of the fewest touches, or of `CYCLES` of them."""
    return float(2.0 * np.sin(np.pi * min(max(LEAST_TOUCHES / 2, count / CYCLES) / rows, 0.25)))
