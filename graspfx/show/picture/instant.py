"""Geometry of a scene at one instant of a recording, common to all kinds of drawing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import GraspFXError, InputError, RecordingError, abbreviate
from graspfx.numeric import number
from graspfx.show.picture.surfaces import Surface, surface

if TYPE_CHECKING:
    from graspfx.recording.record import Recording

FloatArray = NDArray[np.float64]
Table = Mapping[str, Any]

ENDLESS = ("plane", "half-space")
PATCH = 1.15  # size of an infinite plane, as a fraction of the extent
LEAST = 1e-3  # extent of a scene whose points coincide [m]
DOT = 0.03  # drawn radius of an object without a shape, as a fraction of the extent
APART = 0.14  # drawn distance of attached fingers across a line, as a fraction of the extent
TIP = 0.016  # drawn radius of a point fingertip, as a fraction of the extent
THINGS = ("#c3d2e0", "#e3d3b4", "#cfdcc4", "#dccbdc")  # colours of objects in turn
FIXED, EDGE = "#d5d2cc", "#4a4f55"


class Outline(NamedTuple):
    """Shape of an object or an obstacle, with its pose.

    Attributes:
        name: Name in the scene.
        shape: Table of the shape; empty for an object without a shape.
        position: Position (d,) [m].
        orientation: Angle [rad], quaternion x, y, z, w, or None.
        is_object: Whether the thing is an object, not an obstacle.
        fixed: Whether the thing cannot move.
    """

    name: str
    shape: Table
    position: FloatArray
    orientation: Any
    is_object: bool
    fixed: bool

    @property
    def endless(self) -> bool:
        """Whether the shape is a plane or half-space."""
        return self.shape.get("kind") in ENDLESS


def lifted(values: FloatArray, dimensions: int) -> FloatArray:
    """Extend vectors (..., d) by zeros to `dimensions` entries, from a line or the plane to the plane or to space."""
    missing = dimensions - values.shape[-1]
    return np.asarray(np.concatenate([values, np.zeros((*values.shape[:-1], missing))], axis=-1)) if missing else values


def object_tables(table: Table) -> dict[str, Table]:
    """List the tables of a scene's objects by their names."""
    return {each.get("name", "object"): each for each in _listed(table, "object") if isinstance(each, Mapping)}


def is_fixed(own: Table) -> bool:
    """Tell whether all degrees of freedom in an object's table are locked."""
    free = own.get("free")
    return free is not None and not any(free)


def obstacles(table: Table, dimensions: int, notes: list[str]) -> Iterator[Outline]:
    """List a scene's obstacles, in space or in the plane; a note names an obstacle without a shape."""
    for i, each in enumerate(_listed(table, "obstacle")):
        own = each if isinstance(each, Mapping) else {}
        name, shape = own.get("name", f"obstacle{i}"), own.get("shape")
        if not isinstance(shape, Mapping):
            notes.append(f"{name} has no shape to draw")
            continue
        place = lifted(np.asarray(own.get("position") or np.zeros(dimensions), dtype=float), dimensions)
        yield Outline(name, shape, place, own.get("orientation"), False, True)


def solids(
    outlines: Sequence[Outline], tips: FloatArray, dimensions: int, folder: Path | None, notes: list[str]
) -> tuple[list[tuple[Outline, Surface]], FloatArray, float]:
    """Build the surface of each outline; infinite surfaces, and dots for missing shapes, fit the size of the others.

    Args:
        outlines: Shapes with their poses.
        tips: Positions of fingertips (k, d) [m].
        dimensions: Number of dimensions d, 2 or 3.
        folder: Folder of relative mesh paths.
        notes: List to which the reason is added if a shape cannot be drawn.

    Returns:
        Outlines and their surfaces in the frames of the shapes; lower and upper corner (2, d) of all parts except
        infinite surfaces [m]; and the distance of these corners [m].
    """
    surfaces: dict[int, Surface] = {}

    def build(k: int, shape: Table, extent: float) -> None:
        try:
            surfaces[k] = surface(shape, dimensions, extent, folder)
        except GraspFXError as error:
            notes.append(f"{outlines[k].name} is not drawn: {abbreviate(str(error), 300)}")

    for k, each in enumerate(outlines):
        if each.shape and not each.endless:
            build(k, each.shape, LEAST)
    corners = np.concatenate([
        *(surfaces[k].placed(outlines[k].position, outlines[k].orientation).vertices for k in surfaces),
        *(each.position[None] for each in outlines if not each.shape), tips,
    ])  # fmt: skip
    ends = np.array([corners.min(axis=0), corners.max(axis=0)]) if len(corners) else np.zeros((2, dimensions))
    extent = max(float(np.linalg.norm(ends[1] - ends[0])), LEAST)
    for k, each in enumerate(outlines):
        if not each.shape:
            build(k, {"kind": "sphere", "radius": DOT * extent}, extent)
        elif each.endless:
            build(k, each.shape, PATCH * extent)
    return [(each, surfaces[k]) for k, each in enumerate(outlines) if k in surfaces], ends, extent


