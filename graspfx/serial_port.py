"""A serial port of a board's: one program at a time, a frame in one piece, and no wait without an end."""

from __future__ import annotations

import errno
import os
import select
import time
from contextlib import suppress

from graspfx.errors import DeviceError
from graspfx.system.file_lock import lock

MOST = 4096  # bytes at a time
MOST_SELECTED = 1024  # descriptors that `select` counts


class SerialPort:
    """A serial port that one program has for itself, by a lock that goes with the program, and TIOCEXCL.

    Every fault is a DeviceError that names the port.

    Args:
        path: of the port, such as /dev/ttyACM0 or a link in /dev/serial/by-id.
        baud: bits a second; None leaves it, for boards whose USB is their own and takes no notice.
    """

    def __init__(self, path: str, baud: int | None = None) -> None:
        self.path, self.baud = path, baud
        self._descriptor = -1
        self._poll: select.poll | None = None

    def now(self) -> float:
        """Give the time of the clock by which `receive` waits, `time.perf_counter` [s]."""
        return time.perf_counter()

    def sleep(self, duration: float) -> None:
        """Wait for about so long [s]."""
        time.sleep(duration)

    @property
    def is_open(self) -> bool:
        """Whether the port is open."""
        return self._descriptor >= 0

    def open(self) -> None:
        """Take the port, afresh if this object has it already."""
        self.close()
        try:
            import fcntl
            import termios
            import tty
        except ImportError as error:
            raise DeviceError(f"{self.path}: serial ports are opened on Linux and macOS only so far") from error
        try:
            descriptor = os.open(self.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            busy = error.errno == errno.EBUSY  # somebody else's TIOCEXCL
            raise DeviceError(self._busy if busy else f"{self.path} does not open: {error.strerror}") from error
        is_ours = False
        with suppress(OSError):
            is_ours = lock(descriptor, lockless=False)
        if not is_ours:
            os.close(descriptor)
            raise DeviceError(self._busy)
        try:
            fcntl.ioctl(descriptor, termios.TIOCEXCL)
            tty.setraw(descriptor)
            if self.baud is not None:
                settings = termios.tcgetattr(descriptor)
                settings[4] = settings[5] = getattr(termios, f"B{self.baud}")
                termios.tcsetattr(descriptor, termios.TCSANOW, settings)
            termios.tcflush(descriptor, termios.TCIFLUSH)  # not what a program before had to say, such as zero
        except (OSError, termios.error) as error:
            os.close(descriptor)
            raise DeviceError(f"{self.path} is no serial port: {error}") from error
        except AttributeError as error:
            os.close(descriptor)
            raise DeviceError(f"{self.path}: this system knows no rate of {self.baud} bits a second") from error
        self._descriptor, self._poll = descriptor, select.poll()
        self._poll.register(descriptor, select.POLLIN)

    @property
    def _busy(self) -> str:
        return f"{self.path} is taken by another program; end that one first: two must not drive one device"

    def send(self, frame: bytes, patience: float = 0.01) -> None:
        """Send a frame by one call; whatever of it the port does not take at once follows, or the port is at fault.

        Args:
            frame: all of it, since boards wait for the rest of one that is cut.
            patience: until all of it must be out [s].
        """
        left, deadline = memoryview(frame), self.now() + patience
        while True:
            try:
                left = left[os.write(self._descriptor, left) :]
            except BlockingIOError:
                pass
            except OSError as error:
                raise DeviceError(f"the board at {self.path} is gone: {error.strerror}") from error
            if not left:
                return
            if self.now() > deadline:
                raise DeviceError(f"the board at {self.path} takes no more bytes: a frame was cut")
            select.select([], [self._descriptor], [], 0.001)

    def receive(self, deadline: float) -> bytes:
        """Wait for bytes until a time of `now` [s], and give those that are there; none is no error."""
        wait = max(0.0, deadline - self.now())
        try:
            if self._poll is None or not self._wait(wait):
                return b""
            data = os.read(self._descriptor, MOST)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise DeviceError(f"the board at {self.path} is gone: {error.strerror}") from error
        if not data:
            raise DeviceError(f"the board at {self.path} is gone: the line is closed")
        return data

    def _wait(self, seconds: float) -> bool:
        if self._descriptor < MOST_SELECTED:
            return bool(select.select([self._descriptor], [], [], seconds)[0])
        assert self._poll is not None
        return bool(self._poll.poll(1e3 * seconds))  # in whole milliseconds, rounded up

    def flush(self) -> None:
        """Throw away what has come."""
        while self.receive(0.0):
            pass

    def close(self) -> None:
        """Let go of the port; returns also with the hardware gone, and twice."""
        descriptor, self._descriptor, self._poll = self._descriptor, -1, None
        if descriptor < 0:
            return
        import fcntl
        import termios

        with suppress(OSError, termios.error):
            termios.tcflush(descriptor, termios.TCIFLUSH)
            fcntl.ioctl(descriptor, termios.TIOCNXCL)
        with suppress(OSError):
            os.close(descriptor)  # and with it the lock
