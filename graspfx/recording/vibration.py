"""Vibration in a run: residual of Whittaker's smoother, for many signals at once, in blocks of any length."""

from __future__ import annotations

from functools import lru_cache
from math import ceil, comb, pi, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

VIBRATION_FROM = 5.0  # [Hz]: an operator's own motion stays below
FINEST = 1e-3  # [s]: beyond it the smoother's equations are singular to rounding
REACH = 100.0  # over 2 sin(pi f T), in samples: the smoother's response beyond it is below 1e-16
CORE = 1 << 14  # minimum number of samples smoothed together
ORDER = 4  # order of the differences
SQUARED_DIFFERENCES = (70.0, -56.0, 28.0, -8.0, 1.0)  # the diagonals of D D'
FEW = 64  # number of equations below which they are solved directly
TOGETHER = 50_000  # numbers filtered together, so that they fit the processor's cache
NOTHING = 46.0  # -log of the rounding error
SPAN = 16  # samples filtered by one matrix product: too few for BLAS to start threads


def vibration(signal: FloatArray, period: float, above: float = VIBRATION_FROM) -> float | None:
    """Compute the RMS of |x - s| over ticks and rows of x, s minimising |x - s|^2 + q |D s|^2, D fourth differences.

    x - s of Whittaker's smoother equals a Butterworth high-pass of order 4 run forwards and backwards, with the gain
    1/(1 + (above/f)^8), but it removes polynomials up to the third degree exactly and needs no samples beyond the ends
    (E. T. Whittaker, On a new method of graduation, Proc. Edinburgh Math. Soc. 41, 1923; P. H. C. Eilers, A perfect
    smoother, Analytical Chemistry 75(14), 2003). Ticks shorter than 1 ms are first averaged over 1 ms.

    Args:
        signal: Signal (N, k, d): k vectors of d components over time.
        period: Sampling period T [s].
        above: Lower frequency limit [Hz].

    Returns:
        RMS in the signal's unit; None for a signal shorter than two periods of `above`, or sampled too slowly.
    """
    tally = Vibration(period, len(signal), above)
    if len(signal):
        tally.add(signal.reshape(len(signal), -1).T)
    squares = tally.mean_squares()
    return None if squares is None else float(np.sqrt(squares.sum() / signal.shape[1]))


