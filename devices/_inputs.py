"""Input devices without force feedback: Linux input events, and fingers that follow targets set by a device."""

from __future__ import annotations

import errno
import os
import struct
import time
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.devices._device import Closing
from graspfx.devices._settings import corners, flag, number, port_name, whole
from graspfx.protocols import SMALLEST, DeviceError, Features, Follower, InputError, approach, finite

FloatArray = NDArray[np.float64]

LONGEST = 0.1  # largest time step by which one reading advances targets and fingers [s]
HALF_WIDTH = 0.1  # half-width of the workspace, unless stated otherwise [m]

# Linux input events from /dev/input/event*, with codes as in the kernel's input-event-codes.h
EVENT = struct.Struct("@llHHi")  # seconds, microseconds, kind, code, value
MOST, ROUNDS = 256 * EVENT.size, 16  # largest number of bytes per read, and of reads per call

SYNC, KEY, RELATIVE, ABSOLUTE = 0, 1, 2, 3  # kinds of events
REPORT, DROPPED = 0, 3  # codes of SYNC: end of a report, and loss of events

# An ioctl request combines the direction and the size of its data, the letter E, and a number.
READ, WRITE = 2, 1
GRAB = 0x90
KEYS = 0x18
AXIS = 0x40
KEY_BYTES = 96
AXIS_STATE = struct.Struct("@6i")  # value, minimum, maximum, and three unused entries


class Event(NamedTuple):
    """An input event: kind, code of the key or axis, and value."""

    kind: int
    code: int
    value: int


class Range(NamedTuple):
    """State of an absolute axis: present, smallest and largest value."""

    value: int
    least: int
    most: int


def request(direction: int, number: int, size: int) -> int:
    """Return the code of the ioctl request with a direction, a number and a data size [bytes]."""
    return direction << 30 | size << 16 | ord("E") << 8 | number


