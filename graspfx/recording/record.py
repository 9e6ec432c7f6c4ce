"""A recording: what happened in a run, tick by tick, under its names; its summary, and its way to a file and back."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Generic, Literal, NamedTuple, Protocol, Self, TypeVar, overload
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from graspfx.card import Card, Carded, counted, listed
from graspfx.errors import InputError, RecordingError, UnknownNameError, closest
from graspfx.loop.columns import OF_FINGERS, OF_OBJECTS, REST, Layout, RunFault
from graspfx.recording.files import NAME
from graspfx.recording.header import MARK, OF_THE_RUN, Header, KeyChange, Outcome
from graspfx.recording.rows import MemoryRows, RowStore, Window
from graspfx.recording.split import RowSplit, splits_of, work
from graspfx.spatial import Quaternion, Vector, rotate

if TYPE_CHECKING:
    import pandas
    import xarray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
T = TypeVar("T")
Typed = TypeVar("Typed", bound=NDArray[Any] | None)

Beside = Callable[[str, str], dict[str, Any]]  # of an object's name and a mode's

MEANT = {  # what an attribute is looked for by, and what it is called
    **dict.fromkeys(("force", "forces", "f", "contact_force", "contact_forces"), "finger_force"),
    **dict.fromkeys(("position", "positions", "p", "x", "finger_positions", "tip", "tips"), "finger_position"),
    **dict.fromkeys(("velocity", "velocities", "v", "finger_velocities"), "finger_velocity"),
    **dict.fromkeys(("contacts", "contact", "contact_points"), "contact_position"),
    **dict.fromkeys(("times", "t", "timestamps"), "time"),
    **dict.fromkeys(("data", "values", "array"), "rows"),
    **dict.fromkeys(("normals", "normal"), "contact_normal"),
    **dict.fromkeys(("depth", "penetration", "gaps", "distance"), "gap"),
    **dict.fromkeys(("internal", "squeeze", "internal_forces"), "internal_force"),
    **dict.fromkeys(("external", "external_forces"), "external_force"),
    **dict.fromkeys(("fault", "errors"), "faults"),
    **dict.fromkeys(("object", "body", "pose"), "objects[name]"),
    **dict.fromkeys(("orientation", "wrench", "angular_velocity"), "objects[name].{}"),
    **dict.fromkeys(("dt", "period", "T"), "header.period"),
    "dataframe": "to_frame()",
    "df": "to_frame()",
    "csv": "to_csv(path)",
    "show": "plot()",
    "draw": "plot()",
}


MOST = 3  # faults, or changes, on a card
CALLS = (
    ".summary(), .plot(), .picture(time), .to_xarray(), .to_frame(), .to_csv(path), .save(path)\n"
    ".time, .finger_position, .finger_force, .internal_force, .external_force, .touching, .objects[name], ..."
)


class Drawing(Protocol):
    """A figure of a recording: shown by a notebook, written by `save`.

    Attributes:
        notes: what could not be drawn, and why.
    """

    notes: tuple[str, ...]

    @property
    def figure(self) -> Any:
        """Figure of matplotlib."""

    def save(self, path: str | PathLike[str], form: str = "", dpi: int = 0) -> Path:
        """Write it; the path's ending chooses the format, or `form`: "png", "svg" or "pdf"."""


class Event(NamedTuple):
    """An event of a run: its tick, "fault", "change" of a key or "rest", and its text."""

    tick: int
    kind: str
    text: str

    def __str__(self) -> str:
        return f"tick {self.tick}: {self.kind}, {self.text}"


