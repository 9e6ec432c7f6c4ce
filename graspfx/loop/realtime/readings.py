"""Readings of devices, checked before anything computes with them, and what else is asked of hardware in a run.

The rules are kernels on `PortState`, which Python's own loop and the one of machine code run alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.kernel import keep_lowerings, kernel, source_function
from graspfx.compile.records import Floats, Record, Table, floats, size_for, start_of, table
from graspfx.errors import InputError, abbreviate
from graspfx.loop.device_calls import FRESH, REPEAT
from graspfx.loop.device_frame import Frame

FloatArray = NDArray[np.float64]

NEAR = 1e-3  # of a position that was zero to the last bit only by chance [m]
FAST, FAR, ZEROS, STALE, NOT_FINITE, FORCE, NO_ASK, NO_READ, NO_WRITE, LATE = range(1, 11)  # why a device is a fault
QUANTITIES = ("positions", "velocities")

MOST_STILL = 1.0  # for a loop without a tick, and
STILL_PERIODS = 20  # periods at least [s]
HANGS = 0.1  # for a call of a device to return, and
WATCHDOGS = 3  # times what the scene's watchdog lets a tick be late


# Guards ---------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Guards:
    """Figures beyond which a run with hardware ends in a fault.

    Attributes:
        speed: the fastest motion of a fingertip along an axis that a reading may tell [m/s]; a hand reaches 5.
        hold: readings in a row without a new sample.
        late: periods in a row that may be skipped.
        soft_start: over which what stands in the way at the start is let in [s].
    """

    speed: float = 10.0
    hold: int = 3
    late: int = 5
    soft_start: float = 0.5

    def __post_init__(self) -> None:
        if not (math.isfinite(self.speed) and self.speed > 0.0):
            raise InputError("speed", self.speed, "a finite speed above zero [m/s]")
        if self.hold < 0 or self.late < 0:
            raise InputError("hold", (self.hold, self.late), "counts of zero or more")
        if not (math.isfinite(self.soft_start) and self.soft_start >= 0.0):
            raise InputError("soft_start", self.soft_start, "a finite time of zero or more [s]")


def patience(period: float, watchdog: float) -> float:
    """Give the time in which a call of a device has to return, while forces are there [s].

    It is some times what a tick may be late, and no more than a loop without a tick is given.

    Args:
        period: T [s].
        watchdog: time by which a tick may be late [s].
    """
    return min(max(MOST_STILL, STILL_PERIODS * period), max(HANGS, WATCHDOGS * watchdog))


GUARDS = Guards()


# The rules ------------------------------------------------------------------------------------------------------------


class PortState(Record):
    """A device between its functions and the tick."""

    fingers: int  # k
    dimensions: int  # d
    entries: int  # k d
    hold: int  # readings in a row without a new sample that are let pass
    period: float  # T [s]
    speed: float  # the fastest motion of a finger along an axis [m/s]
    force: float  # the largest force of a finger [N]
    is_begun: bool  # whether there has been a sample
    is_gone: bool  # whether a call has failed: it is not read again
    is_fresh: bool  # whether the last reading brought a sample
    samples: int
    repeats: int  # readings without one
    row: int  # those in a row
    periods: int  # since the last sample
    why: int  # it is a fault; 0 for none
    code: int  # that a function returned
    figure: float  # that was too much
    bound: float  # it was compared with
    stop_code: int  # of `stop`, if it failed while the device answered; 0 for none
    stop_tick: int  # in which it failed
    ramp: float  # over which the depth at the start is let in [s]
    ramp_ticks: int  # of it so far
    step: float  # from one reading to the next [s]
    is_framed: bool  # whether it stands in axes of its own (`Frame`)
    scale: float  # metres of the scene for a metre of the device
    origin: Floats = floats("dimensions")  # of the device, in the scene [m]
    axes: Table = table("dimensions", "dimensions")  # R, a row for each axis of the scene
    raw: Floats = floats("2 * entries")  # as it was read: positions [m], then velocities [m/s]
    sample: Floats = floats("2 * entries")  # the last one
    placed: Floats = floats("2 * entries")  # the last one as the tick takes it, in the scene's axes
    depth: Floats = floats("entries")  # depth at the start, of which less and less is taken off [m]
    orders: Floats = floats("entries")  # forces, in the scene's axes [N]
    forces: Floats = floats("entries")  # for `write` [N]


@kernel
def fail(port: PortState, why: int, code: int) -> int:
    """Note the first failure of a device, which is gone from then on; give why."""
    port.is_gone = True
    if port.why == 0:
        port.why = why
        port.code = code
    return why


@kernel
def take_sample(port: PortState, code: int, periods: int) -> int:
    """Take a reading over, whole or not at all; give why it is a fault, 0 for none.

    No number leaps: neither a position by more than `speed` T m along an axis, m the periods since the last sample, nor
    a velocity beyond `speed`. Without a new sample the last one holds, up to `hold` times in a row.

    Args:
        port: whose `raw` has the reading.
        code: that `read` returned.
        periods: that have passed since the one before.
    """
    if code < 0 or code > REPEAT:
        return fail(port, NO_READ, code)
    raw, last = port.raw, port.sample
    half = port.entries
    for i in range(2 * half):
        if not math.isfinite(raw[i]):
            return fail(port, NOT_FINITE, i)
    port.periods += periods
    port.is_fresh = code != REPEAT
    if code == REPEAT:
        port.repeats += 1
        port.row += 1
        if port.row > port.hold:
            return fail(port, STALE, port.row)
        return enter(port)
    fastest = 0.0
    empty = True
    for i in range(half):
        fastest = max(fastest, abs(raw[half + i]))
        if raw[i] != 0.0 or raw[half + i] != 0.0:
            empty = False
    port.bound = port.speed
    port.figure = fastest
    if fastest > port.speed:
        return fail(port, FAST, 0)
    if port.is_begun:
        step = 0.0
        for i in range(half):
            step = max(step, abs(raw[i] - last[i]))
        port.figure = step
        port.bound = port.speed * port.period * max(port.periods, 1)
        if step > NEAR and empty:
            return fail(port, ZEROS, 0)
        if step > port.bound:
            return fail(port, FAR, max(port.periods, 1))
    for i in range(2 * half):
        last[i] = raw[i]
    port.is_begun = True
    port.samples += 1
    port.row = 0
    port.periods = 0
    return enter(port)


@kernel
def enter(port: PortState) -> int:
    """Put the last sample into the scene's axes, p = o + s R p_device, set off by what is not let in yet.

    A finger that is inside an object when a run begins has a depth o_0, which leads from where it would just touch to
    where it is: p' = p - (1 - s) o_0, v' = v + s' o_0, s = u^2 (3 - 2 u), u = t/T_s. The force of the first tick is
    zero, and from T_s on all of the depth counts. v' is the rate of p', as damping has it.
    """
    last, placed, half, d = port.sample, port.placed, port.entries, port.dimensions
    for i in range(2 * half):
        placed[i] = last[i]
    if port.is_framed:
        for j in range(port.fingers):
            for a in range(d):
                x = v = 0.0
                for b in range(d):
                    x += last[j * d + b] * port.axes[a, b]
                    v += last[half + j * d + b] * port.axes[a, b]
                placed[j * d + a] = port.origin[a] + port.scale * x
                placed[half + j * d + a] = port.scale * v
    time = port.ramp_ticks * port.step
    if time < port.ramp:
        u = time / port.ramp
        for i in range(half):
            placed[i] -= (1.0 - u * u * (3.0 - 2.0 * u)) * port.depth[i]
            placed[half + i] += 6.0 * u * (1.0 - u) / port.ramp * port.depth[i]
        port.ramp_ticks += 1
    return 0


@kernel
def limit_forces(port: PortState) -> int:
    """Turn `orders` into the device's axes, and limit each finger's force, whole; give why none may be displayed.

    0 is no reason.
    """
    forces, orders, d = port.forces, port.orders, port.dimensions
    for i in range(port.entries):
        forces[i] = orders[i]
    if port.is_framed:
        for j in range(port.fingers):
            for b in range(d):
                f = 0.0
                for a in range(d):
                    f += orders[j * d + a] * port.axes[a, b]
                forces[j * d + b] = port.scale * f
    for i in range(port.entries):
        if not math.isfinite(forces[i]):
            return fail(port, FORCE, 0)
    for j in range(port.fingers):
        square = 0.0
        for a in range(d):
            square += forces[j * d + a] * forces[j * d + a]
        size = math.sqrt(square)
        if size > port.force:
            for a in range(d):
                forces[j * d + a] *= port.force / size
    return 0


# Readings in Python ---------------------------------------------------------------------------------------------------

GONE, IS_FRESH, SAMPLES = (start_of(PortState, name) for name in ("is_gone", "is_fresh", "samples"))


class Readings:
    """The readings of one device, each taken over whole or not at all.

    A reading is a tuple of two float64 arrays (k, d), finite, and of the time at which they were taken. Numbers are
    copied before they are checked: a device may change its arrays at any time.

    Of hardware also the time is looked at, which goes forward, and no number leaps (`take_sample`). A time that has not
    moved on says that there is no new sample.

    Args:
        shape: (k, d).
        period: T [s].
        guards: of hardware; None for a simulation, whose clock is the count of ticks.
        frame: of the device in the scene; None for the scene's own axes.

    Attributes:
        memory: `PortState`.
        position, velocity: of the last sample, (k, d) [m, m/s].
        placed: the two as the tick takes them, in the scene's axes, (2 k d,).
        time: of it [s].
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        period: float,
        guards: Guards | None,
        frame: Frame | None = None,
    ) -> None:
        k, d = self._shape = shape
        _rehearse()
        self._guards = guards
        self.memory: FloatArray = np.zeros(size_for(PortState, entries=k * d, dimensions=d))
        self._numbers: Any = self.memory.data  # plain floats, where items of an array cost twice as much
        self.state = state = PortState(self._numbers)
        state.fingers, state.dimensions, state.entries = k, d, k * d
        state.period = state.step = period
        if guards is not None:
            state.hold, state.speed = guards.hold, guards.speed
        self._is_framed = state.is_framed = frame is not None
        if frame is not None:
            state.scale = frame.scale
            state.array(PortState.origin)[:], state.array(PortState.axes)[:] = frame.origin, frame.axes.ravel()
        self._take: Callable[..., float] = partial(source_function(take_sample), self._numbers)
        self._raw = state.array(PortState.raw).reshape(2, k, d)
        self._last = state.array(PortState.sample).reshape(2, k, d)
        self.position, self.velocity = self._last
        self.placed = state.array(PortState.placed)
        self._flat = self._raw.reshape(-1)
        self.time = -np.inf

    @property
    def is_fresh(self) -> bool:
        """Whether the last reading brought a sample."""
        return bool(self._numbers[IS_FRESH] != 0.0)

    @property
    def samples(self) -> int:
        """Readings that brought a sample."""
        return self.state.samples

    @property
    def repeats(self) -> int:
        """Readings that brought none."""
        return self.state.repeats

    @property
    def is_gone(self) -> bool:
        """Whether a call of the device has failed."""
        return bool(self._numbers[GONE] != 0.0)

    @is_gone.setter
    def is_gone(self, is_it: bool) -> None:
        if not is_it:
            self.state.why = self.state.code = self.state.stop_code = 0
        self.state.is_gone = is_it

    def compile(self) -> None:
        """Check readings by machine code from now on, a third of the time."""
        from graspfx.compile.machine import compiled

        self._take = compiled(take_sample).on(self.memory)

    def let_in(self, depth: FloatArray, duration: float, step: float) -> None:
        """Let a depth at the start in gradually (`enter`).

        Args:
            depth: of each finger, (k, d) [m].
            duration: T_s [s].
            step: from one reading to the next [s].
        """
        self.state.ramp, self.state.ramp_ticks, self.state.step = duration, 0, step
        self.state.array(PortState.depth)[:] = depth.ravel()

    def take(self, reading: object, periods: int = 1) -> str:
        """Take a reading over; return what is wrong with it, or nothing.

        Args:
            reading: as `Device.read` returned it.
            periods: that have passed since the one before.
        """
        if not isinstance(reading, tuple) or len(reading) != 3:
            return f"gave {abbreviate(reading)} for a reading, expected positions, velocities and a time"
        position, velocity, time = reading
        shape, raw = self._shape, self._raw
        for i, each in enumerate((position, velocity)):
            if type(each) is not np.ndarray or each.shape != shape or each.dtype != np.float64:
                return f"gave {_described(each)} for {QUANTITIES[i]}, expected an array {shape} of float64"
            raw[i] = each
        if self._guards is None:
            return self._simulated()
        if not isinstance(time, float) or not isfinite(time):
            return f"gave {abbreviate(time)} for the time of a reading, expected a finite number [s]"
        if time < self.time:
            return f"gave a reading of {time:.9g} s after one of {self.time:.9g} s: its clock ran back"
        code = FRESH if time > self.time else REPEAT
        why = self._take(0, code, periods)
        if why:
            return reading_text(self.state, int(why), time)
        self.time = time
        return ""

    def _simulated(self) -> str:
        """Take over what a simulation has computed: finite numbers of any size."""
        if not all(map(isfinite, self._flat.tolist())):
            return reading_text(self.state, NOT_FINITE)
        self._numbers[IS_FRESH] = 1.0
        self._numbers[SAMPLES] += 1.0
        self._last[...] = self._raw
        if self._is_framed:
            source_function(enter)(self._numbers, 0)
        else:
            self.placed[:] = self._flat
        return ""


