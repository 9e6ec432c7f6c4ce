"""Hardware that is none: devices that a test reads back, of which one does evil; a clock without a wall, and a line."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import DeviceError
from graspfx.loop.device import Features

FloatArray = NDArray[np.float64]

LIMIT = 1.0  # of a fake's finger [N]
SETTLING = 41  # readings of a fake before the first tick, at a period of 5 ms

DRIVER = '''
"""Fakes, in the order in which they were connected."""
from tests.support.hardware import Fake

fakes = []

def connect(**settings):
    fakes.append(Fake(**settings))
    return fakes[-1]
'''


class VirtualClock:
    """A clock that stands still unless somebody waits: runs on it take no time."""

    time = 0.0

    def now(self) -> float:
        return VirtualClock.time

    def sleep(self, duration: float) -> None:
        VirtualClock.time += duration


class LookedAtClock(VirtualClock):
    """A virtual clock on which a look takes a microsecond, so that no two are at the same time."""

    def now(self) -> float:
        VirtualClock.time += 1e-6
        return VirtualClock.time


class Line:
    """The port of an emulator on a clock of its own: a serial line without a wait.

    Args:
        wire: the emulator, made with a `VirtualClock`.
    """

    STEP = 0.0005  # in which the emulator works by itself [s]

    def __init__(self, wire: Any) -> None:
        self.wire, self.path, self.is_open = wire, "the line", False
        self._bytes = b""

    def now(self) -> float:
        return float(self.wire.clock.now())

    def sleep(self, duration: float) -> None:
        """Let time pass, in which the emulator works."""
        end = self.now() + duration
        while (left := end - self.now()) > 0.0:
            self.wire.clock.sleep(min(left, self.STEP) + 1e-12)
            self._exchange(b"")

    def open(self) -> None:
        if self.wire.failure == "unplugged":
            raise DeviceError(f"{self.path} does not open")
        self.is_open, self._bytes = True, b""

    def send(self, frame: bytes) -> None:
        if not self.is_open or self.wire.failure == "unplugged":
            raise DeviceError(f"the board at {self.path} is disconnected")
        self._exchange(frame)

    def receive(self, deadline: float) -> bytes:
        while not self._bytes and self.now() < deadline:
            self.sleep(min(self.STEP, deadline - self.now()))
        self.send(b"")
        data, self._bytes = self._bytes, b""
        return data

    def flush(self) -> None:
        self.receive(0.0)

    def close(self) -> None:
        self.is_open = False

    def _exchange(self, data: bytes) -> None:
        self._bytes += self.wire.exchange(data)


class Fake:
    """A device whose fingers stand where they are put, and which keeps a list of what it is told.

    Args:
        position: of its fingers, (k, d) [m].
        evil: a name of `EVIL`, done from a tick on; nothing for a device that does all as it should.
        at: that tick.
        workspace: corners of where it works, (2, d) [m].
        board: of no use.
        switches: how many it has; all are down at first.

    Attributes:
        log: "open", "stop", "close", or forces, each with the count of readings so far.
    """

    def __init__(
        self,
        position: Any,
        evil: str = "",
        at: int = 10,
        workspace: Any = None,
        board: object = None,
        switches: int = 0,
    ) -> None:
        self.x = np.array(position, dtype=float)
        k, d = self.x.shape
        box = None if workspace is None else (np.array(workspace[0]), np.array(workspace[1]))
        self.features = Features(fingers=k, dimensions=d, peak_force=LIMIT, workspace=box, switches=switches)
        if switches:
            self.switches: Any = (1 << switches) - 1
        self.velocity = np.zeros((k, d))
        self.reads, self.log = 0, list[tuple[int, Any]]()
        self.period, self.at, self.evil = 0.0, at, EVIL[evil] if evil else Evil()
        self.memory: Any = None  # for evil deeds

    @property
    def tick(self) -> int:
        """The tick that is being read or written, negative before the first."""
        return self.reads - SETTLING - 1

    @property
    def turned(self) -> bool:
        """Whether it does evil by now."""
        return self.tick >= self.at

    def open(self, period: float) -> None:
        self.period, self.reads = period, 0
        self.log.append((0, "open"))

    def read(self) -> Any:
        self.reads += 1
        reading = self.x, self.velocity, self.reads * self.period
        return self.evil.read(self, *reading) if self.turned and self.evil.read else reading

    def write(self, forces: FloatArray) -> None:
        self.log.append((self.reads, np.array(forces)))
        if self.turned and self.evil.write:
            self.evil.write(self, forces)

    def stop(self) -> None:
        self.log.append((self.reads, "stop"))
        if self.turned and self.evil.stop:
            self.evil.stop(self)

    def close(self) -> None:
        self.log.append((self.reads, "close"))

    def __enter__(self) -> Fake:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    @property
    def forces(self) -> list[tuple[int, FloatArray]]:
        """Forces that were written, with their ticks."""
        return [(reads - SETTLING - 1, what) for reads, what in self.log if isinstance(what, np.ndarray)]

    def index(self, what: str) -> int:
        """Find the first entry of the log of that name."""
        return next(i for i, (_, entry) in enumerate(self.log) if isinstance(entry, str) and entry == what)


Reader = Callable[[Fake, FloatArray, FloatArray, float], Any]


@dataclass(frozen=True)
class Evil:
    """Deeds of a fake that no device should do.

    Attributes:
        read, write, stop: instead of what it should return, or besides.
        says: words of the fault; empty where there is none to be, as it does no harm.
        patience: ticks until it is a fault.
    """

    read: Reader | None = None
    write: Callable[[Fake, FloatArray], None] | None = None
    stop: Callable[[Fake], None] | None = None
    says: str = ""
    patience: int = 0


class Unspeakable(Exception):
    """An exception that cannot be written either."""

    def __str__(self) -> str:
        raise RuntimeError("no text")


def _raising(error: BaseException, says: str = "") -> dict[str, Evil]:
    """Give devices that raise an exception at their reading and their writing."""

    def read(fake: Fake, *reading: Any) -> Any:
        raise error

    def write(fake: Fake, forces: FloatArray) -> None:
        raise error

    name, says = type(error).__name__, says or type(error).__name__
    return {f"read raises {name}": Evil(read, says=says), f"write raises {name}": Evil(write=write, says=says)}


def _returning(says: str, make: Reader, patience: int = 0) -> Evil:
    return Evil(make, says=says, patience=patience)


def _hang(fake: Fake, duration: float) -> None:
    if fake.tick == fake.at:
        VirtualClock.time += duration


def _change_views(fake: Fake, forces: FloatArray) -> None:
    """Change what was read, after it was read, and forces, after they were told."""
    fake.x[...] += 0.001 * (-1.0) ** fake.reads
    forces[...] = 1e6


def _cannot_stop(fake: Fake) -> None:
    raise OSError("the port is disconnected")


def _constant(fake: Fake, p: FloatArray, v: FloatArray, t: float) -> Any:
    return p, v, (fake.at + SETTLING) * fake.period


class Subclass(np.ndarray[Any, np.dtype[np.float64]]):
    """An array with manners of its own."""


EVIL: dict[str, Evil] = {
    **_raising(DeviceError("the cable is out"), "the cable is out"),
    **_raising(OSError(5, "Input/output error")),
    **_raising(ValueError("no number")),
    **_raising(TypeError("no type")),
    **_raising(KeyError("axis")),
    **_raising(IndexError("out of range")),
    **_raising(AttributeError("no port")),
    **_raising(ZeroDivisionError("by zero")),
    **_raising(AssertionError()),
    **_raising(RuntimeError("\0 \ud800")),
    **_raising(StopIteration()),
    **_raising(MemoryError()),
    **_raising(RecursionError("too deep")),
    **_raising(TimeoutError("no answer")),
    **_raising(NotImplementedError()),
    **_raising(UnicodeDecodeError("ascii", b"\xff", 0, 1, "no letter")),
    **_raising(ExceptionGroup("two", [OSError("one"), ValueError("other")])),
    **_raising(Unspeakable()),
    "stop raises too": Evil(lambda *a: _raise(OSError("gone")), stop=_cannot_stop, says="OSError"),
    "nothing": _returning("None", lambda f, p, v, t: None),
    "positions alone": _returning("expected positions, velocities and a time", lambda f, p, v, t: p),
    "no time": _returning("expected positions, velocities and a time", lambda f, p, v, t: (p, v)),
    "four things": _returning("expected positions, velocities and a time", lambda f, p, v, t: (p, v, t, t)),
    "a list of three": _returning("expected positions, velocities and a time", lambda f, p, v, t: [p, v, t]),
    "positions in lists": _returning("for positions", lambda f, p, v, t: (p.tolist(), v, t)),
    "a number for positions": _returning("for positions", lambda f, p, v, t: (float(p[0, 0]), v, t)),
    "text for positions": _returning("for positions", lambda f, p, v, t: ("0.01", v, t)),
    "None for velocities": _returning("for velocities", lambda f, p, v, t: (p, None, t)),
    "a row less": _returning("for positions", lambda f, p, v, t: (p[0], v, t)),
    "a row too many": _returning("for positions", lambda f, p, v, t: (np.vstack([p, p]), v, t)),
    "a column too many": _returning("for velocities", lambda f, p, v, t: (p, np.hstack([v, v]), t)),
    "no rows": _returning("for positions", lambda f, p, v, t: (p[:0], v, t)),
    "float32": _returning("float32", lambda f, p, v, t: (p.astype(np.float32), v, t)),
    "whole numbers": _returning("int64", lambda f, p, v, t: (p.astype(np.int64), v, t)),
    "complex numbers": _returning("complex128", lambda f, p, v, t: (p, v.astype(complex), t)),
    "objects": _returning("object", lambda f, p, v, t: (p.astype(object), v, t)),
    "another byte order": _returning("for positions", lambda f, p, v, t: (p.astype(">f8"), v, t)),
    "a masked array": _returning("MaskedArray", lambda f, p, v, t: (np.ma.masked_all(p.shape), v, t)),
    "a subclass": _returning("Subclass", lambda f, p, v, t: (p.view(Subclass), v, t)),
    "NaN": _returning("not finite", lambda f, p, v, t: (p * math.nan, v, t)),
    "infinity": _returning("not finite", lambda f, p, v, t: (p, v + math.inf, t)),
    "a metre off": _returning("from the last position", lambda f, p, v, t: (p + 1.0, v, t)),
    "1e30 m off": _returning("from the last position", lambda f, p, v, t: (p - 1e30, v, t)),
    "1e300 m/s": _returning("velocity of 1e+300", lambda f, p, v, t: (p, v - 1e300, t)),
    "a jump of 6 cm": _returning("from the last position", lambda f, p, v, t: (p + 0.06, v, t)),
    "zeros for a failure": _returning("only zeros", lambda f, p, v, t: (0.0 * p, v, t)),
    # three held samples, then forces that decay over four ticks
    "a clock that stands": _returning("no new reading", _constant, patience=6),
    "a clock that runs back": _returning("ran backwards", lambda f, p, v, t: (p, v, -t)),
    "NaN for the time": _returning("for the time", lambda f, p, v, t: (p, v, math.nan)),
    "infinity for the time": _returning("for the time", lambda f, p, v, t: (p, v, math.inf)),
    "None for the time": _returning("for the time", lambda f, p, v, t: (p, v, None)),
    "text for the time": _returning("for the time", lambda f, p, v, t: (p, v, "12:00")),
    "a whole number for the time": _returning("for the time", lambda f, p, v, t: (p, v, 10**6)),
    "a hang of ten periods": Evil(write=lambda f, forces: _hang(f, 0.05), says="were skipped", patience=1),
    "a hang of half a period": Evil(write=lambda f, forces: _hang(f, 0.0025)),
    "views that change": Evil(write=_change_views),
}


def _raise(error: BaseException) -> None:
    raise error


def driver(folder: Path) -> Path:
    """Write the driver of fakes."""
    file = folder / "fakes.py"
    file.write_text(DRIVER)
    return file


def fakes(file: Path) -> list[Fake]:
    """List the fakes that a driver has connected."""
    from graspfx import plugins

    devices: list[Fake] = plugins.load("devices", str(file)).fakes
    return devices