class Named(Mapping[str, T]):
    """Parts by their names, made whenever they are asked for; an unknown name is told with those that there are.

    Args:
        kind: of a part, for the error.
        keys: by name, what each is made from.
        make: makes it.
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
    """Make a mapping that cannot be changed, and that raises UnknownNameError, a KeyError, with the names it has."""
    return Named(kind, parts, lambda part: part)


class Stored(Generic[Typed]):
    """A column of the table as an attribute: its numbers of the kind that it has, or None in a scene without it."""

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
        if values is not None and values.dtype != np.float64:  # a copy, of a byte each mostly
            noun.__dict__[self._name] = values
        return values


class Recording(Carded):
    """A run, tick by tick: row k of each array holds what was read at the time k T and what was computed from that.

    Args:
        rows: (N, width), read-only from here on; or where they are, to be read as they are asked for.
        layout: their columns.
        header: what was known before the run.
        outcome: how it went.
        start: number of the first row, of a piece of a recording.
    """

    def __new__(cls, rows: object = None, *args: object, **kwargs: object) -> Self:
        """Refuse what only `load` reads."""
        if rows is None or isinstance(rows, str | PathLike):
            remedy = "gx.Recording.load(path) reads a file, gx.run(scene) makes a recording"
            raise InputError("Recording", rows, "the rows of a run", remedy)
        return super().__new__(cls)

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
        self._beside: Beside | None = None  # what a certificate says of a growing mode, where the scene is at hand

    if not TYPE_CHECKING:  # a visible __getattr__ would hide misspelt names from the type checker

        def __getattr__(self, name: str) -> Any:
            if name.startswith("_") or hasattr(type(self), name):
                return super().__getattribute__(name)  # raises what was raised
            if name in self.layout.columns:
                return self.typed(name)
            names = [each for each in dir(self) if not each.startswith("_")]
            meant = MEANT.get(name, "").format(name) or closest(name, names)
            remedy = f"did you mean {meant}?" if meant else "dir(recording) lists what there is"
            raise AttributeError(f"a recording has no {name!r}; {remedy}")

    def __reduce__(self) -> tuple[Callable[..., Recording], tuple[Any, ...]]:
        """Pass to another process, or copy, as the bytes of the file; the rows are in memory there."""
        return from_bytes, (type(self), to_bytes(self.save), self.start)

    def __len__(self) -> int:
        return len(self.store)

    def _card(self) -> Card:
        header = self.header
        name = f"{header.scene or 'a scene'}{f': {header.title}' if header.title else ''}"
        return Card(f"Recording of {name}", [*_card_rows(self)], CALLS)

    # Rows and columns -------------------------------------------------------------------------------------------------

    @property
    def rows(self) -> FloatArray:
        """All rows, (N, width), read-only; those on a disk are read each time, all of them."""
        return self.store.read(0, len(self), slice(0, self.layout.width))

    @property
    def is_stored(self) -> bool:
        """True where the rows are on a disk."""
        return not isinstance(self.store, MemoryRows)

    def part(self, first: int, stop: int) -> Self:
        """Give the rows from one up to another as a recording; its columns are read when they are asked for."""
        rows = Window(self.store, first, stop) if self.is_stored else self.rows[first:stop]
        return type(self)(rows, self.layout, self.header, self.outcome, start=self.start + first)

    def parts(self) -> Iterator[Self]:
        """Give the recording in parts of a few MB, in order."""
        step = self.store.step
        yield from (self.part(k, min(k + step, len(self))) for k in range(0, len(self), step))

    def read(self, column: str, first: int, stop: int) -> FloatArray:
        """Give a column of the layout in the rows from one up to another."""
        values = self.store.read(first, stop, self.layout.columns[column].where)
        return values.reshape(len(values), *self.layout.columns[column].shape)

    def array(self, column: str) -> FloatArray:
        """View a column of the layout, or give what follows from columns by its name in `Layout.derived`, (N, ...).

        Raises:
            UnknownNameError: the recording has no such column.
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
        """View a column; None if the scene has no such quantity.

        Raises:
            RecordingError: it has, and its `record` leaves the column out.
        """
        self.require(column)
        return self.array(column) if column in self.layout.columns else None

    def typed(self, column: str) -> NDArray[Any] | None:
        """Give a column as `optional` does, with numbers of its own kind: truth values and whole numbers as such."""
        values = self.optional(column)
        return None if values is None else self.layout.columns[column].typed(values)

    def whole_numbers(self, column: str) -> NDArray[np.int8] | None:
        """Give a column of whole numbers; None if the scene has no such quantity."""
        values = self.optional(column)
        return None if values is None else values.astype(np.int8)

    def require(self, *columns: str) -> None:
        """Require that columns, if the scene has them, are recorded.

        Raises:
            RecordingError: with the names of those that the scene's `record` leaves out.
        """
        missing = [column for column in columns if column in self.layout.omitted]
        if missing:
            raise RecordingError(
                f"{', '.join(missing)}: not in this recording, as the scene's record.columns leave it out; "
                "add the name there and run the scene again"
            )

    @cached_property
    def time(self) -> FloatArray:
        """Times of the rows, (N,) [s]: tick x T."""
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
        """Raw numbers that came over the wire, by the device's first finger, (N, m); of devices that show them."""
        columns = {name: f"raw/{name}" for name, *_ in self.layout.raw if f"raw/{name}" not in self.layout.omitted}
        return Named("device with raw numbers", columns, lambda column: np.asarray(self.typed(column)))

    # What follows from columns ----------------------------------------------------------------------------------------

    @cached_property
    def displayed_force(self) -> FloatArray:
        """On the operator, after every limit that the framework knows, before output delay, (N, n, d) [N].

        The negative of `finger_force`, since the object receives what was displayed.
        """
        values = self.optional("displayed_force")
        return -self.finger_force if values is None else values

    @cached_property
    def external_force(self) -> FloatArray:
        """P f of each finger's force f on the object, which moves the object, (N, n, d) [N].

        Raises:
            RecordingError: a recording of an earlier format, which does not say what P is made of.
        """
        return np.asarray(self._divided("external_force"))

    @cached_property
    def internal_force(self) -> FloatArray:
        """Rest f - P f of each finger's force on the object, which squeezes it, (N, n, d) [N]; as `external_force`."""
        return np.asarray(self._divided("internal_force"))

    @cached_property
    def external_moment(self) -> FloatArray | None:
        """Moment on the object that goes with `external_force`, (N, n, 3) [N m]; None for fingers that exert none."""
        return self._divided("external_moment")

    @cached_property
    def internal_moment(self) -> FloatArray | None:
        """Moment on the object that goes with `internal_force`, (N, n, 3) [N m]; None for fingers that exert none."""
        return self._divided("internal_moment")

    @cached_property
    def external_displacement(self) -> FloatArray:
        """P' e of e = p - c, the rigid motion of the contacts in it, (N, n, d) [m]; as `external_force`."""
        return np.asarray(self._divided("external_displacement"))

    @cached_property
    def internal_displacement(self) -> FloatArray:
        """Rest of e = p - c, by which the fingers squeeze, (N, n, d) [m]; as `external_force`."""
        return self.finger_position - self.contact_position - self.external_displacement

    def _divided(self, name: str) -> FloatArray | None:
        """Read a variable that stands beside the rows of a file, or compute it part by part; None without moments."""
        self.require(*self.layout.sources_of(name))
        splits = splits_of(self.header, self.outcome.changes)  # which says so where the recording does not tell
        column = next((each for each in self.layout.derived if each.name == name), None)
        values = self.store.beside(name, 0, len(self))
        if values is not None or column is None:
            return values
        return self._gathered(column.shape, lambda part: part._row_split(splits).derived([name])[name])

    def _gathered(self, shape: Sequence[int], compute: Callable[[Self], FloatArray]) -> FloatArray:
        """Put what is computed of the parts into one array, which is all that stays in memory."""
        values, first = np.empty((len(self), *shape)), 0
        for each in self.parts():
            values[first : first + len(each)] = compute(each)
            first += len(each)
        return values

    def _row_split(self, splits: Any) -> RowSplit:
        return RowSplit(self.store, self.layout, splits, self.start)

    @cached_property
    def external_energy(self) -> FloatArray:
        """Work done so far on each fingertip by the external part of `displayed_force`, (N, n) [J].

        With the internal one it is `device_energy`. The parts are those of the force on the object, whose negative is
        displayed; where it is not, as in recordings of old, of what is displayed.
        """
        return self._work(lambda part: part._external_display)

    @cached_property
    def internal_energy(self) -> FloatArray:
        """Work done so far on each fingertip by the internal part of `displayed_force`, (N, n) [J]."""
        return self._work(lambda part: part.displayed_force - part._external_display)

    def _work(self, force: Callable[[Self], FloatArray]) -> FloatArray:
        """Add up the work of a part of the displayed force."""
        if (every := self.header.every) > 1:
            text = f"added up from every tick, and this recording has one row in {every}: set record.every = 1"
            raise RecordingError(f"the work of each force is {text}, or read device_energy, which the ticks add up")
        tips = "true_position" if self.layout.simulated else "finger_position"
        self.require(tips, "device_energy")
        works = np.zeros((len(self), len(self.layout.fingers)))
        for each in self.parts():  # with the row before, of which the first step is
            stop, first = each.start - self.start + len(each), max(each.start - self.start - 1, 0)
            rows, start = self.part(first, stop), works[first : first + 1] if first < each.start - self.start else None
            tip, energy, number = rows.array(tips), rows.device_energy, rows.start
            works[first:stop] = work(force(rows), tip, energy, self.faults, number, start)
        return works

    @property
    def _external_display(self) -> FloatArray:
        if np.array_equal(self.displayed_force, -self.finger_force, equal_nan=True):
            return -self.external_force
        force = np.moveaxis(self.displayed_force, 0, -1)
        split = self._row_split(splits_of(self.header, self.outcome.changes))
        return np.moveaxis(split.external_forces(force)[0], -1, 0)

    # Objects, energies, events ----------------------------------------------------------------------------------------

    @cached_property
    def objects(self) -> Mapping[str, ObjectMotion]:
        """Each object's motion, by its name; another name raises UnknownNameError, a KeyError."""
        return by_name("object", {name: ObjectMotion(self, name) for name in self.layout.objects})

    @cached_property
    def energy(self) -> Mapping[str, Mapping[str, FloatArray]]:
        """The ledger of each object, by its name: quantities (N, 3) by mode (internal, translation, rotation) or (N,).

        Empty unless the scene asks for it (`coupling.passivity`). The names are those of `graspfx.loop.columns`.
        """
        ledgers: dict[str, dict[str, str]] = {}
        for column in self.layout.columns:
            thing, mark, name = column.removeprefix("objects/").rpartition("/energy/")
            if mark:
                ledgers.setdefault(thing, {})[name] = column
        books = {thing: Named("energy", names, self.array) for thing, names in ledgers.items()}
        return by_name("object with a ledger (coupling.passivity asks for one)", books)

    def described_pose(self, name: str) -> tuple[FloatArray, FloatArray | None]:
        """Give the pose of the frame that the scene describes an object's shape in: position (N, d) [m], orientation.

        Of a mesh it is its file's frame, which draws it at any tick; the recorded one is at the centre of mass, along
        the principal axes. Of any other shape both are the same.

        Raises:
            UnknownNameError: there is no such object.
        """
        if name not in self.layout.objects:
            raise UnknownNameError("object", str(name), self.layout.objects)
        return described_pose(self.objects[name], self.header.frames.get(name))

    @property
    def object_position(self) -> FloatArray:
        """The first object's, (N, d) [m]."""
        return self._first_object.position

    @property
    def object_velocity(self) -> FloatArray:
        """The first object's, (N, d) [m/s]."""
        return self._first_object.velocity

    @property
    def object_orientation(self) -> FloatArray | None:
        """The first object's: (N,), (N, 4) or None."""
        return self._first_object.orientation

    @property
    def wrench(self) -> FloatArray:
        """On the first object, (N, w) [N, N m]."""
        return self._first_object.wrench

    @property
    def _first_object(self) -> ObjectMotion:
        return self.objects[self.layout.objects[0]]

    @property
    def rest(self) -> int | None:
        """The tick from which forces decay as the run ends; None where they end at once."""
        return next((change.tick for change in self.outcome.changes if change.key == REST), None)

    @property
    def events(self) -> tuple[Event, ...]:
        """Faults, changes of keys, marks and the rest in the order of their ticks."""
        kinds = {REST: "rest", MARK: "mark"}
        events = [Event(fault.tick, "fault", fault.message) for fault in self.faults]
        events += [Event(change.tick, "change", f"{change.key} = {change.value}") for change in self.changes]
        for kind in kinds:
            own = (change for change in self.outcome.changes if change.key == kind)
            events += [Event(change.tick, kinds[kind], str(change.value)) for change in own]
        return tuple(sorted(events, key=lambda event: event.tick))

    @property
    def period(self) -> float:
        """T of the ticks [s]."""
        return self.header.period

    @property
    def row_period(self) -> float:
        """Time from one row to the next [s]: T, or `every` T where the scene's `record` has fewer rows than ticks."""
        return self.header.period * self.header.every

    @property
    def ticks(self) -> int:
        """How many ticks were run."""
        return self.outcome.ticks or len(self) * self.header.every

    @property
    def end(self) -> float:
        """Time at which the run ended [s]."""
        return self.ticks * self.header.period

    @property
    def faults(self) -> tuple[RunFault, ...]:
        """Faults by tick."""
        return self.outcome.faults

    @property
    def changes(self) -> tuple[KeyChange, ...]:
        """Values of the scene that were replaced in mid-run: tick, key and value; the scene's table is the start's."""
        return tuple(change for change in self.outcome.changes if change.key not in OF_THE_RUN)

    @property
    def wall_time(self) -> float | None:
        """That the run took [s]; None if it broke off."""
        return self.outcome.wall_time

    @property
    def scene_text(self) -> str:
        """The scene file, verbatim."""
        return self.header.scene_text

    # Summary, figures, files ------------------------------------------------------------------------------------------

    def summary(self) -> dict[str, Any]:
        """Summarise the run in SI units; the keys are those of `graspfx.recording.summary.summarise`."""
        from graspfx.recording.growth import losses
        from graspfx.recording.summary import summarise

        needs = {"finger_position", "contact_position", "touching", "true_position"}
        needs |= {f"objects/{name}/position" for name in self.layout.objects}
        is_seen = needs.isdisjoint(self.layout.omitted)
        return summarise(self, losses(self) if is_seen else [])

    def plot(
        self,
        *others: Recording,
        titles: Sequence[str] | None = None,
        width: Literal["screen", "page", "column"] = "screen",
    ) -> Drawing:
        """Draw the run over time, beside others with the same axes if there are any; a notebook shows it as it is.

        Positions; displacements and forces as their internal part, the squeeze, and their external one, the push; how
        the object turns. docs/how-to/figures.md reads it with you.

        Args:
            others: recordings to stand beside it.
            titles: one per recording; what is set in each if not given.
            width: for a screen, or 7.2 ("page") or 3.5 ("column") inches of a journal.

        Returns:
            `.save(path)` writes it, `.figure` is matplotlib's own.

        Raises:
            InputError: a recording without a tick, another number of titles, or no such width.
        """
        from graspfx.show.drawing import plot

        return plot(self, *others, titles=titles, width=width)

    def picture(
        self,
        time: float | None = None,
        *,
        view: tuple[float, float] | None = None,
        forces: Literal["two", "total"] = "two",
        width: Literal["screen", "page", "column"] = "screen",
    ) -> Drawing:
        """Draw one instant of the run, to scale, with its forces as arrows; a notebook shows it as it is.

        Args:
            time: [s]; by default where most fingers touch and their forces are largest, or the end.
            view: azimuth and elevation of the viewer [degrees], in space; by default where the fingers are seen best.
            forces: of each finger its internal and its external part, or their total.
            width: for a screen, or 7.2 ("page") or 3.5 ("column") inches of a journal.

        Returns:
            `.save(path)` writes it, `.figure` is matplotlib's own, `.notes` says what could not be drawn.

        Raises:
            InputError: a recording without a tick, a time outside it, or no such width.
        """
        from graspfx.show.drawing import picture

        return picture(self, time, view=view, forces=forces, width=width)

    def save(
        self,
        path: str | PathLike[str],
        *,
        overwrite: bool = False,
        compression: Literal["none", "lzf", "gzip"] = "none",
    ) -> None:
        """Write the recording as HDF5; the file appears when it is whole.

        Args:
            path: of the file.
            overwrite: whether a file that is there already is replaced.
            compression: of the rows: "lzf" is quick, "gzip" makes them smaller.

        Raises:
            InputError: no such compression.
            RecordingError: the file is there already, or cannot be written.
        """
        from graspfx.recording.recorder import save

        if compression not in ("none", "lzf", "gzip"):
            raise InputError("compression", compression, '"none", "lzf" or "gzip"')
        save(
            path, self.store, self.layout, self.header, self.outcome, overwrite=overwrite, compression=compression
        )  # fmt: skip

    def to_xarray(self) -> xarray.Dataset:
        """Convert to an xarray Dataset: dimensions time, finger, axis, ..., each variable with `units` and `long_name`.

        Columns have the names, dimensions and attributes that xarray reads from the file. Those of objects stand
        together, as `object_position` with a dimension `object`, and what follows from columns is there too, as
        `displayed_force`. Attributes are those of the file: the scene verbatim, overrides, versions, how the run went.

        Raises:
            MissingPackageError: no xarray, which `pip install 'graspfx[data]'` brings.
        """
        from graspfx.show.export import recording_dataset

        return recording_dataset(self)

    def to_frame(self) -> pandas.DataFrame:
        """Convert to a pandas DataFrame: a row per tick, a column per component, as `finger_force.thumb.x`.

        The index is the time [s]; units are SI, by quantity in `frame.attrs["units"]`.

        Raises:
            MissingPackageError: no pandas, which `pip install 'graspfx[data]'` brings.
        """
        from graspfx.show.export import recording_frame

        return recording_frame(self)

    def to_csv(self, path: str | PathLike[str], *, overwrite: bool = False) -> None:
        """Write the columns of `to_frame` with the time first as comma-separated text, for which no package is needed.

        A first line of names, then numbers in SI units that read back the same to the last bit; true is 1, false 0.

        Args:
            path: of the file; it appears when it is whole.
            overwrite: whether a file that is there already is replaced.

        Raises:
            RecordingError: the file is there already, or cannot be written.
        """
        from graspfx.show.export import write_csv

        write_csv(self, path, overwrite=overwrite)

    def to_html(self, path: str | PathLike[str], *, overwrite: bool = False) -> Path:
        """Write a page that plays the run in a browser: objects, fingers, forces as arrows, and a chart.

        The page stands alone and opens without a network. Frames are 50 to 60 in a second, numbers as recorded, each
        rounded to 24 bits; the chart has the least and the greatest of every tick.

        Args:
            path: of the file, which ends in .html; it appears when it is whole.
            overwrite: whether a file that is there already is replaced.

        Raises:
            InputError: a recording without a tick, or no path of a page.
            RecordingError: the file is there already, or cannot be written.
        """
        from graspfx.live.page.document import write_page

        return write_page(self, path, overwrite=overwrite)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Recording:
        """Load a recording from a file; also of a run that goes on or was killed, as far as it was written.

        Args:
            path: of the file, or of the folder in which it is recording.h5. Where there is only the part that a run
                writes until it ends, recording.h5.part, it is read: its outcome is not `complete`.

        Raises:
            RecordingError: there is no recording in the file, or its bytes were changed since it was written.
        """
        from graspfx.recording.file import read

        return cls(*read(path))