@cache
def _rehearse() -> None:
    """Run the rules once: what a kernel needs when it is first called is there before any deadline."""
    memory = np.zeros(size_for(PortState, entries=1, dimensions=1))
    port = PortState(memory.data)
    port.fingers = port.dimensions = port.entries = 1
    port.is_framed, port.ramp = True, 1.0
    source_function(take_sample)(port.buffer, 0, FRESH, 1)
    source_function(take_sample)(port.buffer, 0, NO_READ, 1)
    keep_lowerings()


def reading_text(state: PortState, why: int, time: float | None = None) -> str:
    """Say what is wrong with a reading, by the figures in a device's memory.

    Args:
        state: of the device.
        why: as `take_sample` gave it.
        time: of the reading [s]; None where it has none.
    """
    if why == NOT_FINITE:
        raw = state.array(PortState.raw).reshape(2, state.fingers, state.dimensions)
        i = int(np.isfinite(raw[0]).all())
        return f"gave {abbreviate(raw[i].tolist())} for {QUANTITIES[i]}: numbers that are not finite"
    if why == STALE:
        text = f"gave no new sample in {state.code} readings in a row"
        return text if time is None else f"{text}: each is of {time:.9g} s"
    if why == FAST:
        return f"gave a velocity of {state.figure:.4g} m/s, expected at most {state.bound:g} m/s"
    if why == ZEROS:
        return f"gave zeros for everything, {state.figure:.4g} m from the last position: a reading that failed"
    if why == FORCE:
        forces = state.array(PortState.forces).reshape(state.fingers, state.dimensions)
        return f"is to display {forces.tolist()} N, which is not finite"
    return (
        f"gave a position {state.figure:.4g} m from the last one, expected at most {state.bound:.4g} m "
        f"({state.speed:g} m/s over {state.code} x {state.period:g} s)"
    )


def _described(value: object) -> str:
    """Describe what stands where an array should."""
    if isinstance(value, np.ndarray):
        return f"a {type(value).__name__} {value.shape} of {value.dtype}"
    return f"{abbreviate(value)} ({type(value).__name__})"
