"""Live run controlled by a touch screen: goals of fingers, pictures of the run, and a log of touches."""

from __future__ import annotations

import json
import math
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from os import PathLike
from pathlib import Path
from socket import socket
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.hands import holdings
from graspfx.errors import GraspFXError, InputError
from graspfx.live.frame import STATES, Frames, history_of
from graspfx.live.guides import FingerReach, GoalWalk
from graspfx.live.live_run import LiveRun
from graspfx.live.scenery import Scenery, Solid, scenery
from graspfx.recording.files import placing, require_vacancy
from graspfx.scene.model import Scene
from graspfx.screen.touch_orders import MOST_FINGERS, Box, Kind, Order
from graspfx.screen.touch_server import TouchServer
from graspfx.show.style import CONTACTS, EXTERNAL, INTERNAL

if TYPE_CHECKING:
    from graspfx.assembly.hands import Holding
    from graspfx.screen.gate import Gate

FloatArray = NDArray[np.float64]

WIDE, HIGH = 2.1, 1.4  # half width and height of the touchable area, in extents of the scene
CAVEAT = "The force is shown here, not felt."
LEGEND = (
    ("squeeze (internal force)", INTERNAL, True),
    ("push (external force)", EXTERNAL, True),
    ("free", CONTACTS["free"], False),
    ("touches or sticks", CONTACTS["stick"], False),
    ("slides", CONTACTS["slide"], False),
    ("at its limit", CONTACTS["limit"], False),
)
HEADER = "client,number,kind,finger,x,y,tick,fate"
NAME = "touches.csv"
OWN = ("motion", "turn", "squeeze", "squeeze_ramp", "rest")  # keys of a hand's own motion
SPEED = 0.5  # highest speed of a goal [m/s]
QUICK, SLOW = 0.004, 0.033  # interval between pictures while fingers are touched, and otherwise [s]
STEP = 0.002  # interval between steps of goals [s]
PAUSE = 2.0  # time during which a fault is shown before the scene restarts [s]


def box_of(scenery: Scenery) -> Box:
    """Return the area that can be touched: a box around the scene's centre with space to move objects."""
    x, y = float(scenery.middle[0]), float(scenery.middle[1])
    half, high = WIDE * scenery.extent, HIGH * scenery.extent
    return Box(x - half, y - high, x + half, y + high)


def description(scenery: Scenery, title: str, fingers: Sequence[int], touchable: int, box: Box, fault: str = "") -> str:
    """Return the static content of the page, as JSON.

    Args:
        scenery: Scenery of the scene.
        title: Title of the page.
        fingers: Numbers of the fingers in the order of the page; fingers that can be touched come first.
        touchable: Number of fingers that can be touched.
        box: Area that can be touched, in the scene's coordinates [m].
        fault: Reason why the run ended; empty while it runs.
    """
    objects = [each for each in scenery.solids if each.object is not None]
    most = "one finger" if touchable == 1 else f"up to {touchable} fingers"
    return json.dumps({
        "title": title,
        "hint": f"Touch with {most}. {CAVEAT}",
        "fault": fault,
        "box": box,
        "touchable": touchable,
        "fingers": [
            {"name": scenery.fingers[i], "colour": scenery.colours[i], "radius": float(scenery.radii[i])}
            for i in fingers
        ],
        "objects": [_shape(each) for each in objects],
        "obstacles": [_shape(each) for each in scenery.solids if each.object is None],
        "states": [CONTACTS[state] for state in STATES],
        "internal": INTERNAL,
        "external": EXTERNAL,
        "legend": LEGEND,
    })  # fmt: skip


def picture(frames: Frames, tick: int, scenery: Scenery, fingers: Sequence[int]) -> bytes:
    """Encode the last frame as float64, in SI units.

    The numbers are the tick, the time, the largest squeeze and the largest push of an object; x, y and angle of each
    object; and two coordinates each of position, internal force and external force, and the state, of each finger.
    Forces of fingers that are unknown are 0; other unknown numbers are NaN.
    """
    n = len(fingers)
    modes = frames.modes.values()
    poses = [frames.poses.get(solid.object) for solid in scenery.solids if solid.object is not None]
    rows = np.zeros((n, 7))
    rows[:, :2] = frames.fingertips[-1, fingers, :2]
    if frames.parts is not None:
        rows[:, 2:4], rows[:, 4:6] = (part[-1, fingers, :2] for part in frames.parts)
    rows[:, 6] = frames.states[-1, fingers]
    return np.concatenate([
        [tick, frames.time[-1], _largest(each.mean_squeeze[-1] for each in modes),
         _largest(float(np.linalg.norm(each.push[-1])) for each in modes)],
        *(np.full(3, np.nan) if pose is None else _pose(*pose) for pose in poses), rows.ravel(),
    ]).tobytes()  # fmt: skip


def _pose(place: FloatArray, turn: FloatArray) -> list[float]:
    """Return x, y and angle of an object in the last frame."""
    return [place[-1, 0], place[-1, 1], 2.0 * math.atan2(turn[-1, 3], turn[-1, 0])]


