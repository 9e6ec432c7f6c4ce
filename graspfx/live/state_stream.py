"""WebSocket that sends the states of a run to clients, and receives goals of guides from them.

Messages are JSON, in SI units and right-handed 3-D coordinates.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Collection, Sequence
from contextlib import ExitStack, suppress
from socket import socket
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from graspfx import __version__
from graspfx.errors import GraspFXError, InputError
from graspfx.live.frame import STATES, Frames, history_of
from graspfx.live.guides import GoalWalk, Guide
from graspfx.live.scenery import Scenery, scenery
from graspfx.screen.gate import HOST, TOKEN, StreamGate, listen, names_of, network_address
from graspfx.screen.stream_server import SOCKET, Bounds, StreamOrder, StreamServer
from graspfx.show.picture.instant import lifted

if TYPE_CHECKING:
    from graspfx.live.live_run import LiveRun
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

PROTOCOL = "graspfx-stream/1"  # increased with each incompatible change
UNITS = {"length": "m", "force": "N", "time": "s"}
FIRST = 8770  # first port to try
RATE, FASTEST = 60.0, 120.0  # default and highest rate of states [Hz]
SPEED = 0.5  # highest speed of a goal [m/s]
STEP = 0.004  # interval between steps of goals [s]
REACH = 2.0  # largest component of an offset, in extents of the scene
CLOSEST = 0.3  # largest squeeze, in extents


def hello_message(
    scene: Scene, scenery: Scenery, guides: Sequence[Guide], *, rate: float, farthest: float, closest: float,
    run: int,
) -> str:  # fmt: skip
    """Return the first message to a client: names, units, shapes, and the guides that the client may move.

    Args:
        scene: Running scene.
        scenery: Scenery of the scene.
        guides: Guides that clients may move; empty if they may move none.
        rate: Highest rate of states [Hz].
        farthest: Largest component of an offset [m].
        closest: Largest absolute squeeze [m].
        run: Number of the run in the stream, from 1.
    """
    table = scene.to_dict()
    return _json({
        "type": "hello",
        "protocol": PROTOCOL,
        "version": __version__,
        "title": scene.title,
        "run": run,
        "dimensions": scene.dimensions,
        "period": scene.period,
        "rate": rate,
        "units": UNITS,
        "handedness": "right",
        "up": "z" if scenery.up[2] else "y",
        "fingers": [
            {"name": name, "object": scene.object[own].name, "colour": colour, "radius": float(radius)}
            for name, own, colour, radius in zip(
                scene.finger_names, scene.finger_objects, scenery.colours, scenery.radii, strict=True
            )
        ],
        "objects": [
            {"name": each.name, "shape": _shape(table, "object", i)} for i, each in enumerate(scene.object)
        ],
        "obstacles": [
            {"name": each.name, "shape": _shape(table, "obstacle", i)} for i, each in enumerate(scene.obstacle)
        ],
        "guides": [
            {"name": each.name, "fingers": list(each.fingers), "position": _finite(lifted(each.position[None], 3)[0]),
             "squeezes": each.place is None}
            for each in guides
        ],
        "farthest": farthest,
        "closest": closest,
    })  # fmt: skip


def state_message(frames: Frames, tick: int, number: int, run: int, state: str, fault: str) -> str:
    """Return a state message.

    Args:
        frames: Frames, of which the last one is the state.
        tick: Tick of the state.
        number: Number of the state in the stream, from 1.
        run: Number of the run in the stream, from 1.
        state: "running", "paused" or "ended".
        fault: Message of the fault; empty if the run has no fault.
    """
    force, (internal, external) = frames.force, frames.parts or (None, None)
    return _json({
        "type": "state",
        "number": number,
        "run": run,
        "tick": tick,
        "time": float(frames.time[-1]),
        "state": state,
        "fault": fault,
        "objects": [
            {"name": name, "position": _finite(place[-1]), "orientation": _finite(turn[-1, [1, 2, 3, 0]])}
            for name, (place, turn) in frames.poses.items()
        ],
        "fingers": [
            {
                "position": _finite(frames.fingertips[-1, i]), "contact": STATES[contact],
                "contact_position": _finite(frames.contacts[-1, i]), "force": _part(force, i),
                "internal": _part(internal, i), "external": _part(external, i),
            }
            for i, contact in enumerate(frames.states[-1])
        ],
    })  # fmt: skip


def _json(table: dict[str, Any]) -> str:
    return json.dumps(table, separators=(",", ":"), allow_nan=False)


def _finite(numbers: FloatArray) -> list[float] | None:
    """Convert an array to a list; return None if a number is not finite."""
    return numbers.tolist() if np.isfinite(numbers).all() else None


def _part(forces: FloatArray | None, finger: int) -> list[float] | None:
    """Return the force of a finger in the last frame; None if the forces are unknown or not finite."""
    return None if forces is None else _finite(forces[-1, finger])


def _shape(table: dict[str, Any], kind: str, number: int) -> Any:
    """Return the table `shape` of an object or obstacle in the scene; None for a point."""
    entries = table.get(kind)
    entry = entries if isinstance(entries, dict) else entries[number] if entries else {}
    return entry.get("shape")


class StateStream:
    """Stream of runs, which are attached one after the other; a context manager.

    Offset, squeeze and speed of goals are limited (`REACH`, `CLOSEST`, `SPEED`). Goals are smoothed by the follower of
    the guide, and a recording contains the goals with their ticks. If a client leaves or sends nothing for half a
    second, the goals of the guides that this client has moved no longer change.

    Args:
        line: Listening socket.
        gate: Access control.
        rate: Rate of states [Hz].
        goals: Whether clients may move the guides of a run; a run with hardware then cannot be attached.

    Attributes:
        server: Server of the socket.
        states: Number of states sent.

    Raises:
        InputError: If the rate is not between 1 and 120 Hz.
        MissingPackageError: If websockets is not installed.
    """

    def __init__(self, line: socket, gate: StreamGate, *, rate: float = RATE, goals: bool = False) -> None:
        if not 1.0 <= rate <= FASTEST:
            raise InputError("rate", rate, f"a rate of 1 to {FASTEST:g} Hz")
        self.rate, self._goals = rate, goals
        self.server = StreamServer(line, gate, self.lead, self.release)
        self._run: LiveRun | None = None
        self._scenery: Scenery | None = None
        self._walks: list[GoalWalk] = []  # of each guide's offset and squeeze together (d + 1,) [m]
        self._lock, self._writing, self._over = threading.RLock(), threading.Lock(), threading.Event()
        self.states, self._runs, self._tick, self._next = 0, 0, -1, 0.0
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
            InputError: If clients may move guides and the run has hardware.
        """
        if self._goals and run.has_hardware:
            do = "stream this run without goals, because clients must not move a device that a person holds"
            raise InputError("goals", "a run with hardware", "a run with simulated fingers only", do)
        with self._lock, self._writing:
            self._runs += 1
            guides = list(run.guides) if self._goals else []
            drawn = self._scenery = scenery(run.header, run.layout)
            far, near = REACH * drawn.extent, CLOSEST * drawn.extent
            self._walks = [GoalWalk(SPEED) for _ in guides]
            hello = hello_message(
                run.scene, drawn, guides, rate=self.rate, farthest=far, closest=near, run=self._runs
            )  # fmt: skip
            self._run, self._tick = run, -1
            self.server.describe(hello, Bounds(len(guides), far, near))

    def detach(self) -> None:
        """Send the last state of the run, and then accept no more goals."""
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
            walk, start = self._walks[order.guide], np.append(*self._run.goal(order.guide))
            target = walk.target.copy() if walk.is_led else start.copy()
            if order.offset is not None:
                target[:-1] = order.offset[: len(start) - 1]
            if order.squeeze is not None and self._run.guides[order.guide].place is None:
                target[-1] = order.squeeze
            self._send(order.guide, walk.aim(target, start, time.monotonic()))

    def release(self, guide: int) -> None:
        """Release a guide, so that the goal of this guide no longer changes."""
        with self._lock:
            if guide < len(self._walks):
                self._walks[guide].end()

    def _send(self, guide: int, goal: FloatArray) -> None:
        run = self._run
        if run is not None and run.state != "ended":
            with suppress(GraspFXError):  # the run may end meanwhile
                run.guide(guide, goal[:-1], float(goal[-1]) if run.guides[guide].place is None else None)

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
        for guide, walk in enumerate(self._walks):
            goal = walk.step(time.monotonic())
            if goal is not None:
                self._send(guide, goal)

    def _message(self, run: LiveRun, state: str) -> str | None:
        """Return the newest row as a message; None if there is no new row in a running run."""
        tick, rows = run.rows(run.tick)
        if not len(rows) or self._scenery is None:
            return None
        at = tick + len(rows) - 1
        if at == self._tick and state == "running":
            return None
        frames = Frames(history_of(rows[-1:], run.layout, run.header, changes=run.splits, tick=at), self._scenery.apart)
        self._tick, self.states = at, self.states + 1
        fault = run.fault
        text = str(fault.message) if fault is not None else run.cause
        return state_message(frames, at, self.states, self._runs, state, text)


def stream_of(
    stack: ExitStack, *, rate: float = RATE, goals: bool = False, port: int | None = None, lan: bool = False,
    token: str | None = None, origins: Collection[str] = (),
) -> tuple[StateStream, str]:  # fmt: skip
    """Open a stream; return the stream, and its address including the token.

    Args:
        stack: Exit stack that closes the stream.
        rate: Rate of states [Hz].
        goals: Whether clients may move guides.
        port: Port number; None for the first free port from 8770 on, 0 for any free port.
        lan: Whether other machines in the network have access.
        token: Token that clients must send; None for a new token.
        origins: Origins of web pages that may open the stream.

    Raises:
        InputError: If the port is in use, the token is too short, the machine is not in a network, or the rate is
            invalid.
        MissingPackageError: If websockets is not installed.
    """
    line = stack.enter_context(listen(network_address() if lan else HOST, port, FIRST, "--port"))
    host, number = line.getsockname()[:2]
    gate = StreamGate(*names_of(line, lan=lan), token, origins)
    stream = stack.enter_context(StateStream(line, gate, rate=rate, goals=goals))
    return stream, f"ws://{host}:{number}{SOCKET}?{TOKEN}={gate.token}"
