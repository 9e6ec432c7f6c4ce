"""Vibration in a run: residual of Whittaker's smoother, for many signals and in blocks of any length."""

from __future__ import annotations

from functools import lru_cache
from math import ceil, log2, pi, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

VIBRATION_FROM = 5.0  # [Hz]: an operator's own motion stays below
FINEST = 1e-3  # [s]: with shorter periods the smoother's equations are singular up to rounding
REACH = 100.0  # the smoother's response is below 1e-16 beyond REACH / (2 sin(pi f T)) samples
CORE = 1 << 14  # minimum number of samples smoothed together
ORDER = 4  # order of the differences
FEW = 64  # number of equations below which they are solved directly
TOGETHER = 50_000  # numbers filtered together, so that they fit the processor's cache


def vibration(signal: FloatArray, period: float, above: float = VIBRATION_FROM) -> float | None:
    """Return the RMS over ticks and vectors of a signal's part above a frequency.

    This part is x - s for a signal x, where s minimises |x - s|^2 + q |D s|^2. D are the fourth differences, and the
    weight q follows from `above`. The part has the gain 1/(1 + (above/f)^8) at the frequency f, which is that of a
    Butterworth high-pass filter of order 4 that is run forwards and backwards. Whittaker's smoother s, however, follows
    polynomials up to degree 3 exactly, and needs no samples beyond the ends (E. T. Whittaker, On a new method of
    graduation, Proc. Edinburgh Math. Soc. 41, 1923; P. H. C. Eilers, A perfect smoother, Analytical Chemistry 75(14),
    2003). Samples less than 1 ms apart are first averaged over 1 ms.

    Args:
        signal: Signal (N, k, d): k vectors of d components in N samples.
        period: Sampling period T [s].
        above: Lower limit of frequency [Hz].

    Returns:
        RMS in the signal's unit; None if the signal is shorter than two periods of `above`, or sampled too slowly.
        RMS in the signal's unit; None for a signal shorter than two periods of `above`, or sampled too slowly.
    """
    tally = Vibration(period, len(signal), above)
    if len(signal):
        tally.add(signal.reshape(len(signal), -1).T)
    squares = tally.mean_squares()
    return None if squares is None else float(np.sqrt(squares.sum() / signal.shape[1]))


class Vibration:
    """Mean squares of signals' parts above a frequency, from blocks of a run; see `vibration` for these parts.

    A block is smoothed together with the neighbouring samples that influence it (`REACH`). The division into blocks
    therefore changes the results by rounding only. Samples less than 1 ms apart are first averaged over 1 ms.

    Args:
        period: Sampling period [s].
        samples: Number of samples of the run.
        above: Lower limit of frequency [Hz].
        sums: Two ranges of signals. The mean square of the sum of the k-th signals of both ranges is also computed.
    """

    def __init__(
        self, period: float, samples: int, above: float = VIBRATION_FROM, sums: tuple[slice, slice] | None = None
    ) -> None:
        self._group = max(1, int(FINEST / period))
        period *= self._group
        self._count, self._sums = samples // self._group, sums
        self.is_long = 2.0 * above * period < 1.0 and self._count * period * above >= 2.0
        self._seen = self._first = self._used = 0  # samples so far; evaluated and total samples of the buffer
        self._rest: FloatArray | None = None  # incomplete group
        self._buffer: FloatArray | None = None
        self._squares: FloatArray | float = 0.0
        if self.is_long:
            slow = 2.0 * sin(pi * above * period)
            self._q, self._reach = slow**-8, ceil(REACH / slow)

    def add(self, x: FloatArray) -> None:
        """Add r samples of each of k signals, (k, r)."""
        if not self.is_long:
            return
        if self._group > 1:
            x = self._grouped(x)
        if self._buffer is None:
            size = min(self._count, fast_size(2 * self._reach + max(CORE, 6 * self._reach)) - ORDER)
            self._buffer = np.empty((len(x), size))
        room = self._buffer.shape[1]
        while x.shape[1]:
            part = x[:, : room - self._used]
            count = part.shape[1]
            self._buffer[:, self._used : self._used + count] = part
            self._used, self._seen, x = self._used + count, self._seen + count, x[:, count:]
            if self._used == room and self._seen < self._count:
                self._count_up(self._used - self._reach)

    def mean_squares(self) -> FloatArray | None:
        """Return the mean square for each of k signals, and for each sum of two signals, (k + sums,).

        The result is None if the signals are too short or sampled too slowly.
        """
        if not self.is_long or self._buffer is None:
            return None
        if self._used > self._first:
            self._count_up(self._used)
        return np.asarray(self._squares / self._count)

    def _count_up(self, stop: int) -> None:
        """Add the squares of the buffer's samples before `stop`, and keep the samples that influence later ones."""
        assert self._buffer is not None
        rough = roughness(self._buffer[:, : self._used], self._q)[:, self._first : stop]
        squares = _squares(rough)
        if self._sums is not None:
            squares = np.concatenate([squares, _squares(rough[self._sums[0]] + rough[self._sums[1]])])
        self._squares = self._squares + squares
        low = max(stop - self._reach, 0)
        rest = self._buffer[:, low : self._used].copy()
        self._first, self._used = stop - low, rest.shape[1]
        self._buffer[:, : self._used] = rest

    def _grouped(self, x: FloatArray) -> FloatArray:
        whole = x if self._rest is None else np.concatenate([self._rest, x], axis=1)
        count = whole.shape[1] // self._group
        self._rest = whole[:, count * self._group :].copy()
        return np.asarray(whole[:, : count * self._group].reshape(len(x), count, self._group).mean(axis=2))


