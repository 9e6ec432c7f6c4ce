"""Columns of recorded rows: table of all columns, columns of a scene, and protocol of recorders."""

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
    """Fault of a run: message and tick; from this tick on, all forces are zero."""

    tick: int
    message: str

    def __str__(self) -> str:
        return f"tick {self.tick}: {self.message}"


class RowTaker(Protocol):
    """Protocol of a recorder of rows.

    `Recorder` records in the process of the servo; `RingRecorder` passes the rows to another process, which records.
    """

    @property
    def row(self) -> FloatArray:
        """Row that was written last."""
        ...

    def space(self) -> tuple[FloatArray, int, int]:
        """Return rows (r, width), the index of the next tick, and the number of ticks for which there is space.

        The tick with the index i writes row i. If only one of m ticks is recorded, the tick writes row i / m if m
        divides i, and otherwise no row.
        """
        ...

    def take(self, count: int) -> None:
        """Accept the rows that the next `count` ticks have written."""

    def drain(self) -> None:
        """Write full buffers; this method is called between ticks."""

    def fault(self, k: int, message: str) -> None:
        """Record a fault of tick k."""

    def change(self, k: int, values: Mapping[str, Any]) -> None:
        """Record that keys of the scene have these values from tick k on."""


# The table ------------------------------------------------------------------------------------------------------------


class Declared(NamedTuple):
    """Quantity that a row may contain.

    Attributes:
        name: Name of the column; in a recording, the names of an object's columns begin with `objects/NAME/`.
        dimensions: Names of the dimensions, separated by spaces; empty for a single number.
        unit: Unit of the numbers.
        meaning: Description of the quantity.
        filled: Part that computes the values: "sample" (coupling of a grasp), "servo" (tick), "observer" (ledger of
            energies), "safety" (safety chain), "loop" (exchange with devices in real time) or "reader" (reader of a
            recording, from the other columns).
        when: Property of `Layout` that says whether the column exists. If it is empty, the column always exists; if it
            is "always", the column also exists in recordings of every earlier format.
        kind: Type of the numbers in a file; rows contain only float64.
    """

    name: str
    dimensions: str
    unit: str
    meaning: str
    filled: str
    when: str = ""
    kind: str = "float64"


