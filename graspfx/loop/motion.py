"""Intended motions of a hand: rest, a sine, a minimum-jerk reach, a recorded path, levels, and sums of them."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from csv import reader
from os import PathLike
from pathlib import Path as FilePath
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.errors import InputError

FloatArray = NDArray[np.float64]

AXES = ("x", "y", "z")
ROUNDING = 1e-12  # relative; of times that were meant to be the same


class Motion(Protocol):
    """An offset from where the hand rests, as a function of time; with d = 1 also an angle [rad] or a squeeze [m]."""

    @property
    def dimensions(self) -> int | None:
        """d, or None for a motion that suits any."""
        ...

    def at(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Offset (d,) [m] and its velocity (d,) [m/s] at a time [s]; (1,) for a motion that suits any d."""
        ...


def minimum_jerk(s: float) -> tuple[float, float]:
    """10 s^3 - 15 s^4 + 6 s^5 and its derivative by s; 0 before s = 0, 1 after s = 1.

    The step with the least integral of squared jerk between two states of rest (T. Flash and N. Hogan, The coordination
    of arm movements, J. Neuroscience 5(7), 1985).
    """
    if s <= 0.0:
        return 0.0, 0.0
    if s >= 1.0:
        return 1.0, 0.0
    return s * s * s * (10.0 + s * (6.0 * s - 15.0)), 30.0 * s * s * (1.0 - s) * (1.0 - s)


class Rest:
    """No motion."""

    dimensions = None

    def at(self, time: float) -> tuple[FloatArray, FloatArray]:
        return np.zeros(1), np.zeros(1)


class Sine:
    """x(t) = a s((t - begin) / ramp) sin(2 pi f (t - begin)) along one direction, zero before `begin`.

    s is the minimum-jerk step, 1 throughout when `ramp` is zero: then the velocity jumps by 2 pi f a at `begin`.

    Args:
        amplitude: a [m].
        frequency: f [Hz].
        axis: the direction: a vector (d,) of any length above zero, or 0, 1, 2 for an axis, with `dimensions`.
        begin: [s].
        ramp: over which the amplitude fades in [s].
        dimensions: d, needed when `axis` is a number.
    """

    def __init__(
        self,
        amplitude: float,
        frequency: float,
        axis: int | ArrayLike,
        begin: float = 0.0,
        ramp: float = 0.0,
        *,
        dimensions: int | None = None,
    ) -> None:
        self._a = _number("amplitude", amplitude, "a finite length [m]")
        self._f = _number("frequency", frequency, "a finite frequency above zero [Hz]", above=0.0)
        self._u = direction(axis, dimensions)
        self._begin = _number("begin", begin, "a finite time [s]")
        self._ramp = _number("ramp", ramp, "a finite time of zero or more [s]", least=0.0)
        self.dimensions: int | None = len(self._u)

    def at(self, time: float) -> tuple[FloatArray, FloatArray]:
        t = time - self._begin
        if t < 0.0:
            return 0.0 * self._u, 0.0 * self._u
        s, ds = minimum_jerk(t / self._ramp) if self._ramp > 0.0 else (1.0, 0.0)
        if ds:
            ds /= self._ramp
        w = 2.0 * math.pi * self._f
        sin, cos = math.sin(w * t), math.cos(w * t)
        return self._a * s * sin * self._u, self._a * (s * w * cos + ds * sin) * self._u


class Reach:
    """x(t) = s((t - begin) / duration) displacement, s the minimum-jerk step; it stays there.

    Args:
        displacement: (d,) [m].
        begin: [s].
        duration: [s].
    """

    def __init__(self, displacement: ArrayLike, begin: float = 0.0, duration: float = 1.0) -> None:
        self._x = _vector("displacement", displacement, "the finite components (d,) of a displacement [m]")
        self._begin = _number("begin", begin, "a finite time [s]")
        self._duration = _number("duration", duration, "a finite time above zero [s]", above=0.0)
        self.dimensions: int | None = len(self._x)

    def at(self, time: float) -> tuple[FloatArray, FloatArray]:
        s, ds = minimum_jerk((time - self._begin) / self._duration)
        return s * self._x, ds / self._duration * self._x