MEASURES = (  # of an object's motion, on its card
    ("position", "m"),
    ("velocity", "m/s"),
    ("orientation", "rad or x y z w"),
    ("angular_velocity", "rad/s"),
    ("wrench", "N, N m"),
    ("law", "0 Coulomb's, 1 associated"),
    ("residual", "N"),
)


class ObjectMotion(Carded):
    """One object over time."""

    def __init__(self, recording: Recording, name: str) -> None:
        self._recording, self._at = recording, f"objects/{name}/"

    def typed(self, column: str) -> NDArray[Any] | None:
        """Give one of the object's columns, None if the scene has no such quantity."""
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
    """Compute the pose of the frame that a scene describes an object's shape in: position (N, d) [m], orientation.

    Args:
        motion: of the object.
        frame: the pose of a mesh file's frame in the recorded one; None for any other shape.
    """
    if frame is None or motion.orientation is None:
        return motion.position, motion.orientation
    q: Any = Quaternion(*motion.orientation.T)  # of columns of ticks: the formulas are elementwise
    offset, turn = rotate(q, Vector(*frame["position"])), q @ Quaternion(*frame["orientation"])
    columns = np.broadcast_arrays(offset.x, offset.y, offset.z)
    return motion.position + np.stack(columns, axis=1), np.stack([turn.x, turn.y, turn.z, turn.w], axis=1)


