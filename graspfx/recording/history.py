"""Data of a run: rows by tick, columns by name, objects and events."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, Generic, NamedTuple, Self, TypeVar, overload
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from graspfx.card import Card, Carded, counted
from graspfx.errors import InputError, RecordingError, UnknownNameError
from graspfx.loop.columns import OF_FINGERS, OF_OBJECTS, REST, Layout, RunFault
from graspfx.numeric import count, finite
from graspfx.recording.header import MARK, OF_THE_RUN, Header, KeyChange, Outcome
from graspfx.recording.recorded_split import RowSplit, coefficients, splits_of, work
from graspfx.recording.rows import MemoryRows, RowStore, Window
from graspfx.spatial import Quaternion, Vector, rotate

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
T = TypeVar("T")
Typed = TypeVar("Typed", bound=NDArray[Any] | None)

Beside = Callable[[str, str], dict[str, Any]]  # arguments: name of an object and of a mode


class Event(NamedTuple):
    """Event of a run: tick, kind ("fault", "change", "mark" or "rest") and description."""

    tick: int
    kind: str
    text: str

    def __str__(self) -> str:
        return f"tick {self.tick}: {self.kind}, {self.text}"


class Named(Mapping[str, T]):
    """Mapping whose values are created on access; the error for an unknown name lists the known names.

    Args:
        kind: Kind of the values, for the error message.
        keys: For each name, the argument with which `make` is called.
        make: Function that creates a value.
    """

    def __init__(self, kind: str, keys: Mapping[str, Any], make: Callable[[Any], T]) -> None:
        self._kind, self._keys, self._make = kind, keys, make

    def __getitem__(self, name: str) -> T:
        if name not in self._keys:
            raise UnknownNameError(self._kind, str(name), self._keys)
        return self._make(self._keys[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._keys)

    def __len__(self) -> int:
        return len(self._keys)

    def __repr__(self) -> str:
        return repr(dict(self))


def by_name(kind: str, parts: Mapping[str, T]) -> Mapping[str, T]:
    """Return a read-only mapping that raises UnknownNameError, which is a KeyError and lists the known names."""
    return Named(kind, parts, lambda part: part)


class Stored(Generic[Typed]):
    """Descriptor of a column, converted to its type (float, integer, boolean); None if the scene has no such column."""

    def __set_name__(self, owner: type, name: str) -> None:
        own = [each for each in (*OF_FINGERS, *OF_OBJECTS) if each.name == name]
        shapes = " or ".join(f"({', '.join(['N', *each.dimensions.split()])}) [{each.unit}]" for each in own)
        meaning = " or ".join(each.meaning for each in own)
        absent = "" if own[0].when in ("", "always") else "; None in a scene without it"
        self._name, self.__doc__ = name, f"{shapes}: {meaning}{absent}."

    @overload
    def __get__(self, noun: None, owner: type) -> Self: ...

    @overload
    def __get__(self, noun: object, owner: type) -> Typed: ...

    def __get__(self, noun: Any, owner: type) -> Any:
        if noun is None:
            return self
        values = noun.typed(self._name)
        if values is not None and values.dtype != np.float64:  # a copy, mostly with one byte per entry
            noun.__dict__[self._name] = values
        return values


class History:
    """Data of a run. Row k of each array belongs to tick k m, at time k m T, if one of m ticks is recorded.

    Args:
        rows: Rows (N, width), which become read-only, or a store from which rows are read on demand.
        layout: Layout of the columns.
        header: Metadata that are known before the run.
        outcome: Metadata that are known after the run.
        start: Index of the first row in the complete recording, if this is a part.
    """

    def __init__(
        self,
        rows: FloatArray | RowStore,
        layout: Layout,
        header: Header,
        outcome: Outcome | None = None,
        *,
        start: int = 0,
    ) -> None:
        if isinstance(rows, np.ndarray):
            if rows.ndim != 2 or rows.shape[1] != layout.width:
                raise RecordingError(f"rows of shape {rows.shape} do not fit a layout of {layout.width} columns")
            rows = MemoryRows(rows)
        self.store, self.start = rows, start
        self._arrays: WeakValueDictionary[str, FloatArray] = WeakValueDictionary()
        self.layout, self.header, self.outcome = layout, header, outcome or Outcome()
        self._beside: Beside | None = None  # certificate of a growing mode, if the scene is available

    def __len__(self) -> int:
        return len(self.store)

    # Rows and columns -------------------------------------------------------------------------------------------------

    @property
    def rows(self) -> FloatArray:
        """All rows, (N, width), read-only. Rows that are stored on disk are read on every access."""
        return self.store.read(0, len(self), slice(0, self.layout.width))

    @property
    def is_stored(self) -> bool:
        """Whether the rows are stored on disk."""
        return not isinstance(self.store, MemoryRows)

    def part(self, first: int, stop: int) -> Self:
        """Return the rows `first` to `stop - 1` as a recording; stored columns are read on demand.

        Rows beyond the end of the recording are omitted.

        Raises:
            InputError: If `first` or `stop` is not a non-negative integer.
        """
        first, stop = self._range(first, stop)
        rows = Window(self.store, first, stop) if self.is_stored else self.rows[first:stop]
        return type(self)(rows, self.layout, self.header, self.outcome, start=self.start + first)

    def parts(self) -> Iterator[Self]:
        """Yield the recording in consecutive parts of a few MB."""
        step = self.store.step
        yield from (self.part(k, min(k + step, len(self))) for k in range(0, len(self), step))

    def read(self, column: str, first: int, stop: int) -> FloatArray:
        """Return a column of the rows `first` to `stop - 1`; rows beyond the end of the recording are omitted.

        Raises:
            InputError: If `first` or `stop` is not a non-negative integer.
            UnknownNameError: If the recording has no such column.
        """
        entry, ends = self.layout.columns.get(str(column)), self._range(first, stop)
        if entry is None:
            raise UnknownNameError("column", column, self.layout.columns)
        values = self.store.read(*ends, entry.where)
        return values.reshape(len(values), *entry.shape)

    def _range(self, first: int, stop: int) -> tuple[int, int]:
        """Check the range of rows `first` to `stop - 1`, and limit it to the rows of the recording."""
        low, high = (min(count(name, end), len(self)) for name, end in (("first", first), ("stop", stop)))
        return low, max(low, high)

    def array(self, column: str) -> FloatArray:
        """Return a column by its name in the layout, or a derived variable by its name in `Layout.derived`, (N, ...).

        Raises:
            UnknownNameError: The recording has no such column.
            RecordingError: The scene's `record` omits the column.
        """
        entry = self.layout.columns.get(str(column))
        if entry is None:
            derived = [each.name for each in self.layout.derived]
            if column in derived:
                return np.asarray(getattr(self, column))
            self.require(str(column))
            raise UnknownNameError("column", str(column), [*self.layout.columns, *derived])
        values = self._arrays.get(entry.name)
        if values is None:
            values = self._arrays[entry.name] = self.read(entry.name, 0, len(self))
        return values

    def optional(self, column: str) -> FloatArray | None:
        """Return a column; None if the scene has no such column.

        Raises:
            RecordingError: The scene has the column, but its `record` omits it.
        """
        self.require(column)
        return self.array(column) if column in self.layout.columns else None

    def typed(self, column: str) -> NDArray[Any] | None:
        """Return a column as `optional` does, with booleans or integers in place of floats if that is its type."""
        values = self.optional(column)
        return None if values is None else self.layout.columns[column].typed(values)

    def require(self, *columns: str) -> None:
        """Require that those of the columns that the scene has are recorded.

        Raises:
            RecordingError: The scene's `record` omits some of the columns; the message names them.
        """
        missing = [column for column in columns if column in self.layout.omitted]
        if missing:
            raise RecordingError(
                f"{', '.join(missing)}: not in this recording, because record.columns lists other columns only; "
                "add the missing columns to record.columns, and run the scene again"
            )

    @cached_property
    def time(self) -> FloatArray:
        """Times of the rows, (N,) [s]."""
        return self.header.every * np.arange(self.start, self.start + len(self), dtype=np.float64) * self.header.period

    finger_position = Stored[FloatArray]()
    finger_velocity = Stored[FloatArray]()
    contact_position = Stored[FloatArray]()
    finger_force = Stored[FloatArray]()
    law_force = Stored[FloatArray | None]()
    saturated = Stored[BoolArray | None]()
    finger_moment = Stored[FloatArray | None]()
    touching = Stored[BoolArray]()
    status = Stored[NDArray[np.int8] | None]()
    gap = Stored[FloatArray | None]()
    true_position = Stored[FloatArray | None]()
    device_energy = Stored[FloatArray]()
    wall = Stored[FloatArray | None]()
    late = Stored[FloatArray | None]()
    io = Stored[FloatArray | None]()
    skipped = Stored[IntArray | None]()
    fresh = Stored[BoolArray | None]()
    largest_force = Stored[FloatArray | None]()
    switches = Stored[IntArray | None]()

    @property
    def raw(self) -> Mapping[str, IntArray | FloatArray]:
        """Raw readings of the devices that report them, (N, m), by the name of the device's first finger."""
        columns = {name: f"raw/{name}" for name, *_ in self.layout.raw if f"raw/{name}" not in self.layout.omitted}
        return Named("device with raw numbers", columns, lambda column: np.asarray(self.typed(column)))

    # Derived quantities -----------------------------------------------------------------------------------------------

    @cached_property
    def displayed_force(self) -> FloatArray:
        """Force displayed to the operator, after all limits and before the output delay, (N, n, d) [N].

        This force is the negative of `finger_force`, unless it is recorded as a separate column.
        """
        values = self.optional("displayed_force")
        return -self.finger_force if values is None else values

    @cached_property
    def external_force(self) -> FloatArray:
        """External part P f of the fingers' forces f, (N, n, d) [N], which moves the object.

        P is the projection of eq. (3) that the recording's split rule defines.

        Raises:
            RecordingError: The recording has no split rule, because an earlier version of GraspFX made it.
        """
        return np.asarray(self._divided("external_force"))

    @cached_property
    def internal_force(self) -> FloatArray:
        """Internal part f - P f of the fingers' forces f, (N, n, d) [N], which squeezes the object."""
        return np.asarray(self._divided("internal_force"))

    @cached_property
    def external_moment(self) -> FloatArray | None:
        """Moment on the object that belongs to `external_force`, (N, n, 3) [N m]; None without soft fingers."""
        return self._divided("external_moment")

    @cached_property
    def internal_moment(self) -> FloatArray | None:
        """Moment on the object that belongs to `internal_force`, (N, n, 3) [N m]; None without soft fingers."""
        return self._divided("internal_moment")

    @cached_property
    def external_displacement(self) -> FloatArray:
        """External part of the displacements of the fingertips from their contacts, (N, n, d) [m].

        This part, P' e of the displacements e, is a rigid motion of the contacts; P is defined in `external_force`.
        """
        return np.asarray(self._divided("external_displacement"))

    @cached_property
    def internal_displacement(self) -> FloatArray:
        """Internal part of the displacements of the fingertips from their contacts, (N, n, d) [m]."""
        return self.finger_position - self.contact_position - self.external_displacement

    def _divided(self, name: str) -> FloatArray | None:
        """Read a derived variable from the file, or compute it from rows; None for a moment without soft fingers."""
        self.require(*self.layout.sources_of(name))
        splits = splits_of(self.header, self.outcome.changes)  # raises an error without a defined split
        column = next((each for each in self.layout.derived if each.name == name), None)
        values = self.store.beside(name, 0, len(self))
        if values is not None or column is None:
            return values
        return self._gathered(column.shape, lambda part: part._row_split(splits).derived([name])[name])

    def _gathered(self, shape: Sequence[int], compute: Callable[[Self], FloatArray]) -> FloatArray:
        """Compute a variable for each part of the recording, and return the joined values, (N, *shape)."""
        values, first = np.empty((len(self), *shape)), 0
        for each in self.parts():
            values[first : first + len(each)] = compute(each)
            first += len(each)
        return values

    def _row_split(self, splits: Any) -> RowSplit:
        return RowSplit(self.store, self.layout, splits, self.start)

    @property
    def external_energy(self) -> FloatArray:
        """Work that the external part of `displayed_force` has done on each fingertip so far, (N, n) [J].

        The sum of this work and `internal_energy` is `device_energy`. The displayed force is the negative of the force
        on the object, and is split like it. In recordings of early formats the displayed force can differ; the
        displayed force itself is then split.
        """
        return self._works[0]

    @property
    def internal_energy(self) -> FloatArray:
        """Work that the internal part of `displayed_force` has done on each fingertip so far, (N, n) [J]."""
        return self._works[1]

    @cached_property
    def _works(self) -> tuple[FloatArray, FloatArray]:
        """Work of the external and of the internal part of the displayed force, (N, n) each [J]."""
        if (every := self.header.every) > 1:
            text = f"the sum over all ticks, but this recording has one row per {every} ticks: set record.every = 1"
            raise RecordingError(f"the work of each force is {text}, or use device_energy")
        tips = "true_position" if self.layout.simulated else "finger_position"
        self.require(tips, "device_energy")
        n = len(self.layout.fingers)
        works: tuple[FloatArray, FloatArray] = np.zeros((len(self), n)), np.zeros((len(self), n))
        for each in self.parts():  # includes the previous row, from which the first step starts
            begin = each.start - self.start
            first, stop = max(begin - 1, 0), begin + len(each)
            rows = self.part(first, stop)
            tip, energy, external = rows.array(tips), rows.device_energy, rows._external_display
            for whole, force in zip(works, (external, rows.displayed_force - external), strict=True):
                start = whole[first:begin] if begin else None
                whole[first:stop] = work(force, tip, energy, self.faults, rows.start, start)
        return works

    @property
    def grip_margin(self) -> FloatArray:
        """Smallest friction margin mu f_n - |f_t| of the touching fingers, (N,) [N].

        f_n and f_t are the normal and tangential force of a finger, and mu is its coefficient of friction. Fingers
        without a coefficient (contacts that stick, or slip freely) are ignored. The margin is NaN if no other finger
        touches, and in recordings of early formats, which do not contain the normals.
        """
        return self.grip_margin_of(range(len(self.layout.fingers)))

    def grip_margin_of(self, fingers: Sequence[int]) -> FloatArray:
        """Return the friction margin of the fingers with these indices, (N,) [N]; see `grip_margin`.

        Raises:
            InputError: If a finger does not exist.
        """
        n, expected = len(self.layout.fingers), "indices of fingers, counted from 0"
        indices = finite("fingers", fingers, expected)
        if indices.ndim != 1 or np.asarray(fingers).dtype == bool or not np.isin(indices, range(n)).all():
            raise InputError("fingers", fingers, f"{expected} to {n - 1}")
        self.require("contact_normal", "finger_force", "touching")
        if "contact_normal" not in self.layout.columns:
            return np.full(len(self), np.nan)
        found, own = coefficients(self.header, self.outcome.changes, n), [int(i) for i in indices]
        return self._gathered(
            (), lambda part: RowSplit(part.store, part.layout, [(0, {})], part.start, found).grip(own)[0]
        )

    @property
    def _external_display(self) -> FloatArray:
        if "displayed_force" not in self.layout.columns or np.array_equal(
            self.displayed_force, -self.finger_force, equal_nan=True
        ):
            return -self.external_force
        force = np.moveaxis(self.displayed_force, 0, -1)
        split = self._row_split(splits_of(self.header, self.outcome.changes))
        return np.moveaxis(split.external_forces(force)[0], -1, 0)

    # Objects, energies, events ----------------------------------------------------------------------------------------

    @cached_property
    def objects(self) -> Mapping[str, ObjectMotion]:
        """Motions of the objects by name; an unknown name raises UnknownNameError, which is a KeyError."""
        return by_name("object", {name: ObjectMotion(self, name) for name in self.layout.objects})

    @cached_property
    def energy(self) -> Mapping[str, Mapping[str, FloatArray]]:
        """Energy ledgers of the objects by name, each with quantities (N, 3) or (N,) by name.

        The three columns are the internal, translational and rotational mode. `graspfx.loop.columns` defines the names
        of the quantities. Empty unless the scene sets `coupling.passivity`.
        """
        ledgers: dict[str, dict[str, str]] = {}
        for column in self.layout.columns:
            thing, mark, name = column.removeprefix("objects/").rpartition("/energy/")
            if mark:
                ledgers.setdefault(thing, {})[name] = column
        books = {thing: Named("energy", names, self.array) for thing, names in ledgers.items()}
        return by_name("object with a ledger (set coupling.passivity to record one)", books)

    def described_pose(self, name: str) -> tuple[FloatArray, FloatArray | None]:
        """Return position (N, d) [m] and orientation of the frame in which the scene describes an object's shape.

        A mesh is described in the frame of its file. The recorded frame of its object is at the centre of mass along
        the principal axes. For other shapes both frames are the same.

        Raises:
            UnknownNameError: The recording has no such object.
            UnknownNameError: If there is no such object.
        """
        if name not in self.layout.objects:
            raise UnknownNameError("object", str(name), self.layout.objects)
        return described_pose(self.objects[name], self.header.frames.get(name))

    @property
    def object_position(self) -> FloatArray:
        """Position of the first object, (N, d) [m]."""
        return self._first_object.position

    @property
    def object_velocity(self) -> FloatArray:
        """Velocity of the first object, (N, d) [m/s]."""
        return self._first_object.velocity

    @property
    def object_orientation(self) -> FloatArray | None:
        """Orientation of the first object: angles (N,) [rad] or quaternions (x, y, z, w) (N, 4); None on a line."""
        return self._first_object.orientation

    @property
    def wrench(self) -> FloatArray:
        """Wrench of the fingers on the first object, (N, w) [N, N m]."""
        return self._first_object.wrench

    @property
    def _first_object(self) -> ObjectMotion:
        return self.objects[self.layout.objects[0]]

    @property
    def rest(self) -> int | None:
        """Tick from which the forces decay at the end of the run; None if they were set to zero in one tick."""
        return next((change.tick for change in self.outcome.changes if change.key == REST), None)

    @property
    def events(self) -> tuple[Event, ...]:
        """Faults, changes of keys, marks, and the start of the decay of forces (kind "rest"), ordered by tick."""
        kinds = {REST: "rest", MARK: "mark"}
        events = [Event(fault.tick, "fault", fault.message) for fault in self.faults]
        events += [Event(change.tick, "change", f"{change.key} = {change.value}") for change in self.changes]
        for kind in kinds:
            own = (change for change in self.outcome.changes if change.key == kind)
            events += [Event(change.tick, kinds[kind], str(change.value)) for change in own]
        return tuple(sorted(events, key=lambda event: event.tick))

    @property
    def period(self) -> float:
        """Sampling period T [s]."""
        return self.header.period

    @property
    def row_period(self) -> float:
        """Time from one row to the next [s]: m T if one of m ticks is recorded."""
        return self.header.period * self.header.every

    @property
    def ticks(self) -> int:
        """Number of ticks that have run."""
        return self.outcome.ticks or len(self) * self.header.every

    @property
    def end(self) -> float:
        """Time at which the run ended [s]."""
        return self.ticks * self.header.period

    @property
    def faults(self) -> tuple[RunFault, ...]:
        """Faults of the run, each with tick and message."""
        return self.outcome.faults

    @property
    def changes(self) -> tuple[KeyChange, ...]:
        """Changes of keys of the scene during the run: tick, key and new value. The header has the initial values."""
        return tuple(change for change in self.outcome.changes if change.key not in OF_THE_RUN)

    @property
    def wall_time(self) -> float | None:
        """Wall time of the run [s]; None if the run was interrupted."""
        return self.outcome.wall_time

    @property
    def scene_text(self) -> str:
        """Text of the scene file."""
        return self.header.scene_text