class Path:
    """A recorded path: cubic between its points and continuous in velocity, without overshoot; it holds its ends.

    The slopes are those of F. N. Fritsch and R. E. Carlson (Monotone piecewise cubic interpolation, SIAM J. Numerical
    Analysis 17(2), 1980) as SciPy's PchipInterpolator has them. A path that is moving at an end stops there at once.

    Args:
        times: (N,) increasing, two at least [s].
        positions: (N, d), or (N,) for d = 1, offsets from where the hand rests [m].
    """

    def __init__(self, times: ArrayLike, positions: ArrayLike) -> None:
        from scipy.interpolate import PchipInterpolator

        t, x = floats("times", times), floats("positions", positions)
        if x.ndim == 1:
            x = x[:, None]
        if t.ndim != 1 or len(t) < 2 or not np.isfinite(t).all() or not (np.diff(t) > 0.0).all():
            raise InputError("times", times, "two or more finite times (N,), each later than the one before [s]")
        if x.ndim != 2 or len(x) != len(t) or not 1 <= x.shape[1] <= 3 or not np.isfinite(x).all():
            raise InputError("positions", positions, f"finite positions (N, d) or (N,), N = {len(t)} as for times [m]")
        self._times: list[float] = t.tolist()
        self._first, self._last = x[0].copy(), x[-1].copy()
        self._c: FloatArray = np.moveaxis(
            np.asarray(PchipInterpolator(t, x).c, dtype=float), 1, 0
        ).copy()  # (N-1, 4, d)
        self.dimensions: int | None = x.shape[1]

    @classmethod
    def read(cls, file: str | PathLike[str]) -> Path:
        """The path in a CSV file whose first line names the columns t, x[, y[, z]], in s and m."""
        path = FilePath(file)
        if not path.is_file():
            raise InputError("path", str(file), "a CSV file with columns t, x[, y[, z]]", f"there is none at {path}")
        with path.open(newline="", encoding="utf-8") as lines:
            rows = reader(lines)
            names = [name.strip() for name in next(rows, [])]
            d = len(names) - 1
            if not 1 <= d <= 3 or names != ["t", *AXES[:d]]:
                raise InputError(f"{path}:1", ",".join(names), "the column names t,x or t,x,y or t,x,y,z")
            table = [_row(f"{path}:{rows.line_num}", row, d + 1) for row in rows if row]
        values = np.array(table, dtype=float).reshape(-1, d + 1)
        try:
            return cls(values[:, 0], values[:, 1:])
        except InputError as error:
            raise InputError(f"{path}: {error.name}", error.given, error.expected) from error

    def at(self, time: float) -> tuple[FloatArray, FloatArray]:
        if time <= self._times[0] or time >= self._times[-1]:
            end = self._first if time <= self._times[0] else self._last
            return end.copy(), np.zeros_like(end)
        k = bisect_right(self._times, time) - 1
        s = time - self._times[k]
        c3, c2, c1, c0 = self._c[k]
        return ((c3 * s + c2) * s + c1) * s + c0, (3.0 * c3 * s + 2.0 * c2) * s + c1


