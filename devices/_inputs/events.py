"""Linux input events from /dev/input/event*, with codes as in the kernel's input-event-codes.h."""

from __future__ import annotations

import errno
import os
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import NamedTuple

from graspfx.protocols import DeviceError

EVENT = struct.Struct("@llHHi")  # seconds, microseconds, kind, code, value
MOST, ROUNDS = 256 * EVENT.size, 16  # bytes per read and reads per call; further events wait

SYNC, KEY, RELATIVE, ABSOLUTE = 0, 1, 2, 3  # kinds of events
REPORT, DROPPED = 0, 3  # codes of SYNC: end of a report, and loss of events

# ioctl requests: direction and size of the data, the letter E, a number.
READ, WRITE = 2, 1
GRAB = 0x90
KEYS = 0x18
AXIS = 0x40
KEY_BYTES = 96
AXIS_STATE = struct.Struct("@6i")  # value, minimum, maximum, and three unused entries


class Event(NamedTuple):
    """An event: its kind, its key or axis, and its value."""

    kind: int
    code: int
    value: int


class Range(NamedTuple):
    """State of an absolute axis: its value and its limits."""

    value: int
    least: int
    most: int


def request(direction: int, number: int, size: int) -> int:
    """Return the number of an ioctl request."""
    return direction << 30 | size << 16 | ord("E") << 8 | number


class EventPort:
    """The port of an input device, for one GraspFX program at a time; other programs, such as the desktop, may read it.

    Args:
        path: Path such as /dev/input/by-id/usb-Maker_Mouse-event-mouse.
        grab: Whether to withhold the events from other programs.
        now: Function that returns the time of a reading [s].
    """

    def __init__(self, path: str, *, grab: bool, now: Callable[[], float] = time.perf_counter) -> None:
        self.path, self.grab, self.now = path, grab, now
        self._descriptor = -1
        self._bytes = b""

    def open(self) -> None:
        """Open the port and discard pending events."""
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
                raise DeviceError(f"the input device at {self.path} is gone: {error.strerror}") from error
            if not data:
                raise DeviceError(f"the input device at {self.path} is gone: the file was closed")
            self._bytes += data
            whole = len(self._bytes) - len(self._bytes) % EVENT.size
            data, self._bytes = self._bytes[:whole], self._bytes[whole:]
            for _, _, kind, code, value in EVENT.iter_unpack(data):
                yield Event(kind, code, value)

    def axis(self, code: int) -> Range | None:
        """Return the state of an absolute axis; None if it is unknown."""
        answer = self._ask(AXIS + code, AXIS_STATE.size)
        return None if answer is None else Range(*AXIS_STATE.unpack(answer)[:3])

    def keys(self) -> bytes | None:
        """Return the pressed keys, one bit per code; None if they are unknown."""
        return self._ask(KEYS, KEY_BYTES)

    def _ask(self, number: int, size: int) -> bytes | None:
        import fcntl

        with suppress(OSError):
            return fcntl.ioctl(self._descriptor, request(READ, number, size), bytes(size))
        return None

    def close(self) -> None:
        """Close the port, without an error if the device is disconnected or already closed."""
        descriptor, self._descriptor, self._bytes = self._descriptor, -1, b""
        if descriptor >= 0:
            with suppress(OSError):
                os.close(descriptor)  # also releases the lock and the grab


def is_down(keys: bytes, code: int) -> bool:
    """Tell whether a key is pressed."""
    return bool(keys[code // 8] >> code % 8 & 1)