def _card_rows(recording: Recording) -> Iterator[tuple[str, str]]:
    header, layout, outcome, ticks = recording.header, recording.layout, recording.outcome, len(recording)
    engine = f", {outcome.engine}" if outcome.engine else ""
    broken = "" if outcome.complete else "; NOT complete: the run broke off, goes on or was killed"
    seconds = f"{recording.end:g} s"
    fewer = f", a row every {header.every}" if header.every > 1 else ""
    yield (
        "time",
        f"{seconds}, {counted(recording.ticks, 'tick')} of {1e3 * recording.period:g} ms{fewer}{engine}{broken}",
    )
    yield "left out", listed(layout.omitted)
    yield "set", listed(f"{key} = {value!r}" for key, value in header.overrides.items())
    devices = "simulated" if layout.simulated else "real"
    space = counted(layout.dimensions, "dimension")
    yield "fingers", f"{len(layout.fingers)} in {space}, {devices}: {listed(layout.fingers)}"
    if ticks and not {"touching", "finger_force"} & set(layout.omitted):
        touching = 100.0 * recording.touching.mean(axis=0)
        yield "touching", listed(f"{each:.0f} %" for each in touching) + " of the time"
        peak = np.linalg.norm(recording.finger_force, axis=2).max(axis=0)
        yield "peak force", listed(f"{each:.3g}" for each in peak) + " N"
    yield "objects", listed(layout.objects)
    yield "energies", "booked by mode: .energy[name]" if layout.observed else ""
    yield "changes", _some(recording.changes)
    yield "faults", _some(recording.faults) or "none"
    yield "made", " by ".join(each for each in (header.created, _maker(header.versions)) if each)


