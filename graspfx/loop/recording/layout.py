"""The columns of a recording: one table of all that a row may hold, and which of it a scene has and records."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from math import prod
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import UnknownNameError

FloatArray = NDArray[np.float64]

WIDTHS = {1: 1, 2: 3, 3: 6}  # w
WRENCH = {1: ("fx",), 2: ("fx", "fy", "tz"), 3: ("fx", "fy", "fz", "tx", "ty", "tz")}
ENTRIES = {  # along the dimensions that all recordings have alike
    "axis": ("x", "y", "z"),
    "turn": ("x", "y", "z"),
    "quaternion": ("x", "y", "z", "w"),
    "mode": ("internal", "translation", "rotation"),
    "call": ("read", "write"),
    "share": ("soft", "trust", "squeeze", "outer"),
}


class Declared(NamedTuple):
    """A quantity that a row may hold.

    Attributes:
        name: of the column; of an object's, behind `objects/NAME/`.
        dimensions: names of its dimensions, space-separated; none for a single number.
        unit: of its numbers.
        meaning: what it is.
        filled: who fills it: "sample" (the coupling's sample of a grasp), "servo" (the tick around it), "observer" (the
            ledger of energies), "safety" (the chain) or "loop" (the exchange with devices on the wall's clock).
        when: the flag of the layout that says whether it is there; always if not given.
        kind: the type of its numbers in a file; in a row all are float64.
        essential: whether a recording of every format has it.
    """

    name: str
    dimensions: str
    unit: str
    meaning: str
    filled: str
    when: str = ""
    kind: str = "float64"
    essential: bool = False


DISPLAYED = "on the operator, after every limit, before output delay"
SCALE = "left of the law's force: by the soft start, by trust in readings, of what squeezes, of a finger's whole force"
OF_FINGERS = (
    Declared("finger_position", "finger axis", "m", "as the device reports it", "sample", essential=True),
    Declared("finger_velocity", "finger axis", "m/s", "as the device reports or estimates it", "sample",
             essential=True),
    Declared("contact_position", "finger axis", "m", "c of e = p - c: on the surface, of a ball a radius before it",
             "sample", essential=True),
    Declared("finger_force", "finger axis", "N", "of the finger on the object", "sample", essential=True),
    Declared("finger_moment", "finger turn", "N m", "of the finger on the object", "sample", "moments"),
    Declared("contact_normal", "finger turn", "1", "into the object, where a finger of its is soft or has friction",
             "sample", "normals"),
    Declared("torsion_displacement", "finger", "m", "theta of a soft finger's torsion, times its patch length",
             "sample", "twists"),
    Declared("torsion_axis", "finger turn", "1", "along which a soft finger's torsion acts on the object", "sample",
             "torsion_axes"),
    Declared("displayed_force", "finger axis", "N", DISPLAYED, "servo", "limits"),
    Declared("law_force", "finger axis", "N", "of the finger on the object by eq. (4), before limits", "sample",
             "limits"),
    Declared("touching", "finger", "1", "whether the finger exerts a force", "sample", kind="bool", essential=True),
    Declared("saturated", "finger", "1", "whether the finger's force stands at its limit", "sample", "limits", "bool"),
    Declared("status", "finger", "1", "0 free, 1 stick, 2 slide", "sample", "slips", "int8"),
    Declared("gap", "finger", "m", "distance to the surface, negative inside", "sample", "gaps"),
    Declared("true_position", "finger axis", "m", "of the simulated fingertip", "servo", "simulated"),
    Declared("device_energy", "finger", "J", "work done so far on the fingertip by the displayed force", "servo",
             essential=True),
    Declared("wall", "", "s", "time of the tick on the wall's clock since that of the first", "loop", "timed"),
    Declared("late", "", "s", "after the tick's deadline", "loop", "timed"),
    Declared("io", "call", "s", "to ask and read all devices, and to write them", "loop", "timed"),
    Declared("skipped", "", "1", "periods left out before the tick", "loop", "timed", "int64"),
    Declared("fresh", "finger", "1", "whether the reading brought a new sample", "loop", "timed", "bool"),
    Declared("switches", "device", "1", "bits, the first switch of a device is bit 0", "loop", "has_switches",
             "int64"),
    Declared("raw/", "", "1", "numbers as they came over the wire", "loop", "timed"),  # of each device in `raw`
    Declared("largest_force", "finger", "N", "that the device told it could display where it was read", "loop",
             "varying"),
)  # fmt: skip
OF_OBJECTS = (
    Declared("position", "axis", "m", "of the object's centre", "sample", essential=True),
    Declared("centre", "axis", "m", "of the object in the sample, which is about where it will be", "sample",
             "predicted"),
    Declared("velocity", "axis", "m/s", "of the object's centre", "sample", essential=True),
    Declared("orientation", "", "rad", "angle", "sample", "in_plane"),
    Declared("angular_velocity", "", "rad/s", "about the normal of the plane", "sample", "in_plane"),
    Declared("orientation", "quaternion", "1", "quaternion x, y, z, w", "sample", "in_space"),
    Declared("angular_velocity", "turn", "rad/s", "in world axes", "sample", "in_space"),
    Declared("law", "", "1", "that the elastic force satisfies: 0 Coulomb's, 1 the associated one", "sample", "slips",
             "int8"),
    Declared("residual", "", "N", "of that law", "sample", "slips"),
    Declared("wrench", "component", "N, N m", "of the fingers on the object, about its centre, in world axes",
             "sample", essential=True),
    Declared("scale", "share", "1", SCALE, "safety", "guarded"),
    Declared("tank", "", "J", "energy that pays for stiffness", "safety", "guarded"),
    # energies are totals since the start but for `stored` and `kinetic`, which are momentary
    Declared("energy/work", "mode", "J", "of the held forces on the fingers' motion against the object", "observer",
             "observed"),
    Declared("energy/stored", "mode", "J", "in the springs of eq. (4)", "observer", "observed"),
    Declared("energy/damped", "mode", "J", "taken by the damping of eq. (4)", "observer", "observed"),
    Declared("energy/slipped", "mode", "J", "taken where contacts slide or let go, or beyond a limit", "observer",
             "observed"),
    Declared("energy/reshaped", "mode", "J",
             "taken where the split, a weight or a skew stiffness changes what is stored", "observer", "observed"),
    Declared("energy/leaked", "mode", "J", "made by holding the springs' forces over samples", "observer", "observed"),
    Declared("energy/balance", "mode", "J", "taken beyond what is stored, with frictions; below zero energy was made",
             "observer", "observed"),
    Declared("energy/braked", "mode", "J", "taken by the damping that control added", "observer", "is_controlled"),
    Declared("energy/damping", "mode", "N s/m", "added in this sample", "observer", "is_controlled"),
    Declared("energy/fingers", "", "J", "work of the fingers on coupling and object, by the positions read",
             "observer", "observed"),
    Declared("energy/wrench", "", "J", "work of the fingers' wrench on the object", "observer", "observed"),
    Declared("energy/kinetic", "", "J", "of the object", "observer", "observed"),
    Declared("energy/gravity", "", "J", "work of gravity", "observer", "observed"),
    Declared("energy/contact", "", "J", "work of obstacles and other objects; what is left over, if not native",
             "observer", "observed"),
    Declared("energy/viscous", "", "J", "taken by the object's viscosity", "observer", "observed"),
    Declared("energy/defect", "", "J", "made by the object's integrator", "observer", "observed"),
    Declared("energy/gap", "", "J", "by which the fingers' work misses all the rest", "observer", "observed"),
)  # fmt: skip
DERIVED = (  # what follows from a row; the two forces, and the moments with them, stand in a file beside its columns
    Declared("displayed_force", "finger axis", "N", DISPLAYED, "reader"),
    Declared("internal_force", "finger axis", "N", "part of the finger's force on the object that squeezes the object",
             "reader"),
    Declared("external_force", "finger axis", "N", "part of the finger's force on the object that moves the object",
             "reader"),
    Declared("internal_moment", "finger turn", "N m",
             "part of the finger's moment on the object that squeezes the object", "reader", "moments"),
    Declared("external_moment", "finger turn", "N m",
             "part of the finger's moment on the object that moves the object", "reader", "moments"),
    Declared("internal_displacement", "finger axis", "m", "by which the fingers squeeze, e - P'e", "reader"),
    Declared("external_displacement", "finger axis", "m", "the rigid motion of the contacts in e, P'e", "reader"),
)  # fmt: skip


@dataclass(frozen=True)
class Column:
    """One quantity: its place in a row, its shape per tick, the names of its dimensions, its unit and its meaning."""

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
        """Type of its numbers in a file: a truth value takes a byte."""
        return np.dtype("int8" if self.kind == "bool" else self.kind)


@dataclass(frozen=True)
class Layout:
    """The columns of a recording, all float64 in one row per tick.

    Attributes:
        dimensions: d.
        fingers: their names.
        objects: their names.
        finger_objects: for each finger, the number of the object that it touches.
        gaps: whether fingers have a gap to the surface (not with attached contacts).
        moments: whether fingers exert moments.
        slips: whether some finger has a coefficient of friction.
        simulated: whether true positions are known.
        observed: whether the energy of each grasp is booked.
        controlled: whether what leaks is damped.
        limits: whether some device tells a largest force, or the scene's safety.
        guarded: whether forces pass a safety chain.
        normals: whether contacts' normals are known, where some finger is soft or has friction.
        torsion_axes: whether torsion acts along another axis than the normal.
        timed: whether the run is on the wall's clock.
        varying: whether its devices tell largest forces that depend on where they stand, which are recorded then.
        switched: whether some of its devices have switches.
        devices: their names, of such a run.
        raw: what came over the wire to some of them: a name, a count of numbers, and "int64" or "float64" each.
        predicted: numbers of the objects whose split needs where the implicit integrator predicts their centre.
        absent: names of columns that a recording of an earlier format does not have.
        omitted: names of columns that the scene's `record` leaves out.
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
        """Pass to another process what it was made of; views of columns are made there."""
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
        """Numbers per tick."""
        return sum(prod(column.shape) for column in self.columns.values())

    @property
    def bytes_on_disk(self) -> int:
        """Bytes that a row takes when a run ends: in the part, and in the file with the two forces and the time."""
        return 8 * (2 * self.width + sum(prod(column.shape) for column in self.forces) + 1)

    @property
    def derived(self) -> tuple[Column, ...]:
        """Variables that follow from a row: the displayed force where it is no column, `forces`, and displacements."""
        there = (each for each in DERIVED if self._has(each) and not (each.name == "displayed_force" and self.limits))
        columns = (self._column(each) for each in there)
        return tuple(each for each in columns if set(self.omitted).isdisjoint(self.sources_of(each.name)))

    @property
    def forces(self) -> tuple[Column, ...]:
        """Variables that follow from a row and stand in a file too: the parts of forces and moments."""
        parts = ("internal_force", "external_force", "internal_moment", "external_moment")
        return tuple(each for each in self.derived if each.name in parts)

    def sources_of(self, name: str) -> tuple[str, ...]:
        """List the columns, as far as the scene has them, that a variable follows from."""
        if name == "displayed_force":
            return ("finger_force",)
        displacement = name.endswith("displacement")
        own = ("finger_position", "torsion_displacement") if displacement else ("finger_force", "finger_moment")
        names = {*own, "contact_position", "gap", "contact_normal", "torsion_axis"}
        names |= {f"objects/{thing}/{place}" for thing in self.objects for place in ("position", "centre")}
        return tuple(each.name for each in self._all_columns() if each.name in names)

    def is_essential(self, name: str) -> bool:
        """Tell whether no recording can lack a column."""
        head, _, rest = name.partition("/")
        table, own = (OF_OBJECTS, rest.partition("/")[2]) if head == "objects" else (OF_FINGERS, name)
        return any(each.essential for each in table if each.name == own)

    @property
    def scales(self) -> Mapping[str, tuple[str, ...]]:
        """Names of the entries along each dimension that a layout has, time apart."""
        names = {
            "finger": self.fingers,
            "device": self.devices,
            **{f"{name}_raw": tuple(map(str, range(count))) for name, count, _ in self.raw},
            **ENTRIES,
            "axis": ENTRIES["axis"][: self.dimensions],
            "component": WRENCH[self.dimensions],
        }
        used = {name for column in self.columns.values() for name in column.dimensions}
        return {name: entries for name, entries in names.items() if name in used}

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
        """List the columns that the scene has, recorded or not, in the order of a row; their places are empty."""
        for each in filter(self._has, OF_FINGERS):
            if each.name != "raw/":
                yield self._column(each)
                continue
            for name, count, kind in self.raw:
                about = (each.unit, each.meaning, kind, each.filled)
                yield Column(f"raw/{name}", slice(0, 0), (count,), (f"{name}_raw",), *about)
        for k, name in enumerate(self.objects):
            for each in filter(self._has, OF_OBJECTS):
                if each.when != "predicted" or k in self.predicted:
                    yield self._column(each, f"objects/{name}/")

    def _column(self, each: Declared, before: str = "") -> Column:
        lengths = {"finger": len(self.fingers), "device": len(self.devices), "axis": self.dimensions}
        lengths |= {name: len(entries) for name, entries in ENTRIES.items() if name != "axis"}
        names = tuple(each.dimensions.split())
        shape = tuple(WIDTHS[self.dimensions] if name == "component" else lengths[name] for name in names)
        return Column(
            before + each.name, slice(0, 0), shape, names, each.unit, each.meaning, each.kind, each.filled
        )  # fmt: skip


@dataclass(frozen=True)
class Selection:
    """Cuts rows of all columns and ticks down to those that are recorded.

    Args:
        whole: the layout of all columns.
        layout: of those that are recorded.
        every: ticks from one row to the next.
    """

    whole: Layout
    layout: Layout
    every: int = 1

    @cached_property
    def numbers(self) -> NDArray[np.intp]:
        """Places in a whole row of the numbers of a recorded one."""
        places = np.arange(self.whole.width)
        return np.concatenate([places[:0], *(places[self.whole.columns[name].where] for name in self.layout.columns)])

    @property
    def is_whole(self) -> bool:
        """True where every number of every tick is recorded."""
        return self.every == 1 and self.layout == self.whole

    def cut(self, rows: FloatArray, tick: int = 0) -> FloatArray:
        """Copy what is recorded of whole rows (r, width) of ticks from `tick` on."""
        if self.is_whole:
            return rows
        return np.asarray(rows[-tick % self.every :: self.every][:, self.numbers])


def chosen_layout(whole: Layout, names: Sequence[str]) -> Layout:
    """Lay out the columns of these names alone; all where there is no name.

    A name is that of a column, of a group of them (`objects/bar`, `objects/bar/energy`), or of a variable that follows
    from columns (`internal_force`), which are recorded then.

    Raises:
        UnknownNameError: with the names that come close.
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
    """List the columns that a name stands for; none for a name that nothing has."""
    group = name.rstrip("/") + "/"
    inside = [column for column in whole.columns if column == name or column.startswith(group)]
    if not inside and name in [column.name for column in whole.derived]:
        inside = list(whole.sources_of(name))
    return inside
