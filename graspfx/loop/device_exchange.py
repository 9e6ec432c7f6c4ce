"""Calls of the methods of Python devices; exceptions are converted to messages that name the device."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.kernel import source_function
from graspfx.compile.records import start_of
from graspfx.errors import DeviceError, abbreviate, message
from graspfx.loop.columns import Layout
from graspfx.loop.device import LimitedDevice, is_hardware
from graspfx.loop.realtime.loop_log import LoopState, PortLog, note_times
from graspfx.loop.realtime.pacing import Pacer
from graspfx.loop.realtime.process import Exits, Interruption
from graspfx.loop.realtime.readings import Guards, Readings
from graspfx.loop.safety.trust import CAUSES, DEADMAN
from graspfx.loop.servo_parts import DeviceWiring

FloatArray = NDArray[np.float64]

ZERO = "all forces are zero"
DRIVERS = Exception, SystemExit  # includes SystemExit, so that a library's `sys.exit` does not end a run with hardware
READ_TIME, WRITE_TIME = start_of(LoopState, "io_read"), start_of(LoopState, "io_write")
CALLS = "ask", "read", "write", "stop"  # calls that may hang while a device exerts a force


@dataclass
class Port:
    """Memory through which the tick exchanges positions, velocities and forces with a Python device."""

    station: int
    position: FloatArray
    velocity: FloatArray
    command: FloatArray
    memory: FloatArray  # 1 if the device could be read, otherwise 0; then the three arrays above and the limits
    limit: FloatArray | None = None  # limits of a device whose largest force depends on its position
    misses: FloatArray | None = None  # successive samples without a new reading (1,), if a safety chain counts them
    elapsed: FloatArray | None = None  # periods since the last tick (1,), if a safety chain uses them
    time: float | None = None  # time of the last reading [s]
    cause: FloatArray | None = None  # cause for which the safety chain lets forces decay (1,); None without a chain

    def let_go(self, cause: int) -> bool:
        """Let the safety chain reduce the forces to zero for this cause, unless another cause was set before.

        The result is False if there is no safety chain.
        """
        if self.cause is not None and self.cause[0] == 0.0:
            self.cause[0] = cause + CAUSES * self.station
        return self.cause is not None

    def begin(self, periods: int) -> None:
        """Begin a tick, `periods` sampling periods after the last tick, and mark the device as not read."""
        self.memory[0] = 0.0
        if self.elapsed is not None:
            self.elapsed[0] = periods

    def note(self, time: float) -> None:
        """Count successive readings with the same time, which are not new samples."""
        if self.misses is not None:
            self.misses[0] = self.misses[0] + 1.0 if time == self.time else 0.0
            self.time = time


def part_name(kind: str, part: object, names: Iterable[str]) -> str:
    """Return the name of a part in messages: its kind, the names of its fingers or objects, and its class."""
    return f"the {kind} of {', '.join(names)} ({type(part).__qualname__})"


def device_name(station: DeviceWiring, fingers: Sequence[str]) -> str:
    """Return the name of a device in messages, with the names of its fingers in the scene and its class."""
    return part_name("device", station.device, (fingers[f] for f in station.fingers.tolist() if f >= 0))


class DevicePort:
    """Python device and its port. Each method that calls the device returns an error message; it is empty on success.

    Args:
        port: Memory through which the device is read and written.
        station: Device and the fingers that it moves.
        fingers: Names of the scene's fingers.
        period: Sampling period T [s].
        guards: Limits beyond which a reading of hardware is a fault.

    Attributes:
        name: Name of the device in messages.
        channels: Index of the finger that each channel moves; -1 if it moves none.
        workspace: Lower and upper corners of the workspace in the device's axes [m]; None if the device reports no
            workspace.
        fitting: Relation of the device to the scene.
        readings: State and statistics of the device's readings in the run.
        log: Recorder of new samples, switches and raw numbers of the device; None if they are not recorded.
        place: Number of the device's `ask` among the calls of all devices, from 1 (`call_of`).
        is_unstopped: Whether the last call of `stop` has failed; False before the first call.
        is_up: Whether the deadman switch of the device was open at the last reading.
        watches: Whether the force is removed if the deadman switch is open; False before a run, when there is no force.
    """

    def __init__(
        self, port: Port, station: DeviceWiring, fingers: Sequence[str], period: float, guards: Guards
    ) -> None:  # fmt: skip
        self.port, self.device, self.name = port, station.device, device_name(station, fingers)
        self.channels: list[int] = station.fingers.tolist()
        self.fitting = station.fitting
        self.hardware = is_hardware(self.device)
        self.place = 1 + len(CALLS) * port.station
        self.readings = Readings(port.position.shape, period, guards if self.hardware else None, self.fitting.frame)
        self._since = self.fitting.every - 1  # ticks since the device was called
        self.workspace = self.device.features.workspace
        self.log: PortLog | None = None
        self.is_unstopped = self.is_up = False
        self.watches = True
        ask = getattr(self.device, "ask", None)
        self._ask: Callable[[], object] | None = ask if callable(ask) else None

    @property
    def fingers(self) -> list[int]:
        """Indices of the fingers that the device moves."""
        return [finger for finger in self.channels if finger >= 0]

    @property
    def is_gone(self) -> bool:
        """Whether a call of the device has failed or a reading was invalid; if so, the device is not read again."""
        return self.readings.is_gone

    @is_gone.setter
    def is_gone(self, is_it: bool) -> None:
        self.readings.is_gone = is_it

    def open(self, period: float) -> str:
        """Open the device for one call of `read` and of `write` every `fitting.every` periods."""
        try:
            self.device.__enter__()
            self.device.open(period * self.fitting.every)
        except DRIVERS as error:  # each becomes a fault with a message
            return self._failure("cannot be opened", error)
        self.is_gone = False
        return ""

    def ask(self) -> str:
        """Call `ask`, if the device has this method and is read in the next call of `read`."""
        try:
            if self._ask is not None and self._since + 1 >= self.fitting.every:
                self._ask()
        except DRIVERS as error:
            return self._failure("cannot be asked", error)
        return ""

    def read(self, periods: int) -> str:
        """Begin a tick, `periods` sampling periods after the last one; if the device is due, read it into the port."""
        port, readings = self.port, self.readings
        port.begin(periods)
        if self.log is not None:
            self.log.clear()
        if self.is_gone:
            return ""
        self._since += periods
        is_due = self._since >= self.fitting.every
        try:
            if not is_due:
                text = "" if self.log is None else self.log.take(self.device, is_fresh=False)
                port.memory[0] = float(not text)
                return text and self._fault(text)
            since, self._since = self._since, 0
            reading = self.device.read()
            text = readings.take(reading, since)
            if port.limit is not None and not text:
                assert isinstance(self.device, LimitedDevice)
                text = _take_limit(port.limit, self.device.largest_force, self.fitting.scale)
            if self.fitting.deadman is not None and not text:
                text = self._watch(self.device, self.fitting.deadman)
            if self.log is not None and not text:
                text = self.log.take(self.device, is_fresh=readings.is_fresh)
        except DRIVERS as error:
            return self._failure("cannot be read", error)
        if text:
            return self._fault(text)
        port.memory[1 : 1 + readings.placed.size] = readings.placed
        port.note(reading[2])
        port.memory[0] = 1.0
        return ""

    def write(self) -> str:
        """If the device was read in this tick, write the forces at the port to it."""
        if self._since:
            return ""
        frame = self.fitting.frame
        try:
            self.device.write(self.port.command if frame is None else frame.pull(self.port.command))
        except DRIVERS as error:
            return self._failure("cannot be written", error)
        return ""

    def stop(self) -> str:
        """Set the force of the device to zero."""
        self.is_unstopped = True
        try:
            self.device.stop()
            self.is_unstopped = False
        except DRIVERS as error:  # a lost device cannot be stopped, but the other devices must be
            return self._failure("cannot be stopped, and its force may remain; switch the device off", error)
        return ""

    def close(self) -> str:
        """Close the device."""
        try:
            self.device.__exit__(None, None, None)
        except DRIVERS as error:
            return self._failure("cannot be closed", error)
        return ""

    @property
    def places(self) -> FloatArray:
        """Positions of the last reading in the scene's coordinates, (k, d) [m]."""
        frame, own = self.fitting.frame, self.readings.position
        return own if frame is None else frame.place(own)

    def _watch(self, device: Any, deadman: int) -> str:
        """Check the deadman switch; if it is open, let the safety chain reduce the forces to zero.

        The result is a message if the switches are invalid, or if the switch is open and there is no safety chain.
        """
        switches = device.switches
        if isinstance(switches, bool) or not isinstance(switches, int | np.integer):
            return f"returned {abbreviate(switches)} for its switches, expected an integer with one bit per switch"
        self.is_up = not switches >> deadman & 1
        if not (self.is_up and self.watches):
            return ""
        return "" if self.port.let_go(DEADMAN) else f"has its deadman switch {deadman} released"

    def _fault(self, text: str) -> str:
        """Return the message for an invalid reading, and do not read the device again."""
        self.is_gone = True
        return f"{self.name} {text}; {ZERO}"

    def _failure(self, action: str, error: BaseException) -> str:
        """Return the message for a failed call, and do not read the device again.

        For a DeviceError of a simulated device, the message of the exception is returned unchanged.
        """
        self.is_gone = True
        if isinstance(error, DeviceError):
            return f"{self.name}: {message(error)}" if self.hardware else str(error)
        return f"{self.name} {action}: {type(error).__name__}: {message(error)}; {ZERO}"


