"""Intended motions of a hand: rest, a sine, a minimum-jerk reach, a recorded path, levels, and sums of them."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from os import PathLike
from pathlib import Path as FilePath
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.compile.records import entries_of, size_for, size_of, start_of
from graspfx.environment import require_file, to_path
from graspfx.errors import InputError
from graspfx.loop.motion.state import (
    LEVELS,
    OTHER,
    PATH,
    REACH,
    SINE,
    Course,
    Displacement,
    LevelsPart,
    MotionPart,
    OtherPart,
    PathPart,
    ReachPart,
    SinePart,
)
from graspfx.loop.motion.targets import displace
from graspfx.spatial import Vector

FloatArray = NDArray[np.float64]

AXES = ("x", "y", "z")
EXPECTED = "a CSV file with columns t, x[, y[, z]]"
ROUNDING = 1e-12  # relative tolerance for equal times


class Motion(Protocol):
    """Offset from the rest position as a function of time; a one-dimensional motion may also be an angle or a squeeze.

    The unit is m, or rad for an angle.
    """

    @property
    def dimensions(self) -> int | None:
        """Number of dimensions d; None for a motion that is valid in any number of dimensions."""
        ...

    def at(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Return the offset (d,) [m] and the velocity (d,) [m/s] at a time [s]; the shape is (1,) if d is None."""
        ...


class Part(NamedTuple):
    """Term of a motion: the block of a `MotionPart`, or a third-party motion."""

    entries: FloatArray
    source: Motion | None = None


class CourseBlock(NamedTuple):
    """Block of a motion, with the structure of `Course`."""

    entries: FloatArray
    structure: NDArray[np.intp]  # indices of constant entries that select the computation
    others: list[tuple[int, Motion]]  # third-party motions, each with the first entry of its `OtherPart`

    def ask(self, memory: FloatArray, start: int, time: float) -> None:
        """Evaluate the third-party motions at a time [s], and write their values to the block of the motion.

        Args:
            memory: Memory that contains the block.
            start: Entry of the memory at which the block starts.
            time: Time [s].
        """
        for at, motion in self.others:
            part = OtherPart(memory, start + at)
            d, (x, v) = part.dimensions, motion.at(time)
            part.now.array(Displacement.value)[:d] = x
            part.now.array(Displacement.rate)[:d] = v


HEADER = entries_of(MotionPart, "kind", "entries", "count", "dimensions")


def lay_out(parts: Sequence[Part], d: int) -> CourseBlock:
    """Make the block of the sum of these parts in d dimensions."""
    blocks = [part.entries if part.source is None else _other(d) for part in parts]
    first = start_of(Course, "parts")
    starts = [first + sum(map(len, blocks[:k])) for k in range(len(blocks))]
    structure = entries_of(Course, "count", "entries") + [at + entry for at in starts for entry in HEADER]
    others = [(at, part.source) for at, part in zip(starts, parts, strict=True) if part.source is not None]
    front = np.zeros(first)
    course = Course(front)
    course.count, course.entries = len(parts), sum(map(len, blocks))
    return CourseBlock(np.concatenate([front, *blocks]), np.array(structure, dtype=np.intp), others)


def _other(d: int) -> FloatArray:
    part = OtherPart(np.zeros(size_of(OtherPart)))
    part.kind, part.entries, part.dimensions = OTHER, size_of(OtherPart), d
    return part.buffer  # type: ignore[no-any-return] # an array


def parts_of(motion: Motion) -> Sequence[Part]:
    """List the parts of a motion of this package.

    A third-party motion is a single part, and so is an instance of a subclass that overrides `at`.
    """
    if isinstance(motion, _Parts) and type(motion).at is _Parts.at:
        return motion.parts
    return [Part(np.zeros(0), motion)]