# fmt: off
DISPLAYED = "force on the operator, after all limits and before the output delay"
SCALE = "factors of the law's force: soft start, trust in readings, internal force, smallest factor of a finger"
C, OBSERVED = Declared, ("observer", "observed")
OF_FINGERS = (
    C("finger_position", "finger axis", "m", "position that the device reports", "sample", "always"),
    C("finger_velocity", "finger axis", "m/s", "velocity that the device reports or estimates", "sample", "always"),
    C("contact_position", "finger axis", "m",
      "contact point c in e = p - c, on the surface or, for a ball-shaped fingertip, one radius outside the surface",
      "sample", "always"),
    C("finger_force", "finger axis", "N", "force of the finger on the object", "sample", "always"),
    C("finger_moment", "finger turn", "N m", "moment of the finger on the object", "sample", "moments"),
    C("contact_normal", "finger turn", "1", "normal into the object, if a finger on the object is soft or has friction",
      "sample", "normals"),
    C("torsion_displacement", "finger", "m", "torsion angle of a soft finger times the length of its contact patch",
      "sample", "twists"),
    C("torsion_axis", "finger turn", "1", "axis along which the torsional moment of a soft finger acts on the object",
      "sample", "torsion_axes"),
    C("displayed_force", "finger axis", "N", DISPLAYED, "servo", "limits"),
    C("law_force", "finger axis", "N", "force of the finger on the object from eq. (4), before limits", "sample",
      "limits"),
    C("touching", "finger", "1", "whether the finger exerts a force", "sample", "always", "bool"),
    C("saturated", "finger", "1", "whether the finger's force is at its limit", "sample", "limits", "bool"),
    C("status", "finger", "1", "0 free, 1 stick, 2 slide", "sample", "slips", "int8"),
    C("gap", "finger", "m", "distance of the finger to the surface, negative inside the object", "sample", "gaps"),
    C("true_position", "finger axis", "m", "true position of the simulated fingertip", "servo", "simulated"),
    C("device_energy", "finger", "J", "work of the displayed force on the fingertip since the start", "servo",
      "always"),
    C("wall", "", "s", "wall-clock time since the first tick", "loop", "timed"),
    C("late", "", "s", "delay of the tick after its deadline", "loop", "timed"),
    C("io", "call", "s", "duration of reading from all devices, and of writing to all devices", "loop", "timed"),
    C("skipped", "", "1", "number of periods skipped before the tick", "loop", "timed", "int64"),
    C("fresh", "finger", "1", "whether the reading contained a new sample", "loop", "timed", "bool"),
    C("switches", "device", "1", "switch states as bits; the first switch of a device is bit 0", "loop",
      "has_switches", "int64"),
    C("raw/", "", "1", "raw numbers from the device", "loop", "timed"),  # one column for each device in `raw`
    C("largest_force", "finger", "N", "largest force that the device can exert at its position", "loop", "varying"),
)
OF_OBJECTS = (
    C("position", "axis", "m", "position of the object's centre", "sample", "always"),
    C("centre", "axis", "m", "predicted centre of the object, used by the sample", "sample", "predicted"),
    C("velocity", "axis", "m/s", "velocity of the object's centre", "sample", "always"),
    C("orientation", "", "rad", "angle about the z axis", "sample", "in_plane"),
    C("angular_velocity", "", "rad/s", "angular velocity about the z axis", "sample", "in_plane"),
    C("orientation", "quaternion", "1", "quaternion x, y, z, w", "sample", "in_space"),
    C("angular_velocity", "turn", "rad/s", "angular velocity in world axes", "sample", "in_space"),
    C("law", "", "1", "friction law that the elastic force satisfies: 0 Coulomb's, 1 the associated law", "sample",
      "slips", "int8"),
    C("residual", "", "N", "residual of the friction law in the column `law`", "sample", "slips"),
    C("wrench", "component", "N, N m", "wrench of the fingers on the object, about its centre, in world axes",
      "sample", "always"),
    C("scale", "share", "1", SCALE, "safety", "guarded"),
    C("tank", "", "J", "energy available for increases of stiffness", "safety", "guarded"),
    # energies are totals since the start, except `stored` and `kinetic`, which are present values
    C("energy/work", "mode", "J", "work of the fingers' forces, held over each sample, on their motion relative to "
      "the object", *OBSERVED),
    C("energy/stored", "mode", "J", "energy stored in the springs of eq. (4)", *OBSERVED),
    C("energy/damped", "mode", "J", "energy dissipated by the damping of eq. (4)", *OBSERVED),
    C("energy/slipped", "mode", "J", "energy dissipated by sliding, by release of contacts and by force limits",
      *OBSERVED),
    C("energy/reshaped", "mode", "J", "energy dissipated by changes of the rule that splits forces or of the fingers' "
      "weights, or by a skew-symmetric part of the stiffness", *OBSERVED),
    C("energy/leaked", "mode", "J", "energy generated because the springs' forces are held over samples", *OBSERVED),
    C("energy/balance", "mode", "J", "energy dissipated, including friction; a negative value is generated energy",
      *OBSERVED),
    C("energy/braked", "mode", "J", "energy dissipated by the damping that the passivity controller adds", "observer",
      "is_controlled"),
    C("energy/damping", "mode", "N s/m", "damping that the passivity controller adds in the sample", "observer",
      "is_controlled"),
    C("energy/fingers", "", "J", "work of the fingers on coupling and object, from measured positions", *OBSERVED),
    C("energy/wrench", "", "J", "work of the fingers' wrench on the object", *OBSERVED),
    C("energy/kinetic", "", "J", "kinetic energy of the object", *OBSERVED),
    C("energy/gravity", "", "J", "work of gravity", *OBSERVED),
    C("energy/contact", "", "J", "work of obstacles and other objects on the object; for a body that is not native, "
      "the remainder of the object's energy balance", *OBSERVED),
    C("energy/viscous", "", "J", "energy dissipated by the object's viscosity", *OBSERVED),
    C("energy/defect", "", "J", "energy generated by the object's integrator", *OBSERVED),
    C("energy/gap", "", "J", "work of the fingers minus all other terms of the energy balance", *OBSERVED),
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
    C("internal_displacement", "finger axis", "m",
      "part of the displacement e that squeezes the object, e - P'e, where P f is the external force", "reader"),
    C("external_displacement", "finger axis", "m",
      "rigid-body part of the displacement e, P'e, where P f is the external force", "reader"),
    C("grip_margin", "", "N", "smallest mu f_n - |f_t| of all touching fingers with friction; NaN if there are no "
      "such fingers", "reader", "has_margin"),
)
FORCES = ("internal_force", "external_force", "internal_moment", "external_moment")
# fmt: on


