"""Columns of recorded rows: the table of all columns, a scene's selection, and the protocol of recorders."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from math import prod
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import UnknownNameError

FloatArray = NDArray[np.float64]

WIDTHS = {1: 1, 2: 3, 3: 6}  # w
WRENCH = {1: ("fx",), 2: ("fx", "fy", "tz"), 3: ("fx", "fy", "fz", "tx", "ty", "tz")}
ENTRIES = {  # names of entries, for dimensions that are the same in all recordings
    "axis": ("x", "y", "z"),
    "turn": ("x", "y", "z"),
    "quaternion": ("x", "y", "z", "w"),
    "mode": ("internal", "translation", "rotation"),
    "call": ("read", "write"),
    "share": ("soft", "trust", "squeeze", "outer"),
}
REST = "rest"  # key of a change: from that tick on forces decay; its value is "end" of the run, or "stop"


class RunFault(NamedTuple):
    """A fault at a tick; from that tick on every force is zero."""

    tick: int
    message: str

    def __str__(self) -> str:
        return f"tick {self.tick}: {self.message}"


class RowTaker(Protocol):
    """Protocol of a recorder of rows: `Recorder` in the servo's process, `RingRecorder` if another process records."""

    @property
    def row(self) -> FloatArray:
        """The last row that a tick wrote."""
        ...

    def space(self) -> tuple[FloatArray, int, int]:
        """Return rows (r, width), the next tick's index in these rows, and the number of ticks for which there is room.

        The tick at index r writes row r. If one of every m ticks is recorded, the tick writes row r / m if m divides r,
        and otherwise no row.
        """
        ...

    def take(self, count: int) -> None:
        """Accept the rows that `count` further ticks have written."""

    def drain(self) -> None:
        """Pass on full buffers; this method is called between ticks."""

    def fault(self, k: int, message: str) -> None:
        """Record a fault of tick k."""

    def change(self, k: int, values: Mapping[str, Any]) -> None:
        """Record that keys of the scene have these values from tick k on."""


# The table ------------------------------------------------------------------------------------------------------------


class Declared(NamedTuple):
    """A quantity that a row may contain.

    Attributes:
        name: Name of the column; an object's columns are prefixed with `objects/NAME/`.
        dimensions: Names of its dimensions, space-separated; none for a single number.
        unit: Unit of its numbers.
        meaning: Description of the quantity.
        filled: Origin of the values: "sample" (the coupling's sample of a grasp), "servo" (the tick around the sample),
            "observer" (the ledger of energies), "safety" (the safety chain), "loop" (the exchange with devices in
            real time) or "reader" (computed from a row by the reader of a recording).
        when: Property of `Layout` that tells whether the column exists. An empty name means that the column always
            exists; "always" means that it also exists in recordings of every format.
        kind: Type of its numbers in a file; rows contain only float64.
    """

    name: str
    dimensions: str
    unit: str
    meaning: str
    filled: str
    when: str = ""
    kind: str = "float64"


