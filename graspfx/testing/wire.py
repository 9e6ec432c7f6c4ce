"""Emulators of hardware for tests of drivers: they report the motors' torques and simulate failures.

The emulator of a built-in driver is the module `emulator.py` in the driver's folder; it is imported on first use.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import random
import select
import subprocess
import threading
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from shutil import rmtree, which
from tempfile import mkdtemp
from types import MappingProxyType, ModuleType
from typing import Any, Literal, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from graspfx import plugins
from graspfx.errors import InputError, MissingPackageError
from graspfx.loop.realtime.pacing import Clock as Clock
from graspfx.loop.realtime.pacing import WallClock as WallClock
from graspfx.resource import Resource
from graspfx.system import terminal

_DRIVERS = {
    "DiyWire": "haply-2diy",
    "EventWire": "mouse",
    "ForceDimensionWire": "force-dimension",
    "InverseWire": "haply-inverse",
    "OpenHapticsWire": "open-haptics",
    "RigWire": "rig",
    "ScreenWire": "touch-screen",
}

__all__ = ["FAILURES", "Failure", "SerialWire", "Wire", *_DRIVERS]

FloatArray = NDArray[np.float64]
Page = TypeVar("Page", bound=ctypes.Structure)
Failure = Literal["late", "drop", "flip", "cut", "garbage", "wrong-id", "unplugged", "blocked"]
"""Names of the failures of an emulator."""

FAILURES: tuple[Failure, ...] = get_args(Failure)
"""All names of `Failure`."""
NUMBERS: Mapping[Failure, float] = MappingProxyType(
    {"late": 0.004, "drop": 2.0, "flip": 0.5, "cut": -1.0, "garbage": 20.0}
)
"""Default parameters of the failures."""

IDLE = 0.001  # longest wait between two calls of `SerialWire.tick` [s]
MOST = 4096  # largest read [bytes]
SMALL = 1e-6  # step of an angle for a difference quotient [rad]
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2")


def __getattr__(name: str) -> Any:
    """Load the emulator of a driver on first use."""
    if name not in _DRIVERS:
        raise AttributeError(f"module 'graspfx.testing.wire' has no attribute {name!r}")
    globals()[name] = getattr(emulator(_DRIVERS[name]), name)
    return globals()[name]


def __dir__() -> list[str]:
    return sorted(__all__)


def emulator(driver: str) -> ModuleType:
    """Import the emulator of a driver, which is the module `emulator.py` in the driver's folder."""
    return import_module(f"{plugins.load('devices', driver).__name__}.emulator")


class Wire(Resource):
    """Base class of emulators, which communicate with a driver in place of the hardware.

    An emulator is a context manager. Inside its `with` block, `connect(**settings)` of the driver connects to the
    emulator.

    Args:
        clock: Clock of the hardware and of the conformance kit; by default the system's clock.

    Attributes:
        kinds: Failures that this hardware can have.
        limit: Largest torque of each motor [N m]; for a library that accepts forces, the largest force [N].
        checksum: Whether the receiver of an answer detects a changed bit.
        slowness: Ratio of a time interval on `clock` to the same interval on the hardware's clock.
    """

    kinds: frozenset[Failure] = frozenset(FAILURES)
    limit: float
    checksum = True
    slowness = 1.0

    def __init__(self, clock: Clock | None = None) -> None:
        self.clock: Clock = clock or WallClock()
        self.failure: Failure | None = None
        self.number = 0.0

    @property
    @abstractmethod
    def settings(self) -> dict[str, Any]:
        """Arguments of `connect` for a connection to the emulator, such as the port."""

    @property
    @abstractmethod
    def torque(self) -> FloatArray:
        """Present torques of the motors (m,) [N m]; for a library that accepts forces, present forces [N]."""

    @property
    def position(self) -> FloatArray | None:
        """True positions of the fingertips (k, d) [m]; None if the emulator does not know the mechanism."""
        return None

    @property
    def force(self) -> FloatArray | None:
        """Forces of the motors at the fingertips (k, d) [N]; None if the emulator does not know the mechanism."""
        return None

    @abstractmethod
    def move(self) -> None:
        """Displace every finger by a few millimetres from its initial position, and keep it there."""

    @abstractmethod
    def home(self) -> None:
        """Move every finger to its initial position, at which the device can be opened."""

    def fail(self, kind: Failure, number: float | None = None) -> None:
        """Simulate a failure until `heal` is called.

        Args:
            kind: Kind of failure. "late": answers are delayed by `number` seconds. "drop": one of `number` answers is
                lost. "flip": one bit of an answer is changed with probability `number`. "cut": only the first `number`
                bytes of an answer are transmitted; if `number` is -1, successive answers are cut at different bytes.
                "garbage": `number` random bytes precede each answer. "wrong-id": answers have the identifier of another
                device. "unplugged": the cable is unplugged. "blocked": the board neither reads nor answers,
                and the motors keep their torques.
            number: Parameter of the failure; by default the value in NUMBERS.

        Raises:
            InputError: If this hardware cannot have the failure.
        """
        if kind not in self.kinds:
            raise InputError("kind", kind, f"one of {', '.join(sorted(self.kinds))}")
        self.number = NUMBERS.get(kind, 0.0) if number is None else float(number)
        self.failure = kind
        self._change()

    def heal(self) -> None:
        """End the failure; if the cable was unplugged, connect it again, with the same `settings`."""
        self.failure = None
        self._change()

    @abstractmethod
    def _change(self) -> None:
        """Apply the failure to the emulated hardware."""

    @abstractmethod
    def close(self) -> None:
        """End the emulator; do nothing if it has already ended."""


