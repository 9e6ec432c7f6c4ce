"""Objects, obstacles and fingertips as a scene's tables describe them: what every way of drawing them shares."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.show.picture.surfaces import Surface

FloatArray = NDArray[np.float64]
Table = Mapping[str, Any]

ENDLESS = ("plane", "half-space")
PATCH = 1.15  # of an endless plane, as a share of the extent
LEAST = 1e-3  # [m]: extent of a scene whose points coincide
DOT = 0.03  # radius at which an object without a shape is drawn, as a share of the extent
APART = 0.14  # from finger to finger across the line, where no shape keeps them apart, as a share of the extent
TIP = 0.016  # radius at which a fingertip that is a point is drawn, as a share of the extent
THINGS = ("#c3d2e0", "#e3d3b4", "#cfdcc4", "#dccbdc")  # colours of objects in turn
FIXED, EDGE = "#d5d2cc", "#4a4f55"


class Obstacle(NamedTuple):
    """An obstacle: its name, the table of its shape, None where it has none, and where that is."""

    name: str
    shape: Table | None
    position: FloatArray
    orientation: Any


def lifted(values: FloatArray, dimensions: int) -> FloatArray:
    """Lift vectors on a line or in the plane into the plane or into space."""
    missing = dimensions - values.shape[-1]
    return np.asarray(np.concatenate([values, np.zeros((*values.shape[:-1], missing))], axis=-1)) if missing else values


def object_tables(table: Table) -> dict[str, Table]:
    """List the tables of a scene's objects by their names."""
    return {each.get("name", "object"): each for each in _listed(table, "object") if isinstance(each, Mapping)}


def is_fixed(own: Table) -> bool:
    """Tell whether the table of an object leaves it no direction in which it is free."""
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
    """Set fingers apart across a line, (n,), as shares of the distance from one to the next."""
    return np.asarray(0.5 * (count - 1) - np.arange(count))


def colours_of(names: Sequence[str], movable: Sequence[str]) -> list[str]:
    """Colour objects and obstacles: those that move in turn, the others alike."""
    return [THINGS[movable.index(name) % len(THINGS)] if name in movable else FIXED for name in names]


def slid(surface: Surface, middle: FloatArray) -> Surface:
    """Slide a piece of an endless surface to where it is nearest to the middle."""
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
    """List the tables of a key, which may be a single one."""
    tables = table.get(key, ())
    return tables if isinstance(tables, list | tuple) else [tables]