class DeviceExchange:
    """Calls of all Python devices, in the order of the ports.

    Attributes:
        exits: Record of whether a call of a driver is in progress, so that a signal can interrupt the call.
        call: Memory that contains the number of the device call in progress, or 0; another process may read it.
    """

    def __init__(self, ports: Iterable[DevicePort]) -> None:
        self.ports = list(ports)
        self.exits = Exits()
        self.call: memoryview | list[int] = [0]

    @property
    def hardware(self) -> DeviceExchange:
        """Exchange with only those devices that are hardware."""
        part = DeviceExchange(each for each in self.ports if each.hardware)
        part.exits, part.call = self.exits, self.call
        return part

    @property
    def repeats(self) -> int:
        """Number of readings since the start that returned no new sample."""
        return sum(each.readings.repeats for each in self.ports)

    @property
    def has_unstopped(self) -> bool:
        """Whether the last call of a device's `stop` has failed, so that its force may remain."""
        return any(each.is_unstopped for each in self.ports)

    def read(self, periods: int = 1) -> list[str]:
        """Send requests to all devices that have not failed, then read these devices; list the error messages."""
        call, faults = self.call, list[str]()
        self.exits.inside = True
        try:
            for each in self.ports:
                call[0] = each.place
                if not each.is_gone and (text := each.ask()):
                    faults.append(text)
            for each in self.ports:
                call[0] = each.place + 1
                if text := each.read(periods):
                    faults.append(text)
            return faults
        finally:
            call[0] = 0
            self.exits.inside = False

    def write(self) -> str:
        """Write the forces to the devices until a call fails; return the error message.

        Raises:
            Interruption: If the code of a driver suppressed a signal, or a second signal arrived; no force is written.
        """
        if self.exits.at_once:
            raise Interruption(self.exits.cause)
        self.exits.inside = True
        call = self.call
        try:
            for each in self.ports:
                call[0] = each.place + 2
                if text := each.write():
                    return text
            return ""
        finally:
            call[0] = 0
            self.exits.inside = False

    def stop(self) -> list[str]:
        """Set the force of every device to zero, beginning with the devices that have not failed before.

        The result lists the error messages of the devices that have not failed before.
        """
        sound = [each for each in self.ports if not each.is_gone]
        silent = [each for each in self.ports if each.is_gone]
        try:
            texts = _all([partial(self._stop, each) for each in sound])
            _all([partial(self._stop, each) for each in silent])
        finally:
            self.call[0] = 0
        return texts

    def _stop(self, port: DevicePort) -> str:
        self.call[0] = port.place + 3
        return port.stop()

    def close(self) -> list[str]:
        """Close all devices in reverse order; list the error messages."""
        return _all([each.close for each in reversed(self.ports)])


