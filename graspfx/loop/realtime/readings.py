"""Readings of a device in plain Python, checked before anything computes with them: nothing is broadcast or coerced."""

from __future__ import annotations

from math import isfinite

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import abbreviate
from graspfx.loop.realtime.guards import Guards

FloatArray = NDArray[np.float64]

NEAR = 1e-3  # of a position that was zero to the last bit only by chance [m]
QUANTITIES = ("positions", "velocities")


class Readings:
    """The readings of one device, each taken over whole or not at all.

    A reading is a tuple of two float64 arrays (k, d), finite, and of the time at which they were taken. Numbers are
    copied before they are checked: a device may change its arrays at any time.

    Of hardware also the time is looked at, which goes forward, and no number leaps: neither a position by more than
    `speed` T m along an axis, m the periods since the last sample, nor a velocity beyond `speed`. A time that has not
    moved on says that there is no new sample: the last one holds, up to `guards.hold` times in a row.

    Args:
        shape: (k, d).
        period: T [s].
        guards: of hardware; None for a simulation, whose clock is the count of ticks.

    Attributes:
        position, velocity: of the last sample, (k, d) [m, m/s].
        time: of it [s].
        is_fresh: whether the last reading brought it.
        samples, repeats: counts of readings that brought one, and of those that did not.
    """

    def __init__(self, shape: tuple[int, ...], period: float, guards: Guards | None) -> None:
        self._shape, self._period, self._guards = shape, period, guards
        self._last, self._copy = np.zeros((2, *shape)), np.zeros((2, *shape))
        self.position, self.velocity = self._last
        self._flat = self._copy.reshape(-1)
        self._entries: list[float] = []  # of the last sample: positions, then velocities
        self.time, self.is_fresh = -np.inf, False
        self.samples = self.repeats = 0
        self._row = self._periods = 0  # readings in a row without a new sample; periods since the last sample

    def take(self, reading: object, periods: int = 1) -> str:
        """Take a reading over; return what is wrong with it, or nothing.

        Args:
            reading: as `Device.read` returned it.
            periods: that have passed since the one before.
        """
        if not isinstance(reading, tuple) or len(reading) != 3:
            return f"gave {abbreviate(reading)} for a reading, expected positions, velocities and a time"
        position, velocity, time = reading
        shape, copy, guards = self._shape, self._copy, self._guards
        for i, each in enumerate((position, velocity)):
            if type(each) is not np.ndarray or each.shape != shape or each.dtype != np.float64:
                return f"gave {_described(each)} for {QUANTITIES[i]}, expected an array {shape} of float64"
            copy[i] = each
        entries: list[float] = self._flat.tolist()
        if not all(map(isfinite, entries)):
            return f"gave {number_text(copy)}: numbers that are not finite"
        if guards is not None:
            if not isinstance(time, float) or not isfinite(time):
                return f"gave {abbreviate(time)} for the time of a reading, expected a finite number [s]"
            self._periods += periods
            if time <= self.time:
                return self._repeat(time, guards)
            text = self._leap(entries, guards.speed)
            if text:
                return text
            self.time, self._entries, self._row, self._periods = time, entries, 0, 0
        self.is_fresh = True
        self.samples += 1
        self._last[...] = copy
        return ""

    @property
    def standing(self) -> tuple[bool, int, int]:
        """Whether there was a sample, readings in a row without one, and periods since the last."""
        return bool(self._entries), self._row, self._periods

    def go_on(self, sample: FloatArray, *, samples: int, repeats: int, row: int) -> None:
        """Go on from what others have read meanwhile.

        Args:
            sample: the last one, positions and velocities, (2 k d,).
            samples, repeats: counts so far.
            row: readings in a row without a new sample.
        """
        self._last[...] = sample.reshape(self._last.shape)
        self._entries = sample.tolist() if samples else self._entries
        self.samples, self.repeats, self._row = samples, repeats, row

    def _repeat(self, time: float, guards: Guards) -> str:
        """Count a reading without a new sample; return what is wrong with it, or nothing."""
        if time < self.time:
            return f"gave a reading of {time:.9g} s after one of {self.time:.9g} s: its clock ran back"
        self.is_fresh = False
        self.repeats += 1
        self._row += 1
        if self._row > guards.hold:
            return stale_text(self._row, time)
        return ""

    def _leap(self, entries: list[float], speed: float) -> str:
        """Find a velocity that no hand has, or a step that none makes in the time."""
        half = len(entries) // 2
        fastest = max(map(abs, entries[half:]))
        if fastest > speed:
            return fast_text(fastest, speed)
        if self._entries:
            bound = speed * self._period * max(self._periods, 1)
            step = max(abs(x - y) for x, y in zip(entries[:half], self._entries, strict=False))
            if step > NEAR and not any(entries):
                return zeros_text(step)
            if step > bound:
                return far_text(step, bound, speed, max(self._periods, 1), self._period)
        return ""


def stale_text(row: int, time: float | None = None) -> str:
    """Say that so many readings in a row brought no new sample."""
    text = f"gave no new sample in {row} readings in a row"
    return text if time is None else f"{text}: each is of {time:.9g} s"


def fast_text(fastest: float, speed: float) -> str:
    """Say that a velocity is beyond a hand's."""
    return f"gave a velocity of {fastest:.4g} m/s, expected at most {speed:g} m/s"


def zeros_text(step: float) -> str:
    """Say that a reading failed without a word."""
    return f"gave zeros for everything, {step:.4g} m from the last position: a reading that failed"


def far_text(step: float, bound: float, speed: float, periods: int, period: float) -> str:
    """Say that a position is further from the last one than a hand comes."""
    return (
        f"gave a position {step:.4g} m from the last one, expected at most {bound:.4g} m "
        f"({speed:g} m/s over {periods} x {period:g} s)"
    )


def _described(value: object) -> str:
    """Describe what stands where an array should."""
    if isinstance(value, np.ndarray):
        return f"a {type(value).__name__} {value.shape} of {value.dtype}"
    return f"{abbreviate(value)} ({type(value).__name__})"


def number_text(copy: FloatArray) -> str:
    """Write the first quantity of a reading that is not finite."""
    i = int(np.isfinite(copy[0]).all())
    return f"{abbreviate(copy[i].tolist())} for {QUANTITIES[i]}"