class Damage:
    """A failure of a line that changes, delays or removes answers, reproducibly for a given seed.

    Attributes:
        kind: Kind of the failure, as in `Wire.fail`; None for no failure.
        number: Parameter of the failure, as in `Wire.fail`.
    """

    def __init__(self, seed: int = 0) -> None:
        self.kind: Failure | None = None
        self.number = 0.0
        self._random, self._answers = random.Random(seed), 0

    def apply(self, answer: bytes) -> Iterator[tuple[float, bytes]]:
        """Yield delay [s] and bytes of each part that the line transmits for an answer."""
        self._answers += 1
        match self.kind:
            case "late":
                yield self.number, answer
            case "drop":
                if self._answers % max(1, round(self.number)):
                    yield 0.0, answer
            case "flip":
                out = bytearray(answer)
                if self._random.random() < self.number:
                    out[self._random.randrange(len(out))] ^= 1 << self._random.randrange(8)
                yield 0.0, bytes(out)
            case "cut":
                count = self._answers % len(answer) if self.number < 0.0 else round(self.number)
                yield 0.0, answer[:count]
            case "garbage":
                yield 0.0, self._random.randbytes(round(self.number)) + answer
            case "wrong-id":
                yield 0.0, bytes([answer[0] ^ 0x55]) + answer[1:]
            case "unplugged" | "blocked":
                return
            case _:
                yield 0.0, answer


class Plug:
    """Name of a port that remains valid when the emulator is disconnected and connected again.

    Attributes:
        folder: Temporary folder, which may contain further files of the emulator.
        port: Name of the port, a symbolic link in the folder.
    """

    def __init__(self) -> None:
        self.folder = Path(mkdtemp(prefix="graspfx-wire-"))
        self.port = str(self.folder / "port")

    def lead(self, terminal: str) -> None:
        """Let the port refer to a terminal, given by its path."""
        self.pull()
        (self.folder / "port").symlink_to(terminal)

    def pull(self) -> None:
        """Disconnect the port."""
        (self.folder / "port").unlink(missing_ok=True)

    def remove(self) -> None:
        """Delete the folder."""
        rmtree(self.folder, ignore_errors=True)


