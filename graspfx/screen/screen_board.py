"""Memory shared by a touch-screen device and the process that serves its page; neither side ever waits.

Each half is written by one side and read by the other. A counter in each half is odd while the half's numbers change.
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

HEAD = 8  # numbers before the fingers: counter, time, orders taken, dropped and lost, last order's number, screens
OF_FINGER = 4  # numbers per finger: whether it touches, x, y, number of its touches
HALF = HEAD + OF_FINGER * MOST_FINGERS
TRIES = 8  # attempts to read consistent numbers


class Touches(NamedTuple):
    """Fingers on the screen.

    Attributes:
        time: Time of the server's last write, on the clock of `time.monotonic` [s].
        counts: Orders taken, dropped and lost, number of the last order, number of screens (5,).
        fingers: For each finger, whether it touches, x and y [m], and its number of touches (k, 4).
    """

    time: float
    counts: FloatArray
    fingers: FloatArray


def create() -> int:
    """Create the shared memory; return its descriptor."""
    return shared_memory.create("graspfx-screen", 8 * 2 * HALF)


class Board:
    """The shared memory.

    Args:
        file: Descriptor from `create`.
        fingers: Number of the device's fingers.
    """

    def __init__(self, file: int, fingers: int) -> None:
        self._memory = mmap.mmap(file, 8 * 2 * HALF)
        numbers: FloatArray = np.frombuffer(self._memory, np.float64)
        self._orders, self._state = numbers[:HALF], numbers[HALF:]
        self._fingers = fingers

    # The server's side --------------------------------------------------------------------------------------------

    @contextmanager
    def writing(self) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield the head and the fingers (k, 4), to be changed within the block; no reader sees a partial change."""
        half = self._orders
        half[0] += 1.0
        yield half[1:HEAD], half[HEAD:].reshape(-1, OF_FINGER)[: self._fingers]
        half[0] += 1.0

    def state(self) -> tuple[float, FloatArray] | None:
        """Read the time [s] and the device's fingers (k, 4), position and force; None during a write."""
        half = _read(self._state)
        return None if half is None else (float(half[1]), half[HEAD:].reshape(-1, OF_FINGER)[: self._fingers])

    # The device's side --------------------------------------------------------------------------------------------

    def touches(self) -> Touches | None:
        """Read the touches; None during a write."""
        half = _read(self._orders)
        if half is None:
            return None
        return Touches(float(half[1]), half[2:7], half[HEAD:].reshape(-1, OF_FINGER)[: self._fingers])

    def show(self, time: float, positions: FloatArray, forces: FloatArray) -> None:
        """Write positions (k, 2) [m] and forces (k, 2) [N] for the page."""
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