class EventPort:
    """Event file of an input device.

    One GraspFX program at a time can open the file. Other programs, such as the desktop, can read it unless `grab` is
    set.

    Args:
        path: Path of the event file, such as /dev/input/by-id/usb-Maker_Mouse-event-mouse.
        grab: Whether to withhold the events from other programs.
        now: Function that returns the present time [s].
    """

    def __init__(self, path: str, *, grab: bool, now: Callable[[], float] = time.perf_counter) -> None:
        self.path, self.grab, self.now = path, grab, now
        self._descriptor = -1
        self._bytes = b""

    def open(self) -> None:
        """Open the event file and discard pending events."""
        self.close()
        try:
            import fcntl
        except ImportError as error:
            raise DeviceError(f"{self.path}: input events are available on Linux only") from error
        try:
            self._descriptor = os.open(self.path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            hint = "; add the user to the group input" if error.errno == errno.EACCES else ""
            raise DeviceError(f"{self.path} cannot be opened: {error.strerror}{hint}") from error
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if self.grab:
                fcntl.ioctl(self._descriptor, request(WRITE, GRAB, 4), 1)
            for _ in self.events():
                pass
        except OSError as error:
            self.close()
            busy = error.errno in (errno.EWOULDBLOCK, errno.EBUSY)
            text = (
                "is taken by another program; end that program first" if busy else f"cannot be opened: {error.strerror}"
            )
            raise DeviceError(f"{self.path} {text}") from error
        except DeviceError:
            self.close()
            raise

    def events(self) -> Iterator[Event]:
        """Yield the pending events.

        Raises:
            DeviceError: If the device is disconnected.
        """
        for _ in range(ROUNDS):
            try:
                data = os.read(self._descriptor, MOST)
            except BlockingIOError:
                return
            except OSError as error:
                raise DeviceError(f"the input device at {self.path} is disconnected: {error.strerror}") from error
            if not data:
                raise DeviceError(f"the input device at {self.path} is disconnected: its event file has ended")
            self._bytes += data
            whole = len(self._bytes) - len(self._bytes) % EVENT.size
            data, self._bytes = self._bytes[:whole], self._bytes[whole:]
            for _, _, kind, code, value in EVENT.iter_unpack(data):
                yield Event(kind, code, value)

    def axis(self, code: int) -> Range | None:
        """Query the state of an absolute axis; return None if the query fails."""
        answer = self._ask(AXIS + code, AXIS_STATE.size)
        return None if answer is None else Range(*AXIS_STATE.unpack(answer)[:3])

    def keys(self) -> bytes | None:
        """Query which keys are pressed, one bit per code; return None if the query fails."""
        return self._ask(KEYS, KEY_BYTES)

    def _ask(self, number: int, size: int) -> bytes | None:
        import fcntl

        with suppress(OSError):
            return fcntl.ioctl(self._descriptor, request(READ, number, size), bytes(size))
        return None

    def close(self) -> None:
        """Close the event file; raise no error if the device is disconnected or already closed."""
        descriptor, self._descriptor, self._bytes = self._descriptor, -1, b""
        if descriptor >= 0:
            with suppress(OSError):
                os.close(descriptor)  # also releases the lock and the grab


def is_down(keys: bytes, code: int) -> bool:
    """Tell whether the key with a code is pressed, given the result of `EventPort.keys`."""
    return bool(keys[code // 8] >> code % 8 & 1)


# Fingers --------------------------------------------------------------------------------------------------------------


class FollowingFingers(Closing):  # type: ignore[misc] # mypy does not see devices from inside the package
    """Fingers without force feedback: forces are checked but not displayed.

    The input device sets a target for each finger; the speed of a target is at most `speed`. Each finger follows its
    target with critical damping. Events at 60 to 1000 Hz therefore give a smooth motion in a loop of any rate.

    Args:
        source: Port of the input device, with methods `open` and `close`.
        workspace: Lower and upper corner of the workspace in d dimensions (2, d) [m].
        start: Positions of the k fingers when the device is opened (k, d) [m].
        lag: Time constant of a finger [s]; a finger lags a target of constant velocity by twice this time.
        speed: Largest speed of a target [m/s].
        switch_count: Number of switches.
    """

    def __init__(
        self, source: Any, workspace: FloatArray, start: FloatArray, lag: object, speed: object, switch_count: int
    ) -> None:  # fmt: skip
        self.source, self.speed = source, number("speed", speed, SMALLEST, 5.0)
        self._box, self._start, self._switch_count = workspace, start, switch_count
        self._target = start.copy()
        self._follower = Follower(number("lag", lag, 1e-4, 1.0), start)
        self._position, self._velocity = self._follower.position, self._follower.velocity
        self._switches = 0
        self._is_open = False

    @property
    def features(self) -> Features:
        k, d = self._start.shape
        return Features(
            fingers=k,
            dimensions=d,
            workspace=(self._box[0].copy(), self._box[1].copy()),
            continuous_force=0.0,
            switches=self._switch_count,
        )

    @property
    def switches(self) -> int:
        """Switches that were closed at the last reading, as bits; the first switch is bit 0."""
        return self._switches

    def now(self) -> float:
        """Return the present time on the clock of the readings [s]."""
        return time.perf_counter()

    def open(self, period: float) -> None:
        self.close()
        self.source.open()
        self._target[:] = self._start
        self._follower.place(self._start)
        self._begin()
        self._began = self._time = self.now()
        self._is_open = True

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        """Return positions (k, d) [m], velocities (k, d) [m/s] and the time since `open` [s]."""
        self._opened()
        self._take()
        now = self.now()
        duration, self._time = min(now - self._time, LONGEST), now
        self._aim(duration)
        self._follower.follow(self._target, duration)
        return self._position, self._velocity, now - self._began

    def write(self, forces: FloatArray) -> None:
        """Check forces (k, d) [N], which are not displayed."""
        self._opened()
        if np.shape(forces) != self._position.shape:
            raise InputError("forces", forces, f"an array of shape {self._position.shape}, one row per finger")
        if not np.isfinite(forces).all():
            self.stop()
            raise DeviceError(f"forces of {np.asarray(forces).tolist()} N are not finite")
        self._show(forces)

    def stop(self) -> None:
        self._show(np.zeros_like(self._position))

    def close(self) -> None:
        self._is_open = False
        self._switches = 0
        self.source.close()

    @abstractmethod
    def _begin(self) -> None:
        """Prepare the readings after the input device has been opened."""

    @abstractmethod
    def _take(self) -> None:
        """Process the input since the last reading."""

    @abstractmethod
    def _aim(self, duration: float) -> None:
        """Advance the targets by a duration [s], as determined by the input."""

    def _show(self, forces: FloatArray) -> None:
        """Draw the forces (k, d) [N], if the device has a screen; the operator does not feel them."""

    def _opened(self) -> None:
        if not self._is_open:
            raise DeviceError("the input device is not open: call open(period) first")


class Pointer(FollowingFingers):
    """One finger moved by the events of a mouse or gamepad.

    Events move a goal, and the finger's target approaches the goal at no more than `speed`. Without events the goal
    stays in place, unless `_move` of a subclass moves it.

    Args:
        buttons: Key codes of the device's switches, in the order of the bits of `switches`.
        port, dimensions, workspace, start, lag, speed, grab: Settings of the driver.
    """

    def __init__(
        self, buttons: Sequence[int], *, port: object, dimensions: object, workspace: object, start: object,
        lag: object, speed: object, grab: object,
    ) -> None:  # fmt: skip
        box = area(workspace, whole("dimensions", dimensions, 1, 3))
        place = box.mean(axis=0) if start is None else inside(box, start, box.shape[1:])
        source = EventPort(port_name(port), grab=flag("grab", grab))
        super().__init__(source, box, place[None, :], lag, speed, len(buttons))
        self._buttons, self._goal = tuple(buttons), place.copy()

    def now(self) -> float:
        return float(self.source.now())

    def _begin(self) -> None:
        self._goal[:] = self._start[0]
        self._events: list[Event] = []  # events since the last report
        self._is_lost = False  # whether events of this report were lost
        self._look()

    def _take(self) -> None:
        self._accept(self.source.events())

    def _accept(self, events: Iterable[Event]) -> None:
        """Process the events of complete reports; if events of a report were lost, query the device's state instead."""
        for event in events:
            if event.kind != SYNC:
                self._events.append(event)
            elif event.code == DROPPED:
                self._is_lost = True
                self._switches = 0  # events of released buttons may have been lost
            elif event.code == REPORT:
                report, self._events = self._events, []
                if self._is_lost:
                    self._is_lost = False
                    self._look()
                else:
                    for each in report:
                        self._press(each) if each.kind == KEY else self._act(each)
            del self._events[:-1000]  # limits the memory for a device that never ends a report

    def _aim(self, duration: float) -> None:
        self._move(self._goal, duration)
        np.clip(self._goal, *self._box, out=self._goal)
        approach(self._target[0], self._goal, self.speed * duration)

    @abstractmethod
    def _act(self, event: Event) -> None:
        """Process one event of a complete report; the event is not a key event."""

    def _move(self, goal: FloatArray, duration: float) -> None:
        """Move the goal for a duration [s] independently of events, for example while a stick is deflected."""

    def _look(self) -> None:
        """Query the pressed keys; called when the device is opened and after events were lost."""
        keys = self.source.keys()
        if keys is not None:
            self._switches = sum(1 << i for i, code in enumerate(self._buttons) if is_down(keys, code))

    def _press(self, event: Event) -> None:
        if event.code in self._buttons:
            bit = 1 << self._buttons.index(event.code)
            self._switches = self._switches | bit if event.value else self._switches & ~bit


def area(workspace: object, dimensions: int) -> FloatArray:
    """Check and return the corners of a workspace (2, d) [m]; if None, return -0.1 and 0.1 m along every axis."""
    if workspace is None:
        workspace = np.outer([-HALF_WIDTH, HALF_WIDTH], np.ones(dimensions))
    both: FloatArray = corners(workspace, dimensions)
    return both


def inside(workspace: FloatArray, start: object, shape: tuple[int, ...]) -> FloatArray:
    """Return initial positions [m]; raise InputError if they have another shape or one is outside the workspace."""
    expected = f"coordinates of shape {shape} within the workspace [m]"
    points: FloatArray = finite("start", start, expected)
    if points.shape != shape or not ((workspace[0] <= points) & (points <= workspace[1])).all():
        raise InputError("start", start, expected)
    return points