@dataclass(frozen=True)
class Column:
    """Recorded quantity: its position in a row, shape per tick, names of dimensions, unit, meaning, type and origin."""

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
        """Type of the numbers in a file; a Boolean value is stored in one byte."""
        return np.dtype("int8" if self.kind == "bool" else self.kind)

    def typed(self, values: FloatArray) -> NDArray[Any]:
        """Convert numbers from a row to the type of the column."""
        return np.not_equal(values, 0.0) if self.kind == "bool" else values.astype(self.kind, copy=False)


@dataclass(frozen=True)
class Layout:
    """Columns of a recording with one row of float64 numbers per recorded tick.

    Attributes:
        dimensions: Number of dimensions d of the scene.
        fingers: Names of the fingers.
        objects: Names of the objects.
        finger_objects: For each finger, index of the object to which the finger belongs.
        gaps: Whether fingers have a gap to the surface; False if the contacts are attached.
        moments: Whether fingers exert moments.
        slips: Whether a finger has a coefficient of friction.
        simulated: Whether the true positions of fingertips are known.
        observed: Whether the energy of each grasp is recorded.
        controlled: Whether a passivity controller adds damping to dissipate generated energy.
        limits: Whether a device or the safety settings of the scene limit the force.
        guarded: Whether the scene has a safety chain.
        normals: Whether contact normals are known, because a finger is soft or has friction.
        torsion_axes: Whether a torsional moment acts along an axis other than the normal.
        timed: Whether the run follows the wall clock.
        varying: Whether devices in a real-time run report largest forces that depend on position.
        switched: Whether a device in a real-time run has switches.
        devices: Names of the devices in a real-time run.
        raw: Name, count and type ("int64" or "float64") of the raw numbers of each device that reports raw numbers.
        predicted: Indices of the objects whose forces are split about the centre that the implicit integrator predicts.
        absent: Names of columns that do not exist because the recording has an earlier format.
        omitted: Names of columns that are not recorded because `record.columns` of the scene does not select them.
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
        """Return only the arguments of the constructor for pickling; cached properties are recomputed."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @cached_property
    def columns(self) -> MappingProxyType[str, Column]:
        """Columns by name, such as `finger_force` or, for an object, `objects/NAME/position`."""
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
        """Bytes per row at the end of a run: those of the partial file plus those of the complete file.

        The complete file also contains internal and external forces.
        """
        return 8 * (2 * self.width + sum(prod(column.shape) for column in self.forces) + 1)

    @cached_property
    def derived(self) -> tuple[Column, ...]:
        """Variables that a reader can compute from a row, because the columns that they need are recorded."""
        columns = (self._column(each) for each in DERIVED if self._has(each))
        return tuple(each for each in columns if set(self.omitted).isdisjoint(self.sources_of(each.name)))

    @property
    def forces(self) -> tuple[Column, ...]:
        """Variables computed from a row that a file also stores, namely internal and external forces and moments."""
        return tuple(each for each in self.derived if each.name in FORCES)

    def sources_of(self, name: str) -> tuple[str, ...]:
        """List the columns from which a variable is computed, whether recorded or not."""
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
        """Return whether a column exists in recordings of every format."""
        table, own = (OF_OBJECTS, name.split("/", 2)[-1]) if name.startswith("objects/") else (OF_FINGERS, name)
        return any(each.when == "always" for each in table if each.name == own)

    @property
    def scales(self) -> Mapping[str, tuple[str, ...]]:
        """Names of the entries along each dimension that a column has, except time."""
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
        """Yield all columns of the scene, recorded or not, in the order of a row; their positions are not yet set."""
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
    """Selection of the columns and ticks that are recorded.

    Args:
        whole: Layout of complete rows, which contain all columns.
        layout: Layout of the recorded columns.
        every: Number of ticks from one recorded row to the next.
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
        """Select the recorded ticks and columns from complete rows (r, width); the first row belongs to `tick`."""
        if self.is_whole:
            return rows
        return np.asarray(rows[-tick % self.every :: self.every][:, self.numbers])


def chosen_layout(whole: Layout, names: Sequence[str]) -> Layout:
    """Return a layout that contains only the columns with these names; without names, it contains all columns.

    A name denotes a column, a group of columns such as `objects/bar` or `objects/bar/energy`, or a computed variable
    such as `internal_force`. For a computed variable, the layout contains the columns from which it is computed.

    Raises:
        UnknownNameError: If a name is unknown; the message suggests a similar name.
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
    """List the columns that a name denotes; the list is empty if the name is unknown."""
    group = name.rstrip("/") + "/"
    inside = [column for column in whole.columns if column == name or column.startswith(group)]
    if not inside and name in [column.name for column in whole.derived]:
        inside = list(whole.sources_of(name))
    return inside
