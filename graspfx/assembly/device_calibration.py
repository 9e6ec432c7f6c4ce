"""Calibration of a scene's hardware: delay of forces, mass, friction, origin and axes of each device.

The fingers of one device at a time are pushed by force pulses or moved by a person. Results are text, and TOML for a
scene.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise
from os import PathLike
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.push_response import (
    GROUPS,
    Estimate,
    Push,
    Response,
    drag_matrix,
    friction_of,
    response,
)
from graspfx.assembly.device_limits import guards_of
from graspfx.assembly.resolve import Parts, resolve
from graspfx.assembly.wiring import Wire
from graspfx.errors import DeviceError, InputError
from graspfx.loop.device import is_hardware
from graspfx.loop.device_exchange import DeviceExchange, DevicePort, Port
from graspfx.loop.device_mount import Frame
from graspfx.loop.realtime.lifecycle import opened, settle
from graspfx.loop.realtime.pacing import Clock, Pacer, WallClock, late_text
from graspfx.loop.realtime.process import Interruption, frozen_memory, signals_end
from graspfx.loop.servo_parts import DeviceWiring
from graspfx.numeric import SMALLEST, number

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]
FARTHEST = 0.03  # largest distance of a finger from its initial position during pulses [m]
FASTEST = 0.5  # largest speed of a finger during pulses [m/s]
WINDOW = 0.02  # time window of a velocity [s]


@dataclass(frozen=True, eq=False)
class Sample:
    """Reading of a device in one tick, and the tick's times.

    Attributes:
        due: Deadline of the tick [s].
        start, end: Time of the start of the reading, and of the end of the writing [s].
        position: Positions of the fingers, (k, d) [m].
        is_fresh: Whether the device provided a new sample since the previous reading.
    """

    due: float
    start: float
    end: float
    position: FloatArray
    is_fresh: bool


class Bench:
    """One device that is calibrated, with positions and forces in its own axes.

    Args:
        port: Port of the device, which must be open and stationary.
        exchange: Exchange of readings and forces with this device only.
        period: Time between successive ticks [s].
        limits: Largest force of each channel, (k,) [N].
        clock: Clock of the ticks.
        late: Largest number of successive periods that may be skipped while a force acts.

    Attributes:
        samples: Samples of all previous ticks.
        home: Positions of the fingers when the bench was created, (k, d) [m].
        watched: Whether a finger must stay near `home`; False while a person moves it.
    """

    def __init__(
        self, port: DevicePort, exchange: DeviceExchange, period: float, limits: FloatArray, clock: Clock, late: int
    ) -> None:  # fmt: skip
        self.port, self.period, self.limits, self.clock = port, period, limits, clock
        self._exchange, self._pacer, self._late = exchange, Pacer(period, clock), late
        self.samples: list[Sample] = []
        self.home = port.readings.position.copy()

    @property
    def shape(self) -> tuple[int, int]:
        """Number of channels k and number of dimensions d."""
        k, d = self.home.shape
        return k, d

    def tick(self, channel: int = 0, force: FloatArray | None = None) -> Sample:
        """Wait for the next period, read the device, and write a force to one channel and zero to the others.

        Args:
            channel: Index of the channel.
            force: Force (d,) [N], which is reduced to the channel's limit; zero if None.

        Raises:
            DeviceError: If the device has a fault, a finger moves too far or too fast, or a force acted for too long
                because periods were skipped.
            Interruption: If a signal arrived.
        """
        exchange, pacer, command = self._exchange, self._pacer, self.port.port.command
        skipped = pacer.wait(lambda: bool(exchange.exits.numbers))
        if exchange.exits.numbers:
            raise Interruption(exchange.exits.cause)
        if command.any() and pacer.row > self._late:  # a pause without a force is harmless
            raise DeviceError(f"{self.port.name}: {late_text(pacer.row, self.period, self._late)}")
        start = self.clock.now()
        _require(exchange.read(1 + skipped))
        self._stay()
        command[...] = 0.0
        if force is not None:
            size = float(np.linalg.norm(force))
            command[channel] = force * min(1.0, float(self.limits[channel]) / max(size, SMALLEST))
        _require([exchange.write()])
        readings = self.port.readings
        sample = Sample(
            pacer.deadline or start, start, self.clock.now(), readings.position.copy(), readings.is_fresh
        )  # fmt: skip
        self.samples.append(sample)
        return sample

    def rest(self, duration: float) -> list[Sample]:
        """Run ticks with zero force for `duration` [s], and return their samples."""
        return [self.tick() for _ in range(max(1, round(duration / self.period)))]

    @property
    def velocity(self) -> FloatArray:
        """Mean velocity of the fingers over the last 20 ms, (k, d) [m/s]; a device's own velocity may be too coarse."""
        recent = self.samples[-1 - max(1, round(WINDOW / self.period)) :]
        if len(recent) < 2:
            return np.zeros_like(self.home)
        passed = recent[-1].start - recent[0].start
        return np.asarray((recent[-1].position - recent[0].position) / passed)

    def _stay(self) -> None:
        away = float(np.linalg.norm(self.port.readings.position - self.home, axis=1).max())
        if not self.watched:
            return
        if away > FARTHEST:
            raise DeviceError(
                f"{self.port.name} moved {1e3 * away:.0f} mm away from its start, expected at most "
                f"{1e3 * FARTHEST:.0f} mm; level the device, and make sure that nothing touches it"
            )
        if float(np.abs(self.velocity).max()) > FASTEST:
            raise DeviceError(f"{self.port.name} moves faster than {FASTEST:g} m/s, the largest speed under pulses")

    watched = True

    @property
    def round_trip(self) -> float:
        """Median time from the start of a reading to the end of the following writing [s]."""
        return median(each.end - each.start for each in self.samples)

    @property
    def lateness(self) -> tuple[float, float]:
        """1st and 99th percentiles of the time from a tick's deadline to the end of its writing [s]."""
        low, high = np.percentile([each.end - each.due for each in self.samples], (1.0, 99.0))
        return float(low), float(high)


