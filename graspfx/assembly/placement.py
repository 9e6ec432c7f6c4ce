"""Fingers that start on the way in to their object: a direction and a gap in the place of coordinates."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from graspfx.assembly.bodies import place
from graspfx.assembly.stock import Stock
from graspfx.errors import GraspFXError, abbreviate
from graspfx.objects.surroundings import place_obstacle
from graspfx.surfaces.standoff import standoff

if TYPE_CHECKING:
    from graspfx.scene.tables.scene_table import SceneTable

Point = tuple[float, ...]
Location = tuple[str | int, ...]
Finding = tuple[Location, str]


def start_of(scene: SceneTable, i: int, stock: Stock) -> Point | None:
    """Give where finger i starts, (d,) [m]; None where its table leads to no place, which is a fault.

    A table names a direction from the object's centre of mass, in world axes, with the object where it is at first.
    From far out the fingertip comes in along it, and starts where its gap to the object is what the table asks for.
    """
    start = scene.finger[i].start
    if isinstance(start, tuple):
        return start
    if i not in stock.starts:
        stock.starts[i] = _placed(scene, i, stock)
    return stock.starts[i]


def placement_faults(scene: SceneTable, i: int, stock: Stock) -> Iterator[Finding]:
    """Find why a finger has no place on the way in to its object."""
    start, at = scene.finger[i].start, ("finger", i, "start")
    if isinstance(start, tuple):
        return
    if not any(start.toward):
        yield (*at, "toward"), "expected a direction; given zeros"
        return
    thing = scene.object[scene.finger_objects[i]]
    if thing.shape is None:
        yield at, f"expected coordinates: {thing.name!r} has no shape to start from"
        return
    with suppress(GraspFXError):  # a shape with a fault of its own
        if start_of(scene, i, stock) is None:
            along = abbreviate(list(start.toward))
            yield (
                (*at, "toward"),
                f"{thing.name!r} has no surface along {along} from its centre; choose another direction",
            )


def _placed(scene: SceneTable, i: int, stock: Stock) -> Point | None:
    finger, number = scene.finger[i], scene.finger_objects[i]
    start, table = finger.start, scene.object[number]
    assert not isinstance(start, tuple)
    solid = stock.solid(("object", number), table)
    if solid.shape is None:
        return None
    d = scene.dimensions
    pose = place_obstacle(table.name, solid.shape, d, *place(table, solid))
    u = np.array(start.toward, dtype=float)
    u /= np.linalg.norm(u / np.abs(u).max()) * np.abs(u).max()  # of any length: its square may be too large
    t = standoff(solid.shape, pose.rotation[:d, :d].T @ u, start.gap + finger.radius)
    if t is None:
        return None
    point: Point = tuple((pose.position[:d] + t * u).tolist())
    return point
