"""Gains at which D + k N has a root on the unit circle, and the stable intervals between them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cache
from itertools import zip_longest
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.discrete import plus, times

FloatArray = NDArray[np.float64]
How = Literal["pair", "-1", "+1"]

TRIM = 1e-12  # relative to the largest: smaller leading coefficients are rounding
REAL = 1e-4  # |Im y|/|y| up to which a root counts as real; an extra gain does no harm, a missing gain would
LEAST = 1e-13  # relative to m/T^2: smaller gains are zero
WIDTH = 1e-9  # relative to an interval's upper end: narrower intervals are rounding


@dataclass(frozen=True)
class Loss:
    """End of a stable interval.

    Attributes:
        gain: Gain at the end [N/m].
        frequency: Frequency of the oscillation there [Hz]: 0 for "+1", half the sampling frequency for "-1".
        how: Root that reaches the unit circle: a complex "pair", a root at "-1", or at "+1".
    """

    gain: float
    frequency: float
    how: How


@dataclass(frozen=True, eq=False)
class Limits:
    """Gains k >= 0 for which all roots of D + k N lie inside the unit circle.

    Attributes:
        intervals: Open intervals (low, high) [N/m] in ascending order; high is inf if no gain is too large.
        losses: Losses of stability at the finite non-zero ends of the intervals, in ascending order.
        period: Period T [s].
    """

    intervals: tuple[tuple[float, float], ...]
    losses: tuple[Loss, ...]
    period: float
    _D: FloatArray = field(repr=False)
    _N: FloatArray = field(repr=False)

    @property
    def limit(self) -> float:
        """Smallest gain at which stability is lost [N/m]: 0 if no small gain is stable, inf if every gain is stable."""
        return self.intervals[0][1] if self.intervals and self.intervals[0][0] == 0.0 else 0.0

    @property
    def loss(self) -> Loss | None:
        """Loss of stability at `limit`; None if the limit is 0 or inf."""
        return next((loss for loss in self.losses if loss.gain == self.limit), None)

    @property
    def frequency(self) -> float:
        """Frequency at which stability is lost at `limit` [Hz]; nan if the limit is 0 or inf."""
        return math.nan if self.loss is None else self.loss.frequency

    def is_stable(self, gain: float) -> bool:
        """True if a gain [N/m] lies in one of the intervals."""
        return any(low < gain < high for low, high in self.intervals)

    def margin(self, gain: float) -> tuple[float, float]:
        """Return the factors by which a gain may shrink and grow before stability is lost; (1, 1) for an unstable gain.

        The first factor is 0 if the gain may shrink to zero, the second is inf if the gain may grow without limit.
        """
        for low, high in self.intervals:
            if low < gain < high:
                return low / gain, high / gain
        return 1.0, 1.0

    def spectral_radius(self, gain: float) -> float:
        """Compute the largest |z| of the roots of D + k N, without rigid motions that no force opposes."""
        s = np.roots((self._D + gain * self._N)[::-1])
        return float(np.abs(1.0 + s).max())


def limits_of(D: FloatArray, N: FloatArray, unit: float, period: float) -> Limits:
    """Compute the limits of D + k N, with coefficients (n + 1,) in ascending powers of s = z - 1; unit: m/T^2 [N/m]."""
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


@cache
def to_half_plane(n: int) -> FloatArray:
    """Map coefficients in s of degree n to those in w, z = (1 + w)/(1 - w): s^k -> (2 w)^k (1 - w)^(n - k)."""
    W = np.zeros((n + 1, n + 1))
    for k in range(n + 1):
        row = np.ones(1)
        for _ in range(n - k):
            row = np.convolve(row, [1.0, -1.0])
        W[k, k:] = 2.0**k * row
    return W


def critical_gains(D: FloatArray, N: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Find k and y = tan^2(theta/2), (c, ...), at which D + k N = 0 for z = exp(j theta); non-finite if there is none.

    k is real where Im(N conj D) = 0. Divided by sin theta, this is a polynomial in cos theta; it is solved as a
    polynomial in y, which remains accurate near z = 1, where the roots of slow loops lie. On |z| = 1, w = j sqrt(y) and
    y = (1 - cos theta)/(1 + cos theta). The last two entries belong to z = 1 and z = -1.

    Args:
        D, N: Coefficients in ascending powers of s = z - 1, (n + 1, ...).
    """
    a, b = in_half_plane(D), in_half_plane(N)
    a0, a1, b0, b1 = _alternating(a[::2]), _alternating(a[1::2]), _alternating(b[::2]), _alternating(b[1::2])
    y = positive_roots(plus(times(b1, a0), -times(b0, a1)))
    with np.errstate(all="ignore"):
        A, B, C, E = (_value(c, y) for c in (a0, a1, b0, b1))
        k = -(A * C + y * B * E) / (C * C + y * E * E)
        ends = np.stack([-a[0] / b[0], -a[-1] / b[-1]])
    at = np.zeros(ends.shape)
    at[1] = np.inf
    return np.concatenate([k, ends]), np.concatenate([y, at])


