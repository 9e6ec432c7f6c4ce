"""Touch screen for device drivers: states and positions of the touching fingers, read without waiting."""

from __future__ import annotations

import json
import os
import select
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import DeviceError
from graspfx.screen.screen_board import Board, Touches, create
from graspfx.screen.touch_orders import Box
from graspfx.system import child_process

FloatArray = NDArray[np.float64]

CHILD = "graspfx.screen.screen_child"
PATIENCE = 10.0  # timeout for the start of the page [s]
FAREWELL = 1.0  # timeout for the end of the server's process [s]
DEAF = 0.5  # silence of the server after which no finger is touching [s]
LOOK = 0.02  # interval between checks that the server's process is alive [s]
COLOURS = ("#1b9e77", "#882255", "#00a5b5", "#7a5230", "#332288")
INK = "#1a1a1a"


class TouchScreen:
    """Page on a touch screen, served by a separate process so that sockets do not delay this interpreter.

    Args:
        fingers: Number of fingers.
        port: Port of the page.
        box: Area of valid positions [m].
        lan: Whether a tablet in the network has access through a printed QR code.

    Attributes:
        address: Address of the page while it is open.
    """

    def __init__(self, *, fingers: int, port: int, box: Sequence[float], lan: bool) -> None:
        self.fingers, self.port, self.box, self.lan = fingers, port, Box(*box), lan
        self.address = ""
        self._process: subprocess.Popen[bytes] | None = None
        self._board: Board | None = None
        self._last: Touches | None = None
        self._looked = 0.0

    def open(self) -> None:
        """Serve the page; if it is open, restart it.

        Raises:
            MissingPackageError: If websockets is not installed, or segno for `lan`.
            DeviceError: If the page cannot be served, for example because the port is in use.
        """
        from graspfx.screen.socket_thread import require_websockets  # loads asyncio: 36 ms of every run

        self.close()
        require_websockets()
        if not child_process.is_possible():
            raise DeviceError(f"a touch screen as a device {child_process.REFUSAL}; `graspfx touch` does not")
        file = create()
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
            raise DeviceError(f"the page's process does not start: {error}") from error
        finally:
            os.close(theirs)
            os.close(file)
        with os.fdopen(ours, "rb") as answer:
            ready = select.select([answer], [], [], PATIENCE)[0]
            line = answer.readline().decode().strip() if ready else ""
        if not line.startswith("yes "):
            self.close()
            raise DeviceError(f"the touch screen's page is not served: {line.removeprefix('no ') or 'no answer'}")
        self.address, self._last = line.removeprefix("yes "), None

    def touches(self) -> Touches:
        """Read the touches; there are none while the server sends no heartbeat.

        Raises:
            DeviceError: If the process of the page has ended.
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
        """Show positions (k, d) [m] and forces (k, d) [N] on the page, d up to 2."""
        if self._board is not None:
            self._board.show(time.monotonic(), positions[:, :2], forces[:, :2])

    def close(self) -> None:
        """Close the page, without an error if the page is already closed or its process has ended."""
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
            "hint": f"Touch with {most}. The force is shown here, not felt.",
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
