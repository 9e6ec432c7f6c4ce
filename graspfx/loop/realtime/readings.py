"""Validation of device readings before they are used, and the other checks of hardware during a run.

The rules are kernels on `PortState`, used by both the Python loop and the native loop.
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
from graspfx.loop.device import FRESH, REPEAT
from graspfx.loop.device_mount import Frame

FloatArray = NDArray[np.float64]

NEAR = 1e-3  # distance from zero within which an all-zero reading is plausible [m]
FAST, FAR, ZEROS, STALE, NOT_FINITE, FORCE, NO_ASK, NO_READ, NO_WRITE, LATE = range(1, 11)  # causes of a device's fault
QUANTITIES = ("positions", "velocities")

MOST_STILL = 1.0  # longest stall of a loop [s]
STILL_PERIODS = 20  # or this number of periods, if it is longer
HANGS = 0.1  # least time granted to a device's call [s]
WATCHDOGS = 3  # or this multiple of the scene's watchdog time, if it is longer


# Guards ---------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Guards:
    """Limits beyond which a run with hardware ends in a fault.

    Attributes:
        speed: Largest plausible speed of a fingertip along an axis [m/s]; a hand reaches 5 m/s.
        hold: Number of successive readings without a new sample that are tolerated.
        late: Number of successive periods that may be skipped.
        soft_start: Time over which an initial penetration gradually takes effect [s].
    """

    speed: float = 10.0
    hold: int = 3
    late: int = 5
    soft_start: float = 0.5

    def __post_init__(self) -> None:
        if not (math.isfinite(self.speed) and self.speed > 0.0):
            raise InputError("speed", self.speed, "a finite speed above zero [m/s]")
        if self.hold < 0 or self.late < 0:
            raise InputError("hold", (self.hold, self.late), "`hold` and `late` of zero or more")
        if not (math.isfinite(self.soft_start) and self.soft_start >= 0.0):
            raise InputError("soft_start", self.soft_start, "a finite time of zero or more [s]")


def patience(period: float, watchdog: float) -> float:
    """Return the time within which a device's function must return while forces are displayed [s].

    This time is three times the watchdog time, but at least 0.1 s, and at most the longest stall of a loop: 1 s or 20
    periods, whichever is longer.

    Args:
        period: Sampling period T [s].
        watchdog: Lateness that the watchdog permits [s].
    """
    return min(max(MOST_STILL, STILL_PERIODS * period), max(HANGS, WATCHDOGS * watchdog))


GUARDS = Guards()


# The rules ------------------------------------------------------------------------------------------------------------


class PortState(Record):
    """State of a device's exchange with the tick."""

    fingers: int  # k
    dimensions: int  # d
    entries: int  # k d
    hold: int  # number of successive readings without a new sample that are tolerated
    period: float  # sampling period T [s]
    speed: float  # largest speed of a finger along an axis [m/s]
    force: float  # largest force of a finger [N]
    is_begun: bool  # whether there has been a sample
    is_gone: bool  # whether a call has failed; the device is then not read again
    is_asked: bool  # whether the device was asked, and since then neither written to nor stopped
    is_fresh: bool  # whether the last reading brought a sample
    samples: int
    repeats: int  # readings without a new sample
    row: int  # successive readings without a new sample
    periods: int  # periods since the last sample
    why: int  # cause of the fault, 0 without one
    code: int  # value returned by the function that failed, or another number for the message
    figure: float  # value that exceeded a bound
    bound: float  # that bound
    stop_code: int  # value returned by a `stop` that failed although the device answered; 0 otherwise
    stop_tick: int  # tick in which `stop` failed
    ramp: float  # time over which the initial depth takes effect [s]
    ramp_ticks: int  # ticks of that time so far
    step: float  # time between readings [s]
    is_framed: bool  # whether the device has its own axes (`Frame`)
    scale: float  # metres in the scene per metre of the device
    origin: Floats = floats("dimensions")  # origin of the device in the scene [m]
    axes: Table = table("dimensions", "dimensions")  # rotation R, one row for each axis of the scene
    raw: Floats = floats("2 * entries")  # values as read: positions [m], then velocities [m/s]
    sample: Floats = floats("2 * entries")  # last sample
    placed: Floats = floats("2 * entries")  # last sample in the scene's axes, the input of the tick
    depth: Floats = floats("entries")  # initial depth, of which a decreasing part is subtracted [m]
    orders: Floats = floats("entries")  # forces in the scene's axes [N]
    forces: Floats = floats("entries")  # forces for `write` [N]


@kernel
def fail(port: PortState, why: int, code: int) -> int:
    """Record the first failure of a device, which is not read again; return its cause."""
    port.is_gone = True
    if port.why == 0:
        port.why = why
        port.code = code
    return why