@contextmanager
def on_bench(parts: Parts, wire: Wire, clock: Clock) -> Iterator[Bench]:
    """Open one device of a scene, wait until it is stationary, and close it on exit; its last force is always zero.

    Raises:
        DeviceError: If the device does not open or is not stationary.
        KeyboardInterrupt: If a signal arrived.
    """
    scene = parts.scene
    period = scene.period * wire.fitting.every
    k, d = wire.device.features.fingers, scene.dimensions
    memory = np.zeros(1 + 3 * k * d)
    arrays = [memory[1 + i * k * d : 1 + (i + 1) * k * d].reshape(k, d) for i in range(3)]
    plain = replace(wire.fitting, frame=None, every=1)
    port = DevicePort(
        Port(0, arrays[0], arrays[1], arrays[2], memory),
        DeviceWiring(wire.device, wire.fingers, plain), scene.finger_names, period, guards_of(parts.scene, parts.wires),
    )  # fmt: skip
    exchange = DeviceExchange([port])
    with frozen_memory(), signals_end() as exits:
        exchange.exits = exits
        with opened(exchange, period):
            settle(exchange, period, clock)
            yield Bench(port, exchange, period, _limits(parts, wire), clock, guards_of(parts.scene, parts.wires).late)


def _limits(parts: Parts, wire: Wire) -> FloatArray:
    """Return the largest force of each channel, (k,) [N]: the lower limit of device and scene; inf without a limit."""
    limits = np.full(len(wire.fingers), np.inf)
    if wire.device.features.peak_force is not None:
        limits[:] = wire.device.features.peak_force
    if parts.limits is not None:
        for channel, finger in enumerate(wire.fingers.tolist()):
            if finger >= 0:
                limits[channel] = min(limits[channel], float(parts.limits[finger]) * wire.fitting.scale)
    return limits


def _require(faults: list[str]) -> None:
    for text in faults:
        if text:
            raise DeviceError(text)


