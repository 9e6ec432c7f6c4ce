"""Mailbox between Python and a vendor's thread, for devices whose C functions may only be called in this thread."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.c_calls import mailbox_text as at
from graspfx.compile.emission import address
from graspfx.loop.adapt import c_engine
from graspfx.loop.device import Calls

FloatArray = NDArray[np.float64]

PATIENCE = 20  # turns without new forces from Python, after which forces are zero
NAP = 2e-4  # time between two checks [s]


class Mailbox:
    """Exchange of readings and forces between Python and devices that a vendor's thread calls.

    The thread calls `unsigned function(void *context)` once per period; each call is a turn. In a turn, all devices are
    asked for a reading, then all are read, and then all are written in reverse order. A device receives the forces that
    Python has written for it, or zero if Python has not written forces for it in more than 20 turns. After a fault, a
    device is stopped in the same turn and in all later turns. While `drive` is active, a turn instead calls another
    function; if this function returns 0, the turn proceeds as described.

    Args:
        calls: C functions of the devices.
        shape: Shape of each device's positions: number of fingers k and of dimensions d.
        now: Function that returns the time [s].
        sleep: Function that waits for a duration [s].

    Attributes:
        function: Address of the C function that the vendor's thread calls.
        context: Address of the argument of this function.
    """

    def __init__(
        self,
        calls: Sequence[Calls],
        shape: tuple[int, int],
        now: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        k, d = shape
        self._now, self._sleep = now, sleep
        self._shape, self._entries = shape, k * d
        engine = _engine()
        self.function = address(engine, at.MAILBOX)
        self._words: NDArray[np.int64] = np.zeros(at.FIRST + at.WORDS * len(calls), dtype=np.int64)
        self.context: int = self._words.ctypes.data
        self._samples: FloatArray = np.zeros((len(calls), 2, k, d))
        self._orders: FloatArray = np.zeros((len(calls), 2, k, d))
        self._raw, self._forces = np.zeros((len(calls), 2, k, d)), np.zeros((len(calls), k, d))
        self._keep = engine, tuple(calls)
        self._words[[at.COUNT, at.PATIENCE]] = len(calls), PATIENCE
        for i, each in enumerate(calls):
            words = self._device(i)
            words[[at.ASK, at.READ, at.WRITE, at.STOP, at.OWN]] = (
                each.ask,
                each.read,
                each.write,
                each.stop,
                each.context,
            )
            words[at.ENTRIES] = self._entries
            for place, memory in (
                (at.RAW, self._raw), (at.FORCES, self._forces), (at.SAMPLE, self._samples), (at.ORDERS, self._orders)
            ):  # fmt: skip
                words[place] = memory[i].ctypes.data

    @property
    def turns(self) -> int:
        """Number of turns since the start."""
        return int(self._words[at.TURNS])

    def read(self, i: int) -> tuple[int, FloatArray, FloatArray]:
        """Return the number of samples of device i, and positions [m] and velocities [m/s] (k, d) of the last one."""
        words = self._device(i)
        while True:
            before = int(words[at.SEQUENCE])
            sample = self._samples[i].copy()
            if before % 2 == 0 and int(words[at.SEQUENCE]) == before:
                return before // 2, sample[0], sample[1]

    def write(self, i: int, forces: FloatArray) -> None:
        """Set the forces (k, d) [N] of device i, which must be finite and within the limit of the device."""
        words = self._device(i)
        news = int(words[at.NEWS]) + 1
        self._orders[i, news % 2] = forces
        words[at.NEWS] = news

    def fault(self, i: int) -> int:
        """Return the code of the first fault of device i; 0 if there is no fault."""
        return int(self._device(i)[at.FAULT])

    def wait(self, turns: int, longest: float) -> bool:
        """Wait for a number of turns, but at most for `longest` seconds; return whether the turns were completed."""
        last, end = self.turns + turns, self._now() + longest
        while self.turns < last:
            if self._now() > end:
                return False
            self._sleep(NAP)
        return True

    def drive(self, function: int, context: int) -> None:
        """Let each turn call `unsigned function(void *context)`; if it returns 0, the turn exchanges with the mailbox.

        Args:
            function: Address of the function.
            context: Address that is passed to the function.
        """
        self._words[at.CONTEXT] = context
        self._words[at.LOOP] = function

    def release(self, longest: float) -> bool:
        """End the calls of the function set by `drive`; return whether the last call ended within `longest` seconds."""
        self._words[at.LOOP] = 0
        end = self._now() + longest
        while True:
            self._sleep(NAP)
            if not self._words[at.BUSY]:
                return True
            if self._now() > end:
                return False

    def _device(self, i: int) -> NDArray[np.int64]:
        return self._words[at.FIRST + at.WORDS * i :][: at.WORDS]


@cache
def _engine() -> Any:
    return c_engine(at.TEXT)
