"""Touch screen for device drivers: positions of the fingers on the screen, read without blocking."""

from __future__ import annotations

import json
import mmap
import os
import select
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import DeviceError
from graspfx.screen.touch_orders import MOST_FINGERS, Box
from graspfx.system import child_process, shared_memory

FloatArray = NDArray[np.float64]

HEAD = 8  # numbers before the fingers: counter, time, orders taken, dropped and lost, last order's number, screens
OF_FINGER = 4  # numbers per finger: whether it touches, x, y, number of its touches; for the page position and force
HALF = HEAD + OF_FINGER * MOST_FINGERS
BOARD = 8 * 2 * HALF  # size of the shared memory [bytes]
TRIES = 8  # attempts to read consistent numbers
CHILD = "graspfx.screen.screen_child"
PATIENCE = 10.0  # timeout for the start of the page [s]
FAREWELL = 1.0  # timeout for the end of the server's process [s]
DEAF = 0.5  # silence of the server after which no finger is touching [s]
LOOK = 0.02  # interval between checks that the server's process is alive [s]
COLOURS = ("#1b9e77", "#882255", "#00a5b5", "#7a5230", "#332288")
INK = "#1a1a1a"


def approach(point: FloatArray, goal: FloatArray, most: float) -> None:
    """Move a point (d,) in place towards a goal (d,), by a distance of at most `most` [m]."""
    way = goal - point
    far = float(np.linalg.norm(way))
    if far <= most:
        point[...] = goal
    else:
        point += way * (most / far)


class Touches(NamedTuple):
    """State of the fingers on a touch screen.

    Attributes:
        time: Time of the server's last write, on the clock of `time.monotonic` [s].
        counts: Numbers of orders taken, dropped and lost, number of the last order, number of screens, (5,).
        fingers: For each finger, whether it touches the screen, x and y [m], and how often it has touched, (k, 4).
    """

    time: float
    counts: FloatArray
    fingers: FloatArray


class Board:
    """Memory that a touch-screen device shares with the process that serves its page; no side waits for the other.

    Each half of the memory is written by one side and read by the other. A half begins with a counter, which is odd
    while the numbers in the half change.

    Args:
        file: Descriptor of a shared memory of `BOARD` bytes.
        fingers: Number of fingers of the device.
    """

    def __init__(self, file: int, fingers: int) -> None:
        self._memory = mmap.mmap(file, BOARD)
        numbers: FloatArray = np.frombuffer(self._memory, np.float64)
        self._orders, self._state = numbers[:HALF], numbers[HALF:]
        self._fingers = fingers

    # The server's side --------------------------------------------------------------------------------------------

    @contextmanager
    def writing(self) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield the head and the fingers (k, 4) for changes in the `with` block, of which readers see all or none."""
        with self._changing(self._orders) as fingers:
            yield self._orders[1:HEAD], fingers

    def state(self) -> tuple[float, FloatArray] | None:
        """Return the time [s], and position [m] and force [N] of the fingers (k, 4), from the device; None on failure.

        Reading fails if the device writes during all attempts.
        """
        half = _read(self._state)
        return None if half is None else (float(half[1]), self._of_fingers(half))

    # The device's side --------------------------------------------------------------------------------------------

    def touches(self) -> Touches | None:
        """Return the touches from the server; None if the server is writing."""
        half = _read(self._orders)
        if half is None:
            return None
        return Touches(float(half[1]), half[2:7], self._of_fingers(half))

    def show(self, time: float, positions: FloatArray, forces: FloatArray) -> None:
        """Write the time [s], and the fingers' positions (k, d) [m] and forces (k, d) [N], d <= 2, for the page."""
        with self._changing(self._state) as fingers:
            self._state[1] = time
            fingers[:, : positions.shape[1]] = positions
            fingers[:, 2 : 2 + forces.shape[1]] = forces

    @contextmanager
    def _changing(self, half: FloatArray) -> Iterator[FloatArray]:
        half[0] += 1.0
        yield self._of_fingers(half)
        half[0] += 1.0

    def _of_fingers(self, half: FloatArray) -> FloatArray:
        return half[HEAD:].reshape(-1, OF_FINGER)[: self._fingers]


def _read(half: FloatArray) -> FloatArray | None:
    """Return a copy of a half of the memory; None if each of `TRIES` attempts coincides with a write."""
    for _ in range(TRIES):
        before = half[0]
        copy = half.copy()
        if before % 2.0 == 0.0 and half[0] == before and copy[0] == before:
            return copy
    return None