def fingertip_radii(table: Table, count: int) -> FloatArray:
    """List the radii of a scene's fingertips, zero for points (n,) [m]."""
    radii = [float(each.get("radius") or 0.0) for each in _listed(table, "finger") if isinstance(each, Mapping)]
    return np.array(radii if len(radii) == count else [0.0] * count)


def apart_on_a_line(count: int) -> FloatArray:
    """Return offsets that separate fingers across a line, (n,), in units of their distance."""
    return np.asarray(0.5 * (count - 1) - np.arange(count))


def colours_of(names: Sequence[str], movable: Sequence[str]) -> list[str]:
    """Assign colours: cyclically repeated colours to movable objects, one colour to all other objects and obstacles."""
    return [THINGS[movable.index(name) % len(THINGS)] if name in movable else FIXED for name in names]


def slid(surface: Surface, middle: FloatArray) -> Surface:
    """Move the drawn part of an infinite surface to the surface's point closest to the centre of the drawing."""
    v = surface.vertices
    if len(middle) == 3:
        along = np.array([v[1] - v[0], v[3] - v[0]])
        offset = middle - v.mean(axis=0)
    else:
        along = np.array([v[1] - v[0]])
        offset = middle - 0.5 * (v[0] + v[1])
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return Surface(v + along.T @ (along @ offset), surface.faces)


def _listed(table: Table, key: str) -> Sequence[Any]:
    """List the tables of a key, which may be a single table."""
    tables = table.get(key, ())
    return tables if isinstance(tables, list | tuple) else [tables]


@dataclass(frozen=True)
class Thing:
    """An object or an obstacle with its placed surface.

    Attributes:
        name: Name in the scene.
        surface: Surface in the world, or a part of an infinite surface.
        fixed: Whether the thing is an obstacle, or an object that cannot move.
        endless: Whether the surface is a plane or half-space.
        path: Path of the centre so far (k, d) [m].
    """

    name: str
    surface: Surface
    fixed: bool
    endless: bool
    path: FloatArray


@dataclass(frozen=True)
class Instant:
    """One instant, prepared for drawing.

    Attributes:
        dimensions: Number of dimensions, 2 or 3; a line is drawn in the plane.
        on_a_line: Whether the scene is on a line.
        time: Time of the instant [s].
        extent: Size of the drawing without arrows and infinite surfaces [m].
        middle: Centre of the drawing (d,) [m].
        things: Objects and obstacles.
        names: Names of the fingers.
        tips: Positions of the fingertips (n, d) [m].
        radii: Radii of ball fingertips, zero for points (n,) [m].
        contacts: Contact points, or the fingertips if they are attached (n, d) [m].
        forces: Forces of the fingers on their objects (n, d) [N].
        parts: Internal and external parts of the forces (n, d) [N], zero for a free finger; None if not recorded.
        touching: Mask of touching fingers (n,).
        paths: Paths of the fingertips so far (k, n, d) [m].
        title: Title of the scene.
        notes: Reasons for omitted parts.
    """

    dimensions: int
    on_a_line: bool
    time: float
    extent: float
    middle: FloatArray
    things: Sequence[Thing]
    names: Sequence[str]
    tips: FloatArray
    radii: FloatArray
    contacts: FloatArray
    forces: FloatArray
    parts: tuple[FloatArray, FloatArray] | None
    touching: NDArray[np.bool_]
    paths: FloatArray
    title: str
    notes: tuple[str, ...]