@kernel
def take_sample(port: PortState, code: int, periods: int) -> int:
    """Accept a reading as a whole or reject it; return the cause of a fault, 0 for none.

    A position may change by at most `speed` T m along an axis, where m is the number of periods since the last sample.
    A velocity may be at most `speed` along an axis. A reading of zeros alone must be within 1 mm of the last sample.
    Without a new sample the last sample is kept, up to `hold` times in succession.

    Args:
        port: State of the device, with the reading in `raw`.
        code: Value returned by `read`.
        periods: Periods since the previous reading.
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
    """Transform the last sample into the scene's axes (`Frame`), and subtract the depth that is not yet in effect.

    A finger that is inside an object when a run begins has an initial depth e, the vector from the nearest point
    without contact to its position p. It is placed at p - (1 - w) e with velocity v + dw/dt e, where w = u^2 (3 - 2 u),
    u = t/T_s, and t is the time of the ticks so far. The force of the first tick is zero; from T_s on the whole depth
    is in effect. Damping uses the velocity of the place.
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
    """Transform `orders` into the device's axes, reduce forces to their limit, and return the cause of a fault.

    The cause is 0 if the forces may be displayed.
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
    """The readings of one device, each accepted as a whole or rejected.

    A reading is a tuple of positions [m] and velocities [m/s], two finite float64 arrays (k, d), and the time [s] at
    which they were taken. The arrays are copied before they are checked, because a device may change them at any time.

    For hardware, time must not decrease and values must not jump (`take_sample`). An unchanged time means that there is
    no new sample.

    Args:
        shape: Shape (k, d) of the positions: fingers and dimensions.
        period: Sampling period T [s].
        guards: Guards of hardware; None for a simulation, whose clock is the tick counter.
        frame: Frame of the device in the scene; None for the scene's frame.

    Attributes:
        memory: State of the device, `PortState`.
        position, velocity: Position [m] and velocity [m/s] of the last sample (k, d).
        placed: Both in the scene's axes (2 k d,), the input of the tick.
        time: Time of the last sample [s].
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
        self._numbers: Any = self.memory.data  # plain floats, because access to items of an array takes twice as long
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
        """Whether the last reading contained a new sample."""
        return bool(self._numbers[IS_FRESH] != 0.0)

    @property
    def samples(self) -> int:
        """Number of readings with a new sample."""
        return self.state.samples

    @property
    def repeats(self) -> int:
        """Number of readings without a new sample."""
        return self.state.repeats

    @property
    def is_gone(self) -> bool:
        """Whether a call of the device has failed."""
        return bool(self._numbers[GONE] != 0.0)

    @is_gone.setter
    def is_gone(self, is_it: bool) -> None:
        if not is_it:
            self.state.why = self.state.code = self.state.stop_code = 0
            self.state.is_asked = False
        self.state.is_gone = is_it

    def compile(self) -> None:
        """Check readings by machine code from now on, which takes a third of the time."""
        from graspfx.compile.machine import compiled

        self._take = compiled(take_sample).on(self.memory)

    def let_in(self, depth: FloatArray, duration: float, step: float) -> None:
        """Let the initial depth take effect gradually (`enter`).

        Args:
            depth: Initial depth of each finger (k, d) [m].
            duration: Duration T_s [s].
            step: Time between readings [s].
        """
        self.state.ramp, self.state.ramp_ticks, self.state.step = duration, 0, step
        self.state.array(PortState.depth)[:] = depth.ravel()

    def take(self, reading: object, periods: int = 1) -> str:
        """Accept or reject a reading; return a description of the error, or an empty string.

        Args:
            reading: Reading as returned by `Device.read`.
            periods: Periods since the previous reading.
        """
        if not isinstance(reading, tuple) or len(reading) != 3:
            return f"returned {abbreviate(reading)} for a reading, expected positions, velocities and a time"
        position, velocity, time = reading
        shape, raw = self._shape, self._raw
        for i, each in enumerate((position, velocity)):
            if type(each) is not np.ndarray or each.shape != shape or each.dtype != np.float64:
                return f"returned {_described(each)} for {QUANTITIES[i]}, expected an array {shape} of float64"
            raw[i] = each
        if self._guards is None:
            return self._simulated()
        if not isinstance(time, float) or not isfinite(time):
            return f"returned {abbreviate(time)} for the time of a reading, expected a finite number [s]"
        if time < self.time:
            return f"returned a reading of {time:.9g} s after one of {self.time:.9g} s: its clock ran backwards"
        code = FRESH if time > self.time else REPEAT
        why = self._take(0, code, periods)
        if why:
            return reading_text(self.state, int(why), time)
        self.time = time
        return ""

    def _simulated(self) -> str:
        """Accept the values of a simulation if they are finite."""
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
    """Run the rules once, so that the set-up time of a kernel's first call does not delay a tick."""
    memory = np.zeros(size_for(PortState, entries=1, dimensions=1))
    port = PortState(memory.data)
    port.fingers = port.dimensions = port.entries = 1
    port.is_framed, port.ramp = True, 1.0
    source_function(take_sample)(port.buffer, 0, FRESH, 1)
    source_function(take_sample)(port.buffer, 0, NO_READ, 1)
    keep_lowerings()


def reading_text(state: PortState, why: int, time: float | None = None) -> str:
    """Return a description of a faulty reading, with the values in the device's memory.

    Args:
        state: State of the device.
        why: Cause given by `take_sample`.
        time: Time of the reading [s]; None if there is none.
    """
    if why == NOT_FINITE:
        raw = state.array(PortState.raw).reshape(2, state.fingers, state.dimensions)
        i = int(np.isfinite(raw[0]).all())
        return f"returned {abbreviate(raw[i].tolist())} for {QUANTITIES[i]}, which are not finite"
    if why == STALE:
        text = f"returned no new sample in {state.code} successive readings"
        return text if time is None else f"{text}: all have the time {time:.9g} s"
    if why == FAST:
        return f"returned a velocity of {state.figure:.4g} m/s, expected at most {state.bound:g} m/s"
    if why == ZEROS:
        return f"returned only zeros, {state.figure:.4g} m from the last position: a failed reading"
    if why == FORCE:
        forces = state.array(PortState.forces).reshape(state.fingers, state.dimensions)
        return f"was given {forces.tolist()} N, which is not finite"
    return (
        f"returned a position {state.figure:.4g} m from the last one, expected at most {state.bound:.4g} m "
        f"({state.speed:g} m/s over {state.code} x {state.period:g} s)"
    )


def _described(value: object) -> str:
    """Describe a value given instead of an array."""
    if isinstance(value, np.ndarray):
        return f"a {type(value).__name__} {value.shape} of {value.dtype}"
    return f"{abbreviate(value)} ({type(value).__name__})"