def in_half_plane(D: FloatArray) -> FloatArray:
    """Return the coefficients in w = (z - 1)/(z + 1) of (1 - w)^n D."""
    W = to_half_plane(len(D) - 1)
    return np.stack([sum((w * d for w, d in zip(row, D, strict=True) if w), np.zeros(D.shape[1:])) for row in W.T])


def _alternating(a: FloatArray) -> FloatArray:
    """Convert coefficients in w^2 to coefficients in y = -w^2."""
    value = a.copy()
    value[1::2] *= -1.0
    return value


def _value(a: FloatArray, y: FloatArray) -> FloatArray:
    return np.asarray(np.polynomial.polynomial.polyval(y, a, tensor=False))


def positive_roots(h: FloatArray) -> FloatArray:
    """Find the positive real roots (n, ...) of polynomials with ascending coefficients (n + 1, ...); NaN for others."""
    n = len(h) - 1
    flat = h.reshape(n + 1, -1)
    roots_ = np.full((n, flat.shape[1]), np.nan)
    size = np.abs(flat)
    significant = size > TRIM * size.max(axis=0, initial=0.0)
    degree = np.where(significant.any(axis=0), n - np.argmax(significant[::-1], axis=0), 0)
    for d in range(1, n + 1):
        points = degree == d
        if not points.any():
            continue
        monic = flat[:d, points] / flat[d, points]
        roots = _cubic(monic) if d == 3 else _eigenvalues(monic)
        y = np.where(np.abs(roots.imag) <= REAL * np.abs(roots), roots.real, np.nan)
        roots_[:d, points] = _polished(monic, np.where(y > 0.0, y, np.nan))
    return roots_.reshape(n, *h.shape[1:])


def _eigenvalues(monic: FloatArray) -> NDArray[np.complex128]:
    d = len(monic)
    companion = np.zeros((monic.shape[1], d, d))
    companion[:, np.arange(1, d), np.arange(d - 1)] = 1.0
    companion[:, :, -1] = -monic.T
    return np.linalg.eigvals(companion).astype(complex).T


def _cubic(monic: FloatArray) -> NDArray[np.complex128]:
    """Estimate three roots by Cardano's formula, as start values for `_polished`."""
    c, b, a = monic
    shift = a / 3.0
    p, q = b / 3.0 - shift * shift, shift * shift * shift + 0.5 * (c - shift * b)
    D = q * q + p * p * p
    three = D <= 0.0
    size = np.sqrt(np.maximum(-p, 0.0))
    with np.errstate(all="ignore"):
        angle = np.arccos(np.clip(np.where(size > 0.0, -q / (size * size * size), 0.0), -1.0, 1.0)) / 3.0
    u = -np.copysign(np.cbrt(np.abs(q) + np.sqrt(np.maximum(D, 0.0))), q)
    v = np.where(u != 0.0, -p / np.where(u != 0.0, u, 1.0), 0.0)
    roots = np.empty((3, monic.shape[1]), dtype=complex)
    for k in range(3):
        turn = np.exp(2j * np.pi * k / 3.0)
        roots[k].real = np.where(three, 2.0 * size * np.cos(angle - 2.0 * np.pi * k / 3.0), turn.real * (u + v)) - shift
        roots[k].imag = np.where(three, 0.0, turn.imag * (u - v))
    return roots


