"""Stable intervals of a gain k, from the gains at which a polynomial D + k N in z has a root on the unit circle."""

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
    """Loss of stability at one end of an interval of stable gains.

    Attributes:
        gain: Gain at the end of the interval [N/m].
        frequency: Frequency of the oscillation at this gain [Hz]: 0 for "+1", half the sampling rate for "-1".
        how: Roots that reach the unit circle: a complex "pair", a real root at z = -1 ("-1"), or one at z = 1 ("+1").
    """

    gain: float
    frequency: float
    how: How


@dataclass(frozen=True, eq=False)
class Limits:
    """Gains k >= 0 at which a sampled loop is stable: all roots of its polynomial D + k N lie inside the unit circle.

    Attributes:
        intervals: Open intervals (low, high) of stable gains [N/m] in ascending order; high is inf for an interval
            without an upper end.
        losses: Losses of stability at the finite non-zero ends of the intervals, in ascending order of gain.
        period: Sampling period [s].
    """

    intervals: tuple[tuple[float, float], ...]
    losses: tuple[Loss, ...]
    period: float
    _D: FloatArray = field(repr=False)
    _N: FloatArray = field(repr=False)

    @property
    def limit(self) -> float:
        """Upper end of the interval of stable gains that starts at 0 [N/m]; 0 if no interval starts at 0."""
        return self.intervals[0][1] if self.intervals and self.intervals[0][0] == 0.0 else 0.0

    @property
    def loss(self) -> Loss | None:
        """Loss of stability at `limit`; None if the limit is 0 or inf."""
        return next((loss for loss in self.losses if loss.gain == self.limit), None)

    @property
    def frequency(self) -> float:
        """Frequency of the oscillation at the gain `limit` [Hz]; nan if the limit is 0 or inf."""
        return math.nan if self.loss is None else self.loss.frequency

    def is_stable(self, gain: float) -> bool:
        """Return whether `gain` [N/m] lies in one of the intervals."""
        return any(low < gain < high for low, high in self.intervals)

    def margin(self, gain: float) -> tuple[float, float]:
        """Return low/gain and high/gain, with the ends (low, high) of the stable interval that contains `gain`.

        The first factor is 0 if every smaller gain is stable, and the second is inf if every larger gain is stable. An
        unstable gain has the factors (1, 1).
        """
        for low, high in self.intervals:
            if low < gain < high:
                return low / gain, high / gain
        return 1.0, 1.0

    def spectral_radius(self, gain: float) -> float:
        """Compute the largest |z| of the roots of D + k N for k = `gain`, without motions that no force opposes."""
        s = np.roots((self._D + gain * self._N)[::-1])
        return float(np.abs(1.0 + s).max())


def limits_of(D: FloatArray, N: FloatArray, unit: float, period: float) -> Limits:
    """Compute the limits of k for D + k N, whose coefficients (n + 1,) are in ascending powers of s = z - 1.

    `unit` is the reference stiffness of `edges` [N/m], and `period` the sampling period [s].
    """
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
    """Return the matrix (n + 1, n + 1) whose row k has the coefficients of (2 w)^k (1 - w)^(n - k).

    This polynomial in w is s^k times (1 - w)^n, for s = z - 1 and z = (1 + w)/(1 - w).
    """
    W = np.zeros((n + 1, n + 1))
    for k in range(n + 1):
        row = np.ones(1)
        for _ in range(n - k):
            row = np.convolve(row, [1.0, -1.0])
        W[k, k:] = 2.0**k * row
    return W


def critical_gains(D: FloatArray, N: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Find the gains k, and y = tan^2(theta/2), at which D + k N = 0 for z = exp(j theta).

    The gain k = -D/N is real where Im(N conj D) = 0. This condition, divided by sin theta, is a polynomial in cos
    theta. It is solved as a polynomial in y = (1 - cos theta)/(1 + cos theta), which is accurate also near z = 1, where
    the roots of slow loops lie. On the unit circle, w = (z - 1)/(z + 1) equals j sqrt(y).

    Args:
        D, N: Coefficients in ascending powers of s = z - 1, (n + 1, ...).

    Returns:
        k and y, each (c, ...). The last two entries belong to z = 1 and z = -1. Where a gain does not exist, k is nan
        or infinite.
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
    """Convert coefficients of D (n + 1, ...) in s = z - 1 to those of (1 - w)^n D in w = (z - 1)/(z + 1)."""
    W = to_half_plane(len(D) - 1)
    return np.stack([sum((w * d for w, d in zip(row, D, strict=True) if w), np.zeros(D.shape[1:])) for row in W.T])


def _alternating(a: FloatArray) -> FloatArray:
    """Convert coefficients of a polynomial in w^2 to coefficients in y = -w^2."""
    value = a.copy()
    value[1::2] *= -1.0
    return value


def _value(a: FloatArray, y: FloatArray) -> FloatArray:
    return np.asarray(np.polynomial.polynomial.polyval(y, a, tensor=False))


def positive_roots(h: FloatArray) -> FloatArray:
    """Find the positive real roots (n, ...), else NaN, of polynomials with ascending coefficients (n + 1, ...)."""
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
    """Estimate the roots (3, points) of monic cubics by Cardano's formula, as start values for `_polished`."""
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
    """Correct the rounding of positive roots y by Newton steps; a step that does not reduce |polynomial| is undone."""
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
    """Test for each gain k (...) whether all roots of D + k N lie inside the unit circle, by Routh's array in w.

    The variable w = (z - 1)/(z + 1) maps the unit disc to the left half-plane.
    """
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
    """Divide the gains from 0 to inf at the critical gains, and test each interval for stability.

    Args:
        D, N: Coefficients as for `critical_gains`.
        unit: Reference stiffness [N/m], device mass over squared period; gains below 1e-13 `unit` count as zero.

    Returns:
        Ends k of the intervals in ascending order and y (`critical_gains`) at each end, both (c + 2, ...), and the mask
        (c + 1, ...) of the stable intervals.
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
    """Find the upper end of the stable gains that start at zero, and y there; the arguments are the result of `edges`.

    The end is 0 if small gains are unstable.
    """
    limit, where = np.zeros(k.shape[1:]), np.zeros(k.shape[1:])
    going = np.ones(k.shape[1:], dtype=bool)
    for low, high, at, ok in zip(k[:-1], k[1:], y[1:], stable, strict=True):
        going &= ok | is_thin(low, high)
        limit, where = np.where(going, high, limit), np.where(going, at, where)
    return limit, where


def is_thin(low: FloatArray, high: FloatArray) -> NDArray[np.bool_]:
    """Return where two positive bounds agree within rounding."""
    bounded = np.isfinite(high)
    return bounded & (
        np.where(bounded, high - np.where(bounded, low, 0.0), 1.0) <= WIDTH * np.where(bounded, high, 1.0)
    )