def instant(recording: Recording, time: float | None = None, folder: Path | None = None) -> Instant:
    """Read one instant of a recording.

    Args:
        recording: Recording with at least one tick.
        time: Time [s]; by default the tick with the largest sum of forces among those with most touching fingers, or
            the last tick if all forces are zero.
        folder: Folder of relative mesh paths; by default the scene's folder.

    Raises:
        InputError: If the recording has no ticks, the time is outside the recording, or nothing can be drawn.
    """
    k = _tick(recording, time)
    d = max(recording.layout.dimensions, 2)
    folder = folder or Path(recording.header.scene_folder)
    notes: list[str] = []
    true = recording.true_position
    tips = lifted(recording.finger_position if true is None else true, d)  # (N, n, d)
    finite = np.isfinite(tips[k]).all(axis=1)
    if not finite.all():
        notes.append("fingers without finite positions are omitted")
    table = recording.header.scene_table
    radii = fingertip_radii(table, len(recording.layout.fingers))
    outlines = [*_objects(recording, table, k, d), *obstacles(table, d, notes)]
    outlines = [each for each in outlines if np.isfinite(each.position).all()]
    built, ends, extent = solids(outlines, tips[k][finite], d, folder, notes)
    if not built and not finite.any():
        at, expected = float(recording.time[k]), "a time at which an object or a finger has a finite position [s]"
        raise InputError("time", at, expected, "the run may have diverged: give an earlier time")
    middle = ends.mean(axis=0)
    built.sort(key=lambda one: (not one[0].endless, not one[0].shape))  # infinite surfaces are behind all others
    things = []
    for each, solid in built:
        solid = solid.placed(each.position, each.orientation)
        path = lifted(recording.objects[each.name].position, d)[: k + 1] if each.is_object else each.position[None]
        things.append(Thing(each.name, slid(solid, middle) if each.endless else solid, each.fixed, each.endless, path))
    forces = lifted(recording.finger_force, d)[k]
    attached = recording.gap is None
    if recording.layout.dimensions == 1 and attached:
        n = tips.shape[1]
        tips = tips + APART * extent * apart_on_a_line(n)[:, None] * np.array([0.0, 1.0])
    contacts = tips[k] if attached else lifted(recording.contact_position, d)[k]
    moments = recording.finger_moment
    if moments is not None and np.abs(moments[k]).max(initial=0.0) > 0.0:
        notes.append("moments of fingers are not drawn")
    return Instant(
        dimensions=d, on_a_line=recording.layout.dimensions == 1, time=float(recording.time[k]),
        extent=extent, middle=middle, things=things,
        names=[name for name, one in zip(recording.layout.fingers, finite, strict=True) if one],
        tips=tips[k][finite], radii=radii[finite], contacts=contacts[finite],
        forces=np.nan_to_num(forces[finite], posinf=0.0, neginf=0.0), parts=_parts(recording, k, d, finite),
        touching=recording.touching[k][finite],
        paths=tips[: k + 1][:, finite],
        title=recording.header.title or Path(recording.header.scene).stem, notes=tuple(notes),
    )  # fmt: skip


def _parts(recording: Recording, k: int, d: int, finite: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray] | None:
    try:
        parts = recording.internal_force, recording.external_force
    except RecordingError:  # recording of an earlier format
        return None
    seen = recording.touching[k, :, None] & np.isfinite(recording.finger_force[k])
    internal, external = (lifted(np.where(seen, part[k], 0.0), d)[finite] for part in parts)
    return internal, external


def _tick(recording: Recording, time: float | None) -> int:
    N = len(recording)
    if not N:
        raise InputError("recording", N, "a recording with at least one tick")
    if time is None:
        total = np.nan_to_num(np.linalg.norm(recording.finger_force, axis=2).sum(axis=1), posinf=0.0)
        if not total.any():
            return N - 1
        many = recording.touching.sum(axis=1)
        return int(np.where(many == many[total > 0.0].max(), total, -1.0).argmax())
    expected = f"a time from 0 to {recording.time[-1]:g} s, within the recording"
    k = round(number("time", time, expected) / recording.row_period)
    if k >= N:
        raise InputError("time", time, expected)
    return k


def _objects(recording: Recording, table: Table, k: int, d: int) -> Iterator[Outline]:
    """List the objects in the poses in which the scene describes their shapes."""
    tables = object_tables(table)
    for name in recording.objects:
        own = tables.get(name, {})
        x, q = recording.described_pose(name)
        turn = None if q is None else q[k]
        yield Outline(name, own.get("shape") or {}, lifted(x, d)[k], turn, True, is_fixed(own))
