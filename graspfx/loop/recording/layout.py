"""Which column of a tick's row holds what, and how the columns unfold into arrays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cached_property
from math import prod
from types import MappingProxyType
from typing import Any

WIDTHS = {1: 1, 2: 3, 3: 6}  # w
# what a recording of every format has, of fingers and, by the name's last part, of objects
ESSENTIAL = ("finger_position", "finger_velocity", "contact_position", "finger_force", "touching", "device_energy")
ESSENTIAL_OF_OBJECTS = ("position", "velocity", "wrench")
DISPLAYED = "on the operator, after every limit, before output delay"
SCALE = "left of the law's force: by the soft start, by trust in readings, of what squeezes, of a finger's whole force"
TIMED = ("wall", "late", "io", "skipped", "fresh", "largest_force", "switches")  # columns of runs in real time only
WRENCH = {1: ("fx",), 2: ("fx", "fy", "tz"), 3: ("fx", "fy", "fz", "tx", "ty", "tz")}


@dataclass(frozen=True)
class Column:
    """One quantity: where it stands in a row, its shape per tick, the names of its dimensions and its unit."""

    name: str
    where: slice
    shape: tuple[int, ...]
    dimensions: tuple[str, ...]
    unit: str
    meaning: str


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
        normals: whether contacts' normals and the torsion held at them are known, of soft fingers.
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
        for name, axes, unit, meaning in self._quantities():
            if name in self.absent or name in self.omitted:
                continue
            shape = tuple(count for _, count in axes)
            where = slice(start, start + prod(shape))
            columns[name] = Column(name, where, shape, tuple(axis for axis, _ in axes), unit, meaning)
            start += prod(shape)
        return MappingProxyType(columns)

    @cached_property
    def width(self) -> int:
        """Numbers per tick."""
        return sum(prod(column.shape) for column in self.columns.values())

    @cached_property
    def forces(self) -> tuple[Column, ...]:
        """Variables that follow from a row, and stand in a file beside its columns: the parts of forces and moments."""
        if not set(self.omitted).isdisjoint(self.sources_of("internal_force")):
            return ()
        n, names = ("finger", len(self.fingers)), ["force", "moment"] if self.moments else ["force"]
        axes = {"force": (n, ("axis", self.dimensions)), "moment": (n, ("turn", 3))}
        parts = {"internal": "that squeezes the object", "external": "that moves the object"}
        return tuple(
            Column(
                f"{part}_{name}", slice(0, 0), tuple(size for _, size in axes[name]), tuple(a for a, _ in axes[name]),
                {"force": "N", "moment": "N m"}[name], f"part of the finger's {name} on the object {purpose}",
            )
            for name in names
            for part, purpose in parts.items()
        )  # fmt: skip

    @property
    def derived(self) -> tuple[Column, ...]:
        """Variables that follow from a row: the displayed force where it is no column, `forces`, and displacements."""
        shape, names = (len(self.fingers), self.dimensions), ("finger", "axis")
        displayed = Column("displayed_force", slice(0, 0), shape, names, "N", DISPLAYED)
        meanings = {
            "internal_displacement": "by which the fingers squeeze, e - P'e",
            "external_displacement": "the rigid motion of the contacts in e, P'e",
        }
        parts = (Column(name, slice(0, 0), shape, names, "m", meaning) for name, meaning in meanings.items())
        all_ = (*(() if self.limits else (displayed,)), *self.forces, *parts)
        return tuple(each for each in all_ if set(self.omitted).isdisjoint(self.sources_of(each.name)))

    def sources_of(self, name: str) -> tuple[str, ...]:
        """List the columns, as far as the scene has them, that a variable follows from."""
        if name == "displayed_force":
            return ("finger_force",)
        displacement = name.endswith("displacement")
        own = ("finger_position", "torsion_displacement") if displacement else ("finger_force", "finger_moment")
        names = {*own, "contact_position", "gap", "contact_normal", "torsion_axis"}
        names |= {f"objects/{thing}/{place}" for thing in self.objects for place in ("position", "centre")}
        return tuple(each for each, *_ in self._quantities() if each in names)

    def is_essential(self, name: str) -> bool:
        """Tell whether no recording can lack a column."""
        folder, _, last = name.rpartition("/")
        return name in ESSENTIAL or (folder.count("/") == 1 and last in ESSENTIAL_OF_OBJECTS)

    def _quantities(self) -> Iterator[tuple[str, tuple[tuple[str, int], ...], str, str]]:
        d = self.dimensions
        n = ("finger", len(self.fingers))
        axis, turn, wrench = ("axis", d), ("turn", 3), ("component", WIDTHS[d])
        yield "finger_position", (n, axis), "m", "as the device reports it"
        yield "finger_velocity", (n, axis), "m/s", "as the device reports or estimates it"
        yield "contact_position", (n, axis), "m", "c of e = p - c: on the surface, of a ball a radius before it"
        yield "finger_force", (n, axis), "N", "of the finger on the object"
        if self.moments:
            yield "finger_moment", (n, turn), "N m", "of the finger on the object"
        if self.normals:
            yield "contact_normal", (n, turn), "1", "into the object, where some finger of its is soft"
            yield "torsion_displacement", (n,), "m", "theta of a soft finger's torsion, times its patch length"
        if self.torsion_axes:
            yield "torsion_axis", (n, turn), "1", "along which a soft finger's torsion acts on the object"
        if self.limits:
            yield "displayed_force", (n, axis), "N", DISPLAYED
            yield "law_force", (n, axis), "N", "of the finger on the object by eq. (4), before limits"
        yield "touching", (n,), "1", "whether the finger exerts a force"
        if self.limits:
            yield "saturated", (n,), "1", "whether the finger's force stands at its limit"
        if self.slips:
            yield "status", (n,), "1", "0 free, 1 stick, 2 slide"
        if self.gaps:
            yield "gap", (n,), "m", "distance to the surface, negative inside"
        if self.simulated:
            yield "true_position", (n, axis), "m", "of the simulated fingertip"
        yield "device_energy", (n,), "J", "work done so far on the fingertip by the displayed force"
        if self.timed:
            yield from self._times(n)
        if self.varying:
            yield "largest_force", (n,), "N", "that the device told it could display where it was read"
        for k, name in enumerate(self.objects):
            at = f"objects/{name}/"
            yield at + "position", (axis,), "m", "of the object's centre"
            if k in self.predicted:
                yield at + "centre", (axis,), "m", "of the object in the sample, which is about where it will be"
            yield at + "velocity", (axis,), "m/s", "of the object's centre"
            if d == 2:
                yield at + "orientation", (), "rad", "angle"
                yield at + "angular_velocity", (), "rad/s", "about the normal of the plane"
            if d == 3:
                yield at + "orientation", (("quaternion", 4),), "1", "quaternion x, y, z, w"
                yield at + "angular_velocity", (turn,), "rad/s", "in world axes"
            if self.slips:
                yield at + "law", (), "1", "that the elastic force satisfies: 0 Coulomb's, 1 the associated one"
                yield at + "residual", (), "N", "of that law"
            yield at + "wrench", (wrench,), "N, N m", "of the fingers on the object, about its centre, in world axes"
            if self.guarded:
                yield at + "scale", (("share", 4),), "1", SCALE
                yield at + "tank", (), "J", "energy that pays for stiffness"
            if self.observed:
                yield from self._energies(at + "energy/")

    def _times(self, n: tuple[str, int]) -> Iterator[tuple[str, tuple[tuple[str, int], ...], str, str]]:
        """List what a run on the wall's clock records of its ticks and of its devices."""
        yield "wall", (), "s", "time of the tick on the wall's clock since that of the first"
        yield "late", (), "s", "after the tick's deadline"
        yield "io", (("call", 2),), "s", "to ask and read all devices, and to write them"
        yield "skipped", (), "1", "periods left out before the tick"
        yield "fresh", (n,), "1", "whether the reading brought a new sample"
        if self.switched:
            yield "switches", (("device", len(self.devices)),), "1", "bits, the first switch of a device is bit 0"
        for name, count, _ in self.raw:
            yield f"raw/{name}", ((f"{name}_raw", count),), "1", "numbers as they came over the wire"

    def _energies(self, at: str) -> Iterator[tuple[str, tuple[tuple[str, int], ...], str, str]]:
        """List the energies: totals since the start but for `stored` and `kinetic`, which are momentary."""
        mode = (("mode", 3),)
        yield at + "work", mode, "J", "of the held forces on the fingers' motion against the object"
        yield at + "stored", mode, "J", "in the springs of eq. (4)"
        yield at + "damped", mode, "J", "taken by the damping of eq. (4)"
        yield at + "slipped", mode, "J", "taken where contacts slide or let go, or beyond a limit"
        yield at + "reshaped", mode, "J", "taken where the split, a weight or a skew stiffness changes what is stored"
        yield at + "leaked", mode, "J", "made by holding the springs' forces over samples"
        yield at + "balance", mode, "J", "taken beyond what is stored, with frictions; below zero energy was made"
        if self.controlled:
            yield at + "braked", mode, "J", "taken by the damping that control added"
            yield at + "damping", mode, "N s/m", "added in this sample"
        yield at + "fingers", (), "J", "work of the fingers on coupling and object, by the positions read"
        yield at + "wrench", (), "J", "work of the fingers' wrench on the object"
        yield at + "kinetic", (), "J", "of the object"
        yield at + "gravity", (), "J", "work of gravity"
        yield at + "contact", (), "J", "work of obstacles and other objects; what is left over, if not native"
        yield at + "viscous", (), "J", "taken by the object's viscosity"
        yield at + "defect", (), "J", "made by the object's integrator"
        yield at + "gap", (), "J", "by which the fingers' work misses all the rest"