class TouchScreen:
    """Page on a touch screen, served by a separate process, so that its connections do not delay this process.

    Args:
        fingers: Number of fingers.
        port: Port of the page; 0 for any free port.
        box: Rectangle of valid positions: left, bottom, right and top [m].
        lan: Whether a tablet in the network can open the page, by a QR code that is printed.

    Attributes:
        address: Address of the page while the page is open; otherwise empty.
    """

    def __init__(self, *, fingers: int, port: int, box: Sequence[float], lan: bool) -> None:
        self.fingers, self.port, self.box, self.lan = fingers, port, Box(*box), lan
        self.address = ""
        self._process: subprocess.Popen[bytes] | None = None
        self._board: Board | None = None
        self._last: Touches | None = None
        self._looked = 0.0

    def open(self) -> None:
        """Start the process that serves the page; if it is running, restart it.

        Raises:
            MissingPackageError: If websockets is not installed.
            DeviceError: If the page cannot be served, for example because the port is in use, or because `lan` is True
                and segno is not installed.
        """
        from graspfx.screen.claim_server import require_websockets  # loads asyncio: 36 ms of every run

        self.close()
        require_websockets()
        if not child_process.is_possible():
            raise DeviceError(
                f"a touch screen as a device {child_process.REFUSAL}; `graspfx touch` has no such requirement"
            )
        file = shared_memory.create("graspfx-screen", BOARD)
        ours, theirs = os.pipe()
        try:
            self._board = Board(file, self.fingers)
            self._process = child_process.start(
                CHILD,
                (file, theirs, self._settings()),
                (theirs, file),
                inputs=subprocess.PIPE,
                outputs=subprocess.DEVNULL,
            )
        except OSError as error:
            os.close(ours)
            raise DeviceError(f"the process that serves the page cannot start: {error}") from error
        finally:
            os.close(theirs)
            os.close(file)
        with os.fdopen(ours, "rb") as answer:
            ready = select.select([answer], [], [], PATIENCE)[0]
            line = answer.readline().decode().strip() if ready else ""
        if not line.startswith("yes "):
            self.close()
            reason = line.removeprefix("no ") or f"its process sent no answer in {PATIENCE:g} s"
            raise DeviceError(f"the page of the touch screen cannot be served: {reason}")
        self.address, self._last = line.removeprefix("yes "), None

    def touches(self) -> Touches:
        """Return the touches; no finger touches if the server has not written for half a second.

        Raises:
            DeviceError: If the process that serves the page has ended.
        """
        assert self._board is not None
        now = time.monotonic()
        if now - self._looked > LOOK:
            self._looked = now
            if self._process is None or self._process.poll() is not None:
                raise DeviceError(f"the process that serves {self.address or 'the page'} has ended")
        touches = self._board.touches() or self._last or Touches(now, np.zeros(5), np.zeros((self.fingers, 4)))
        if now - touches.time > DEAF:
            touches.fingers[:, 0] = 0.0
        self._last = touches
        return touches

    def show(self, positions: FloatArray, forces: FloatArray) -> None:
        """Show the fingers' positions (k, d) [m] and forces (k, d) [N] on the page; a third component is ignored."""
        if self._board is not None:
            self._board.show(time.monotonic(), positions[:, :2], forces[:, :2])

    def close(self) -> None:
        """Close the page and end its process, if it is still running."""
        process, self._process, self._board = self._process, None, None
        if process is None:
            return
        with suppress(OSError):
            if process.stdin is not None:
                process.stdin.close()
        try:
            process.wait(FAREWELL)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def _settings(self) -> str:
        most = "one finger" if self.fingers == 1 else f"up to {self.fingers} fingers"
        colours = [COLOURS[i % len(COLOURS)] for i in range(self.fingers)]
        scenery = {
            "title": "Touch screen",
            "hint": f"Touch with {most}. The page shows the force on the finger, which cannot be felt.",
            "fault": "",
            "box": self.box,
            "touchable": self.fingers,
            "fingers": [{"name": f"finger {i}", "colour": colour, "radius": 0.0} for i, colour in enumerate(colours)],
            "objects": [],
            "obstacles": [],
            "states": ["#b8b8b8", "#7f7f7f"],
            "internal": "",
            "external": INK,
            "legend": [
                ["force on the finger", INK, True],
                ["free", "#b8b8b8", False],
                ["on the screen", "#7f7f7f", False],
            ],
        }
        table = {"fingers": self.fingers, "port": self.port, "box": self.box, "lan": self.lan, "scenery": scenery}
        return json.dumps(table)