class Levels:
    """From level to level by minimum-jerk steps, each held until the next begins; zero before the first. d = 1.

        x(t) = x_k-1 + s((t - begin_k) / duration_k) (x_k - x_k-1)    from begin_k on

    Args:
        steps: (N, 3), each x_k, begin_k [s] and duration_k [s]; none begins before the one before it has ended. A
            duration of zero is a jump, which has no velocity.
    """

    dimensions = 1

    def __init__(self, steps: ArrayLike) -> None:
        table = floats("steps", steps)
        if table.ndim != 2 or table.shape[1] != 3 or len(table) < 1 or not np.isfinite(table).all():
            raise InputError("steps", steps, "rows (N, 3) of finite numbers: a level, its beginning and duration [s]")
        begin, duration = table[:, 1], table[:, 2]
        if (duration < 0.0).any() or any(map(overlap, begin, duration, begin[1:])):
            raise InputError("steps", steps, "durations of zero or more, and no step before the end of the one before")
        self._levels: list[float] = [0.0, *table[:, 0].tolist()]
        self._begin: list[float] = begin.tolist()
        self._duration: list[float] = duration.tolist()
        self.end = self._begin[-1] + self._duration[-1]  # [s]; from here on nothing moves
        self.last = self._levels[-1]

    def at(self, time: float) -> tuple[FloatArray, FloatArray]:
        k = bisect_right(self._begin, time) - 1
        before, level = self._levels[max(k, 0)], self._levels[k + 1]
        t = time - self._begin[k]
        if k < 0 or t >= self._duration[k]:
            return np.array([level]), np.zeros(1)
        s, ds = minimum_jerk(t / self._duration[k])
        change = level - before
        return np.array([before + s * change]), np.array([ds / self._duration[k] * change])


def overlap(begin: float, duration: float, following: float) -> bool:
    """Whether what begins `following` does so before this is over, by more than the rounding of 0.1 + 0.2."""
    end = begin + duration
    return following < end - ROUNDING * max(abs(begin), abs(end))


class Sum:
    """Motions that add up.

    Args:
        motions: one at least, all of the same number of dimensions.
    """

    def __init__(self, motions: Sequence[Motion]) -> None:
        known = {motion.dimensions for motion in motions} - {None}
        if not motions or len(known) > 1:
            given = [motion.dimensions for motion in motions]
            raise InputError("motions", given, "one motion at least, all of the same number of dimensions")
        self._motions = tuple(motions)
        self.dimensions: int | None = known.pop() if known else None

    def at(self, time: float) -> tuple[FloatArray, FloatArray]:
        x, v = self._motions[0].at(time)
        for motion in self._motions[1:]:
            dx, dv = motion.at(time)
            x, v = x + dx, v + dv
        return x, v


def direction(axis: int | ArrayLike, dimensions: int | None = None) -> FloatArray:
    """The unit vector (d,) along a vector of any length, or along the axis 0, 1 or 2 of `dimensions`."""
    if isinstance(axis, int | np.integer) and not isinstance(axis, bool):
        if dimensions is None:
            raise InputError("axis", axis, "a vector (d,)", "or give `dimensions` with the number of an axis")
        if not 0 <= axis < dimensions:
            raise InputError("axis", axis, f"a number from 0 to {dimensions - 1}, or a vector ({dimensions},)")
        u = np.zeros(dimensions)
        u[axis] = 1.0
        return u
    u = _vector("axis", axis, "the finite components (d,) of a direction")
    if dimensions is not None and len(u) != dimensions:
        raise InputError("axis", axis, f"a vector of {dimensions} components")
    largest = np.abs(u).max()
    if largest == 0.0:
        raise InputError("axis", axis, "a direction, not the zero vector")
    u /= largest  # first, so that squares neither overflow nor vanish
    u /= math.hypot(*u)
    return u


def floats(name: str, value: ArrayLike) -> FloatArray:
    """An array of floats from what a caller gave, or InputError."""
    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(name, value, "an array of numbers") from error


def _row(place: str, row: list[str], count: int) -> list[float]:
    expected = f"{count} finite numbers"
    try:
        values = [float(cell) for cell in row]
    except ValueError as error:
        raise InputError(place, ",".join(row), expected) from error
    if len(values) != count or not all(map(math.isfinite, values)):
        raise InputError(place, ",".join(row), expected)
    return values


def _vector(name: str, value: ArrayLike, expected: str) -> FloatArray:
    x = floats(name, value)
    if x.ndim != 1 or not 1 <= len(x) <= 3 or not np.isfinite(x).all():
        raise InputError(name, value, expected)
    return x


def _number(name: str, value: float, expected: str, *, above: float = -math.inf, least: float = -math.inf) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise InputError(name, value, expected)
    if not math.isfinite(value) or value <= above or value < least:
        raise InputError(name, value, expected)
    return float(value)
