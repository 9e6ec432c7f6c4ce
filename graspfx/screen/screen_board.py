"""Memory that a touch screen's device shares with the process that serves its page: neither ever waits.

Each half is written by one side and read by the other, behind a count that is odd while numbers change.
"""

from __future__ import annotations

import mmap
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.screen.touch_orders import MOST_FINGERS
from graspfx.system import shared_memory

FloatArray = NDArray[np.float64]

HEAD = 8  # numbers before those of the fingers: count, time, orders taken, dropped, lost, number of the last, screens
OF_FINGER = 4  # whether it is touched, x, y, number of its last touch
HALF = HEAD + OF_FINGER * MOST_FINGERS
TRIES = 8  # readings, of which one is whole: else the last stands


class Touches(NamedTuple):
    """Fingers on the screen.

    Attributes:
        time: at which the server wrote, of `time.monotonic` [s].
        counts: orders taken, dropped and lost, number of the last, screens (5,).
        fingers: whether each is touched, where (x, y) [m], and how many touches it has had (k, 4).
    """

    time: float
    counts: FloatArray
    fingers: FloatArray


def create() -> int:
    """Make the memory, which goes with the last process that has it; give its descriptor."""
    return shared_memory.create("graspfx-screen", 8 * 2 * HALF)


class Board:
    """The shared memory.

    Args:
        file: its descriptor, from `create`.
        fingers: of the device.
    """

    def __init__(self, file: int, fingers: int) -> None:
        self._memory = mmap.mmap(file, 8 * 2 * HALF)
        numbers: FloatArray = np.frombuffer(self._memory, np.float64)
        self._orders, self._state = numbers[:HALF], numbers[HALF:]
        self._fingers = fingers

    # The server's side --------------------------------------------------------------------------------------------

    @contextmanager
    def writing(self) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Change the head and the fingers (k, 4) in one piece."""
        half = self._orders
        half[0] += 1.0
        yield half[1:HEAD], half[HEAD:].reshape(-1, OF_FINGER)[: self._fingers]
        half[0] += 1.0

    def state(self) -> tuple[float, FloatArray] | None:
        """Read the time [s] and the fingers (k, 4) of the device: place and force; None if they change just now."""
        half = _read(self._state)
        return None if half is None else (float(half[1]), half[HEAD:].reshape(-1, OF_FINGER)[: self._fingers])

    # The device's side --------------------------------------------------------------------------------------------

    def touches(self) -> Touches | None:
        """Read what is touched; None if that changes just now."""
        half = _read(self._orders)
        if half is None:
            return None
        return Touches(float(half[1]), half[2:7], half[HEAD:].reshape(-1, OF_FINGER)[: self._fingers])

    def show(self, time: float, positions: FloatArray, forces: FloatArray) -> None:
        """Leave positions (k, 2) [m] and forces (k, 2) [N] for the page."""
        half = self._state
        half[0] += 1.0
        half[1] = time
        fingers = half[HEAD:].reshape(-1, OF_FINGER)[: self._fingers]
        fingers[:, : positions.shape[1]] = positions
        fingers[:, 2 : 2 + forces.shape[1]] = forces
        half[0] += 1.0


def _read(half: FloatArray) -> FloatArray | None:
    for _ in range(TRIES):
        before = half[0]
        copy = half.copy()
        if before % 2.0 == 0.0 and half[0] == before and copy[0] == before:
            return copy
    return None