def _maker(versions: Any) -> str:
    return f"GraspFX {versions['graspfx']}" if "graspfx" in versions else ""


def _some(things: Any) -> str:
    lines = [str(each) for each in things[:MOST]]
    return "\n".join([*lines, *([f"and {len(things) - MOST} more"] if len(things) > MOST else [])])


# Between processes: as the bytes of a file, with the checks that it has ---------------------------------------------


def to_bytes(save: Callable[[Path], object]) -> bytes:
    """Give the bytes of the file that `save` writes."""
    with TemporaryDirectory(prefix="graspfx-") as folder:
        place = Path(folder) / NAME
        save(place)
        return place.read_bytes()


def from_bytes(kind: type[Recording], content: bytes, start: int = 0) -> Recording:
    """Make a recording in memory of the bytes of a file; `start` is the number of its first row in a whole run.

    Raises:
        RecordingError: the bytes were changed since they were written.
    """
    from graspfx.recording.file import read

    with TemporaryDirectory(prefix="graspfx-") as folder:
        place = Path(folder) / NAME
        place.write_bytes(content)
        rows, layout, header, outcome = read(place)
        return kind(rows.read(0, len(rows), slice(0, layout.width)), layout, header, outcome, start=start)


# Compared with another one, column by column and to the bit ---------------------------------------------------------