def call_of(place: int, names: Sequence[str]) -> str:
    """Return a text with the method and the device of a device call; it is empty if no call has this number.

    Args:
        place: Number of the call.
        names: Names of all devices.
    """
    number, call = divmod(place - 1, len(CALLS))
    return f"`{CALLS[call]}` of {names[number]}" if 0 <= number < len(names) else ""


def _all(calls: Sequence[Callable[[], str]]) -> list[str]:
    """Make all calls, also those after a call that raises an exception; list the error messages."""
    texts: list[str] = []
    for i, call in enumerate(calls):
        try:
            texts.append(call())
        except BaseException:
            _all(calls[i + 1 :])  # then the exception propagates
            raise
    return [text for text in texts if text]


def _take_limit(limit: FloatArray, largest: object, scale: float) -> str:
    """Copy the largest forces of a device, divided by the scale of its frame; return a message if they are invalid."""
    if type(largest) is not np.ndarray or largest.shape != limit.shape or largest.dtype != np.float64:
        return f"reported {abbreviate(largest)} for its largest forces, expected an array {limit.shape} of float64"
    limit[...] = largest / scale
    if (limit > 0.0).all():
        return ""
    return f"reported largest forces of {', '.join(f'{force:g}' for force in limit)} N, expected values above zero"


class LoopLog:
    """Exchange with devices that also records the time of each tick and the duration of device calls.

    Args:
        memory: Memory of the real-time loop, `LoopState`, in which they are stored.
        layout: Layout of the recorded rows.
        devices: Python devices; their ports then record new samples, switches and raw numbers.
        pacer: Pacer that makes each tick wait for its deadline.
    """

    def __init__(self, memory: FloatArray, layout: Layout, devices: DeviceExchange, pacer: Pacer) -> None:
        self._numbers: Any = memory.data  # plain floats, because access to items of an array takes twice as long
        self._devices, self._pacer, self._clock = devices, pacer, pacer.clock
        LoopState(memory).array(LoopState.fresh)[:] = 1.0  # for simulated devices whose kernels read them
        for each in devices.ports:
            each.log = PortLog(memory, layout, each.device, each.port.station, each.channels)

    def begin(self) -> None:
        """Record the present time as the start of a tick."""
        source_function(note_times)(self._numbers, 0, self._pacer.buffer, 0)

    def read(self, periods: int) -> list[str]:
        """Call `DeviceExchange.read` and record the duration of the call."""
        began = self._clock.now()
        faults = self._devices.read(periods)
        self._numbers[READ_TIME] = self._clock.now() - began
        return faults

    def write(self) -> str:
        """Call `DeviceExchange.write` and record the duration of the call."""
        began = self._clock.now()
        fault = self._devices.write()
        self._numbers[WRITE_TIME] = self._clock.now() - began
        return fault