MEASURES = (  # columns on the card of an object's motion
    ("position", "m"),
    ("velocity", "m/s"),
    ("orientation", "rad or x y z w"),
    ("angular_velocity", "rad/s"),
    ("wrench", "N, N m"),
    ("law", "0 Coulomb's, 1 associated"),
    ("residual", "N"),
)


class ObjectMotion(Carded):
    """Motion of one object over time."""

    def __init__(self, recording: History, name: str) -> None:
        self._recording, self._at = recording, f"objects/{name}/"

    def typed(self, column: str) -> NDArray[Any] | None:
        """Return a column of the object, in its type; None if the scene has no such column."""
        return self._recording.typed(self._at + column)

    position = Stored[FloatArray]()
    velocity = Stored[FloatArray]()
    orientation = Stored[FloatArray | None]()
    angular_velocity = Stored[FloatArray | None]()
    wrench = Stored[FloatArray]()
    law = Stored[NDArray[np.int8] | None]()
    residual = Stored[FloatArray | None]()
    scale = Stored[FloatArray | None]()
    tank = Stored[FloatArray | None]()

    def _card(self) -> Card:
        rows = []
        for name, unit in MEASURES:
            values = getattr(self, name)
            if values is not None:
                rows.append((name, f"{values.shape} [{unit}]{_ends(values)}"))
        return Card(f"Motion of an object over {counted(len(self.position), 'tick')}", rows)


def _ends(values: np.ndarray[Any, Any]) -> str:
    if not len(values):
        return ""
    first, last = (np.array2string(np.round(end, 6) + 0.0, separator=", ") for end in (values[0], values[-1]))
    return f", {first} at first, {last} at last"


def described_pose(
    motion: ObjectMotion, frame: Mapping[str, Sequence[float]] | None
) -> tuple[FloatArray, FloatArray | None]:
    """Return position (N, d) [m] and orientation of the frame in which a scene describes an object's shape.

    Args:
        motion: Motion of the object.
        frame: Pose of a mesh file's frame relative to the recorded frame; None for other shapes.
    """
    if frame is None or motion.orientation is None:
        return motion.position, motion.orientation
    q: Any = Quaternion(*motion.orientation.T)  # components are columns of ticks, because the formulas are elementwise
    offset, turn = rotate(q, Vector(*frame["position"])), q @ Quaternion(*frame["orientation"])
    columns = np.broadcast_arrays(offset.x, offset.y, offset.z)
    return motion.position + np.stack(columns, axis=1), np.stack([turn.x, turn.y, turn.z, turn.w], axis=1)