def _largest(forces: Iterable[float]) -> float:
    """Return the largest finite force [N]; NaN if no force is finite."""
    return max(filter(math.isfinite, forces), default=math.nan)


def _shape(solid: Solid) -> dict[str, Any]:
    """Return name, colour and outline of a slab; the outline consists of the front vertices, which come first."""
    outline = solid.vertices[: len(solid.vertices) // 2, :2]
    return {"name": solid.name, "colour": solid.colour, "loops": [outline.round(9).tolist()]}


class Entry(NamedTuple):
    """Order of a client, the newest tick when the order arrived, and the fate of the order."""

    client: int
    order: Order
    tick: int
    fate: str


class TouchLog:
    """Log of orders, kept in memory until `save` writes a file.

    Args:
        is_on: Whether orders are logged.
    """

    def __init__(self, *, is_on: bool) -> None:
        self.is_on = is_on
        self.entries: list[Entry] = []

    def note(self, client: int, order: Order, tick: int, fate: str) -> None:
        """Log an order."""
        if self.is_on:
            self.entries.append(Entry(client, order, tick, fate))

    def fates(self) -> list[str]:
        """List the fate of each order.

        The fate is "applied", "superseded" if another order for the same finger arrived before the next tick, or the
        reason why the order was rejected.
        """
        fates, newest = [each.fate for each in self.entries], dict[int, int]()
        for k, each in enumerate(self.entries):
            if each.fate != "taken" or each.order.kind == Kind.ALIVE:
                continue
            before = newest.get(each.order.finger)
            if before is not None and self.entries[before].tick == each.tick:
                fates[before] = "superseded"
            newest[each.order.finger], fates[k] = k, "applied"
        return ["applied" if fate == "taken" else fate for fate in fates]

    def save(self, folder: Path) -> Path:
        """Write the log as a CSV file in a folder, in place of an existing log; return the file's path.

        Raises:
            RecordingError: If the file cannot be written; an existing file is unchanged.
        """
        lines = [HEADER]
        for (client, order, tick, _), fate in zip(self.entries, self.fates(), strict=True):
            x, y = order.place
            lines.append(f"{client},{order.number},{order.kind.name.lower()},{order.finger},{x!r},{y!r},{tick},{fate}")
        file = folder / NAME
        with placing(file) as draft:
            draft.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return file


def touched_scene(scene: Scene) -> Scene:
    """Return the scene without motions, rotations and squeezes of hands, so that fingers stay where they start.

    Raises:
        InputError: If the scene is three-dimensional, or has no hand that can be moved.
    """
    if scene.dimensions > 2:
        raise InputError(
            "scene", scene.title or scene.source.name, "a scene with one or two dimensions",
            "move hands in three dimensions with `graspfx view`",
        )  # fmt: skip
    if not any(_is_led(each) for each in holdings(scene)):
        raise InputError(
            "scene", scene.title or scene.source.name, "a scene with a simulated finger held by a spring hand",
            "add `hand = { stiffness = 60.0, damping = 1.0 }` to the table of a finger",
        )  # fmt: skip
    table = scene.to_dict()
    for each in holdings(scene):
        if _is_led(each):
            own = _at(table, each.at)
            for key in OWN:
                own.pop(key, None)
    return Scene(scene.source, **table)


def _is_led(holding: Holding) -> bool:
    return holding.table is not None and holding.table.form != "made"


def _at(table: Any, place: tuple[str | int, ...]) -> dict[str, Any]:
    for key in place:
        table = table[key]
    own: dict[str, Any] = table
    return own


class TouchRun:
    """Live run whose fingers follow a touch screen; a context manager.

    Args:
        scene: One- or two-dimensional scene with simulated fingers that are held by hands.
        line: Listening socket.
        gate: Access control of the page.
        speed: Highest speed of a goal [m/s].
        out: Folder in which the recording and the log of orders are written; None to write neither.
        overwrite: Whether to replace an existing log, and an existing recording, including an unfinished one of a
            killed run.

    Attributes:
        run: Live run.
        server: Server of the page.
        log: Log of orders.

    Raises:
        InputError: If the scene is three-dimensional, or has no finger that can be moved.
        MissingPackageError: If websockets is not installed.
        RecordingError: If a file exists and is not to be replaced.
    """

    def __init__(
        self, scene: Scene, line: socket, gate: Gate, *,
        speed: float = SPEED, out: str | PathLike[str] | None = None, overwrite: bool = False,
    ) -> None:  # fmt: skip
        if not (math.isfinite(speed) and speed > 0.0):
            raise InputError("speed", speed, "a finite speed above zero [m/s]")
        still = touched_scene(scene)
        self._out = None if out is None else Path(out)
        if self._out is not None and not overwrite:
            require_vacancy([self._out / NAME])
        self.log = TouchLog(is_on=out is not None)
        self.run = LiveRun(still, out=out, overwrite=overwrite, guide="fingers")
        try:
            self._scenery, guides = scenery(self.run.header, self.run.layout), self.run.guides
            self.box = box_of(self._scenery)
            if not 0 < len(guides) <= MOST_FINGERS:
                raise InputError("scene", still.title, f"one to {MOST_FINGERS} fingers held by a spring hand")
            led = [guide.fingers[0] for guide in guides]
            self._fingers = [*led, *(i for i in range(len(self.run.layout.fingers)) if i not in led)]
            self._walks = [GoalWalk(speed) for _ in guides]
            self._reaches = [FingerReach(self.run.servo, finger, speed) for finger in led]
            self._lock = threading.Lock()
            self._tips = np.array([guide.position for guide in guides])
            self._dimensions = self._tips.shape[1]
            self._fault = ""
            self.server = TouchServer(line, gate, len(guides), self.box, self._described(), self, self._note)
        except BaseException:
            self.run.close()
            raise
        self._is_over, self._is_closed = threading.Event(), False
        self._thread = threading.Thread(target=self._follow, name="pictures", daemon=True)

    def __enter__(self) -> Self:
        try:
            self.server.__enter__()
        except BaseException:
            self.run.close()
            raise
        self._thread.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the page and the run, and write the log of orders; a second call has no effect."""
        if self._is_closed:
            return
        self._is_closed = True
        self.server.__exit__()
        self._is_over.set()
        self._thread.join()
        try:
            self.run.close()
        finally:
            if self._out is not None:
                self.log.save(self._out)

    def wait(self, look: Callable[[], bool]) -> None:
        """Wait until `look` returns True or the run has ended."""
        while not look() and not self._is_over.wait(0.1):
            pass

    @property
    def fault(self) -> str:
        """Reason why the run has ended; empty while the run continues."""
        return self._fault

    # Orders: in the server's thread -------------------------------------------------------------------------------

    def press(self, finger: int, place: tuple[float, float]) -> None:
        """Move a finger to a position."""
        now = time.monotonic()
        with self._lock:
            aim = self._reaches[finger].nearest(np.array(place[: self._dimensions]))
            self._send(finger, self._walks[finger].aim(aim, self._tips[finger], now))

    def lift(self, finger: int) -> None:
        """Release a finger."""
        with self._lock:
            self._walks[finger].end()
            if self.run.state != "ended":
                self.run.let_go(finger)

    def _send(self, finger: int, goal: FloatArray) -> None:
        if self.run.state != "ended":
            goal = self._reaches[finger].nearest(goal)
            self.run.guide(finger, goal - self.run.guides[finger].position)

    def _note(self, client: int, order: Order, fate: str) -> None:
        self.log.note(client, order, self.run.tick, fate)

    # Pictures: in a thread of its own -----------------------------------------------------------------------------

    def _follow(self) -> None:
        """Move the goals and send pictures until the page is closed."""
        tick, pictured = -1, 0.0
        while not self._is_over.is_set():
            if self.run.state == "ended" or self.run.fault is not None:
                if not self._begin_anew():
                    return
                tick = -1
                continue
            began = time.monotonic()
            if self.run.await_row(tick, 0.05):
                tick, row = self.run.tick, self.run.row()
                busy = self.server.has_touches
                if row is not None and time.monotonic() - pictured > (QUICK if busy else SLOW) - 0.5 * STEP:
                    pictured = time.monotonic()
                    self._show(row, tick)
            self._step()
            self._is_over.wait(max(0.0, STEP - (time.monotonic() - began)))

    def _show(self, row: FloatArray, tick: int) -> None:
        frames = Frames(history_of(row[None], self.run.layout, self.run.header, tick=tick), self._scenery.apart)
        with self._lock:
            self._tips = frames.fingertips[0, self._fingers, : self._dimensions].copy()
        self.server.show(picture(frames, tick, self._scenery, self._fingers))

    def _step(self) -> None:
        with self._lock:
            now = time.monotonic()
            for finger, walk in enumerate(self._walks):
                goal = walk.step(now)
                if goal is not None:
                    self._send(finger, goal)

    def _begin_anew(self) -> bool:
        """Show why the run ended; restart it, unless it is recorded or has hardware; return whether it runs again."""
        self._fault = str(self.run.fault or self.run.cause or "the run has ended")
        self.server.describe(self._described())
        with self._lock:
            for walk in self._walks:
                walk.end()
        if self._is_over.wait(PAUSE):
            return False
        if self._out is not None or self.run.has_hardware:
            self._is_over.set()
            return False
        try:
            self.run.reset()
        except GraspFXError as error:
            self._fault = str(error)
            self._is_over.set()
            return False
        self._fault = ""
        self.server.describe(self._described())
        return True

    def _described(self) -> str:
        scene = self.run.scene
        title = scene.title or Path(scene.source.name).stem
        return description(self._scenery, title, self._fingers, len(self._walks), self.box, self._fault)
