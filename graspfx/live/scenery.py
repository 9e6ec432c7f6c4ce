"""Static content of a 3-D view of a scene: triangles of objects and obstacles, and size and colour of fingertips."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.show.picture.instant import (
    APART,
    TIP,
    Outline,
    colours_of,
    fingertip_radii,
    is_fixed,
    lifted,
    object_tables,
    obstacles,
    slid,
    solids,
)
from graspfx.show.picture.surfaces import Surface
from graspfx.show.style import FINGERS

if TYPE_CHECKING:
    from graspfx.loop.columns import Layout
    from graspfx.recording.header import Header

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Table = Mapping[str, Any]

SLAB = 0.16  # thickness of planar objects, as a share of the extent


@dataclass(frozen=True)
class Solid:
    """Triangles of an object or an obstacle.

    Attributes:
        name: Name of the object or obstacle in the scene.
        vertices: Vertices (v, 3) [m], for an object in the frame whose pose is in `Frames.poses`, for an obstacle in
            the world frame.
        faces: Indices of the vertices of each triangle (f, 3), counter-clockwise as seen from outside.
        colour: Colour as "#rrggbb".
        object: Name of the object; None for an obstacle.
        endless: Whether the triangles are a part of an infinite plane or half-space; they are visible from both sides.
    """

    name: str
    vertices: FloatArray
    faces: IntArray
    colour: str
    object: str | None
    endless: bool


@dataclass(frozen=True)
class Scenery:
    """Static content of a view of a scene.

    Attributes:
        solids: Objects and obstacles.
        fingers: Names of the fingers.
        colours: Colours of the fingers, as in figures.
        radii: Radii with which the fingertips are drawn (n,) [m].
        is_ball: Whether each fingertip is a ball in the scene; other fingertips are points (n,).
        extent: Initial size of the scene without infinite surfaces [m].
        middle: Initial centre of the scene (3,) [m].
        up: Unit vector that is drawn upwards (3,): z in a three-dimensional scene, otherwise y.
        apart: Lateral distance at which fingers of a one-dimensional scene are drawn [m].
        notes: Message for each shape that could not be drawn.
    """

    solids: tuple[Solid, ...]
    fingers: tuple[str, ...]
    colours: tuple[str, ...]
    radii: FloatArray
    is_ball: NDArray[np.bool_]
    extent: float
    middle: FloatArray
    up: FloatArray
    apart: float
    notes: tuple[str, ...]


def scenery(header: Header, layout: Layout, folder: Path | None = None) -> Scenery:
    """Make the scenery of a run or of a recording.

    Args:
        header, layout: Header and layout of the run or recording.
        folder: Folder to which mesh paths are relative; None for the scene's folder.
    """
    folder, table = folder or Path(header.scene_folder), header.scene_table
    d, n, notes = max(layout.dimensions, 2), len(layout.fingers), list[str]()
    outlines, starts = [*_objects(table, layout.objects, d), *obstacles(table, d, notes)], _starts(table, d)
    built, ends, extent = solids(outlines, starts, d, folder, notes)
    centre = ends.mean(axis=0)
    colours = colours_of([each.name for each, _ in built], [each.name for each in outlines if not each.fixed])
    placed = [_solid(*one, colour, d, extent, centre) for one, colour in zip(built, colours, strict=True)]
    radii = fingertip_radii(table, n)
    return Scenery(
        solids=tuple(placed), fingers=tuple(layout.fingers), colours=tuple(FINGERS[i % len(FINGERS)] for i in range(n)),
        radii=np.where(radii > 0.0, radii, TIP * extent), is_ball=radii > 0.0, extent=extent, middle=lifted(centre, 3),
        up=np.eye(3)[2 if layout.dimensions == 3 else 1],
        apart=APART * extent if layout.dimensions == 1 and not layout.gaps else 0.0, notes=tuple(notes),
    )  # fmt: skip


def _objects(table: Table, names: Sequence[str], d: int) -> Iterator[Outline]:
    tables = object_tables(table)
    for name in names:
        own = tables.get(name, {})
        x = lifted(np.asarray(own.get("position") or np.zeros(d), dtype=float), d)
        yield Outline(name, own.get("shape") or {}, x, own.get("orientation"), True, is_fixed(own))


def _starts(table: Table, d: int) -> FloatArray:
    """Return the initial positions of the k fingers whose `start` is set in the scene (k, d) [m]."""
    tables = table.get("finger", ())
    starts = [each.get("start") for each in tables if isinstance(each, Mapping)]
    places = [lifted(np.asarray(start, dtype=float), d) for start in starts if start is not None]
    return np.array(places).reshape(-1, d)


def _solid(each: Outline, built: Surface, colour: str, d: int, extent: float, middle: FloatArray) -> Solid:
    if not each.is_object:
        built = built.placed(each.position, each.orientation)
        built = slid(built, middle) if each.endless else built
    built = slab(built, SLAB * extent) if d == 2 else built
    return Solid(each.name, built.vertices, built.faces, colour, each.name if each.is_object else None, each.endless)


def slab(outline: Surface, thickness: float) -> Surface:
    """Extrude a convex outline in the x-y plane to a slab that is centred on this plane."""
    v = outline.vertices
    a, b = v, np.roll(v, -1, axis=0)
    if float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()) < 0.0:
        v = v[::-1]  # counter-clockwise
    m = len(v)
    front, back = (np.column_stack([v, np.full(m, z)]) for z in (0.5 * thickness, -0.5 * thickness))
    i = np.arange(m)
    j, fan = (i + 1) % m, np.arange(1, m - 1)
    first = np.zeros_like(fan)
    faces = np.concatenate([
        np.column_stack([first, fan, fan + 1]),
        np.column_stack([first, fan + 1, fan]) + m,
        np.column_stack([i + m, j + m, j]), np.column_stack([i + m, j, i]),
    ])  # fmt: skip
    return Surface(np.concatenate([front, back]), faces)