class SerialWire(Wire):
    """Base class of emulated boards on a serial line. A subclass defines the board's answers in `receive`.

    The board runs in its own thread, which is started by the constructor, and `settings` contain only the port. If a
    clock is given, the board has no thread and no port; it runs only during calls of `exchange`.

    Args:
        seed: Seed of the random failures.
        clock: Clock of the board; by default the system's clock.
    """

    def __init__(self, seed: int = 0, clock: Clock | None = None) -> None:
        super().__init__(clock)
        self._damage, self._plug = Damage(seed), Plug()
        self._lock = threading.Lock()  # lock of the terminal's descriptors
        self._late: list[tuple[float, bytes]] = []
        self._unread = self._unsent = b""
        self._master = self._slave = -1
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._serve, name=type(self).__name__, daemon=True)
        self._has_port = clock is None
        if self._has_port:
            self._insert()
            self._thread.start()

    @abstractmethod
    def receive(self, data: bytes) -> Iterable[bytes]:
        """Process received bytes, which may end within a frame; return the answers, one frame each."""

    def tick(self) -> None:
        """Perform actions that are independent of received bytes, such as a watchdog.

        The board calls this method about every millisecond or more often.
        """

    def exchange(self, data: bytes = b"") -> bytes:
        """Send bytes to a board that was created with a clock, and return the bytes that the board has sent."""
        self._unread += data
        return b"".join(self._turn())

    @property
    def port(self) -> str:
        """Name of the serial port; it does not change when the cable is unplugged and connected again."""
        return self._plug.port

    @property
    def settings(self) -> dict[str, Any]:
        return {"port": self.port}

    def _change(self) -> None:
        with self._lock:
            if self.failure == "unplugged":
                self._pull()
            elif self._master < 0 and self._has_port:
                self._insert()
            self._damage.number, self._damage.kind = self.number, self.failure

    def close(self) -> None:
        if not self._closed.is_set():
            self._closed.set()
            if self._has_port:
                self._thread.join()
            with self._lock:
                self._pull()
            self._plug.remove()

    def _insert(self) -> None:
        self._master, self._slave = terminal.pseudo_terminal()  # a separate descriptor of the slave keeps the line open
        os.set_blocking(self._master, False)  # a driver may flush bytes after `select` has reported them
        self._plug.lead(os.ttyname(self._slave))

    def _pull(self) -> None:
        if self._master >= 0:
            os.close(self._slave)
            os.close(self._master)
        self._master = self._slave = -1
        self._plug.pull()
        self._late.clear()
        self._unsent = b""

    def _serve(self) -> None:
        while not self._closed.is_set():
            self._unread += self._heard()
            with self._lock:
                self._unsent += b"".join(self._turn())
                if self._unsent and self._master >= 0:
                    self._send()

    def _send(self) -> None:
        """Write as many bytes of the answers as the line accepts now; the others are written in a later call."""
        try:
            self._unsent = self._unsent[os.write(self._master, self._unsent) :]
        except BlockingIOError:
            return
        except OSError:  # the line has failed
            self._unsent = b""

    def _turn(self) -> Iterator[bytes]:
        """Process received bytes, yield the answers that are due, and call `tick`."""
        if self._unread and self._damage.kind != "blocked":
            for answer in self.receive(self._unread):
                now = self.clock.now()
                self._late += [(now + delay, part) for delay, part in self._damage.apply(answer) if part]
            self._unread = b""
        now = self.clock.now()
        while self._late and self._late[0][0] <= now:
            yield self._late.pop(0)[1]
        self.tick()

    def _heard(self) -> bytes:
        """Wait for bytes for up to `IDLE` seconds; return the received bytes."""
        with self._lock:
            master = self._master
            wait = IDLE if not self._late else max(0.0, min(IDLE, self._late[0][0] - self.clock.now()))
        if master < 0 or self._damage.kind == "blocked":
            self.clock.sleep(IDLE)
            return b""
        with suppress(OSError, ValueError):  # the cable was unplugged in the meantime
            has_bytes = bool(select.select([master], [], [], wait)[0])
            with self._lock:  # the number `master` may belong to another file by now
                if has_bytes:
                    return os.read(self._master, MOST)
                terminal.release_terminal(self._slave)  # releases the claim of a dead user, as unplugging a board does
        return b""


def compiler() -> str | None:
    """Return the path of a C compiler, gcc or cc; None if neither is installed."""
    return which("gcc") or which("cc")


def build(arguments: Sequence[str], product: Path, folder: Path) -> Path:
    """Run the C compiler, and return the path of its output.

    Args:
        arguments: Arguments of the compiler, such as source files.
        product: Path of the output.
        folder: Working folder of the compiler.

    Raises:
        MissingPackageError: If no C compiler is installed.
        RuntimeError: If the compilation fails; the message contains the compiler's messages.
    """
    program = compiler()
    if program is None:
        raise MissingPackageError("gcc", "an emulator in C", "install a C compiler")
    call = [program, *STRICT, *arguments, "-o", str(product)]
    answer = subprocess.run(call, cwd=folder, capture_output=True, text=True, check=False)
    if answer.returncode:
        raise RuntimeError(f"{' '.join(call)}:\n{answer.stderr}")
    return product


def shared_page(kind: type[Page], file: Path) -> Page:
    """Create a file with a C structure of zeros, and map it into memory that other programs can share."""
    file.write_bytes(bytes(ctypes.sizeof(kind)))
    with file.open("r+b") as opened:
        return kind.from_buffer(mmap.mmap(opened.fileno(), 0))


def tip_force(place: Callable[[FloatArray], FloatArray], angles: FloatArray, torque: FloatArray) -> FloatArray:
    """Compute the force f at a fingertip (d,) [N] that corresponds to given joint torques tau, by J'f = tau.

    The Jacobian J of the fingertip's position with respect to the joint angles is computed by finite differences.

    Args:
        place: Function that returns the position of the fingertip (d,) [m] for joint angles (d,) [rad].
        angles: Joint angles (d,) [rad].
        torque: Joint torques tau (d,) [N m].
    """
    steps = SMALL * np.eye(len(angles))
    J = np.array([(place(angles + step) - place(angles - step)) / (2.0 * SMALL) for step in steps]).T
    force: FloatArray = np.linalg.solve(J.T, torque)
    return force
