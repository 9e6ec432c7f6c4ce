"""Serial port of a microcontroller board: exclusive access, whole frames, time limits on sending and receiving."""

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
    """Serial port with exclusive access, by a lock that ends with the program, and by TIOCEXCL.

    All faults raise a DeviceError that names the port.

    Args:
        path: Path of the port, such as /dev/ttyACM0 or a link in /dev/serial/by-id.
        baud: Rate [bit/s]; None to leave it unchanged, for boards with native USB, which ignore it.
    """

    def __init__(self, path: str, baud: int | None = None) -> None:
        self.path, self.baud = path, baud
        self._descriptor = -1
        self._poll: select.poll | None = None

    def now(self) -> float:
        """Return the time of `time.perf_counter` [s], the clock of `receive`."""
        return time.perf_counter()

    def sleep(self, duration: float) -> None:
        """Sleep for about `duration` [s]."""
        time.sleep(duration)

    @property
    def is_open(self) -> bool:
        """Whether the port is open."""
        return self._descriptor >= 0

    def open(self) -> None:
        """Open the port; if it is already open, reopen it.

        Raises:
            DeviceError: If the port cannot be opened, does not support the rate, or is used by another program.
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
        """Send a frame in one write if the port accepts the whole frame, otherwise in several.

        Args:
            frame: Complete frame; boards wait for the rest of a partial frame.
            patience: Time limit for sending [s].

        Raises:
            DeviceError: If the port has failed, or does not accept the frame in time.
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
                raise DeviceError(f"the board at {self.path} does not accept more bytes: a frame is incomplete")
            select.select([], [self._descriptor], [], 0.001)

    def receive(self, deadline: float) -> bytes:
        """Wait for bytes until `deadline`, on the clock of `now` [s]; return the received bytes, possibly none."""
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
        """Discard the received bytes."""
        while self.receive(0.0):
            pass

    def close(self) -> None:
        """Close the port; safe to call twice, and after the hardware is gone."""
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