PATIENCE = 20.0  # time to wait for a person [s]
PUSH = 0.01  # smallest displacement that counts as a push; two centimetres are requested [m]
CLEAR = 0.8  # fraction of a motion that must be along one axis
STILL = 5e-4  # largest motion of a still finger [m]
LONG_ENOUGH = 1.0  # time that a finger must be still [s]
AWAY = 2e-3  # smallest displacement that counts as a motion [m]
WAYS = {
    1: ("to the right",),
    2: ("to the right", "up, or away from you"),
    3: ("to the right", "away from you", "up"),
}  # directions of a scene's axes, by its dimensions
Prompt = Callable[[str], None]


def axis_checks(bench: Bench, channel: int, finger: str, frame: Frame | None, prompt: Prompt) -> dict[str, str]:
    """Ask a person to push a finger along each axis of the scene; return the result, a text, by letter of the axis."""
    answers = {}
    bench.watched = False
    for axis in range(bench.shape[1]):
        prompt(f"push {finger} {WAYS[bench.shape[1]][axis]} by two centimetres; expected: +{'xyz'[axis]}")
        start = _placed(bench, channel, frame)
        shift = np.zeros_like(start)
        for _ in range(round(PATIENCE / bench.period)):
            bench.tick()
            shift = _placed(bench, channel, frame) - start
            if float(np.linalg.norm(shift)) > PUSH:
                break
        answers["xyz"[axis]] = _answer(shift, axis)
        prompt(f"  {answers['xyz'[axis]]}")
    return answers


def _answer(shift: FloatArray, axis: int) -> str:
    size = float(np.linalg.norm(shift))
    if size <= PUSH:
        return "not checked: no push"
    most = int(np.argmax(np.abs(shift)))
    if abs(float(shift[most])) < CLEAR * size:
        return "unclear: it moved between two axes; push again along one axis"
    sign = "+" if shift[most] > 0.0 else "-"
    if (most, sign) == (axis, "+"):
        return f"correct: it moved along +{'xyz'[axis]}"
    return f"WRONG: it moved along {sign}{'xyz'[most]}; correct frame.axes"


def zero_check(bench: Bench, channel: int, finger: str, frame: Frame | None, prompt: Prompt) -> FloatArray | None:
    """Ask a person to hold a finger at the scene's origin, and return its position, (d,) [m]; None if this fails."""
    bench.watched = False
    prompt(f"put {finger} at the intended origin of the scene, and hold it there for {LONG_ENOUGH:g} s")
    start = _placed(bench, channel, frame)
    there, since, is_away = start, 0, False
    for _ in range(round(PATIENCE / bench.period)):
        bench.tick()
        now = _placed(bench, channel, frame)
        is_away = is_away or float(np.linalg.norm(now - start)) > AWAY
        if float(np.linalg.norm(now - there)) > STILL:
            there, since = now, 0
        since += 1
        if is_away and since * bench.period >= LONG_ENOUGH:
            prompt(f"  read at {np.round(1e3 * now, 2).tolist()} mm")
            return now
    prompt("  not checked: the finger did not move, or was not held still")
    return None


def _placed(bench: Bench, channel: int, frame: Frame | None) -> FloatArray:
    """Return the last reading of a finger's position in the scene's axes, (d,) [m]."""
    own = bench.port.readings.position
    placed: FloatArray = (own if frame is None else frame.place(own))[channel].copy()
    return placed


UNTOLD = 1e-5  # resolution assumed for a device that reports none [m]
SEEN = 4.0  # number of encoder steps that count as a motion
STEPS = 60.0  # displacement by a pulse, in resolution steps
LONGEST_TRIAL = 0.15  # longest trial push [s]
LONGEST_PULSE, SHORTEST_PULSE = 0.08, 6  # longest pulse [s], and shortest pulse [periods]
MOST_SPEED = 0.1  # largest speed at the end of a pulse [m/s]
BEFORE = 0.04  # time at rest before a pulse [s]
SPEED = 0.025  # speed at which a finger is released to coast [m/s]
COAST, TRAVEL, LEAST = 0.35, 0.008, 20  # largest time and distance of coasting [s, m], and smallest number of readings
LONGEST_START = 0.3  # longest time to reach the speed of coasting [s]
NEAR, CALM = 2e-3, 0.02  # largest distance and speed of a finger that has returned [m, m/s]
RETURN = 12.0  # natural frequency of the spring that returns a finger [rad/s]
LONGEST_WAY = 1.0  # longest return of a finger [s]
EXPLAINED = 0.9  # smallest explained fraction of the motion under pulses
MOST_DELAY = 0.02  # largest delay to search for [s], or three periods if they are longer


