"""Touch and Phantom devices behind a stand-in for OpenHaptics: three of them, which nothing moves but a test."""

from __future__ import annotations

import mmap
import time
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.realtime.pacing import Clock
from graspfx.testing.wire import fake_scheduler as at
from graspfx.testing.wire.wire import Failure, Wire

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

HOME = 0.01, -0.02, 0.03  # [m]
STEP = 0.003  # of `move`, along every axis [m]
NAMES = "left", "right", "third"
COMM_ERROR = 0x302
MM = 1e-3  # [m]
TURN = 1.0  # longest for the thread to take its turns [s]


class OpenHapticsWire(Wire):
    """Devices "left", "right" and "third" behind a fake library whose thread calls back 1000 times a second.

    Other programs that load the library meet the same devices, where this machine has a compiler that links it.
    `settings`, `position`, `force` and `torque` are those of the first device.

    Args:
        clock: of the scheduler, which then calls as somebody waits on the wire's `clock`; the machine's if left out.

    Attributes:
        words: state of the library, as whole numbers; `numbers` is the same as floats.
    """

    kinds: frozenset[Failure] = frozenset({"late", "drop", "garbage", "unplugged", "blocked"})
    limit = 3.3  # [N]

    def __init__(self, *, clock: Clock | None = None) -> None:
        super().__init__(None if clock is None else _TurnsClock(clock, self))
        self._folder = Path(mkdtemp(prefix="graspfx-wire-"))
        state = self._folder / "state"
        state.write_bytes(bytes(8 * at.SIZE))
        with state.open("r+b") as file:
            memory = mmap.mmap(file.fileno(), 0)
        self.words: IntArray = np.frombuffer(memory, np.int64)
        self.numbers: FloatArray = self.words.view(np.float64)
        self.words[at.RATE] = 1000
        self.words[at.PACED] = clock is not None
        for k, name in enumerate(NAMES):
            place = 8 * (at.FIRST_DEVICE + k * at.DEVICE + at.NAME)
            memory[place : place + len(name)] = name.encode()
        self.library = at.library(state, self._folder)
        self.home()

    @property
    def settings(self) -> dict[str, Any]:
        return {"unit": NAMES[0], "library": self.library}

    @property
    def torque(self) -> FloatArray:
        """Force that the first device displays (3,) [N]; it stays if nobody writes any more."""
        return self._field(at.FORCE).copy()

    @property
    def position(self) -> FloatArray:
        return MM * self._field(at.POSITION)[None, :]

    @property
    def force(self) -> FloatArray:
        return self.torque[None, :]

    @property
    def turns(self) -> int:
        """Calls of the callback so far."""
        return int(self.words[at.TURNS])

    @property
    def violations(self) -> int:
        """Breaches of the library's rules: calls outside a frame or callback, frames that cross, a second callback."""
        return int(self.words[at.VIOLATIONS])

    @property
    def durations(self) -> IntArray:
        """Counts of callbacks by how long they took, a microsecond a bin; the last has the rest."""
        return self.words[at.FIRST_BIN : at.FIRST_BIN + at.BINS]

    def place(self, position: FloatArray, device: int = 0) -> None:
        """Put the handle of a device at a position (3,) [m]."""
        self._field(at.POSITION, device)[:] = np.asarray(position) / MM

    def leave(self, error: int, device: int = 0) -> None:
        """Have every frame of a device leave this error on the library's stack; 0 for none."""
        self.words[at.FIRST_DEVICE + device * at.DEVICE + at.ERROR] = error

    def forces(self, device: int) -> FloatArray:
        """Force that a device displays (3,) [N]."""
        return self._field(at.FORCE, device).copy()

    def move(self) -> None:
        self.place(np.array(HOME) + STEP)

    def home(self) -> None:
        self.place(np.array(HOME))

    def _field(self, field: int, device: int = 0) -> FloatArray:
        start = at.FIRST_DEVICE + device * at.DEVICE + field
        return self.numbers[start : start + 3]

    def _change(self) -> None:
        """Have the scheduler or the first device be what the failure makes of them."""
        self.words[at.STALLED] = self.failure in ("late", "drop", "blocked")
        self.leave(COMM_ERROR if self.failure == "unplugged" else 0)
        if self.failure == "unplugged":  # no power, and nobody's
            self.words[at.FIRST_DEVICE + at.OWNER] = 0
            self._field(at.FORCE)[:] = 0.0
        if self.failure == "garbage":
            self.place(np.full(3, np.nan))
        elif np.isnan(self.position).any():
            self.home()

    def close(self) -> None:
        rmtree(self._folder, ignore_errors=True)


class _TurnsClock:
    """A clock on which to wait is to let the scheduler take its turns."""

    def __init__(self, clock: Clock, wire: OpenHapticsWire) -> None:
        self.now = clock.now
        self._clock, self._wire, self._part = clock, wire, 0.0

    def sleep(self, duration: float) -> None:
        words = self._wire.words
        self._clock.sleep(duration)
        turns, self._part = divmod(self._part + duration * words[at.RATE], 1.0)
        words[at.DUE] += int(turns)
        end = time.monotonic() + TURN
        while words[at.RUNNING] and words[at.PASSED] < words[at.DUE] and time.monotonic() < end:
            time.sleep(1e-5)
        if words[at.PASSED] < words[at.DUE]:  # its process is gone
            words[at.RUNNING] = 0
