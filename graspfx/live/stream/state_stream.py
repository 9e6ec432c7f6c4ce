"""Stream of a run over a WebSocket: sends the newest row as a state, and applies goals of clients to the hands."""

from __future__ import annotations

import threading
import time
from collections.abc import Collection
from contextlib import ExitStack, suppress
from socket import socket
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import GraspFXError, InputError
from graspfx.live.frame import Frames, history_of
from graspfx.live.scenery import Scenery, scenery
from graspfx.live.stream.state_message import hello_message, state_message
from graspfx.live.touch.finger_goals import GoalWalk
from graspfx.screen.gate import TOKEN, StreamGate
from graspfx.screen.own_page import HOST, NAMES, listen_at
from graspfx.screen.stream_server import SOCKET, Bounds, StreamOrder, StreamServer
from graspfx.screen.touch_address import network_address

if TYPE_CHECKING:
    from graspfx.live.live_run import LiveRun
    from graspfx.screen.gate import StreamGate

FloatArray = NDArray[np.float64]

RATE, FASTEST = 60.0, 120.0  # default and highest rate of states [Hz]
SPEED = 0.5  # highest speed of a goal [m/s]
STEP = 0.004  # interval between steps of goals [s]
REACH = 2.0  # largest component of an offset, in extents of the scene
CLOSEST = 0.3  # largest squeeze, in extents


