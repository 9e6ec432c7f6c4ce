"""Validation of device readings and of forces before they are used in a run.

The computations are kernels on `PortState`, which both the Python loop and the native loop use.
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
STILL_PERIODS = 20  # number of periods of the longest stall, if this is longer
HANGS = 0.1  # shortest time within which a device call must return [s]
WATCHDOGS = 3  # multiple of the watchdog time within which a device call must return, if this is longer


# Guards ---------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Guards:
    """Limits beyond which a run with hardware ends in a fault.

    Attributes:
        speed: Largest plausible speed of a fingertip along an axis [m/s]; a human hand reaches 5 m/s.
        hold: Largest number of successive readings without a new sample.
        late: Largest number of successive skipped periods.
        soft_start: Time during which the effect of an initial penetration increases gradually [s].
    """

    speed: float = 10.0
    hold: int = 3
    late: int = 5
    soft_start: float = 0.5

    def __post_init__(self) -> None:
        if not (math.isfinite(self.speed) and self.speed > 0.0):
            raise InputError("speed", self.speed, "a finite speed above zero [m/s]")
        if self.hold < 0 or self.late < 0:
            raise InputError("hold, late", (self.hold, self.late), "numbers of zero or more")
        if not (math.isfinite(self.soft_start) and self.soft_start >= 0.0):
            raise InputError("soft_start", self.soft_start, "a finite time of zero or more [s]")


def patience(period: float, watchdog: float) -> float:
    """Return the time within which a device call must return while forces are displayed [s].

    The time is three times the watchdog time and at least 0.1 s. It is at most 1 s or, if this is longer, 20 periods.

    Args:
        period: Sampling period T [s].
        watchdog: Watchdog time, the largest permitted lateness [s].
    """
    return min(max(MOST_STILL, STILL_PERIODS * period), max(HANGS, WATCHDOGS * watchdog))


GUARDS = Guards()


# The rules ------------------------------------------------------------------------------------------------------------


class PortState(Record):
    """State of a device, and of the exchange of readings and forces between the device and the tick."""

    fingers: int  # k
    dimensions: int  # d
    entries: int  # k d
    hold: int  # largest number of successive readings without a new sample
    period: float  # sampling period T [s]
    speed: float  # largest speed of a finger along an axis [m/s]
    force: float  # largest force of a finger [N]
    is_begun: bool  # whether there has been a sample
    is_gone: bool  # whether a call has failed or a reading was invalid; the device is then not read again
    is_asked: bool  # whether the device was asked, and neither written to nor stopped afterwards
    is_fresh: bool  # whether the last reading contained a new sample
    samples: int  # number of readings with a new sample
    repeats: int  # number of readings without a new sample
    row: int  # number of successive readings without a new sample
    periods: int  # periods since the last sample
    why: int  # cause of the fault, 0 without a fault
    code: int  # value returned by the function that failed, or another number for the message
    figure: float  # value that was compared with `bound`
    bound: float  # largest permitted value
    stop_code: int  # value returned by a `stop` that failed although the device answered; 0 otherwise
    stop_tick: int  # tick in which `stop` failed
    ramp: float  # time during which the effect of the initial depth increases [s]
    ramp_ticks: int  # number of readings since the start of this time
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
    """Record that a device has failed, so that it is not read again; return the cause `why`."""
    port.is_gone = True
    if port.why == 0:
        port.why = why
        port.code = code
    return why


@kernel
def take_sample(port: PortState, code: int, periods: int) -> int:
    """Accept or reject a complete reading; return the cause of a fault, 0 without a fault.

    Along an axis, a velocity may be at most `speed`, and a position may change by at most `speed` m T, where m is the
    number of periods since the last sample. If all numbers are zero, the last position must be within 1 mm of zero. If
    there is no new sample, the last sample is kept, for at most `hold` successive readings.

    Args:
        port: State of the device, with the reading in `raw`.
        code: Value that `read` returned.
        periods: Number of periods since the previous reading.
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
    """Transform the last sample to the scene's axes (`Frame`), and let an initial depth take effect gradually.

    A finger that is inside an object when a run begins has an initial depth e, the vector from the nearest point
    without contact to the position p of the finger. At the time t since the start, p and the velocity v are replaced by
    p - (1 - w) e and v + dw/dt e, with w = u^2 (3 - 2 u) and u = t/T_s, until the time T_s. The force of the first tick
    is therefore zero.
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
    """Transform the forces `orders` to the device's axes, and reduce forces above the limit of a finger to the limit.

    The result is the cause of a fault, or 0 if the forces may be displayed.
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
    """Validation of the readings of one device.

    A reading is a tuple of positions [m] and velocities [m/s], two finite float64 arrays (k, d), and the time of the
    measurement [s]. The arrays are copied before they are checked, because a device may change them at any time. The
    times of hardware must not decrease, and the values must satisfy the conditions of `take_sample`. If the time is
    unchanged, there is no new sample.

    Args:
        shape: Shape (k, d) of the positions, with the number of fingers k and of dimensions d.
        period: Sampling period T [s].
        guards: Limits of hardware; None for a simulation, whose times are not checked.
        frame: Frame of the device in the scene; None for the frame of the scene.

    Attributes:
        memory: State of the device, `PortState`.
        position, velocity: Positions [m] and velocities [m/s] of the last sample (k, d).
        placed: Positions, then velocities, of the last sample in the scene's axes (2 k d,), the input of the tick.
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
        """Whether a call of the device has failed or a reading was invalid."""
        return bool(self._numbers[GONE] != 0.0)

    @is_gone.setter
    def is_gone(self, is_it: bool) -> None:
        if not is_it:
            self.state.why = self.state.code = self.state.stop_code = 0
            self.state.is_asked = False
        self.state.is_gone = is_it

    def compile(self) -> None:
        """Check the following readings by machine code, which takes a third of the time."""
        from graspfx.compile.machine import compiled

        self._take = compiled(take_sample).on(self.memory)

    def let_in(self, depth: FloatArray, duration: float, step: float) -> None:
        """Let initial depths take effect gradually (`enter`).

        Args:
            depth: Initial depth e of each finger (k, d) [m].
            duration: Time T_s until the whole depth takes effect [s].
            step: Time between readings [s].
        """
        self.state.ramp, self.state.ramp_ticks, self.state.step = duration, 0, step
        self.state.array(PortState.depth)[:] = depth.ravel()

    def take(self, reading: object, periods: int = 1) -> str:
        """Accept or reject a reading; return an error message, which is empty if the reading is accepted.

        Args:
            reading: Result of `Device.read`.
            periods: Number of periods since the previous reading.
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
            return f"returned a reading with the time {time:.9g} s after {self.time:.9g} s: its clock ran backwards"
        code = FRESH if time > self.time else REPEAT
        why = self._take(0, code, periods)
        if why:
            return reading_text(self.state, int(why), time)
        self.time = time
        return ""

    def _simulated(self) -> str:
        """Accept a reading of a simulation if the values are finite."""
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
    """Call the kernels once, because the first call of a kernel takes longer and would delay a tick."""
    memory = np.zeros(size_for(PortState, entries=1, dimensions=1))
    port = PortState(memory.data)
    port.fingers = port.dimensions = port.entries = 1
    port.is_framed, port.ramp = True, 1.0
    source_function(take_sample)(port.buffer, 0, FRESH, 1)
    source_function(take_sample)(port.buffer, 0, NO_READ, 1)
    keep_lowerings()


def reading_text(state: PortState, why: int, time: float | None = None) -> str:
    """Return the message for an invalid reading or force, with the values in the state of the device.

    Args:
        state: State of the device.
        why: Cause returned by `take_sample` or `limit_forces`.
        time: Time of the reading [s]; None if it has no time.
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
        return f"returned only zeros, {state.figure:.4g} m from the last position, which is a failed reading"
    if why == FORCE:
        forces = state.array(PortState.forces).reshape(state.fingers, state.dimensions)
        return f"was given forces of {forces.tolist()} N, which are not finite"
    return (
        f"returned a position {state.figure:.4g} m from the last position, expected at most {state.bound:.4g} m "
        f"({state.speed:g} m/s over {state.code} x {state.period:g} s)"
    )


def _described(value: object) -> str:
    """Return a text that describes a value which is not the expected array."""
    if isinstance(value, np.ndarray):
        return f"a {type(value).__name__} {value.shape} of {value.dtype}"
    return f"{abbreviate(value)} ({type(value).__name__})"
