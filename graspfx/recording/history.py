"""Data of a run tick by tick: rows by the names of their columns, objects and events."""

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
    """Event of a run: tick, kind ("fault", "change", "mark" or "rest") and text."""

    tick: int
    kind: str
    text: str

    def __str__(self) -> str:
        return f"tick {self.tick}: {self.kind}, {self.text}"


class Named(Mapping[str, T]):
    """Parts by name, created on access; the error for an unknown name lists the known names.

    Args:
        kind: Kind of the parts, for the error message.
        keys: Argument of `make`, by name.
        make: Function that creates a part.
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
    """Return a read-only mapping that raises UnknownNameError, a KeyError, with the known names."""
    return Named(kind, parts, lambda part: part)


class Stored(Generic[Typed]):
    """A column as an attribute, in the type of its kind; None if the scene has no such column."""

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
    """Data of a run tick by tick: row k of each array belongs to the time k T (k m T with one row every m ticks).

    Args:
        rows: Rows (N, width), read-only afterwards; or a store from which they are read on demand.
        layout: Columns of the rows.
        header: Facts known before the run.
        outcome: Facts known after the run.
        start: Number of the first row, if the recording is a part of another recording.
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
        """All rows (N, width), read-only. Rows on a disk are read on every access."""
        return self.store.read(0, len(self), slice(0, self.layout.width))

    @property
    def is_stored(self) -> bool:
        """Whether the rows are on a disk."""
        return not isinstance(self.store, MemoryRows)

    def part(self, first: int, stop: int) -> Self:
        """Return a range of rows as a recording; its columns are read on demand.

        Raises:
            InputError: If an end is not a whole number; rows beyond the end of the recording are left out.
        """
        first, stop = self._range(first, stop)
        rows = Window(self.store, first, stop) if self.is_stored else self.rows[first:stop]
        return type(self)(rows, self.layout, self.header, self.outcome, start=self.start + first)

    def parts(self) -> Iterator[Self]:
        """Yield the recording in parts of a few MB, in order."""
        step = self.store.step
        yield from (self.part(k, min(k + step, len(self))) for k in range(0, len(self), step))

    def read(self, column: str, first: int, stop: int) -> FloatArray:
        """Return a column in a range of rows.

        Raises:
            InputError: If an end is not a whole number; rows beyond the end of the recording are left out.
            UnknownNameError: If the recording has no such column.
        """
        entry, ends = self.layout.columns.get(str(column)), self._range(first, stop)
        if entry is None:
            raise UnknownNameError("column", column, self.layout.columns)
        values = self.store.read(*ends, entry.where)
        return values.reshape(len(values), *entry.shape)

    def _range(self, first: int, stop: int) -> tuple[int, int]:
        """Check a range of rows, and end it within the recording."""
        low, high = (min(count(name, end), len(self)) for name, end in (("first", first), ("stop", stop)))
        return low, max(low, high)

    def array(self, column: str) -> FloatArray:
        """Return a column of the layout, or a derived variable by its name in `Layout.derived`, (N, ...).

        Raises:
            UnknownNameError: the recording has no such column.
            RecordingError: If the scene's `record` omits the column.
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
        """Return a column; None if the scene has no such quantity.

        Raises:
            RecordingError: If the scene has the quantity, but its `record` omits the column.
        """
        self.require(column)
        return self.array(column) if column in self.layout.columns else None

    def typed(self, column: str) -> NDArray[Any] | None:
        """Return a column like `optional`, converted to booleans or integers if the column is of such a kind."""
        values = self.optional(column)
        return None if values is None else self.layout.columns[column].typed(values)

    def require(self, *columns: str) -> None:
        """Require that columns are recorded, if the scene has them.

        Raises:
            RecordingError: If the scene's `record` omits some of the columns; the message names these columns.
        """
        missing = [column for column in columns if column in self.layout.omitted]
        if missing:
            raise RecordingError(
                f"{', '.join(missing)}: not in this recording, because record.columns lists other columns only; "
                "add what is missing there and run the scene again"
            )

    @cached_property
    def time(self) -> FloatArray:
        """Times of the rows (N,) [s], tick x T."""
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
        """Raw numbers of devices that report them, (N, m), by the first finger of the device."""
        columns = {name: f"raw/{name}" for name, *_ in self.layout.raw if f"raw/{name}" not in self.layout.omitted}
        return Named("device with raw numbers", columns, lambda column: np.asarray(self.typed(column)))

    # Derived quantities -----------------------------------------------------------------------------------------------

    @cached_property
    def displayed_force(self) -> FloatArray:
        """Force on the operator after all limits and before output delay, (N, n, d) [N].

        The negative of `finger_force`, because the object receives the displayed force.
        """
        values = self.optional("displayed_force")
        return -self.finger_force if values is None else values

    @cached_property
    def external_force(self) -> FloatArray:
        """External part P f of the fingers' forces f, which moves the object, (N, n, d) [N].

        Raises:
            RecordingError: If a recording of an earlier format does not define P.
        """
        return np.asarray(self._divided("external_force"))

    @cached_property
    def internal_force(self) -> FloatArray:
        """Internal part f - P f of the forces, which squeezes the object, (N, n, d) [N]; see `external_force`."""
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
        """External part P' e of e = p - c, the rigid motion of the contacts, (N, n, d) [m]; see `external_force`."""
        return np.asarray(self._divided("external_displacement"))

    @cached_property
    def internal_displacement(self) -> FloatArray:
        """Internal part of e = p - c, by which the fingers squeeze, (N, n, d) [m]; see `external_force`."""
        return self.finger_position - self.contact_position - self.external_displacement

    def _divided(self, name: str) -> FloatArray | None:
        """Read a derived variable from the file, or compute it in parts; None for a moment without soft fingers."""
        self.require(*self.layout.sources_of(name))
        splits = splits_of(self.header, self.outcome.changes)  # raises an error without a defined split
        column = next((each for each in self.layout.derived if each.name == name), None)
        values = self.store.beside(name, 0, len(self))
        if values is not None or column is None:
            return values
        return self._gathered(column.shape, lambda part: part._row_split(splits).derived([name])[name])

    def _gathered(self, shape: Sequence[int], compute: Callable[[Self], FloatArray]) -> FloatArray:
        """Compute a variable in parts, and join the results in one array."""
        values, first = np.empty((len(self), *shape)), 0
        for each in self.parts():
            values[first : first + len(each)] = compute(each)
            first += len(each)
        return values

    def _row_split(self, splits: Any) -> RowSplit:
        return RowSplit(self.store, self.layout, splits, self.start)

    @property
    def external_energy(self) -> FloatArray:
        """Work done so far on each fingertip by the external part of `displayed_force` (N, n) [J].

        The sum of external and internal work is `device_energy`. The force on the object, whose negative is displayed,
        is split into the two parts. If another force is displayed, as in recordings of early formats, that
        force is split instead.
        """
        return self._works[0]

    @property
    def internal_energy(self) -> FloatArray:
        """Work done so far on each fingertip by the internal part of `displayed_force`, (N, n) [J]."""
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
        """Friction margin of the grip: the smallest mu f_n - |f_t| of touching fingers with friction (N,) [N].

        NaN if no such finger touches, if contacts stick or slip freely, and in recordings of earlier formats, which
        have no normals.
        """
        return self.grip_margin_of(range(len(self.layout.fingers)))

    def grip_margin_of(self, fingers: Sequence[int]) -> FloatArray:
        """Friction margin of the grip of the fingers with these indices (N,) [N]; see `grip_margin`.

        Raises:
            InputError: If a finger does not exist.
        """
        n, expected = len(self.layout.fingers), "indices of fingers, counted from 0"
        indices = finite("fingers", fingers, expected)
        if indices.ndim != 1 or not np.isin(indices, range(n)).all():
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
        """Energy ledgers of the objects by name: quantities (N, 3) by mode (internal, translation, rotation), or (N,).

        Empty unless the scene sets `coupling.passivity`. The names are those of `graspfx.loop.columns`.
        """
        ledgers: dict[str, dict[str, str]] = {}
        for column in self.layout.columns:
            thing, mark, name = column.removeprefix("objects/").rpartition("/energy/")
            if mark:
                ledgers.setdefault(thing, {})[name] = column
        books = {thing: Named("energy", names, self.array) for thing, names in ledgers.items()}
        return by_name("object with a ledger (coupling.passivity asks for one)", books)

    def described_pose(self, name: str) -> tuple[FloatArray, FloatArray | None]:
        """Return the pose of the frame in which the scene describes an object: position (N, d) [m], orientation.

        A mesh is described in the frame of its file, in which it is drawn; the recorded frame is at the centre of mass,
        along the principal axes. For other shapes both frames are equal.

        Raises:
            UnknownNameError: If there is no such object.
        """
        if name not in self.layout.objects:
            raise UnknownNameError("object", str(name), self.layout.objects)
        return described_pose(self.objects[name], self.header.frames.get(name))

    @property
    def object_position(self) -> FloatArray:
        """Position of the first object (N, d) [m]."""
        return self._first_object.position

    @property
    def object_velocity(self) -> FloatArray:
        """Velocity of the first object (N, d) [m/s]."""
        return self._first_object.velocity

    @property
    def object_orientation(self) -> FloatArray | None:
        """Orientation of the first object: angles (N,) [rad] or quaternions x, y, z, w (N, 4); None on a line."""
        return self._first_object.orientation

    @property
    def wrench(self) -> FloatArray:
        """Wrench of the fingers on the first object (N, w) [N, N m]."""
        return self._first_object.wrench

    @property
    def _first_object(self) -> ObjectMotion:
        return self.objects[self.layout.objects[0]]

    @property
    def rest(self) -> int | None:
        """Tick from which forces decay at the end of the run; None if forces end at once."""
        return next((change.tick for change in self.outcome.changes if change.key == REST), None)

    @property
    def events(self) -> tuple[Event, ...]:
        """Faults, changes of keys, marks, and the start of the decay of forces ("rest"), ordered by tick."""
        kinds = {REST: "rest", MARK: "mark"}
        events = [Event(fault.tick, "fault", fault.message) for fault in self.faults]
        events += [Event(change.tick, "change", f"{change.key} = {change.value}") for change in self.changes]
        for kind in kinds:
            own = (change for change in self.outcome.changes if change.key == kind)
            events += [Event(change.tick, kinds[kind], str(change.value)) for change in own]
        return tuple(sorted(events, key=lambda event: event.tick))

    @property
    def period(self) -> float:
        """Period T of the ticks [s]."""
        return self.header.period

    @property
    def row_period(self) -> float:
        """Time between rows [s]: T, or `every` T if the scene records fewer rows than ticks."""
        return self.header.period * self.header.every

    @property
    def ticks(self) -> int:
        """Number of ticks that were run."""
        return self.outcome.ticks or len(self) * self.header.every

    @property
    def end(self) -> float:
        """Time at which the run ended [s]."""
        return self.ticks * self.header.period

    @property
    def faults(self) -> tuple[RunFault, ...]:
        """Faults of the run, each with its tick."""
        return self.outcome.faults

    @property
    def changes(self) -> tuple[KeyChange, ...]:
        """Changes of the scene's values during the run: tick, key and value. The header has the initial values."""
        return tuple(change for change in self.outcome.changes if change.key not in OF_THE_RUN)

    @property
    def wall_time(self) -> float | None:
        """Wall time of the run [s]; None if it was interrupted."""
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
        """Return a column of the object; None if the scene has no such quantity."""
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
    """Compute the pose of the frame in which a scene describes an object's shape: position (N, d) [m], orientation.

    Args:
        motion: Motion of the object.
        frame: Pose of a mesh file's frame in the recorded frame; None for other shapes.
    """
    if frame is None or motion.orientation is None:
        return motion.position, motion.orientation
    q: Any = Quaternion(*motion.orientation.T)  # components are columns of ticks, because the formulas are elementwise
    offset, turn = rotate(q, Vector(*frame["position"])), q @ Quaternion(*frame["orientation"])
    columns = np.broadcast_arrays(offset.x, offset.y, offset.z)
    return motion.position + np.stack(columns, axis=1), np.stack([turn.x, turn.y, turn.z, turn.w], axis=1)