class Vibration:
    """Mean squares of |x - s|, s minimising |x - s|^2 + q |D s|^2, D fourth differences, over a run in blocks.

    A block is smoothed together with the neighbouring samples that influence it (`REACH`), so that the division into
    blocks changes the result by rounding only. Samples closer than 1 ms are first averaged over 1 ms.

    Args:
        period: Sampling period [s].
        samples: Total number of samples.
        above: Lower frequency limit [Hz].
        sums: Pairs of signal indices, for which the mean square of their sum is also computed.
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
        """Add samples of k signals, (k, r)."""
        if not self.is_long:
            return
        if self._group > 1:
            x = self._grouped(x)
        if self._buffer is None:
            size = min(self._count, 2 * self._reach + max(CORE, 6 * self._reach))
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
        """Compute the mean squares of each signal, then of the sums; None if too short or sampled too slowly."""
        if not self.is_long or self._buffer is None:
            return None
        if self._used > self._first:
            self._count_up(self._used)
        return np.asarray(self._squares / self._count)

    def _count_up(self, stop: int) -> None:
        """Evaluate the samples of the buffer up to one; keep those that influence later ones."""
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
    """Compute x - s, s minimising |x - s|^2 + q |D s|^2 with D the fourth differences: q D' (q D D' + I)^-1 D x.

    Nearly equal numbers are not subtracted, so small residuals are accurate. The matrix is that of a filter, L L' with
    the same L in every row, except for a corner of four rows without a past. L L' is solved forwards and backwards, and
    the corner is corrected by Woodbury's identity.

    Args:
        x: Signals, (k, N), N > 4 samples each.
        q: Weight of the penalty.
    """
    rough = np.empty(x.shape)
    step = max(1, TOGETHER // x.shape[1])
    for k in range(0, len(x), step):
        z = np.pad(_solve(q, np.diff(x[k : k + step], ORDER, axis=1)), ((0, 0), (ORDER, ORDER)))
        np.multiply(np.diff(z, ORDER, axis=1), q, out=rough[k : k + step])
    return rough


def _solve(q: float, b: FloatArray) -> FloatArray:
    """Solve (q D D' + I) z = b for signals (k, N - 4)."""
    rows = b.shape[1]
    if rows < FEW:
        return np.asarray(np.linalg.solve(_dense(q, rows), b.T).T)
    both = _factored(q, rows)
    z = both.recursion(both.recursion(b)[:, ::-1])[:, ::-1] / both.gain
    right = np.linalg.solve(np.eye(ORDER) + both.missing @ both.corner[:, :ORDER].T, both.missing @ z[:, :ORDER].T)
    z[:, : both.corner.shape[1]] -= right.T @ both.corner
    return np.asarray(z)


def _dense(q: float, rows: int) -> FloatArray:
    """Return q D D' + I as a dense matrix."""
    diagonals = np.zeros(max(rows, ORDER + 1))
    diagonals[: ORDER + 1] = SQUARED_DIFFERENCES
    return np.asarray(q * diagonals[np.abs(np.arange(rows)[:, None] - np.arange(rows))] + np.eye(rows))


class Factored(NamedTuple):
    """Factors of q D D' + I: gain L' L with a recursion L, and the correction of its corner.

    Attributes:
        recursion: Filter y = L^-1 x.
        gain: Gain of the product.
        corner: Response of the product's inverse to the first four rows, within its reach (4, r).
        missing: Difference of the product from the matrix in these rows (4, 4).
    """

    recursion: Recursion
    gain: float
    corner: FloatArray
    missing: FloatArray


@lru_cache(4)
def _factored(q: float, rows: int) -> Factored:
    """Factorise 1 + q (2 - z - 1/z)^4 into gain A(z) A(1/z), A = prod(1 - z_i / z) with the roots within the circle.

    In closed form: 2 - z - 1/z = c for the four roots c of c^4 = -1/q, and e = 1 - z is a root of e^2 - c e + c.
    """
    c = q**-0.25 * np.exp(0.25j * pi * np.array([1.0, 3.0, 5.0, 7.0]))
    e = 0.5 * (c + np.sqrt(c * c - 4.0 * c))
    e = np.where(np.abs(1.0 - e) > 1.0, c - e, e)
    a = np.ones(1, complex)
    for each in e:  # 1 - z_i / z = e_i + (1 - e_i) d, d = 1 - 1 / z the backward difference
        a = np.convolve(a, [each, 1.0 - each])
    recursion, gain = Recursion(a.real), q / float(np.prod(1.0 - e).real)
    reach = min(rows, int(NOTHING / -np.log(np.abs(1.0 - e).max())) + ORDER)
    unit = np.zeros((ORDER, reach))
    unit[:, :ORDER] = np.eye(ORDER)
    corner = recursion(recursion(unit)[:, ::-1])[:, ::-1] / gain
    missing = _dense(q, ORDER + 1)[:ORDER, :ORDER] - gain * recursion.corner()
    return Factored(recursion, gain, corner, missing)


class Recursion:
    """Filters by a_0 y + a_1 d y + ... + a_4 d^4 y = x, d backward differences, from rest, by products of matrices.

    `SPAN` samples are filtered together, starting from y, d y, d^2 y and d^3 y before them, because differences of
    outputs would lose digits for poles near 1.

    Args:
        a: Coefficients a_0, ..., a_4, whose sum is 1.
    """

    def __init__(self, a: FloatArray) -> None:
        self._a = a
        add = np.triu(np.ones((ORDER, ORDER)))  # d^j y increases by d^(j+1) y, which was updated first
        step = add - np.outer(np.ones(ORDER), a[:ORDER] @ add)
        states = [np.eye(ORDER)]
        for _ in range(SPAN):
            states.append(step @ states[-1])
        self._step = states[SPAN]
        self._of_state = np.array([each[0] for each in states[1:]])  # (SPAN, 4): y
        inputs = np.array([each @ np.ones(ORDER) for each in states[:SPAN]])  # (SPAN, 4): response to earlier impulses
        lag = np.arange(SPAN)[:, None] - np.arange(SPAN)
        self._of_input = np.where(lag >= 0, inputs[np.abs(lag), 0], 0.0)
        self._to_state = inputs[::-1]

    def corner(self) -> FloatArray:
        """Return the first four rows of L L', y = L^-1 x."""
        lag = np.arange(ORDER)[:, None] - np.arange(ORDER)
        difference = np.array([(-1.0) ** k * comb(j, k) for j in range(ORDER + 1) for k in range(ORDER + 1)])
        plain = self._a @ difference.reshape(ORDER + 1, ORDER + 1)
        lower = np.where(lag >= 0, plain[np.abs(lag)], 0.0)
        return np.asarray(lower @ lower.T)

    def __call__(self, x: FloatArray) -> FloatArray:
        """Filter signals (k, N)."""
        k, N = x.shape
        spans = -(-N // SPAN)
        whole = np.zeros((k, spans * SPAN))
        whole[:, :N] = x
        whole = whole.reshape(k, spans, SPAN)
        y = whole @ self._of_input.T
        y += _states(self._step, whole @ self._to_state) @ self._of_state.T
        return np.asarray(y.reshape(k, -1)[:, :N])


def _states(step: FloatArray, inputs: FloatArray) -> FloatArray:
    """Compute s_j+1 = step s_j + inputs_j from rest, (k, M, 4), by products of matrices for several j at once."""
    k, M, n = inputs.shape
    if M == 1:
        return np.zeros_like(inputs)
    count = min(SPAN, M)
    groups = -(-M // count)
    whole = np.zeros((k, groups * count, n))
    whole[:, :M] = inputs
    within, after, last = _powers(step.tobytes(), n, count)
    flat = whole.reshape(k, groups, count * n) @ within
    states = flat[:, :, : count * n] + _states(last, flat[:, :, count * n :]) @ after
    return states.reshape(k, groups * count, n)[:, :M]


@lru_cache(16)
def _powers(content: bytes, n: int, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the matrices of states from inputs (count n, (count + 1) n), and from the previous state."""
    powers = [np.eye(n)]
    for _ in range(count):
        powers.append(np.frombuffer(content).reshape(n, n) @ powers[-1])
    within = np.zeros((count, n, count + 1, n))  # from input i to state j
    for j in range(1, count + 1):
        for i in range(j):
            within[i, :, j] = powers[j - 1 - i].T
    return within.reshape(count * n, -1), np.hstack([each.T for each in powers[:count]]), powers[count]
