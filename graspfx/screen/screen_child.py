"""Process that serves the page of a touch-screen device, separately from the control loop."""

from __future__ import annotations

import json
import os
import select
import signal
import sys
import threading
import time
from typing import Any

import numpy as np

from graspfx.errors import GraspFXError
from graspfx.screen.gate import HOST, code, gate_for, listen, network_address, url
from graspfx.screen.touch_orders import Box
from graspfx.screen.touch_screen import Board
from graspfx.screen.touch_server import TouchServer
from graspfx.system.scheduling import be_nice

PICTURES = 0.016  # interval between pictures [s]
NICENESS = 5


def main(board: int, answers: int, settings: str) -> None:
    """Serve the page until the device closes the standard input of this process or ends.

    Args:
        board: Descriptor of the memory shared with the device.
        answers: Descriptor of a pipe, to which one line is written: the page's address, or why the page is not served.
        settings: Settings `fingers`, `port`, `box` and `lan` of `TouchScreen`, and the page's content, as JSON.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the device's process, which then closes this one
    be_nice(NICENESS)
    table: dict[str, Any] = json.loads(settings)
    with os.fdopen(answers, "w", encoding="utf-8") as answer:
        try:
            screen = _Screen(board, table)
        except (GraspFXError, OSError) as error:
            answer.write(f"no {' '.join(str(error).split())}\n")
            return
        answer.write(f"yes {url(screen.server.line)}\n")
    screen.serve()


class _Screen:
    """Page whose touches are written to the memory that is shared with a device."""

    def __init__(self, board: int, table: dict[str, Any]) -> None:
        fingers, lan = int(table["fingers"]), bool(table["lan"])
        self.board, self._fingers, self._lock = Board(board, fingers), fingers, threading.Lock()
        line = listen(network_address() if lan else HOST, table["port"])
        gate = gate_for(line, lan=lan)
        if lan:
            address = url(line, gate.renew())
            print(f"{code(address)}\n{address}\nvalid for one screen and ten minutes", file=sys.stderr, flush=True)
        self.server = TouchServer(line, gate, fingers, Box(*table["box"]), json.dumps(table["scenery"]), self)
        self.server.__enter__()

    def press(self, finger: int, place: tuple[float, float]) -> None:
        """Write to the shared memory that a finger touches the screen at a position [m]."""
        self._note(finger, 1.0, place)

    def lift(self, finger: int) -> None:
        """Write to the shared memory that a finger was lifted."""
        self._note(finger, 0.0, None)

    def _note(self, finger: int, is_down: float, place: tuple[float, float] | None) -> None:
        with self._lock, self.board.writing() as (head, fingers):
            own = fingers[finger]
            if is_down and not own[0]:
                own[3] += 1.0
            own[0] = is_down
            if place is not None:
                own[1:3] = place
            self._count(head)

    def _count(self, head: Any) -> None:
        counts = self.server.counts
        dropped = sum(counts[reason] for reason in ("length", "kind", "finger", "place", "number", "rate", "claim"))
        head[:6] = time.monotonic(), counts["taken"], dropped, counts["lost"], self.server.last, self.server.clients

    def serve(self) -> None:
        """Send pictures to the screens and heartbeats to the device until the standard input is closed."""
        try:
            while not select.select([sys.stdin], [], [], PICTURES)[0] or os.read(0, 1):
                with self._lock, self.board.writing() as (head, _):
                    self._count(head)
                state = self.board.state()
                if state is not None and self.server.clients:
                    now, fingers = state
                    self.server.show(_picture(now, fingers, self.board.touches()))
        finally:
            self.server.__exit__(None, None, None)


def _picture(now: float, fingers: Any, touches: Any) -> bytes:
    """Return a picture in the format of the page: position, force and touch of each finger, without objects."""
    size = float(np.linalg.norm(fingers[:, 2:4], axis=1).max())
    rows = np.zeros((len(fingers), 7))
    rows[:, 0:2], rows[:, 4:6] = fingers[:, :2], fingers[:, 2:4]
    rows[:, 6] = 0.0 if touches is None else touches.fingers[:, 0]
    return np.concatenate([[now, now, np.nan, size], rows.ravel()]).tobytes()
