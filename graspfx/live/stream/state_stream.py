"""A stream of a run: its newest row as a state, many times a second, and goals of clients on their way to its hands."""

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
from graspfx.loop.recording.header import SPLIT, KeyChange
from graspfx.screen.gate import TOKEN, StreamGate
from graspfx.screen.own_page import HOST, NAMES, listen_at
from graspfx.screen.stream_server import SOCKET, Bounds, StreamOrder, StreamServer
from graspfx.screen.touch_address import network_address

if TYPE_CHECKING:
    from graspfx.live.live_run import LiveRun
    from graspfx.screen.gate import StreamGate

FloatArray = NDArray[np.float64]

RATE, FASTEST = 60.0, 120.0  # of states [Hz]
SPEED = 0.5  # of a goal, the largest [m/s]
STEP = 0.004  # between two steps of goals [s]
REACH = 2.0  # of an offset's component, in extents of the scene
CLOSEST = 0.3  # of a squeeze, in extents


class StateStream:
    """A stream on a socket, in threads of its own; a context manager. It looks at one run after another.

    Goals go the way that every goal goes: bounded in distance, no faster than `SPEED`, and behind the follower of the
    guide, into the recording with their ticks. Where a client leaves, or says nothing for half a second, the goal stays
    where it has come.

    Args:
        line: a socket that listens.
        gate: before it.
        rate: of states [Hz].
        goals: whether clients may lead the guides of a run; never of one with hardware.

    Attributes:
        server: of the socket.
        states: that were written.

    Raises:
        InputError: a rate above 120 Hz, or none.
        MissingPackageError: websockets is not installed.
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
        """Stream a run from now on.

        Raises:
            InputError: clients may lead guides, and the run has hardware.
        """
        if self._goals and run.has_hardware:
            do = "stream it without goals: where a person's hand is, nobody else leads"
            raise InputError("goals", "a run with hardware", "simulated fingers alone", do)
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
        """Stream no run: its last state, and no goal comes in any more."""
        with self._lock:
            run, self._run = self._run, None
        with self._writing, suppress(GraspFXError):
            if run is not None:
                self.server.conclude(self._message(run, "ended") or "")

    # Goals: in the server's thread --------------------------------------------------------------------------------

    def lead(self, order: StreamOrder) -> None:
        """Lead a guide towards a goal."""
        with self._lock:
            if self._run is None or order.guide >= len(self._walks):
                return
            now = time.monotonic()
            walk, closing = self._walks[order.guide]
            if not (walk.is_led or closing.is_led):  # from where it was left
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
        """Lead a guide no farther: its goal stays where it has come."""
        with self._lock:
            if guide < len(self._walks):
                for walk in self._walks[guide]:
                    walk.end()

    def _send(self, guide: int) -> None:
        run = self._run
        if run is not None and run.state != "ended":
            offset, squeeze = self._goal[guide]
            with suppress(GraspFXError):  # a run that ends meanwhile
                run.guide(guide, offset, float(squeeze[0]) if run.guides[guide].place is None else None)

    # States: in a thread of its own -------------------------------------------------------------------------------

    def _follow(self) -> None:
        while not self._over.wait(STEP):
            with self._lock:
                self._step()
            now = time.monotonic()
            if now < self._next or not self.server.clients:
                continue
            with self._writing, suppress(GraspFXError):  # a run that ends while it is looked at
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
        """Write the newest row; None where there is none, or none that is new."""
        tick, rows = run.rows(run.tick)
        if not len(rows) or self._scenery is None:
            return None
        at = tick + len(rows) - 1
        if at == self._tick and state == "running":
            return None
        splits = [KeyChange(since, SPLIT, split) for since, split in run.splits]
        frames = Frames(history_of(rows[-1:], run.layout, run.header, changes=splits, tick=at), self._scenery.apart)
        self._tick, self._number, self.states = at, self._number + 1, self.states + 1
        fault = run.fault
        text = str(fault.message) if fault is not None else run.cause
        return state_message(frames[0], self._number, self._runs, state, text)


FIRST = 8770  # port to try


def stream_of(
    stack: ExitStack, *, rate: float = RATE, goals: bool = False, port: int | None = None, lan: bool = False,
    token: str | None = None, origins: Collection[str] = (),
) -> tuple[StateStream, str]:  # fmt: skip
    """Open a stream, which the stack closes; give it and its address, with the token.

    Args:
        stack: closes it.
        rate: of states [Hz].
        goals: whether clients may lead guides.
        port: by default the first that is free from 8770 on; 0 for any.
        lan: whether other machines in the network may have it.
        token: that clients bring; a new one if not given.
        origins: of browsers' pages that may open it.

    Raises:
        InputError: a port in use; a token that is short; a machine in no network; a rate that is none.
        MissingPackageError: websockets is not installed.
    """
    line = stack.enter_context(listen_at(network_address() if lan else HOST, port, FIRST, "--port"))
    host, number = line.getsockname()[:2]
    gate = StreamGate({host} if lan else NAMES, number if lan else 0, token, origins)
    stream = stack.enter_context(StateStream(line, gate, rate=rate, goals=goals))
    return stream, f"ws://{host}:{number}{SOCKET}?{TOKEN}={gate.token}"