# fmt: off
DISPLAYED = "force on the operator, after every limit, before output delay"
SCALE = "factors on the law's force: soft start, trust in readings, internal force, a finger's whole force"
C, OBSERVED = Declared, ("observer", "observed")
OF_FINGERS = (
    C("finger_position", "finger axis", "m", "position that the device reports", "sample", "always"),
    C("finger_velocity", "finger axis", "m/s", "velocity that the device reports or estimates", "sample", "always"),
    C("contact_position", "finger axis", "m", "c of e = p - c: on the surface, or one radius outside it for a ball",
      "sample", "always"),
    C("finger_force", "finger axis", "N", "force of the finger on the object", "sample", "always"),
    C("finger_moment", "finger turn", "N m", "moment of the finger on the object", "sample", "moments"),
    C("contact_normal", "finger turn", "1", "normal into the object, if one of its fingers is soft or has friction",
      "sample", "normals"),
    C("torsion_displacement", "finger", "m", "theta of a soft finger's torsion, times its patch length",
      "sample", "twists"),
    C("torsion_axis", "finger turn", "1", "axis along which a soft finger's torsion acts on the object",
      "sample", "torsion_axes"),
    C("displayed_force", "finger axis", "N", DISPLAYED, "servo", "limits"),
    C("law_force", "finger axis", "N", "force of the finger on the object by eq. (4), before limits", "sample",
      "limits"),
    C("touching", "finger", "1", "whether the finger exerts a force", "sample", "always", "bool"),
    C("saturated", "finger", "1", "whether the finger's force is at its limit", "sample", "limits", "bool"),
    C("status", "finger", "1", "0 free, 1 stick, 2 slide", "sample", "slips", "int8"),
    C("gap", "finger", "m", "distance to the surface, negative inside", "sample", "gaps"),
    C("true_position", "finger axis", "m", "true position of the simulated fingertip", "servo", "simulated"),
    C("device_energy", "finger", "J", "work that the displayed force has done on the fingertip so far", "servo",
      "always"),
    C("wall", "", "s", "wall-clock time since the first tick", "loop", "timed"),
    C("late", "", "s", "delay past the tick's deadline", "loop", "timed"),
    C("io", "call", "s", "time to ask and read all devices, and time to write them", "loop", "timed"),
    C("skipped", "", "1", "periods skipped before the tick", "loop", "timed", "int64"),
    C("fresh", "finger", "1", "whether the reading contained a new sample", "loop", "timed", "bool"),
    C("switches", "device", "1", "switch states as bits; the first switch of a device is bit 0", "loop",
      "has_switches", "int64"),
    C("raw/", "", "1", "raw numbers from the device", "loop", "timed"),  # one column for each device in `raw`
    C("largest_force", "finger", "N", "largest force that the device reports for its position", "loop", "varying"),
)
OF_OBJECTS = (
    C("position", "axis", "m", "position of the object's centre", "sample", "always"),
    C("centre", "axis", "m", "predicted centre of the object, which the sample used", "sample", "predicted"),
    C("velocity", "axis", "m/s", "velocity of the object's centre", "sample", "always"),
    C("orientation", "", "rad", "angle", "sample", "in_plane"),
    C("angular_velocity", "", "rad/s", "angular velocity about the normal of the plane", "sample", "in_plane"),
    C("orientation", "quaternion", "1", "quaternion x, y, z, w", "sample", "in_space"),
    C("angular_velocity", "turn", "rad/s", "angular velocity in world axes", "sample", "in_space"),
    C("law", "", "1", "friction law that the elastic force satisfies: 0 Coulomb's, 1 the associated law", "sample",
      "slips", "int8"),
    C("residual", "", "N", "residual of that law", "sample", "slips"),
    C("wrench", "component", "N, N m", "wrench of the fingers on the object, about its centre, in world axes",
      "sample", "always"),
    C("scale", "share", "1", SCALE, "safety", "guarded"),
    C("tank", "", "J", "energy available for increases of stiffness", "safety", "guarded"),
    # energies are totals since the start, except `stored` and `kinetic`, which are momentary
    C("energy/work", "mode", "J", "work of the held forces on the fingers' motion relative to the object", *OBSERVED),
    C("energy/stored", "mode", "J", "energy stored in the springs of eq. (4)", *OBSERVED),
    C("energy/damped", "mode", "J", "energy dissipated by the damping of eq. (4)", *OBSERVED),
    C("energy/slipped", "mode", "J", "energy dissipated by sliding, by release and by limits", *OBSERVED),
    C("energy/reshaped", "mode", "J",
      "energy dissipated by changes of the split or of weights, or by a skew-symmetric stiffness", *OBSERVED),
    C("energy/leaked", "mode", "J", "energy generated by holding the springs' forces over samples", *OBSERVED),
    C("energy/balance", "mode", "J", "energy dissipated, including friction; energy was generated if it is below zero",
      *OBSERVED),
    C("energy/braked", "mode", "J", "energy dissipated by the added damping", "observer", "is_controlled"),
    C("energy/damping", "mode", "N s/m", "damping added in this sample", "observer", "is_controlled"),
    C("energy/fingers", "", "J", "work of the fingers on coupling and object, from the measured positions", *OBSERVED),
    C("energy/wrench", "", "J", "work of the fingers' wrench on the object", *OBSERVED),
    C("energy/kinetic", "", "J", "kinetic energy of the object", *OBSERVED),
    C("energy/gravity", "", "J", "work of gravity", *OBSERVED),
    C("energy/contact", "", "J", "work of obstacles and other objects; the remainder, for a body that is not native",
      *OBSERVED),
    C("energy/viscous", "", "J", "energy dissipated by the object's viscosity", *OBSERVED),
    C("energy/defect", "", "J", "energy generated by the object's integrator", *OBSERVED),
    C("energy/gap", "", "J", "difference between the fingers' work and all other terms", *OBSERVED),
)
DERIVED = (  # computed from a row; a file also stores the internal and external forces and moments
    C("displayed_force", "finger axis", "N", DISPLAYED, "reader", "unlimited"),
    C("internal_force", "finger axis", "N", "part of the finger's force on the object that squeezes the object",
      "reader"),
    C("external_force", "finger axis", "N", "part of the finger's force on the object that moves the object", "reader"),
    C("internal_moment", "finger turn", "N m", "part of the finger's moment on the object that squeezes the object",
      "reader", "moments"),
    C("external_moment", "finger turn", "N m", "part of the finger's moment on the object that moves the object",
      "reader", "moments"),
    C("internal_displacement", "finger axis", "m", "displacement by which the fingers squeeze, e - P'e", "reader"),
    C("external_displacement", "finger axis", "m", "rigid-body part of the displacement e, P'e", "reader"),
    C("grip_margin", "", "N", "smallest mu f_n - |f_t| of touching fingers with friction; NaN if there are none",
      "reader",
      "has_margin"),
)
FORCES = ("internal_force", "external_force", "internal_moment", "external_moment")
# fmt: on


