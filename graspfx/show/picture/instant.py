"""Geometry of a scene at one instant of a recording, common to all kinds of drawing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import GraspFXError, InputError, RecordingError, abbreviate
from graspfx.show.picture.surfaces import Surface, surface

if TYPE_CHECKING:
    from graspfx.recording.record import Recording

FloatArray = NDArray[np.float64]
Table = Mapping[str, Any]

ENDLESS = ("plane", "half-space")
PATCH = 1.15  # size of an infinite plane, as a fraction of the extent
LEAST = 1e-3  # extent of a scene whose points coincide [m]
DOT = 0.03  # drawn radius of an object without a shape, as a fraction of the extent
APART = 0.14  # distance of fingers across a line without shapes, as a fraction of the extent
TIP = 0.016  # drawn radius of a point fingertip, as a fraction of the extent
THINGS = ("#c3d2e0", "#e3d3b4", "#cfdcc4", "#dccbdc")  # colours of objects in turn
FIXED, EDGE = "#d5d2cc", "#4a4f55"


class Obstacle(NamedTuple):
    """An obstacle: its name, the table of its shape (None if it has no shape), and its pose."""

    name: str
    shape: Table | None
    position: FloatArray
    orientation: Any


def lifted(values: FloatArray, dimensions: int) -> FloatArray:
    """Extend vectors on a line or in the plane to the plane or to space."""
    missing = dimensions - values.shape[-1]
    return np.asarray(np.concatenate([values, np.zeros((*values.shape[:-1], missing))], axis=-1)) if missing else values


def object_tables(table: Table) -> dict[str, Table]:
    """List the tables of a scene's objects by their names."""
    return {each.get("name", "object"): each for each in _listed(table, "object") if isinstance(each, Mapping)}


def is_fixed(own: Table) -> bool:
    """Tell whether all degrees of freedom in an object's table are locked."""
    free = own.get("free")
    return free is not None and not any(free)


def obstacles(table: Table, dimensions: int) -> Iterator[Obstacle]:
    """List a scene's obstacles, in space or in the plane."""
    for i, each in enumerate(_listed(table, "obstacle")):
        if not isinstance(each, Mapping):
            yield Obstacle(f"obstacle{i}", None, np.zeros(dimensions), None)
            continue
        shape = each.get("shape")
        place = lifted(np.asarray(each.get("position") or np.zeros(dimensions), dtype=float), dimensions)
        name = each.get("name", f"obstacle{i}")
        yield Obstacle(name, shape if isinstance(shape, Mapping) else None, place, each.get("orientation"))


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
        contacts: Points where forces act (n, d) [m].
        forces: Forces on the object (n, d) [N].
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
        time: Time [s]; by default the time with most touching fingers and the largest sum of forces, or the end.
        folder: Folder of relative mesh paths; by default the scene's folder.

    Raises:
        InputError: If the recording has no ticks, or the time is outside the recording.
    """
    k = _tick(recording, time)
    d = max(recording.layout.dimensions, 2)
    folder = folder or Path(recording.header.scene_folder)
    notes: list[str] = []
    tips = lifted(_tips(recording), d)  # (N, n, d)
    finite = np.isfinite(tips[k]).all(axis=1)
    if not finite.all():
        notes.append("fingers without finite positions are omitted")
    table = recording.header.scene_table
    radii = fingertip_radii(table, len(recording.layout.fingers))
    described = [each for each in _described(recording, table, k, d, notes) if np.isfinite(each[2]).all()]
    bounded = [
        thing
        for each in described
        if each[1] and each[1].get("kind") not in ENDLESS
        for thing in _things(*each, d, LEAST, folder, notes)
    ]
    points = [each[2][None] for each in described if not each[1]]
    corners = np.concatenate([*(thing.surface.vertices for thing in bounded), *points, tips[k][finite]])
    ends = np.array([corners.min(axis=0), corners.max(axis=0)]) if len(corners) else np.zeros((2, d))
    extent = max(float(np.linalg.norm(ends[1] - ends[0])), LEAST)
    middle = ends.mean(axis=0)
    dot = {"kind": "sphere", "radius": DOT * extent}
    bounded += [
        thing
        for each in described
        if not each[1]
        for thing in _things(each[0], dot, *each[2:], d, extent, folder, notes)
    ]
    endless = [
        replace(thing, surface=slid(thing.surface, middle))
        for each in described
        if each[1] and each[1].get("kind") in ENDLESS
        for thing in _things(*each, d, PATCH * extent, folder, notes)
    ]
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
        extent=extent, middle=middle, things=[*endless, *bounded],
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
    k = round(time / recording.row_period) if np.isfinite(time) else -1
    if not 0 <= k < N:
        raise InputError("time", time, f"a time from 0 to {recording.time[-1]:g} s, within the recording")
    return k


def _tips(recording: Recording) -> FloatArray:
    true = recording.true_position
    return recording.finger_position if true is None else true


Described = tuple[str, Mapping[str, Any], FloatArray, Any, bool, FloatArray]  # name, shape, x, q, fixed, path


def _described(recording: Recording, table: Mapping[str, Any], k: int, d: int, notes: list[str]) -> Iterator[Described]:
    by_name = object_tables(table)
    for name, motion in recording.objects.items():
        own = by_name.get(name, {})
        shape = own.get("shape") or {}
        x, q = _pose(recording, name)
        path = lifted(motion.position, d)[: k + 1]
        yield name, shape, lifted(x, d)[k], None if q is None else q[k], is_fixed(own), path
    for each in obstacles(table, d):
        if each.shape is None:
            notes.append(f"{each.name} has no shape to draw")
            continue
        yield each.name, each.shape, each.position, each.orientation, True, each.position[None, :]


def _pose(recording: Recording, name: str) -> tuple[FloatArray, FloatArray | None]:
    """Return the pose over time of the frame in which a scene describes a shape, or else of the object."""
    describe = getattr(recording, "described_pose", None)
    if describe is not None:
        position, orientation = describe(name)
        return position, orientation
    motion = recording.objects[name]
    return motion.position, motion.orientation


def _things(
    name: str, shape: Mapping[str, Any], x: FloatArray, q: Any, fixed: bool, path: FloatArray,
    d: int, extent: float, folder: Path | None, notes: list[str],
) -> Iterator[Thing]:  # fmt: skip
    try:
        solid = surface(shape, d, extent, folder).placed(x, q)
    except GraspFXError as error:
        notes.append(f"{name} is not drawn: {abbreviate(str(error), 300)}")
        return
    yield Thing(name, solid, fixed, shape.get("kind") in ENDLESS, path)
