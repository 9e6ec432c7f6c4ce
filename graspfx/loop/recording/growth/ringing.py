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


class Ringing(NamedTuple):
    """Rows from `first` up to `stop` in which contacts ring, cycles a tick, and the amplitudes of the motion (c,)."""

    first: int
    stop: int
    turn: float
    swing: NDArray[np.complex128]


def touches(touching: BoolArray) -> list[tuple[int, int]]:
    """Find the longest row of touches of each finger without a long pause, as (first, stop) of ticks; none of a few."""
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
            spans.append((int(onsets[edges[longest]]), int(onsets[edges[longest + 1] - 1])))
    return spans


def ringing(displacement: FloatArray, first: int, noise: float) -> Ringing | None:
    """Find the oscillation of a motion that keeps its size and stands above the noise of sensors; None without one.

    Args:
        displacement: (M, c), rows from `first` on.
        noise: of the measured positions, RMS.
    """
    x = displacement[-MOST_ROWS:]
    M = len(x)
    slow = 2.0 * np.sin(np.pi * min(LEAST_TOUCHES / 2 / M, 0.25))  # half as many cycles as there are touches at least
    fast = roughness(x, float(slow) ** -8)
    early, late = (float(np.sqrt((part**2).mean())) for part in (fast[: M // 2], fast[M // 2 :]))
    if late < STEADY * early or late <= 10.0 * noise or late <= 0.0:
        return None
    spectrum = np.fft.rfft(fast * np.hanning(M)[:, None], axis=0)
    peak = int(np.argmax((np.abs(spectrum) ** 2).sum(axis=1)))
    if peak == 0:
        return None
    swing = spectrum[peak] * (2.0 / np.hanning(M).sum())
    return Ringing(first + len(displacement) - M, first + len(displacement), peak / M, swing)