@dataclass(frozen=True)
class Column:
    """A recorded quantity: position in a row, shape per tick, dimension names, unit and meaning."""

    name: str
    where: slice
    shape: tuple[int, ...]
    dimensions: tuple[str, ...]
    unit: str
    meaning: str
    kind: str = "float64"
    filled: str = ""

    @property
    def stored(self) -> np.dtype[Any]:
        """Type of its numbers in a file; a Boolean takes one byte."""
        return np.dtype("int8" if self.kind == "bool" else self.kind)

    def typed(self, values: FloatArray) -> NDArray[Any]:
        """Convert numbers of a row to the column's type."""
        return np.not_equal(values, 0.0) if self.kind == "bool" else values.astype(self.kind, copy=False)


@dataclass(frozen=True)
class Layout:
    """Columns of a recording, all float64, with one row per recorded tick.

    Attributes:
        dimensions: Number of dimensions d.
        fingers: Names of the fingers.
        objects: Names of the objects.
        finger_objects: Index of the object that each finger touches.
        gaps: Whether fingers have a gap to the surface (not with attached contacts).
        moments: Whether fingers exert moments.
        slips: Whether some finger has a coefficient of friction.
        simulated: Whether true fingertip positions are known.
        observed: Whether the energy of each grasp is recorded.
        controlled: Whether damping is added to dissipate generated energy.
        limits: Whether a device or the scene's safety settings limit the force.
        guarded: Whether forces pass a safety chain.
        normals: Whether contact normals are known, for fingers that are soft or have friction.
        torsion_axes: Whether torsion acts along an axis other than the normal.
        timed: Whether the run follows the wall clock.
        varying: Whether devices of a run in real time report position-dependent largest forces, which are then
            recorded.
        switched: Whether some device of a run in real time has switches.
        devices: Names of the devices of a run in real time.
        raw: Raw numbers of some devices: a name, a count and "int64" or "float64" for each.
        predicted: Indices of the objects whose split depends on the centre predicted by the implicit integrator.
        absent: Names of columns that a recording of an earlier format does not have.
        omitted: Names of columns that the scene's `record` omits.
    """

    dimensions: int
    fingers: tuple[str, ...]
    objects: tuple[str, ...]
    finger_objects: tuple[int, ...]
    gaps: bool = True
    moments: bool = False
    slips: bool = False
    simulated: bool = True
    observed: bool = False
    controlled: bool = False
    limits: bool = False
    guarded: bool = False
    normals: bool = False
    torsion_axes: bool = False
    timed: bool = False
    varying: bool = False
    switched: bool = False
    devices: tuple[str, ...] = ()
    raw: tuple[tuple[str, int, str], ...] = ()
    predicted: tuple[int, ...] = ()
    absent: tuple[str, ...] = ()
    omitted: tuple[str, ...] = ()

    def __getstate__(self) -> dict[str, Any]:
        """Pickle only the constructor's arguments; the receiving process recomputes the columns."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @cached_property
    def columns(self) -> MappingProxyType[str, Column]:
        """Columns by name: `finger_force`, ..., and per object `objects/NAME/position`, ..."""
        columns: dict[str, Column] = {}
        start = 0
        for column in self._all_columns():
            if column.name not in self.absent and column.name not in self.omitted:
                stop = start + prod(column.shape)
                columns[column.name] = replace(column, where=slice(start, stop))
                start = stop
        return MappingProxyType(columns)

    @cached_property
    def width(self) -> int:
        """Number of entries in a row."""
        return sum(prod(column.shape) for column in self.columns.values())

    @property
    def bytes_on_disk(self) -> int:
        """Bytes per row at the end of a run, in the partial file and in the file with internal and external forces."""
        return 8 * (2 * self.width + sum(prod(column.shape) for column in self.forces) + 1)

    @cached_property
    def derived(self) -> tuple[Column, ...]:
        """Variables computed from a row: displayed force (if not a column), `forces`, displacements and grip margin."""
        columns = (self._column(each) for each in DERIVED if self._has(each))
        return tuple(each for each in columns if set(self.omitted).isdisjoint(self.sources_of(each.name)))

    @property
    def forces(self) -> tuple[Column, ...]:
        """Variables computed from a row that a file also stores: internal and external forces and moments."""
        return tuple(each for each in self.derived if each.name in FORCES)

    def sources_of(self, name: str) -> tuple[str, ...]:
        """List the scene's columns from which a variable is computed."""
        if name == "displayed_force":
            return ("finger_force",)
        if name == "grip_margin":
            return ("finger_force", "contact_normal", "touching")
        displacement = name.endswith("displacement")
        own = ("finger_position", "torsion_displacement") if displacement else ("finger_force", "finger_moment")
        names = {*own, "contact_position", "gap", "contact_normal", "torsion_axis"}
        names |= {f"objects/{thing}/{place}" for thing in self.objects for place in ("position", "centre")}
        return tuple(each.name for each in self._all_columns() if each.name in names)

    def is_essential(self, name: str) -> bool:
        """Return whether every recording must have a column."""
        table, own = (OF_OBJECTS, name.split("/", 2)[-1]) if name.startswith("objects/") else (OF_FINGERS, name)
        return any(each.when == "always" for each in table if each.name == own)

    @property
    def scales(self) -> Mapping[str, tuple[str, ...]]:
        """Names of the entries along each dimension of a layout, except time."""
        used = {name for column in self.columns.values() for name in column.dimensions}
        return {name: entries for name, entries in self._entries.items() if name in used}

    @cached_property
    def _entries(self) -> Mapping[str, tuple[str, ...]]:
        return {
            "finger": self.fingers,
            "device": self.devices,
            **{f"{name}_raw": tuple(map(str, range(count))) for name, count, _ in self.raw},
            **ENTRIES,
            "axis": ENTRIES["axis"][: self.dimensions],
            "component": WRENCH[self.dimensions],
        }

    always = True

    @property
    def has_margin(self) -> bool:
        return self.slips and self.normals and "contact_normal" not in self.absent

    @property
    def unlimited(self) -> bool:
        return not self.limits

    @property
    def twists(self) -> bool:
        return self.normals and self.moments

    @property
    def in_plane(self) -> bool:
        return self.dimensions == 2

    @property
    def in_space(self) -> bool:
        return self.dimensions == 3

    @property
    def has_switches(self) -> bool:
        return self.timed and self.switched

    @property
    def is_controlled(self) -> bool:
        return self.observed and self.controlled

    def _has(self, each: Declared) -> bool:
        return not each.when or bool(getattr(self, each.when))

    def _all_columns(self) -> Iterator[Column]:
        """List the scene's columns, recorded or not, in the order of a row; their positions are not set yet."""
        for each in OF_FINGERS:
            if each.name == "raw/":
                for name, _, kind in self.raw if self.timed else ():
                    yield self._column(each._replace(name=f"raw/{name}", dimensions=f"{name}_raw", kind=kind))
            elif self._has(each):
                yield self._column(each)
        for k, name in enumerate(self.objects):
            for each in OF_OBJECTS:
                if k in self.predicted if each.when == "predicted" else self._has(each):
                    yield self._column(each, f"objects/{name}/")

    def _column(self, each: Declared, before: str = "") -> Column:
        names = tuple(each.dimensions.split())
        shape = tuple(len(self._entries[name]) for name in names)
        return Column(before + each.name, slice(0, 0), shape, names, each.unit, each.meaning, each.kind, each.filled)