class Difference(NamedTuple):
    """A column in which two recordings differ.

    Attributes:
        column: its name.
        largest: difference of two numbers, of either sign; infinite where one of them alone is no number.
        tick: the first in which they differ.
        unit: of the column.
    """

    column: str
    largest: float
    tick: int
    unit: str

    def __str__(self) -> str:
        return f"{self.column}: up to {self.largest:.3g} {self.unit}, from tick {self.tick} on"


def compared(one: Recording, other: Recording) -> list[str]:
    """List the columns that two recordings have, but for those that say when ticks were."""
    columns = [name for name in one.layout.columns if name in other.layout.columns]
    return [name for name in columns if one.layout.columns[name].filled != "loop"]


def differences(one: Recording, other: Recording) -> list[Difference]:
    """Compare the columns that two recordings of as many rows have, but for those that say when ticks were.

    Numbers differ where their bits do: zeros by their signs too, and no number from any other.
    """
    each = (_difference(one, other, name) for name in compared(one, other))
    return [difference for difference in each if difference is not None]


def _difference(one: Recording, other: Recording, name: str) -> Difference | None:
    first, largest = -1, 0.0
    for start in range(0, len(one), one.store.step):
        stop = min(start + one.store.step, len(one))
        a, b = (np.ascontiguousarray(each.read(name, start, stop)) for each in (one, other))
        differ = a.view(np.int64) != b.view(np.int64)
        if differ.any():
            rows = differ.reshape(len(a), -1).any(axis=1)
            if first < 0:
                first = (start + int(np.flatnonzero(rows)[0])) * one.header.every
            with np.errstate(invalid="ignore"):
                gaps = np.abs(a[differ] - b[differ])
            largest = max(largest, float(np.where(np.isnan(gaps), np.inf, gaps).max()))
    return None if first < 0 else Difference(name, largest, first, one.layout.columns[name].unit)
