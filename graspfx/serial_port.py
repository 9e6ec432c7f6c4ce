"""Serial port of a microcontroller board, with exclusive access, and time limits for sending and receiving."""

from __future__ import annotations

import errno
import os
import select
import time
from contextlib import suppress

from graspfx.errors import DeviceError
from graspfx.system.file_lock import lock

MOST = 4096  # bytes per read
MOST_SELECTED = 1024  # `select` accepts descriptors below this number


class SerialPort:
    """Serial port to which this program has exclusive access while the port is open, by a lock and by TIOCEXCL.

    The lock ends with the program. Errors of the port are raised as DeviceError, with the path in the message.

    Args:
        path: Path of the port, such as /dev/ttyACM0 or a link in /dev/serial/by-id.
        baud: Rate [bit/s]; None to keep the present rate, for example for boards with native USB, which ignore the
            rate.
    """

    def __init__(self, path: str, baud: int | None = None) -> None:
        self.path, self.baud = path, baud
        self._descriptor = -1
        self._poll: select.poll | None = None

    def now(self) -> float:
        """Return the present time [s], on the clock of `time.perf_counter`."""
        return time.perf_counter()

    def sleep(self, duration: float) -> None:
        """Sleep for `duration` [s]."""
        time.sleep(duration)

    @property
    def is_open(self) -> bool:
        """Whether the port is open."""
        return self._descriptor >= 0

    def open(self) -> None:
        """Open the port; if it is already open, close it first.

        Raises:
            DeviceError: If the port cannot be opened, does not support the rate, or is open in another program.
        """
        self.close()
        try:
            import fcntl
            import termios
            import tty
        except ImportError as error:
            raise DeviceError(f"{self.path}: serial ports are supported on Linux and macOS only") from error
        try:
            descriptor = os.open(self.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            busy = error.errno == errno.EBUSY  # TIOCEXCL of another program
            raise DeviceError(self._busy if busy else f"{self.path} cannot be opened: {error.strerror}") from error
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
            termios.tcflush(descriptor, termios.TCIFLUSH)  # drop replies to an earlier program
        except (OSError, termios.error) as error:
            os.close(descriptor)
            raise DeviceError(f"{self.path} is not a serial port: {error}") from error
        except AttributeError as error:
            os.close(descriptor)
            raise DeviceError(f"{self.path}: this system does not support {self.baud} bit/s") from error
        self._descriptor, self._poll = descriptor, select.poll()
        self._poll.register(descriptor, select.POLLIN)

    @property
    def _busy(self) -> str:
        return f"{self.path} is taken by another program; end that program first: only one may drive a device"

    def send(self, frame: bytes, patience: float = 0.01) -> None:
        """Send a frame; if the port accepts only a part of the frame at once, send the rest as soon as possible.

        Args:
            frame: Complete frame of the board's protocol.
            patience: Longest duration of sending [s].

        Raises:
            DeviceError: If the port has failed, or has not accepted the whole frame in `patience`.
        """
        left, deadline = memoryview(frame), self.now() + patience
        while True:
            try:
                left = left[os.write(self._descriptor, left) :]
            except BlockingIOError:
                pass
            except OSError as error:
                raise DeviceError(f"the board at {self.path} is disconnected: {error.strerror}") from error
            if not left:
                return
            if self.now() > deadline:
                raise DeviceError(
                    f"the board at {self.path} accepted only a part of a frame in {patience:g} s: "
                    f"{len(left)} of {len(frame)} bytes were not sent"
                )
            select.select([], [self._descriptor], [], 0.001)

    def receive(self, deadline: float) -> bytes:
        """Wait until bytes arrive or `now()` reaches `deadline` [s]; return the bytes, or b"" if none arrived."""
        wait = max(0.0, deadline - self.now())
        try:
            if self._poll is None or not self._wait(wait):
                return b""
            data = os.read(self._descriptor, MOST)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise DeviceError(f"the board at {self.path} is disconnected: {error.strerror}") from error
        if not data:
            raise DeviceError(f"the board at {self.path} is disconnected: its port was closed")
        return data

    def _wait(self, seconds: float) -> bool:
        if self._descriptor < MOST_SELECTED:
            return bool(select.select([self._descriptor], [], [], seconds)[0])
        assert self._poll is not None
        return bool(self._poll.poll(1e3 * seconds))  # in whole milliseconds, rounded up

    def flush(self) -> None:
        """Discard all bytes that were received and not read."""
        while self.receive(0.0):
            pass

    def close(self) -> None:
        """Close the port, without an error if it is already closed or the board is disconnected."""
        descriptor, self._descriptor, self._poll = self._descriptor, -1, None
        if descriptor < 0:
            return
        import fcntl
        import termios

        with suppress(OSError, termios.error):
            termios.tcflush(descriptor, termios.TCIFLUSH)
            fcntl.ioctl(descriptor, termios.TIOCNXCL)
        with suppress(OSError):
            os.close(descriptor)  # releases the lock too
