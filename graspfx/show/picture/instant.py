"""Geometry of a scene at one instant of a recording, common to all kinds of drawing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import GraspFXError, InputError, RecordingError, abbreviate
from graspfx.numeric import finite
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
    """Shape and pose of an object or an obstacle.

    Attributes:
        name: Name in the scene.
        shape: Table that describes the shape; empty for an object without a shape.
        position: Position of the origin of the shape's frame (d,) [m].
        orientation: Angle [rad] in the plane, quaternion x, y, z, w in space; None for no rotation.
        is_object: Whether the outline belongs to an object; otherwise it belongs to an obstacle.
        fixed: Whether the object or obstacle cannot move.
    """

    name: str
    shape: Table
    position: FloatArray
    orientation: Any
    is_object: bool
    fixed: bool

    @property
    def endless(self) -> bool:
        """Whether the shape is a plane or a half-space, which have infinite surfaces."""
        return self.shape.get("kind") in ENDLESS


def lifted(values: FloatArray, dimensions: int) -> FloatArray:
    """Append zeros to vectors (..., d) so that they have `dimensions` entries."""
    missing = dimensions - values.shape[-1]
    return np.asarray(np.concatenate([values, np.zeros((*values.shape[:-1], missing))], axis=-1)) if missing else values


def object_tables(table: Table) -> dict[str, Table]:
    """Return the tables of a scene's objects by the objects' names."""
    return {each.get("name", "object"): each for each in _listed(table, "object") if isinstance(each, Mapping)}


def is_fixed(own: Table) -> bool:
    """Return whether all degrees of freedom in an object's table are locked."""
    free = own.get("free")
    return free is not None and not any(free)


def obstacles(table: Table, dimensions: int, notes: list[str]) -> Iterator[Outline]:
    """Yield the outline of each obstacle of a scene; for an obstacle without a shape, add its name to `notes`."""
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
    """Build the surface of each outline.

    An object without a shape becomes a small sphere. This sphere and the drawn part of an infinite surface are scaled
    to the size of the finite shapes and the fingertips.

    Args:
        outlines: Shapes with their poses.
        tips: Positions of fingertips (k, d) [m].
        dimensions: Number of dimensions d, 2 or 3.
        folder: Folder to which relative paths of meshes refer.
        notes: List of messages; for each shape that cannot be drawn, the reason is appended.

    Returns:
        Pairs of an outline and its surface in the shape's frame; lower and upper corner (2, d) of the box around all
        finite shapes and fingertips [m]; and the distance between the two corners [m].
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
    """Return the radii of a scene's fingertips (n,) [m]; the radius of a point fingertip is zero."""
    radii = [float(each.get("radius") or 0.0) for each in _listed(table, "finger") if isinstance(each, Mapping)]
    return np.array(radii if len(radii) == count else [0.0] * count)


def apart_on_a_line(count: int) -> FloatArray:
    """Return offsets (n,) across a line at which to draw n fingers; neighbouring offsets differ by 1."""
    return np.asarray(0.5 * (count - 1) - np.arange(count))


def colours_of(names: Sequence[str], movable: Sequence[str]) -> list[str]:
    """Return a colour for each name: movable objects repeat the colours in `THINGS`, all others get `FIXED`."""
    return [THINGS[movable.index(name) % len(THINGS)] if name in movable else FIXED for name in names]


def slid(surface: Surface, middle: FloatArray) -> Surface:
    """Translate the drawn part of an infinite surface along the surface to the point nearest to `middle`."""
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
    """Return the tables under a key as a sequence, also if the key contains a single table."""
    tables = table.get(key, ())
    return tables if isinstance(tables, list | tuple) else [tables]


@dataclass(frozen=True)
class Thing:
    """An object or an obstacle, with its surface in the world frame.

    Attributes:
        name: Name in the scene.
        surface: Surface in the world frame; of an infinite surface, the drawn part.
        fixed: Whether it is an obstacle, or an object that cannot move.
        endless: Whether the surface is that of a plane or a half-space.
        path: Positions of the object from the start to the drawn instant (k, d) [m]; of an obstacle, its position
            (1, d).
    """

    name: str
    surface: Surface
    fixed: bool
    endless: bool
    path: FloatArray


@dataclass(frozen=True)
class Instant:
    """State of a scene at one instant, prepared for drawing.

    Attributes:
        dimensions: Number of dimensions d of the drawing, 2 or 3; a scene on a line is drawn in the plane.
        on_a_line: Whether the scene is on a line.
        time: Time of the instant [s].
        extent: Diagonal of the box around all finite shapes and fingertips [m].
        middle: Centre of this box (d,) [m].
        things: Objects and obstacles.
        names: Names of the n fingers that have finite positions.
        tips: Positions of the fingertips (n, d) [m].
        radii: Radii of the fingertips (n,) [m]; zero for a point fingertip.
        contacts: Contact points (n, d) [m]; if the fingers are attached to the object, positions of the fingertips.
        forces: Forces of the fingers on their objects (n, d) [N].
        parts: Internal and external parts of `forces`, each (n, d) [N], zero for a free finger; None if the recording
            does not contain them.
        touching: Mask of touching fingers (n,).
        paths: Positions of the fingertips from the start to the drawn instant (k, n, d) [m].
        title: Title of the scene.
        notes: Messages about parts of the scene that are not drawn.
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
    """Return the state of a scene at one instant of a recording.

    Args:
        recording: Recording with at least one tick.
        time: Time of the instant [s]. If None, the instant is the tick with the largest sum of the magnitudes of the
            forces among the ticks with the most touching fingers; if all forces are zero, it is the last tick.
        folder: Folder to which relative paths of meshes refer; by default the scene's folder.

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
    at = finite("time", time, expected)
    k = round(float(at) / recording.row_period) if at.ndim == 0 else -1
    if not 0 <= k < N:
        raise InputError("time", time, expected)
    return k


def _objects(recording: Recording, table: Table, k: int, d: int) -> Iterator[Outline]:
    """Yield the outline of each object, in the frame in which the scene describes the object's shape, at tick k."""
    tables = object_tables(table)
    for name in recording.objects if not recording.header.has_host else ():
        own = tables.get(name, {})
        x, q = recording.described_pose(name)
        turn = None if q is None else q[k]
        yield Outline(name, own.get("shape") or {}, lifted(x, d)[k], turn, True, is_fixed(own))
