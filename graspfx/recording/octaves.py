"""Analysis of motions in octaves of frequency: exponential growth, divergence, and sustained oscillation."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.recording.vibration import roughness

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Rows = Callable[[int, int], FloatArray]  # function that returns rows `first` to `stop` - 1, (r, c)

ORDER = 6  # order of the differences, which reduce a component at 1/16 of the sampling rate to 6e-5
HALVING = 4  # order of the sums that form the octave below
WINDOW = 4  # samples per window, one to two cycles
SHORTEST = 6  # smallest number of windows for growth
BLOCK = 4096  # rows per block, which fit into the processor's cache
LEAST_GROWTH = 2.0  # smallest growth of the log amplitude
STRAIGHT = 0.12  # largest RMS deviation of log amplitude from a line, relative to the growth
MOST_ASTRAY = 0.4  # largest RMS deviation of log amplitude from a line; more indicates a jump
LENGTHENING = 1.5
STRIDES = 6  # number of starts per length of an interval
END = 16  # [samples]
TINY = 1e-300


class Stretch(NamedTuple):
    """A range of windows of an octave in which the log amplitude grows along a line.

    Attributes:
        first: Index of the first window.
        length: Number of windows.
        growth: Growth of the log amplitude over the range.
    """

    first: int
    length: int
    growth: float


class Octave:
    """A motion, sampled at half the rate of the octave above, and the amplitude of its part at high frequencies.

    Attributes:
        step: Sampling period [s].
        size: Number of samples.
        begin: Time of the first sample [s].
        is_highest: Whether the samples are those of the original motion.
        logs: Log amplitude in each window, (windows,), computed by the Teager-Kaiser operator x_k^2 - x_(k-1) x_(k+1),
            which is constant for a sine. The highest octave has a second array, computed from squares, because the
            operator is zero for a motion that alternates from sample to sample.
    """

    def __init__(self, rows: Rows, size: int, step: float, begin: float = 0.0, *, highest: bool = False) -> None:
        self.step, self.size, self.begin, self.is_highest = step, size, begin, highest
        self._rows = rows
        self._lower: list[FloatArray] = []
        self.logs = self._sizes(highest)

    def fast(self, first: int, stop: int) -> FloatArray:
        """Return the part at high frequencies at samples `first` to `stop - 1`: the sixth differences divided by 64."""
        x = self._rows(max(first - ORDER // 2, 0), min(stop + ORDER // 2, self.size))
        return np.diff(x, ORDER, axis=0) / 2.0**ORDER

    def samples(self) -> FloatArray:
        """Return all samples, (r, c)."""
        return self._rows(0, self.size)

    def size_before(self, time: float) -> float:
        """Return the RMS of the part at high frequencies over the last 16 samples before a time [s]."""
        stop = min(max(int((time - self.begin) / self.step), END), self.size)
        return float(np.sqrt((self.fast(stop - END, stop) ** 2).mean()))

    def windows(self, first: int, count: int) -> FloatArray:
        """Return the part at high frequencies in `count` windows from the window `first` on."""
        begin = ORDER // 2 + 1 + first * WINDOW
        return self.fast(begin, begin + count * WINDOW)

    def time(self, window: int) -> float:
        """Return the start time of a window [s]."""
        return self.begin + (ORDER // 2 + 1 + window * WINDOW) * self.step

    def below(self) -> Octave | None:
        """Return the octave below; None if it would have too few samples for the detection of growth."""
        x = np.concatenate(self._lower) if self._lower else np.empty((0, 0))
        if len(x) < WINDOW * SHORTEST + ORDER + 2:
            return None
        self._lower = []
        return Octave(lambda a, b: x[a:b], len(x), 2.0 * self.step, self.begin + HALVING / 2 * self.step)

    def _sizes(self, highest: bool) -> list[FloatArray]:
        """Compute the log amplitudes block by block, so that little more than half of the samples are in memory."""
        sizes: list[list[FloatArray]] = [[], []]
        for begin in range(0, self.size, BLOCK):
            stop = min(begin + BLOCK, self.size)
            x = self._rows(begin, min(stop + ORDER + 2, self.size))
            low = x
            for _ in range(HALVING):
                low = low[1:] + low[:-1]
            self._lower.append(low[: stop - begin : 2] / 2.0**HALVING)
            y = np.diff(x, ORDER, axis=0)
            count = (len(y) - 2) // WINDOW
            if count < 1:
                continue
            y = y[: count * WINDOW + 2]
            squares = y[1:-1] ** 2
            if highest:
                sizes[1].append(squares.reshape(count, -1).sum(axis=1))
            squares -= y[:-2] * y[2:]
            sizes[0].append(np.abs(squares.reshape(count, -1).sum(axis=1)))
        return [0.5 * np.log(np.concatenate(part) / WINDOW + TINY) - ORDER * math.log(2.0) for part in sizes if part]


def octaves(rows: Rows, size: int, step: float) -> Iterator[Octave]:
    """Yield the octaves of a motion, from the highest, which ends at half the sampling rate, to the lowest.

    Args:
        rows: Function that returns a range of rows of the motion, (r, c); it is called block by block.
        size: Number of rows.
        step: Sampling period [s].
    """
    if size < WINDOW * SHORTEST + ORDER + 2:
        return
    octave: Octave | None = Octave(rows, size, step, highest=True)
    while octave is not None:
        yield octave
        octave = octave.below()


def rises(logs: FloatArray) -> list[Stretch]:
    """Find intervals in which the log amplitude grows by 2 or more along a line; one interval for each length at most.

    Of the intervals of a length, the one with the largest growth is returned. The lengths increase by factors of 1.5,
    and the starts are one sixth of the length apart. Lines are fitted by least squares from precomputed sums.
    """
    n, stretches = len(logs), []
    level = logs - (logs.mean() if n else 0.0)
    sums = [np.concatenate([[0.0], np.cumsum(part)]) for part in (level, level**2, level * np.arange(n))]
    length = SHORTEST
    while length <= n:
        first = np.arange(0, n - length + 1, max(1, length // STRIDES))
        mean, square, moment = ((part[first + length] - part[first]) / length for part in sums)
        spread = (length * length - 1) / 12.0
        slope = (moment - mean * (first + (length - 1) / 2.0)) / spread
        stray = np.sqrt(np.maximum(square - mean**2 - slope**2 * spread, 0.0))
        growth = slope * length
        growth[(growth < LEAST_GROWTH) | (stray > np.minimum(STRAIGHT * growth, MOST_ASTRAY))] = -np.inf
        best = int(np.argmax(growth))
        if growth[best] > 0.0:
            stretches.append(Stretch(int(first[best]), length, float(growth[best])))
        length = max(length + 1, int(LENGTHENING * length))
    return stretches


def poles(y: FloatArray, growth: float, rank: int) -> tuple[NDArray[np.complex128], float]:
    """Fit the poles z_i of y_k = sum_i c_i z_i^k; return them and the explained share of y_k exp(-growth k).

    The method is ESPRIT (R. Roy and T. Kailath, ESPRIT, IEEE Trans. ASSP 37(7), 1989), applied to y_k exp(-growth k),
    so that the beginning and the end of the signals have equal weight. Signals whose phase changes randomly, such as
    noise, have a small explained share.

    Args:
        y: Signals, (M, c).
        growth: Growth of the log amplitude per sample.
        rank: Number of poles; an oscillation has two.
    """
    d = y * np.exp(-growth * np.arange(len(y)))[:, None]
    rows = min(10, len(d) // 2)
    count = len(d) - rows + 1
    hankel = np.stack([d[i : i + count].ravel() for i in range(rows)])
    sizes, vectors = np.linalg.eigh(hankel @ hankel.T)
    U = vectors[:, -rank:]
    z = np.linalg.eigvals(np.linalg.lstsq(U[:-1], U[1:], rcond=None)[0])
    total = float(sizes.sum())
    share = float(sizes[-rank:].sum()) / total if total > 0.0 else 0.0
    return np.asarray(z * math.exp(growth), dtype=np.complex128), share


def amplitudes(y: FloatArray, z: complex, others: Sequence[complex] = ()) -> NDArray[np.complex128]:
    """Fit the complex amplitudes c (c,) of y_k = Re(c z^k + c_1 z_1^k + ...), (M, c), where z_1, ... are `others`.

    The fit is by least squares of y_k |z|^-k, so that all poles must have magnitudes near that of z.
    """
    k = np.arange(len(y), dtype=float)
    phases = np.stack([(each / abs(z)) ** k for each in (z, *others)], axis=1)
    basis = np.concatenate([phases.real, -phases.imag], axis=1)
    level = y * np.exp(-math.log(abs(z)) * k)[:, None]
    parts = np.linalg.lstsq(basis, level, rcond=None)[0]
    return np.asarray(parts[0] + 1j * parts[1 + len(others)], dtype=np.complex128)


def gain(frequency: float, octave: Octave, step: float) -> float:
    """Return the ratio of a sine's amplitude in the part at high frequencies of an octave to its original amplitude.

    Args:
        frequency: Frequency of the sine [Hz].
        octave: Octave.
        step: Sampling period of the original motion [s].
    """
    share, T = 1.0, step
    for _ in range(round(math.log2(octave.step / step))):
        share *= abs(math.cos(math.pi * frequency * T)) ** HALVING
        T *= 2.0
    return share * abs(math.sin(math.pi * frequency * T)) ** ORDER


# Divergence without oscillation, such as that of a grasp squeezed beyond its limit ---------------------------------

MOST_SAMPLES = 600  # largest number of samples of a searched octave; longer motions are searched in lower octaves
GROWTH_AWAY = 4.5  # smallest growth of the log amplitude
SHARE_AWAY = 0.99  # fraction of an interval, after removal of growth, that one real pole must explain
AGREEMENT_AWAY = 0.2  # relative agreement of the pole's rate with the growth of the windows


class Divergence(NamedTuple):
    """An interval of an octave in which a motion grows by the factor z per sample, without oscillation.

    Attributes:
        octave: Octave.
        stretch: Range of the windows in the interval.
        z: Factor of growth per sample.
        last: Second differences of the motion at the end of the interval, (c,).
    """

    octave: Octave
    stretch: Stretch
    z: float
    last: FloatArray

    @property
    def begin(self) -> float:
        """Start time of the interval [s]."""
        return self.octave.begin + (1 + self.stretch.first * WINDOW) * self.octave.step

    @property
    def end(self) -> float:
        """End time of the interval [s]."""
        return self.begin + self.stretch.length * WINDOW * self.octave.step

    @property
    def swing(self) -> FloatArray:
        """Motion at the end of the interval, (c,): the second differences of z^k are z^k (z - 2 + 1/z)."""
        return self.last / (self.z - 2.0 + 1.0 / self.z)


def divergences(octave: Octave) -> list[Divergence]:
    """Find the divergences in an octave; return none if the octave has more than MOST_SAMPLES samples."""
    if octave.size > MOST_SAMPLES:
        return []
    y = np.diff(octave.samples(), 2, axis=0)
    count = len(y) // WINDOW
    squares = (y[: count * WINDOW] ** 2).reshape(count, -1).sum(axis=1)
    ways = []
    for stretch in rises(0.5 * np.log(squares + TINY)):
        if stretch.growth < max(GROWTH_AWAY, LEAST_GROWTH):
            continue
        part = y[stretch.first * WINDOW : (stretch.first + stretch.length) * WINDOW]
        growth = stretch.growth / len(part)
        (z,), share = poles(part, growth, 1)
        rate = math.log(z.real) if z.real > 0.0 else 0.0
        if share >= SHARE_AWAY and abs(rate - growth) < AGREEMENT_AWAY * growth and z.imag == 0.0:
            ways.append(Divergence(octave, stretch, float(z.real), part[-1]))
    return ways


# Contacts that separate and close in every cycle of a sustained oscillation ----------------------------------------

LEAST_TOUCHES = 12  # smallest number of successive touches of a finger
LONGEST_PAUSE = 3.0  # longest pause between touches, as a multiple of the median
STEADY = 0.7  # fraction of the first half's amplitude that the second half must keep
MOST_ROWS = 4096  # number of rows from which a frequency is computed
CYCLES = 8  # longest assumed cycle of a motion, in touches
SLOWEST = 0.03  # 2 sin(pi f) for f cycles per row, below which the smoother's equations are singular up to rounding


class Ringing(NamedTuple):
    """A sustained oscillation of contacts.

    Attributes:
        first, stop: Range of rows.
        turn: Frequency, in cycles per row.
        swing: Complex amplitudes of the motion, (c,).
    """

    first: int
    stop: int
    turn: float
    swing: NDArray[np.complex128]


def touches(touching: BoolArray) -> list[tuple[int, int, int]]:
    """Return the longest sequence of touches without a long pause, for each finger: first row, stop row, count.

    Sequences of fewer than LEAST_TOUCHES touches are omitted.
    """
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
    """Find a sustained oscillation that is larger than the noise of the sensor; None if there is none.

    If cycles are long, the rows are first averaged in groups.

    Args:
        displacement: Displacements in the rows from `first` on, (M, c) [m].
        first: Index of the first row.
        count: Number of touches in these rows.
        noise: RMS noise of the measured positions [m].
    """
    x = displacement[-MOST_ROWS:]
    slow = _slow(len(x), count * len(x) / len(displacement))
    group = max(1, int(np.ceil(SLOWEST / slow)))
    x = x[len(x) % group :].reshape(-1, group, x.shape[1]).mean(axis=1)
    M = len(x)
    fast = roughness(x.T, _slow(M, count * M * group / len(displacement)) ** -8).T
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
    """Return 2 sin(pi f) for the lowest possible frequency f, in cycles per row, of `count` touches in `rows` rows."""
    return float(2.0 * np.sin(np.pi * min(max(LEAST_TOUCHES / 2, count / CYCLES) / rows, 0.25)))