def _polished(monic: FloatArray, y: FloatArray, steps: int = 3) -> FloatArray:
    """Apply Newton steps to positive roots where they reduce the polynomial; a closed form has lost digits."""
    h = np.concatenate([monic, np.ones((1, monic.shape[1]))])
    slope: FloatArray = h[1:] * np.arange(1.0, len(h))[:, None]
    with np.errstate(all="ignore"):
        value = _value(h, y)
        for _ in range(steps):
            new = y - value / _value(slope, y)
            next_value = _value(h, new)
            better = (new > 0.0) & (np.abs(next_value) < np.abs(value))
            y, value = np.where(better, new, y), np.where(better, next_value, value)
    return y


def is_stable(D: FloatArray, N: FloatArray, k: FloatArray | float) -> NDArray[np.bool_]:
    """Test whether all roots of D + k N lie inside the unit circle, for gains k (...), by Routh's array in w."""
    return is_hurwitz(in_half_plane(plus(D, k * N)))


def is_hurwitz(a: FloatArray) -> NDArray[np.bool_]:
    """Test whether all roots of polynomials with ascending coefficients (n + 1, ...) have negative real parts."""
    rows = list(a[::-1] * np.sign(a[-1]))
    ok: NDArray[np.bool_] = np.logical_and.reduce([row > 0.0 for row in rows])
    above, row = rows[::2], rows[1::2]
    with np.errstate(all="ignore"):
        for _ in range(len(rows) - 2):
            factor = above[0] / row[0]
            below = [a - factor * b for a, b in zip_longest(above[1:], row[1:], fillvalue=0.0)]
            above, row = row, below
            ok &= row[0] > 0.0
    return ok


def edges(D: FloatArray, N: FloatArray, unit: FloatArray | float) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Return ends k and their y, (c + 2, ...), of the intervals from 0 to inf, and the mask of stable intervals.

    Args:
        D, N: Coefficients as for `critical_gains`, which also defines y.
        unit: Reference stiffness m/T^2 for small gains [N/m].
    """
    k, y = critical_gains(D, N)
    k = np.where(np.isfinite(k) & (k > LEAST * unit), k, np.inf)
    order = np.argsort(k, axis=0)
    k, y = np.take_along_axis(k, order, 0), np.take_along_axis(y, order, 0)
    zero = np.zeros((1, *k.shape[1:]))
    k = np.concatenate([zero, k, zero + np.inf])
    y = np.concatenate([zero, y, zero + np.nan])
    low, high = k[:-1], k[1:]
    some, bounded = np.isfinite(low), np.isfinite(high)
    start = np.where(some, low, 0.0)
    middle = np.where(bounded, 0.5 * (start + np.where(bounded, high, 0.0)), 2.0 * start + unit)
    a, b = in_half_plane(D), in_half_plane(N)
    return k, y, is_hurwitz(a[:, None] + middle * b[:, None]) & some


def first_loss(k: FloatArray, y: FloatArray, stable: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Find the end of the stable gains that start at zero, and y there (`edges`); the end is 0 if there are none."""
    limit, where = np.zeros(k.shape[1:]), np.zeros(k.shape[1:])
    going = np.ones(k.shape[1:], dtype=bool)
    for low, high, at, ok in zip(k[:-1], k[1:], y[1:], stable, strict=True):
        going &= ok | is_thin(low, high)
        limit, where = np.where(going, high, limit), np.where(going, at, where)
    return limit, where


def is_thin(low: FloatArray, high: FloatArray) -> NDArray[np.bool_]:
    """True if two positive bounds agree within rounding."""
    bounded = np.isfinite(high)
    return bounded & (
        np.where(bounded, high - np.where(bounded, low, 0.0), 1.0) <= WIDTH * np.where(bounded, high, 1.0)
    )