@dataclass(frozen=True)
class Selection:
    """Selection of the recorded columns and ticks from complete rows.

    Args:
        whole: Layout of all columns.
        layout: Layout of the recorded columns.
        every: Number of ticks from one row to the next.
    """

    whole: Layout
    layout: Layout
    every: int = 1

    @cached_property
    def numbers(self) -> NDArray[np.intp]:
        """Indices of the recorded numbers in a complete row."""
        places = np.arange(self.whole.width)
        return np.concatenate([places[:0], *(places[self.whole.columns[name].where] for name in self.layout.columns)])

    @property
    def is_whole(self) -> bool:
        """True if every number of every tick is recorded."""
        return self.every == 1 and self.layout == self.whole

    def cut(self, rows: FloatArray, tick: int = 0) -> FloatArray:
        """Return the recorded part of complete rows (r, width), whose first tick is `tick`."""
        if self.is_whole:
            return rows
        return np.asarray(rows[-tick % self.every :: self.every][:, self.numbers])


def chosen_layout(whole: Layout, names: Sequence[str]) -> Layout:
    """Lay out only the columns with these names, or all columns if no names are given.

    A name denotes a column, a group of columns (`objects/bar`, `objects/bar/energy`), or a computed variable
    (`internal_force`). For a computed variable, the columns from which it is computed are recorded.

    Raises:
        UnknownNameError: If a name is unknown; the message lists close matches.
    """
    if not names:
        return whole
    columns_: set[str] = set()
    for name in names:
        columns = columns_of(whole, name)
        if not columns:
            groups = {column.rpartition("/")[0] for column in whole.columns if "/" in column}
            raise UnknownNameError("column", name, {*whole.columns, *(each.name for each in whole.derived), *groups})
        columns_.update(columns)
    return replace(whole, omitted=tuple(name for name in whole.columns if name not in columns_))


def columns_of(whole: Layout, name: str) -> list[str]:
    """List the columns that a name denotes; the list is empty for an unknown name."""
    group = name.rstrip("/") + "/"
    inside = [column for column in whole.columns if column == name or column.startswith(group)]
    if not inside and name in [column.name for column in whole.derived]:
        inside = list(whole.sources_of(name))
    return inside