def _squares(x: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ij,ij->i", x, x))


def roughness(x: FloatArray, q: float) -> FloatArray:
    """Return x - s, where s minimises |x - s|^2 + q |D s|^2, by the formula q D' (q D D' + I)^-1 D x.

    D are the fourth differences. The formula does not subtract nearly equal numbers, so that small residuals are
    accurate.

    Args:
        x: Signals, (k, N), with N > 4 samples each.
        q: Weight of the smoothness of s.
    """
    rough = np.empty(x.shape)
    step = max(1, TOGETHER // x.shape[1])
    for k in range(0, len(x), step):
        z = _solve(q, np.diff(x[k : k + step], ORDER, axis=1))
        np.multiply(np.diff(z, ORDER, axis=1), q, out=rough[k : k + step])
    return rough


def _solve(q: float, b: FloatArray) -> FloatArray:
    """Solve (q D D' + I) z = b for k signals b (k, n); return z between four zeros at either end, (k, n + 8).

    D are the fourth differences. The matrix is a section of a circulant matrix, which is inverted by a Fourier
    transform. Both matrices have the same effect on z if z is zero in four samples at either end. The right-hand side
    in these samples is chosen accordingly.
    """
    k, n = b.shape
    if n < FEW:
        D = np.diff(np.eye(n + ORDER), ORDER, axis=0)
        return np.pad(np.linalg.solve(q * D @ D.T + np.eye(n), b.T).T, ((0, 0), (ORDER, ORDER)))
    whole = np.zeros((k, fast_size(n + 2 * ORDER)))
    whole[:, ORDER : n + ORDER] = b
    inverse = _inverse(q, n, whole.shape[1])
    whole[:, inverse.ends] = -np.linalg.solve(inverse.among, inverse.between @ whole[:, inverse.near].T).T
    return np.fft.irfft(inverse.gain * np.fft.rfft(whole), whole.shape[1])[:, : n + 2 * ORDER]


class Inverse(NamedTuple):
    """Inverse of q D D' + I, where D is the circulant matrix of fourth differences, and q the weight of smoothness.

    Attributes:
        gain: Factors of the inverse by frequency.
        ends: Indices of the first four and the last four samples.
        near: Indices of the samples that are close enough to either end to have an influence there.
        among, between: Entries of the inverse in the rows `ends`, and in the columns `ends` (`among`) or `near`.
    """

    gain: FloatArray
    ends: NDArray[np.intp]
    near: NDArray[np.intp]
    among: FloatArray
    between: FloatArray


@lru_cache(4)
def _inverse(q: float, n: int, size: int) -> Inverse:
    gain = 1.0 / (1.0 + q * (2.0 * np.sin(pi * np.fft.rfftfreq(size))) ** (2 * ORDER))
    column, reach = np.fft.irfft(gain, size), ceil(REACH * q ** (0.5 / ORDER))
    places = np.arange(n + 2 * ORDER)
    ends = np.concatenate([places[:ORDER], places[-ORDER:]])
    near = places[(places < reach) | (places >= n - reach)]
    return Inverse(gain, ends, near, column[ends[:, None] - ends], column[ends[:, None] - near])


def fast_size(least: int) -> int:
    """Return the smallest of the sizes 2^a k, k = 1, 3, 5, 9, 15, that is `least` or more; transforms are then fast."""
    return min(k << max(0, ceil(log2(least / k))) for k in (1, 3, 5, 9, 15))
