"""Motions that run away without swinging, as a grasp does that is squeezed more than it can bear."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.recording.growth.octaves import LEAST_GROWTH, TINY, WINDOW, Octave, Stretch, poles, rises

FloatArray = NDArray[np.float64]

MOST_SAMPLES = 600  # of an octave in which it is looked for: more are looked at in those below
GROWTH = 4.5  # of log amplitude, at least
SHARE = 0.99  # of a stretch without its growth that one real pole explains
AGREEMENT = 0.2  # of the pole's rate with the growth that the windows show


class Divergence(NamedTuple):
    """A stretch of an octave that grows by z a sample, and its second differences in the end (c,)."""

    octave: Octave
    stretch: Stretch
    z: float
    last: FloatArray

    @property
    def begin(self) -> float:
        """[s]."""
        return self.octave.begin + (1 + self.stretch.first * WINDOW) * self.octave.step

    @property
    def end(self) -> float:
        """[s]."""
        return self.begin + self.stretch.length * WINDOW * self.octave.step

    @property
    def swing(self) -> FloatArray:
        """The motion in the end: z^k has second differences of z - 2 + 1/z times itself."""
        return self.last / (self.z - 2.0 + 1.0 / self.z)


def divergences(octave: Octave) -> list[Divergence]:
    """Find stretches of an octave in which a motion grows along one exponential; none in one of many samples."""
    if octave.size > MOST_SAMPLES:
        return []
    y = np.diff(octave.samples(), 2, axis=0)
    count = len(y) // WINDOW
    squares = (y[: count * WINDOW] ** 2).reshape(count, -1).sum(axis=1)
    ways = []
    for stretch in rises(0.5 * np.log(squares + TINY)):
        if stretch.growth < max(GROWTH, LEAST_GROWTH):
            continue
        part = y[stretch.first * WINDOW : (stretch.first + stretch.length) * WINDOW]
        growth = stretch.growth / len(part)
        (z,), share = poles(part, growth, 1)
        rate = math.log(z.real) if z.real > 0.0 else 0.0
        if share >= SHARE and abs(rate - growth) < AGREEMENT * growth and z.imag == 0.0:
            ways.append(Divergence(octave, stretch, float(z.real), part[-1]))
    return ways