class StateStream:
    """Stream on a socket with its own threads; a context manager. Runs are attached one after the other.

    Distance and speed of goals are limited (`REACH`, `SPEED`). Goals pass through the follower of the guide, and are
    recorded with their ticks. If a client leaves, or is silent for half a second, the goal no longer changes.

    Args:
        line: Listening socket.
        gate: Access control.
        rate: Rate of states [Hz].
        goals: Whether clients may move the guides of a run; never with hardware.

    Attributes:
        server: Server of the socket.
        states: Number of states sent.

    Raises:
        InputError: If the rate is not from 1 to 120 Hz.
        MissingPackageError: If websockets is not installed.
    """

    def __init__(self, line: socket, gate: StreamGate, *, rate: float = RATE, goals: bool = False) -> None:
        if not 1.0 <= rate <= FASTEST:
            raise InputError("rate", rate, f"1 to {FASTEST:g} states a second")
        self.rate, self._goals = rate, goals
        self.server = StreamServer(line, gate, self)
        self._run: LiveRun | None = None
        self._scenery: Scenery | None = None
        self._walks: list[tuple[GoalWalk, GoalWalk]] = []
        self._goal: list[tuple[FloatArray, FloatArray]] = []
        self._lock, self._writing, self._over = threading.RLock(), threading.Lock(), threading.Event()
        self._number, self._runs, self._tick, self._next = 0, 0, -1, 0.0
        self.states = 0
        self._thread = threading.Thread(target=self._follow, name="states", daemon=True)

    def __enter__(self) -> Self:
        self.server.__enter__()
        self._thread.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self._over.set()
        self._thread.join()
        self.server.__exit__()

    def attach(self, run: LiveRun) -> None:
        """Start streaming a run.

        Raises:
            InputError: If clients may move guides, and the run has hardware.
        """
        if self._goals and run.has_hardware:
            do = "stream it without goals: clients must not move a finger that a person holds"
            raise InputError("goals", "a run with hardware", "simulated fingers only", do)
        with self._lock, self._writing:
            self._runs += 1
            guides = list(run.guides) if self._goals else []
            drawn = self._scenery = scenery(run.scene)
            far, near = REACH * drawn.extent, CLOSEST * drawn.extent
            self._walks = [(GoalWalk(SPEED), GoalWalk(SPEED)) for _ in guides]
            self._goal = [(np.zeros(run.layout.dimensions), np.zeros(1)) for _ in guides]
            hello = hello_message(
                run.scene, drawn, guides, rate=self.rate, farthest=far, closest=near, run=self._runs
            )  # fmt: skip
            self._run, self._tick = run, -1
            self.server.describe(hello, Bounds(len(guides), far, near))

    def detach(self) -> None:
        """Stop streaming: send the last state, and accept no more goals."""
        with self._lock:
            run, self._run = self._run, None
        with self._writing, suppress(GraspFXError):
            if run is not None:
                self.server.conclude(self._message(run, "ended") or "")

    # Goals: in the server's thread --------------------------------------------------------------------------------

    def lead(self, order: StreamOrder) -> None:
        """Move a guide towards a goal."""
        with self._lock:
            if self._run is None or order.guide >= len(self._walks):
                return
            now = time.monotonic()
            walk, closing = self._walks[order.guide]
            if not (walk.is_led or closing.is_led):  # start from the last goal
                place, near = self._run.goal(order.guide)
                self._goal[order.guide] = place.copy(), np.array([near])
            offset, squeeze = self._goal[order.guide]
            if order.offset is not None:
                self._goal[order.guide] = (walk.aim(np.array(order.offset[: len(offset)]), offset, now), squeeze)
            if order.squeeze is not None and self._run.guides[order.guide].place is None:
                offset, _ = self._goal[order.guide]
                self._goal[order.guide] = (offset, closing.aim(np.array([order.squeeze]), squeeze, now))
            self._send(order.guide)

    def release(self, guide: int) -> None:
        """Release a guide; its goal no longer changes."""
        with self._lock:
            if guide < len(self._walks):
                for walk in self._walks[guide]:
                    walk.end()

    def _send(self, guide: int) -> None:
        run = self._run
        if run is not None and run.state != "ended":
            offset, squeeze = self._goal[guide]
            with suppress(GraspFXError):  # the run may end meanwhile
                run.guide(guide, offset, float(squeeze[0]) if run.guides[guide].place is None else None)

    # States: in a thread of its own -------------------------------------------------------------------------------

    def _follow(self) -> None:
        while not self._over.wait(STEP):
            with self._lock:
                self._step()
            now = time.monotonic()
            if now < self._next or not self.server.clients:
                continue
            with self._writing, suppress(GraspFXError):  # the run may end meanwhile
                run = self._run
                if run is None:
                    continue
                message = self._message(run, run.state)
                if message is not None:
                    self._next = max(self._next + 1.0 / self.rate, now - 0.5 / self.rate)
                    self.server.show(message)

    def _step(self) -> None:
        now = time.monotonic()
        for guide, walks in enumerate(self._walks):
            parts = list(self._goal[guide])
            steps = [walk.step(now) for walk in walks]
            if any(each is not None for each in steps):
                new = [old if each is None else each for old, each in zip(parts, steps, strict=True)]
                self._goal[guide] = new[0], new[1]
                self._send(guide)

    def _message(self, run: LiveRun, state: str) -> str | None:
        """Return the newest row as a message; None without a new row."""
        tick, rows = run.rows(run.tick)
        if not len(rows) or self._scenery is None:
            return None
        at = tick + len(rows) - 1
        if at == self._tick and state == "running":
            return None
        frames = Frames(history_of(rows[-1:], run.layout, run.header, changes=run.splits, tick=at), self._scenery.apart)
        self._tick, self._number, self.states = at, self._number + 1, self.states + 1
        fault = run.fault
        text = str(fault.message) if fault is not None else run.cause
        return state_message(frames[0], self._number, self._runs, state, text)


FIRST = 8770  # first port to try


def stream_of(
    stack: ExitStack, *, rate: float = RATE, goals: bool = False, port: int | None = None, lan: bool = False,
    token: str | None = None, origins: Collection[str] = (),
) -> tuple[StateStream, str]:  # fmt: skip
    """Open a stream; return it and its address with the token. The stack closes the stream.

    Args:
        stack: Exit stack that closes the stream.
        rate: Rate of states [Hz].
        goals: Whether clients may move guides.
        port: Port; None for the first free one from 8770, 0 for any.
        lan: Whether other machines in the network have access.
        token: Token of clients; None for a new one.
        origins: Origins of web pages that may open the stream.

    Raises:
        InputError: If the port is in use, the token is too short, the machine is not in a network, or the rate is
            invalid.
        MissingPackageError: If websockets is not installed.
    """
    line = stack.enter_context(listen_at(network_address() if lan else HOST, port, FIRST, "--port"))
    host, number = line.getsockname()[:2]
    gate = StreamGate({host} if lan else NAMES, number if lan else 0, token, origins)
    stream = stack.enter_context(StateStream(line, gate, rate=rate, goals=goals))
    return stream, f"ws://{host}:{number}{SOCKET}?{TOKEN}={gate.token}"
