"""Limits of one gain: its stable intervals, and where, at which frequency and how stability is lost."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.critical import edges, is_thin

FloatArray = NDArray[np.float64]
How = Literal["pair", "-1", "+1"]


@dataclass(frozen=True)
class Loss:
    """An end of a stable interval.

    Attributes:
        gain: [N/m].
        frequency: of the oscillation there [Hz]: 0 for "+1", half the sampling frequency for "-1".
        how: what reaches the unit circle: a complex "pair", a root at "-1" or at "+1".
    """

    gain: float
    frequency: float
    how: How


@dataclass(frozen=True, eq=False)
class Limits:
    """The gains k >= 0 for which every root of D + k N lies inside the unit circle.

    Attributes:
        intervals: open intervals (low, high) [N/m] in order; high is inf where no gain is too large.
        losses: what happens at their finite ends above zero, in order.
        period: T [s].
    """

    intervals: tuple[tuple[float, float], ...]
    losses: tuple[Loss, ...]
    period: float
    _D: FloatArray = field(repr=False)
    _N: FloatArray = field(repr=False)

    @property
    def limit(self) -> float:
        """The first loss of stability as the gain grows from zero [N/m]: 0 if at once, inf if never."""
        return self.intervals[0][1] if self.intervals and self.intervals[0][0] == 0.0 else 0.0

    @property
    def loss(self) -> Loss | None:
        """Kind of instability at `limit`; None where it is 0 or inf."""
        return next((loss for loss in self.losses if loss.gain == self.limit), None)

    @property
    def frequency(self) -> float:
        """Frequency at which stability is lost at `limit` [Hz]; nan where it is 0 or inf."""
        return math.nan if self.loss is None else self.loss.frequency

    def is_stable(self, gain: float) -> bool:
        """Tell whether a gain [N/m] lies in one of the intervals."""
        return any(low < gain < high for low, high in self.intervals)

    def margin(self, gain: float) -> tuple[float, float]:
        """Give the factors by which a gain may shrink and grow before stability is lost; (1, 1) for an unstable one.

        The first is 0 where it may shrink to nothing, the second inf where it may grow without end.
        """
        for low, high in self.intervals:
            if low < gain < high:
                return low / gain, high / gain
        return 1.0, 1.0

    def spectral_radius(self, gain: float) -> float:
        """Find the largest |z| of the roots of D + k N, without a motion of everything that no force opposes."""
        s = np.roots((self._D + gain * self._N)[::-1])
        return float(np.abs(1.0 + s).max())


def limits_of(D: FloatArray, N: FloatArray, unit: float, period: float) -> Limits:
    """Find the limits of D + k N, D and N (n + 1,) in ascending powers of s = z - 1; unit: m/T^2 [N/m]."""
    k, y, stable = edges(D, N, unit)
    intervals: list[list[float]] = []
    losses: dict[float, Loss] = {}
    for low, high, at, ok in zip(k[:-1], k[1:], y[1:], stable, strict=True):
        if is_thin(low, high):
            if intervals and intervals[-1][1] == low:
                intervals[-1][1] = float(high)
        elif ok and intervals and intervals[-1][1] == low:
            intervals[-1][1] = float(high)
        elif ok:
            intervals.append([float(low), float(high)])
        if math.isfinite(high):
            losses[float(high)] = _loss(float(high), float(at), period)
    ends = [end for interval in intervals for end in interval if 0.0 < end < math.inf]
    return Limits(tuple((low, high) for low, high in intervals), tuple(losses[end] for end in ends), period, D, N)


def _loss(gain: float, y: float, period: float) -> Loss:
    how: How = "+1" if y == 0.0 else "-1" if y == math.inf else "pair"
    return Loss(gain, math.atan(math.sqrt(y)) / (math.pi * period), how)