@dataclass(frozen=True, eq=False)
class FingerFigures:
    """Measured properties of one finger.

    Attributes:
        delay: Time from the end of the writing of a force to the first reading with a motion [s].
        mass: Mean mass of the finger [kg].
        friction: Mean viscous friction [N s/m].
        mobility: Mobility, which maps a force to an acceleration, (d, d) [1/kg].
        resolution: Resolution [m] that the device reports; if it reports none, the smallest difference between
            successive readings, or 0 if all readings are equal.
        pulses: Number of pulses.
        force: Force of a pulse [N].
    """

    delay: Estimate
    mass: Estimate
    friction: Estimate
    mobility: FloatArray
    resolution: float
    pulses: int
    force: float


def finger_figures(bench: Bench, channel: int, force: float, pulses: int) -> FingerFigures:
    """Measure one finger by pushing it back and forth along each axis, and by letting it coast.

    Args:
        bench: Bench of the finger's device.
        channel: Channel of the finger.
        force: Force of a pulse [N].
        pulses: Number of pulses along all axes together; it is increased to ten pulses along each axis if necessary.

    Raises:
        DeviceError: If the finger does not move, or the device has a fault.
    """
    d = bench.shape[1]
    own = bench.port.device.features.resolution
    step = own or UNTOLD
    accelerations = [_trial(bench, channel, axis, force, step) for axis in range(d)]
    coasts = [
        _coast(bench, channel, axis, sign * force, acceleration)
        for axis, acceleration in enumerate(accelerations)
        for sign in (1.0, -1.0) * max(1, min(2, pulses // (25 * d)))
    ]
    drag, others = drag_matrix(coasts)
    each = max(GROUPS, math.ceil(pulses / d))
    done = [
        _pulse(bench, channel, axis, force if k % 2 == 0 else -force, step, acceleration)
        for axis, acceleration in enumerate(accelerations)
        for k in range(each)
    ]
    answer: Response = response(done, max(float(np.trace(drag)) / d, 0.0), max(MOST_DELAY, 3.0 * bench.period))
    if answer.explained < EXPLAINED or not math.isfinite(answer.mass.value):
        raise DeviceError(
            f"{bench.port.name}: a model of a mass explains {answer.explained:.0%} of the motion under pulses, "
            f"expected at least {EXPLAINED:.0%} and a finite mass; move the finger to the middle of the workspace, and "
            "make sure that nothing touches it"
        )
    friction = friction_of(answer.mobility, drag, others)
    return FingerFigures(
        answer.delay, answer.mass, friction, answer.mobility, own or _least_step(bench, channel), len(done), force
    )


def _trial(bench: Bench, channel: int, axis: int, force: float, step: float) -> float:
    """Push a finger along an axis until its motion is visible, undo the motion, and return the acceleration [m/s^2]."""
    bench.rest(BEFORE)
    push = force * np.eye(bench.shape[1])[axis]
    first = last = bench.tick(channel, push)
    while last.start - first.end < LONGEST_TRIAL and _shift(first, last, channel, axis) <= 3.0 * SEEN * step:
        last = bench.tick(channel, push)
    took, shift = last.start - first.end, float((last.position - first.position)[channel, axis])
    _take_back(bench, channel, push, took)
    if abs(shift) <= SEEN * step:
        raise DeviceError(
            f"{bench.port.name} moved by {1e6 * abs(shift):.0f} um under {force:.3g} N in {1e3 * took:.0f} ms, "
            f"expected more than {1e6 * SEEN * step:.0f} um: release the finger, check that the motors are on, or use "
            "a larger force"
        )
    if shift < 0.0:
        raise DeviceError(
            f"{bench.port.name} moves against a force along axis {axis}: correct the driver's sign of the motor torques"
        )
    _bring_home(bench, channel, force, force * took**2 / (2.0 * shift))
    return 2.0 * shift / took**2


def _take_back(bench: Bench, channel: int, push: FloatArray, duration: float) -> None:
    """Undo the motion of a push: push backwards for twice the duration of the push, and forwards for the duration."""
    began = bench.samples[-1].end
    while bench.samples[-1].end - began < 2.0 * duration:
        bench.tick(channel, -push)
    began = bench.samples[-1].end
    while bench.samples[-1].end - began < duration:
        bench.tick(channel, push)
    bench.tick()


def _shift(first: Sample, last: Sample, channel: int, axis: int) -> float:
    return abs(float((last.position - first.position)[channel, axis]))


def _pulse(bench: Bench, channel: int, axis: int, force: float, step: float, acceleration: float) -> Push:
    """Push one finger along an axis, undo the motion, and return the force with the readings before and during it."""
    samples = bench.rest(BEFORE)
    duration = math.sqrt(2.0 * STEPS * step / acceleration)
    duration = min(max(duration, SHORTEST_PULSE * bench.period), LONGEST_PULSE, MOST_SPEED / acceleration)
    push = force * np.eye(bench.shape[1])[axis]
    first = bench.tick(channel, push)
    samples.append(first)
    while samples[-1].end - first.end < duration:
        samples.append(bench.tick(channel, push))
    samples.append(bench.tick(channel, -push))  # read before the push ends
    _take_back(bench, channel, push, samples[-1].end - first.end)
    _bring_home(bench, channel, abs(force), abs(force) / acceleration)
    fresh = [each for each in samples if each.is_fresh]
    time = np.array([each.start for each in fresh]) - first.end
    return Push(axis, force, time, np.array([each.position[channel] for each in fresh]))


def _bring_home(bench: Bench, channel: int, force: float, mass: float) -> None:
    """Return a finger to its start by a spring and damper with a force of at most `force` [N]."""
    readings, home = bench.port.readings, bench.home[channel]
    began = bench.tick().start
    while bench.samples[-1].start - began < LONGEST_WAY:
        away, speed = readings.position[channel] - home, bench.velocity[channel]
        if np.linalg.norm(away) < NEAR and np.linalg.norm(speed) < CALM:
            break
        pull = -mass * RETURN * (RETURN * away + 2.0 * speed)
        size = float(np.linalg.norm(pull))
        bench.tick(channel, pull * min(1.0, force / max(size, SMALLEST)))
    bench.tick()


def _coast(
    bench: Bench, channel: int, axis: int, force: float, acceleration: float
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Accelerate a finger and release it; return times (n,) [s] and positions (n, d) [m] while no force acts."""
    duration = min(SPEED / acceleration, LONGEST_START)
    bench.rest(BEFORE)
    push = force * np.eye(bench.shape[1])[axis]
    first = bench.tick(channel, push)
    while bench.samples[-1].end - first.end < duration:
        bench.tick(channel, push)
    began = bench.tick()
    samples: list[Sample] = []
    while bench.samples[-1].start - began.start < COAST:
        last = bench.tick()
        if last.start - began.start > MOST_DELAY:
            samples.append(last)
        if float(np.linalg.norm((last.position - began.position)[channel])) > TRAVEL and len(samples) > LEAST:
            break
    _bring_home(bench, channel, abs(force), abs(force) / acceleration)
    fresh = [each for each in samples if each.is_fresh]
    return np.array([each.start for each in fresh]), np.array([each.position[channel] for each in fresh])


def _least_step(bench: Bench, channel: int) -> float:
    """Return the smallest non-zero distance between successive readings of a finger [m]; 0 if all are equal."""
    positions = np.array([each.position[channel] for each in bench.samples])
    steps = [float(np.linalg.norm(b - a)) for a, b in pairwise(positions)]
    changes = [each for each in steps if each > 0.0]
    return min(changes, default=0.0)


# Calibration of a scene -----------------------------------------------------------------------------------------------

SHARE = 0.02  # fraction of a device's largest force that pushes use
UNTOLD_FORCE = 3.0  # assumed largest force of a device that reports none [N]
MOST_SHARE = 0.2  # largest allowed share of a device's force
PULSES = 200


@dataclass(frozen=True, eq=False)
class DeviceMeasures:
    """Measured properties of one device.

    Attributes:
        fingers: Names of the device's fingers.
        key: Key of the device's table in the scene, such as `finger.0.device` or `device.0`.
        each: Properties of each finger, by name of the finger.
        round_trip: Median time from the start of a reading to the end of the following writing [s].
        jitter: 1st and 99th percentiles of the time from a tick's deadline to the end of its writing [s].
        axes: Texts with the results of the axis check, by name of the finger and letter of the axis; empty if the axes
            were not checked.
        zero: Position read at the scene's origin, (d,) [m], by name of the finger; empty if it was not checked.
    """

    fingers: tuple[str, ...]
    key: str
    each: Mapping[str, FingerFigures]
    round_trip: float
    jitter: tuple[float, float]
    axes: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    zero: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def delay(self) -> float:
        """Time from the end of a writing to the start of the first reading with its effect, mean over fingers [s]."""
        return float(np.mean([each.delay.value for each in self.each.values()]))

    @property
    def lateness(self) -> float:
        """Mean time from a sample of the position to the force computed from it, including the sample's age [s]."""
        return max(self.delay + self.round_trip, 0.0)

    @property
    def measures(self) -> dict[str, Any]:
        """Content of the table `measures` in the scene's table of the device."""
        each = list(self.each.values())
        table: dict[str, Any] = {
            "mass": float(np.mean([figures.mass.value for figures in each])),
            "friction": float(np.mean([figures.friction.value for figures in each])),
            "lateness": self.lateness,
            "jitter": [max(self.delay + end, 0.0) for end in self.jitter],
            "round_trip": self.round_trip,
        }
        resolution = max(figures.resolution for figures in each)
        return table | ({"resolution": resolution} if resolution > 0.0 else {})

    def lines(self) -> Iterator[str]:
        """Yield the results as lines of text."""
        yield f"{', '.join(self.fingers)} ({self.key})"
        for name, figures in self.each.items():
            delay, mass, friction = figures.delay, figures.mass, figures.friction
            yield f"  {name}: {figures.pulses} pulses of {figures.force:.3g} N"
            late, error = 1e3 * (delay.value + self.round_trip), 1e3 * delay.error
            yield f"    lateness    {late:8.3f} ms    +- {error:.3f}   from a sample to its force"
            yield f"    mass        {1e3 * mass.value:8.2f} g     +- {1e3 * mass.error:.2f}"
            yield f"    friction    {friction.value:8.4f} N s/m +- {friction.error:.4f}"
            if figures.resolution > 0.0:
                yield f"    resolution  {1e6 * figures.resolution:8.2f} um"
            axes = self.axes.get(name, {})
            yield from (f"    axis {axis}      {text}" for axis, text in axes.items())
            if not axes:
                yield "    axes        not checked: a person must push the finger"
            zero = self.zero.get(name)
            unchecked = "not checked: a person must hold the finger at the origin"
            where = unchecked if zero is None else f"read at {np.round(1e3 * zero, 2)} mm"
            yield f"    origin      {where}"
        low, high = (1e3 * (self.delay + end) for end in self.jitter)
        own = f"lateness includes {1e3 * self.round_trip:.3f} ms for reading and writing"
        yield f"  {own}; lateness is {low:.3f} to {high:.3f} ms in 98 % of the ticks"


@dataclass(frozen=True, eq=False)
class Calibration:
    """Measured properties of a scene's hardware.

    Attributes:
        scene: Name of the scene.
        devices: Properties of each device.
    """

    scene: str
    devices: tuple[DeviceMeasures, ...]

    @property
    def overrides(self) -> dict[str, Any]:
        """Tables `measures` of all devices, by dotted key, as overrides for `gx.load(scene, overrides)`."""
        return {f"{each.key}.measures": each.measures for each in self.devices}

    def lines(self) -> Iterator[str]:
        """Yield all results as lines of text."""
        for each in self.devices:
            yield from each.lines()

    def toml(self) -> str:
        """Format `overrides` as TOML."""
        text = [f"# Measures of the hardware of {self.scene}, by `graspfx calibrate`. Add each table to its device,"]
        text += ["#     device = { ..., measures = { ... } }"]
        text += ['# or load the scene with this file: gx.load(scene, tomllib.loads(Path("...").read_text()))']
        for key, table in self.overrides.items():
            values = ", ".join(f"{name} = {_figure(value)}" for name, value in table.items())
            text += [f'"{key}" = {{ {values} }}']
        return "\n".join(text) + "\n"


def _figure(value: float | Sequence[float]) -> str:
    if isinstance(value, float):
        return f"{value:.6g}" if "." in f"{value:.6g}" or "e" in f"{value:.6g}" else f"{value:.1f}"
    return f"[{', '.join(_figure(each) for each in value)}]"


def require_hardware(parts: Parts) -> None:
    """Check that at least one device of a scene is hardware.

    Raises:
        InputError: If all devices are simulated.
    """
    if not parts.hardware:
        remedy = "the properties of a simulated device are its settings and cannot be measured"
        raise InputError("scene", parts.scene.source.name, "a scene with hardware", remedy)


def calibrate(
    scene: Scene | str | PathLike[str],
    *,
    pulses: int = PULSES,
    share: float = SHARE,
    prompt: Prompt | None = None,
) -> Calibration:
    """Measure lateness, mass, friction and resolution of a scene's hardware, and check its axes and origin.

    Devices are opened one after another. When a device is stationary at zero force, small pulses push its fingers back
    and forth, one finger at a time; nobody may hold them. Pulses do not exceed the force limits of the scene. Forces
    are set to zero before a device is closed, also after an error or a signal.

    Args:
        scene: `Scene`, or name or path of a scene.
        pulses: Number of pulses per device, divided among its fingers.
        share: Force of the pulses as a fraction of the device's largest force, at most one fifth.
        prompt: Function that shows an instruction to a person, who moves the fingers to check axes and origin. If None,
            axes and origin are not checked.

    Raises:
        InputError: If the scene has no hardware, or `share` or `pulses` is out of range.
        DeviceError: If a device does not open, is not stationary, does not move, or has a fault.
        KeyboardInterrupt: If a signal ended the calibration.
    """
    from graspfx.scene.load import to_scene

    scene_ = to_scene(scene)
    if not 0.0 < number("share", share, "a number above zero") <= MOST_SHARE:
        raise InputError("share", share, f"a fraction of the largest force, above 0 and at most {MOST_SHARE:g}")
    if not number("pulses", pulses, "a whole number, 1 or more") >= 1:
        raise InputError("pulses", pulses, "a whole number, 1 or more")
    parts = resolve(scene_)
    require_hardware(parts)
    hardware = [wire for wire in parts.own_wires() if is_hardware(wire.device)]
    figures = tuple(_device(parts, wire, pulses, share, prompt) for wire in hardware)
    return Calibration(scene_.source.name, figures)


def _device(parts: Parts, wire: Wire, pulses: int, share: float, prompt: Prompt | None) -> DeviceMeasures:
    names = parts.scene.finger_names
    channels = {names[f]: channel for channel, f in enumerate(wire.fingers.tolist()) if f >= 0}
    axes, zero = dict[str, dict[str, str]](), dict[str, FloatArray]()
    if prompt is not None:
        prompt(f"move {', '.join(channels)} to the middle of the workspace and release: force pulses follow")
    with on_bench(parts, wire, WallClock()) as bench:
        each = {
            name: finger_figures(bench, channel, _force(bench, channel, share), max(1, pulses // len(channels)))
            for name, channel in channels.items()
        }
        trip, jitter = bench.round_trip, bench.lateness
        if prompt is not None:
            for name, channel in channels.items():
                axes[name] = axis_checks(bench, channel, name, wire.fitting.frame, prompt)
                place = zero_check(bench, channel, name, wire.fitting.frame, prompt)
                if place is not None:
                    zero[name] = place
    key = ".".join(map(str, wire.at))
    return DeviceMeasures(tuple(channels), key, each, trip, jitter, axes, zero)


def _force(bench: Bench, channel: int, share: float) -> float:
    limit = float(bench.limits[channel])
    return share * (limit if np.isfinite(limit) else UNTOLD_FORCE)
