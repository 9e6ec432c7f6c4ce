"""Sessions: runs of a scene whose values can be read, and changed, during the run."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache
from os import PathLike
from pathlib import Path
from time import perf_counter
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from graspfx import log
from graspfx.assembly.build import build, build_again
from graspfx.assembly.live import keys_of, numbered, require_value, value_of
from graspfx.assembly.provenance import header_of, split_rules
from graspfx.assembly.resolve import Parts, require_prompt_simulations, resolve
from graspfx.assembly.steering import Steering
from graspfx.card import Card, Carded
from graspfx.compile.kernel import keep_lowerings
from graspfx.environment import to_path
from graspfx.errors import InputError
from graspfx.loop.columns import Layout, RunFault, Selection, chosen_layout
from graspfx.loop.realtime.lifecycle import require_simulations
from graspfx.loop.servo import Update
from graspfx.numeric import number
from graspfx.recording.files import NAME, make_folder, part_of, recording_path, require_vacancy_of
from graspfx.recording.header import SPLIT, Header
from graspfx.recording.history import by_name
from graspfx.recording.record import Recording
from graspfx.recording.recorded_split import RowSplit, Split
from graspfx.recording.recorder import Recorder, Sink

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

WHOLE = "a whole number of ticks, one or more"

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class ObjectView:
    """State of an object in one tick of a scene of d dimensions.

    Attributes:
        position: Position of the object's centre, (d,) [m].
        velocity: Velocity of the object's centre, (d,) [m/s].
        orientation: Angle [rad] for d = 2, quaternion x, y, z, w for d = 3, None for d = 1.
        angular_velocity: Angular velocity [rad/s], a number for d = 2, in world axes (3,) for d = 3, None for d = 1.
        wrench: Wrench of the fingers on the object about the object's centre, (w,) [N, N m].
    """

    position: FloatArray
    velocity: FloatArray
    orientation: float | FloatArray | None
    angular_velocity: float | FloatArray | None
    wrench: FloatArray


class Session(Carded):
    """A run that its caller advances tick by tick. `gx.open` creates it, and the end of the `with` block closes it.

    Positions, velocities and forces are the recorded values of the last tick. Before the first tick, positions and
    velocities are those at the start, and forces are zero.

    Args:
        scene: Scene to run.
        live, out, overwrite: As for `gx.open`.
        ticks: Number of ticks of the whole run; None if it is not known.
        how: Further arguments of `build`.
    """

    is_paced = False  # whether it runs in real time
    keeps_rows = True  # whether rows stay in memory without a folder
    is_repeated = False  # whether the servo of the previous run is reused

    def __init__(
        self,
        scene: Scene,
        *,
        live: Iterable[str] = (),
        out: str | PathLike[str] | None = None,
        overwrite: bool = False,
        ticks: int | None = None,
        **how: Any,
    ) -> None:
        if isinstance(scene, str | PathLike):
            raise InputError("scene", scene, "a Scene", "`graspfx.open` also takes a name or a path")
        if out is not None:
            to_path("out", out, "the path of a folder")
        keys = [numbered(scene, key) for key in keys_of(live)]
        parts = resolve(scene)
        if "playback" not in how:  # a playback moves nothing, and the original run has warned
            if not self.is_paced:
                require_simulations(parts.hardware)
            require_prompt_simulations(parts)
            warn_of_axes(parts)
        if out is not None and not overwrite:
            require_vacancy_of(recording_path(out, "out") / NAME)
        self.scene, self._ticks, self._spent = scene, ticks, 0.0
        self._finished: Recording | None = None
        self._so_far: tuple[int, int, Recording] | None = None  # number of ticks and changes at the last access
        self._place = None if out is None else Path(out) / NAME
        made = build_again if self.is_repeated else build
        with ExitStack() as stack:
            self.servo = stack.enter_context(made(scene, live=keys, real_time=self.is_paced, **how))
            self._steering = Steering(self.servo, scene, keys, how.get("playback"))
            for key in keys:
                require_value(scene, key)
            whole = self.servo.layout  # or the recorded part, if ticks write nothing else
            layout = whole if how.get("selected") else chosen_layout(whole, scene.record.columns)
            every = scene.record.every
            if ticks is not None:
                require_room(ticks, layout, every, out)
            header, sinks = self._start(stack, parts, keys), list[Sink]()
            self._splits: list[tuple[int, Split]] = [(0, header.split)]  # split of forces from each tick on
            if out is not None:
                from graspfx.recording.sink import FileSink

                file, packed = make_folder(out) / NAME, scene.record.compression
                sinks.append(FileSink(file, layout, header, overwrite=overwrite, compression=packed))
            self._recorder = stack.enter_context(
                Recorder(
                    whole, header, sinks, keep=out is None and self.keeps_rows, ticks=ticks, real_time=self.is_paced,
                    selection=None if how.get("selected") else Selection(whole, layout, every),
                )
            )  # fmt: skip
            self._go()
            self._stack = stack.pop_all()

    def _start(self, stack: ExitStack, parts: Parts, keys: Sequence[str]) -> Header:
        """Prepare the run, and return the header of the recording; closing `stack` ends what was prepared."""
        return header_of(parts, self.servo.objects)

    def _go(self) -> None:
        """Start the run when the recording is prepared; simulated time has nothing to start."""

    def _card(self) -> Card:
        rows = [("live", ", ".join(self.live)), ("fault", str(self.fault or ""))]
        return Card(repr(self), rows, ".step(ticks), .set(key, value), .position, .force, .recording, .close()")

    def __repr__(self) -> str:
        name, state = self._recorder.header.scene or "a scene", "closed" if self._finished else "open"
        live = f", live: {', '.join(self.live)}" if self.live else ""
        fault = f", fault at {self.fault}" if self.fault else ""
        return f"<Session of {name}, {state}: {self.tick} ticks, {self.time:g} s{live}{fault}>"

    def __enter__(self) -> Self:
        self._require_open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close(complete=kind is None)

    def close(self) -> None:
        """End the run: write the recording, and close devices and bodies; a second call has no effect."""
        self._close(complete=True)

    def _require_open(self) -> None:
        if self._finished is not None:
            raise InputError("session", self, "an open session", "this session is closed; open another with gx.open")

    def _close(self, *, complete: bool) -> None:
        if self._finished is not None:
            return
        try:
            with self._stack:
                self._finished = self._with_notes(self._recorder.finish(**self._outcome(complete)))
                keep_lowerings()  # caches the kernels that were called
        finally:
            if self._finished is not None and self._place is not None:
                self._finished = self._with_notes(Recording.load(self._place))

    def _outcome(self, complete: bool) -> dict[str, Any]:
        return {
            "wall_time": self._spent if complete else None,
            "complete": complete,
            "engine": self.servo.engine_name,
        } | self.servo.coupling

    def _with_notes(self, recording: Recording) -> Recording:
        from graspfx.certificate.report import beside

        recording._beside = beside(self.scene)
        return recording

    # Stepping -----------------------------------------------------------------------------------------------------

    def step(self, ticks: int = 1) -> None:
        """Run a number of ticks.

        A failure of a device does not raise an error; it is recorded as a fault.

        Raises:
            InputError: If `ticks` is not an integer above zero, the session is closed, the recording does not fit into
                memory, or a block was written directly instead of by `set`.
        """
        count = ticks if type(ticks) is int else number("ticks", ticks, WHOLE)
        if count < 1.0 or count % 1.0 or isinstance(ticks, bool | np.bool_):
            raise InputError("ticks", ticks, WHOLE)
        self._require_open()
        if self._place is None:
            require_memory(self.tick + count, 8 * self._recorder.recorded.width / self._recorder.header.every)
        self._advance(int(count))

    def _advance(self, ticks: int, stop: Callable[[], bool] | None = None) -> None:
        """Run a number of ticks, or fewer if `stop` returns True."""
        began = perf_counter()
        try:
            self._tick(ticks, self._recorder, stop)
        finally:
            self._spent += perf_counter() - began

    def _tick(self, ticks: int, recorder: Recorder, stop: Callable[[], bool] | None) -> None:
        self.servo.run(ticks, recorder, stop)

    @property
    def tick(self) -> int:
        """Number of ticks that have been run, which is the index of the next tick."""
        return self.servo.ticks

    @property
    def time(self) -> float:
        """Time of the next tick, `tick` times the period [s]."""
        return self.tick * self.servo.period

    @property
    def fault(self) -> RunFault | None:
        """First fault of the run, after which all forces are zero; None without a fault."""
        return self.servo.fault

    # Looking at it ------------------------------------------------------------------------------------------------

    @property
    def recording(self) -> Recording:
        """Recording of all ticks that have been run."""
        if self._finished is not None:
            return self._finished
        state = self.tick, len(self._recorder.changes)
        if self._so_far is None or self._so_far[:2] != state:
            self._so_far = (*state, self._with_notes(self._recording_so_far()))
        return self._so_far[2]

    def _recording_so_far(self) -> Recording:
        if self._place is None:
            return self._recorder.recording(**self._outcome(complete=False))
        self._recorder.flush()
        return Recording.load(part_of(self._place))

    @property
    def position(self) -> FloatArray:
        """Positions of the fingers as their devices report them, (n, d) [m]."""
        return self._of_fingers("finger_position")

    @property
    def velocity(self) -> FloatArray:
        """Velocities of the fingers as their devices report or estimate them, (n, d) [m/s]."""
        return self._of_fingers("finger_velocity")

    @property
    def force(self) -> FloatArray:
        """Forces of the fingers on their objects, (n, d) [N]."""
        return self._of_fingers("finger_force")

    @property
    def internal_force(self) -> FloatArray:
        """Parts of the fingers' forces that squeeze their objects, (n, d) [N]."""
        return self.force - self.external_force

    @property
    def external_force(self) -> FloatArray:
        """Parts of the fingers' forces that move their objects, (n, d) [N]; takes a few hundred microseconds."""
        layout = self.servo.layout
        if not self.tick:
            return np.zeros(layout.columns["finger_force"].shape)
        split = next(split for tick, split in reversed(self._splits) if tick < self.tick)  # at the row's tick
        external, _ = RowSplit(self.servo.row[None], layout, [(0, split)]).external_forces()  # (n, d, 1)
        return np.asarray(external[:, :, 0])

    @property
    def touching(self) -> BoolArray:
        """Whether each finger exerts a force, (n,)."""
        return np.not_equal(self._of_fingers("touching"), 0.0)

    @property
    def objects(self) -> Mapping[str, ObjectView]:
        """State of each object, by name of the object."""
        return by_name("object", {part.name: self._object(i) for i, part in enumerate(self.servo.objects)})

    def _object(self, i: int) -> ObjectView:
        orientation, angular_velocity = self._column(i, "orientation"), self._column(i, "angular_velocity")
        plane = self.servo.layout.dimensions == 2
        return ObjectView(
            position=self._column(i, "position"),
            velocity=self._column(i, "velocity"),
            orientation=float(orientation[0]) if plane else orientation if len(orientation) else None,
            angular_velocity=float(angular_velocity[0]) if plane else angular_velocity if len(orientation) else None,
            wrench=self._column(i, "wrench"),
        )

    def _of_fingers(self, name: str) -> FloatArray:
        column = self.servo.layout.columns[name]
        if self.tick:
            return self.servo.row[column.where].reshape(column.shape).copy()
        values = np.zeros(column.shape)
        for part in self.servo.objects:
            values[part.fingers] = part.grasped.block[part.grasped.where[name]]
        return values

    def _column(self, i: int, name: str) -> FloatArray:
        """Return a quantity of object i as a flat array; the array is empty if the object lacks the quantity."""
        part = self.servo.objects[i]
        column = self.servo.layout.columns.get(f"objects/{part.name}/{name}")
        if column is None:
            return np.empty(0)
        if self.tick:
            return self.servo.row[column.where].copy()
        return part.grasped.block[part.grasped.where[name]]

    # Steering -----------------------------------------------------------------------------------------------------

    @property
    def live(self) -> tuple[str, ...]:
        """Keys whose values `set` may change."""
        return self._steering.keys

    @property
    def values(self) -> Mapping[str, Any]:
        """Present values of the live keys, by key."""
        return by_name("live key", {key: value_of(self.scene, key) for key in self.live})

    def get(self, key: str) -> Any:
        """Return the present value of a key of the scene.

        If the key contains `*`, the value is that of all tables if they are equal, otherwise a tuple of their values.
        Mass and damping of a device are None if the scene does not set them.

        Raises:
            UnknownNameError: If the key does not exist; the message suggests a close match.
            InputError: If the scene does not set the setting of a device, so that the driver's default applies, or if
                the key goes through a name that refers to another table.
        """
        return value_of(self.scene, numbered(self.scene, key))

    def set(self, key: str | Mapping[str, Any], value: Any = None) -> None:
        """Change the values of live keys from the next tick on: `session.set("coupling.internal.stiffness", 55.0)`.

        Values that depend on the keys, such as an automatic `coupling.fade`, change too. Positions, contacts and other
        states do not change. The change is recorded with its tick.

        Args:
            key: Key, or several values by key, which change in the same tick.
            value: New value if `key` is a single key.

        Raises:
            InputError: If the key is not live, the new value requires another form or another computation, or a block
                was written directly instead of by `set`.
            UnknownNameError: If the key does not exist; the message suggests a close match.
            SceneError: If the scene does not allow the value; then nothing is changed.
        """
        if not isinstance(key, str | Mapping):
            raise InputError("key", key, "a key, or values by key")
        changes = dict(key) if isinstance(key, Mapping) else {key: value}
        if not changes:
            return
        values: dict[str, Any] = {}  # values by keys with numbers instead of names
        for each, new in changes.items():
            plain = numbered(self.scene, each)
            self._steering.require_live(plain, new)
            if plain in values:
                raise InputError(each, new, f"one value for {plain}", "the same key is given by name and by number")
            values[plain] = new
        self._require_open()
        self.servo.watch.require()
        scene = self.scene.replace(values)
        self._write(self._steering.update(scene, values))
        self.scene = scene

    def _write(self, update: Update) -> None:
        """Write new values to the servo; if they change the split of forces, record the new split."""
        self.servo.write(update, self._recorder)
        split = split_rules(self.servo.objects)
        if split != self._splits[-1][1]:
            self._recorder.change(self.tick, {SPLIT: split})
            self._splits.append((self.tick, split))