class _Parts:
    """Base class of the motions of this package, which are sums of parts that a kernel computes."""

    def __init__(self, dimensions: int | None, parts: Sequence[Part]) -> None:
        self.dimensions = dimensions
        self.parts = tuple(parts)
        self._course = lay_out(parts, dimensions or 1)
        self._now: FloatArray = np.zeros(size_of(Displacement))
        self._block: FloatArray = self._course.entries.copy()

    def at(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Return the offset (d,) [m] and the velocity (d,) [m/s] at a time [s]."""
        d = self.dimensions or 1
        self._course.ask(self._block, 0, time)
        displace(Course(self._block.data), time, Displacement(self._now.data))
        now = Displacement(self._now)
        return now.array(Displacement.value)[:d].copy(), now.array(Displacement.rate)[:d].copy()


class Rest(_Parts):
    """No motion."""

    def __init__(self) -> None:
        super().__init__(None, [])


class Sine(_Parts):
    """Sine x(t) = a s((t - begin) / ramp) sin(2 pi f (t - begin)) along one direction; zero before `begin`.

    s is the minimum-jerk step. If `ramp` is zero, s = 1, and the velocity changes abruptly by 2 pi f a at `begin`.

    Args:
        amplitude: Amplitude a [m].
        frequency: Frequency f [Hz].
        axis: Direction of the motion: a vector (d,) of any length above zero, or the number 0, 1 or 2 of an axis.
        begin: Start time [s].
        ramp: Time during which the amplitude increases to a [s].
        dimensions: Number of dimensions d, required if `axis` is a number.
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
        a = _number("amplitude", amplitude, "a finite length [m]")
        f = _number("frequency", frequency, "a finite frequency above zero [Hz]", above=0.0)
        u = direction(axis, dimensions)
        t = _number("begin", begin, "a finite time [s]")
        fade = _number("ramp", ramp, "a finite time of zero or more [s]", least=0.0)
        part = SinePart(np.zeros(size_of(SinePart)))
        part.kind, part.entries, part.dimensions = SINE, len(part.buffer), len(u)
        part.amplitude, part.angular_frequency, part.begin, part.ramp = a, 2.0 * math.pi * f, t, fade
        part.direction = _padded(u)
        super().__init__(len(u), [Part(part.buffer)])


class Reach(_Parts):
    """Reach x(t) = s((t - begin) / duration) displacement, with the minimum-jerk step s.

    Args:
        displacement: Final offset (d,) [m].
        begin: Start time [s].
        duration: Duration of the step [s].
    """

    def __init__(self, displacement: ArrayLike, begin: float = 0.0, duration: float = 1.0) -> None:
        x = _vector("displacement", displacement, "the finite components (d,) of a displacement [m]")
        t = _number("begin", begin, "a finite time [s]")
        T = _number("duration", duration, "a finite time above zero [s]", above=0.0)
        part = ReachPart(np.zeros(size_of(ReachPart)))
        part.kind, part.entries, part.dimensions = REACH, len(part.buffer), len(x)
        part.begin, part.duration, part.displacement = t, T, _padded(x)
        super().__init__(len(x), [Part(part.buffer)])


class Path(_Parts):
    """Path through given points: a monotone cubic interpolation, constant before the first and after the last point.

    Between the first and the last point, the velocity is continuous and the path does not overshoot. The slopes are
    those of F. N. Fritsch and J. Butland (A method for constructing local monotone piecewise cubic interpolants, SIAM
    J. Scientific and Statistical Computing 5(2), 1984), as in SciPy's PchipInterpolator. If the slope at the first or
    last point is not zero, the velocity is discontinuous at this point.

    Args:
        times: Times of the points (N,), increasing, at least two [s].
        positions: Offsets of the points from the rest position, (N, d), or (N,) for d = 1 [m].
    """

    def __init__(self, times: ArrayLike, positions: ArrayLike) -> None:
        from scipy.interpolate import PchipInterpolator

        t, x = floats("times", times), floats("positions", positions)
        if x.ndim == 1:
            x = x[:, None]
        if t.ndim != 1 or len(t) < 2 or not np.isfinite(t).all() or not (np.diff(t) > 0.0).all():
            raise InputError("times", times, "two or more finite times (N,), strictly increasing [s]")
        if x.ndim != 2 or len(x) != len(t) or not 1 <= x.shape[1] <= 3 or not np.isfinite(x).all():
            raise InputError("positions", positions, f"finite positions (N, d) or (N,), N = {len(t)} as in `times` [m]")
        cubics = np.moveaxis(np.asarray(PchipInterpolator(t, x).c, dtype=float), 1, 0)  # (N - 1, 4, d)
        count, d = x.shape
        part = PathPart(np.zeros(size_for(PathPart, count=count, dimensions=d)))
        part.kind, part.entries, part.count, part.dimensions = PATH, len(part.buffer), count, d
        part.array(PathPart.times)[:] = t
        part.cubics.array(count - 1)[:] = cubics.reshape(count - 1, 4 * d)
        part.array(PathPart.last)[:] = x[-1]
        super().__init__(d, [Part(part.buffer)])

    @classmethod
    def read(cls, file: str | PathLike[str], folder: FilePath | None = None) -> Path:
        """Read a path from a CSV file whose first line contains the column names t, x[, y[, z]].

        The times t are in s, the positions in m.

        Args:
            file: Name of the file, absolute or relative to `folder`.
            folder: Folder to which `file` is relative; None for the current folder.

        Raises:
            InputError: If the file does not exist or has another content; the message names the line of a wrong row.
        """
        path = to_path("path", file, folder=folder)
        require_file("path", str(file), path, EXPECTED)
        try:
            with path.open(newline="", encoding="utf-8") as lines:
                d, table = _table(path, csv.reader(lines))
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise InputError("path", str(file), EXPECTED, str(error)) from error
        values = np.array(table, dtype=float).reshape(-1, d + 1)
        try:
            return cls(values[:, 0], values[:, 1:])
        except InputError as error:
            raise InputError(f"{path}: {error.name}", error.given, error.expected) from error


class Levels(_Parts):
    """One-dimensional motion between levels, which are reached by minimum-jerk steps and held until the next step.

        x(t) = x_(k-1) + s((t - begin_k) / duration_k) (x_k - x_(k-1))    from begin_k to begin_(k+1)

    with the minimum-jerk step s and x_0 = 0.

    Args:
        steps: Rows of a level x_k [m, rad], begin_k [s] and duration_k [s], (N, 3). A step must not begin before the
            previous step has ended. For a duration of zero, x changes abruptly while the velocity remains zero.
    """

    def __init__(self, steps: ArrayLike) -> None:
        table = floats("steps", steps)
        if table.ndim != 2 or table.shape[1] != 3 or len(table) < 1 or not np.isfinite(table).all():
            raise InputError("steps", steps, "rows (N, 3) of finite numbers: a level, its start time and duration [s]")
        begin, duration = table[:, 1], table[:, 2]
        if (duration < 0.0).any() or any(map(overlap, begin, duration, begin[1:])):
            raise InputError(
                "steps", steps, "durations of zero or more, and steps that begin after the end of the previous step"
            )
        part = LevelsPart(np.zeros(size_for(LevelsPart, count=len(begin))))
        part.kind, part.entries, part.count, part.dimensions = LEVELS, len(part.buffer), len(begin), 1
        part.array(LevelsPart.begins)[:], part.array(LevelsPart.durations)[:] = begin, duration
        part.array(LevelsPart.levels)[1:] = table[:, 0]
        super().__init__(1, [Part(part.buffer)])
        self.end = float(begin[-1] + duration[-1])  # time after which nothing moves [s]
        self.last = float(table[-1, 0])


def overlap(begin: float, duration: float, following: float) -> bool:
    """Return whether the next step, which begins at `following`, begins before a step ends, apart from rounding."""
    end = begin + duration
    return following < end - ROUNDING * max(abs(begin), abs(end))


class Sum(_Parts):
    """Sum of motions.

    Args:
        motions: One or more motions with the same number of dimensions.
    """

    def __init__(self, motions: Sequence[Motion]) -> None:
        dimension_set = {motion.dimensions for motion in motions} - {None}
        if not motions or len(dimension_set) > 1:
            numbers = [motion.dimensions for motion in motions]
            raise InputError("motions", numbers, "one or more motions with the same number of dimensions")
        dimensions = dimension_set.pop() if dimension_set else None
        super().__init__(dimensions, [part for motion in motions for part in parts_of(motion)])


def direction(axis: int | ArrayLike, dimensions: int | None = None) -> FloatArray:
    """Compute the unit vector (d,) along a direction.

    Args:
        axis: Vector (d,) other than zero, or the number 0, 1 or 2 of an axis.
        dimensions: Number of dimensions d, required if `axis` is a number.
    """
    if isinstance(axis, int | np.integer) and not isinstance(axis, bool):
        if dimensions is None:
            raise InputError("axis", axis, "a vector (d,)", "if `axis` is a number, also give `dimensions`")
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
        raise InputError("axis", axis, "a vector other than zero")
    u /= largest  # scaled first, so that squares neither overflow nor underflow
    u /= math.hypot(*u)
    return u


def floats(name: str, value: ArrayLike) -> FloatArray:
    """Convert a value to an array of floats; raise InputError if this is not possible."""
    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(name, value, "an array of numbers") from error


def _table(path: FilePath, rows: Any) -> tuple[int, list[list[float]]]:
    """Return the number of dimensions and the rows of a CSV table."""
    names = [name.strip() for name in next(rows, [])]
    d = len(names) - 1
    if not 1 <= d <= 3 or names != ["t", *AXES[:d]]:
        raise InputError(f"{path}:1", ",".join(names), "the column names t,x or t,x,y or t,x,y,z")
    return d, [_row(f"{path}:{rows.line_num}", row, d + 1) for row in rows if row]


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


def _padded(components: FloatArray) -> Vector:
    """Extend a vector to three dimensions with zeros."""
    x, y, z = [*components.tolist(), 0.0, 0.0][:3]
    return Vector(x, y, z)


def _number(name: str, value: float, expected: str, *, above: float = -math.inf, least: float = -math.inf) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise InputError(name, value, expected)
    if not math.isfinite(value) or value <= above or value < least:
        raise InputError(name, value, expected)
    return float(value)