def warn_of_axes(parts: Parts) -> None:
    """Warn if matrix gains generate energy on a rotating object (`axes_notes`)."""
    scene = parts.scene
    if scene.coupling.axes == "object" and scene.coupling.reaction == "fingertip":
        return
    from graspfx.assembly.grasps import axes_notes
    from graspfx.grasp.impedance import ActiveCouplingWarning

    for text in axes_notes(parts):
        log.warn(text, ActiveCouplingWarning)


def require_room(ticks: int, layout: Layout, every: int, out: str | PathLike[str] | None) -> None:
    """Raise InputError if the rows of the ticks do not fit on the disk of `out`, or into memory if `out` is None."""
    if out is None:
        require_memory(ticks, 8 * layout.width / every)
    else:
        _require_disk(recording_path(out, "out"), ticks, layout.bytes_on_disk / every)


def require_memory(ticks: float, size: float) -> None:
    """Raise InputError if `ticks` rows of `size` bytes do not fit into memory."""
    _require_room(ticks, size, "this machine's memory", _memory())


def _require_disk(folder: Path, ticks: float, size: float) -> None:
    """Raise InputError if `ticks` rows of `size` bytes do not fit on the disk of a folder, which may not exist."""
    home = next((each for each in (folder, *folder.absolute().parents) if each.is_dir()), None)
    usage = None if home is None else shutil.disk_usage(home)
    if usage is not None and usage.total > 0:  # a pseudo file system such as /proc reports size zero
        _require_room(ticks, size, f"the disk of {folder}", usage.free)


def _require_room(ticks: float, size: float, where: str, limit: float) -> None:
    if ticks * size > limit:
        raise InputError(
            "duration",
            ticks,
            f"at most {limit / size:.3g} periods, because a row takes {size:g} bytes, and {where} has room for "
            f"{limit / 1e9:.3g} GB, not {ticks * size / 1e9:.3g} GB",
            "use a shorter duration or a longer period",
        )


@cache
def _memory() -> float:
    """Return the machine's memory [bytes], or the addressable memory if the machine's memory is unknown."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return float(sys.maxsize)
