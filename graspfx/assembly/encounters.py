"""Encounters of a scene: which objects and obstacles meet, and how the plan says it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from graspfx.assembly import bodies
from graspfx.assembly.stock import Stock
from graspfx.objects.dynamics_table import MEETING, dynamics_of
from graspfx.objects.surroundings import Obstacle, place_obstacle

if TYPE_CHECKING:
    from graspfx.scene.tables.part_tables import Object
    from graspfx.scene.tables.scene_table import SceneTable

Location = tuple[str | int, ...]
Finding = tuple[Location, str]


def moves(scene: SceneTable, thing: Object) -> bool:
    """Tell whether any freedom of an object is free."""
    return any(scene.free(thing))


def collide(scene: SceneTable) -> bool:
    """Tell whether objects that share a world meet one another."""
    return scene.world.collide if scene.world.collide is not None else scene.dimensions == 3


def groups(scene: SceneTable) -> list[list[int]]:
    """List the objects that are moved together, by number: natively each alone, otherwise those of a world."""
    groups_: list[list[int]] = []
    for i, thing in enumerate(scene.object):
        mates = [group for group in groups_ if scene.object[group[0]].dynamics == thing.dynamics != "native"]
        if mates and (scene.obstacle or collide(scene)):
            mates[0].append(i)
        else:
            groups_.append([i])
    return groups_


def in_world(scene: SceneTable, group: Sequence[int]) -> bool:
    """Tell whether the objects of a group meet anything: an obstacle, or one another."""
    things = [scene.object[i] for i in group]
    if scene.obstacle:
        return any(thing.shape is not None and moves(scene, thing) for thing in things)
    return len(group) > 1


def obstacles(scene: SceneTable, stock: Stock) -> list[Obstacle]:
    """Put the scene's obstacles in their places."""
    solids = [stock.solid(("obstacle", i), table) for i, table in enumerate(scene.obstacle)]
    return [
        place_obstacle(table.name, solid.shape, scene.dimensions, *bodies.place(table, solid))
        for table, solid in zip(scene.obstacle, solids, strict=True)
    ]


def meeting(scene: SceneTable, thing: Object) -> tuple[bool, str]:
    """Tell whether an object meets anything, and what and how."""
    if thing.shape is None:
        return False, "it has no shape: it meets nothing"
    if not moves(scene, thing) and thing.dynamics == "native":
        return False, "every freedom is locked: nothing moves it, and native objects pass through it"
    names = ", ".join(table.name for table in scene.obstacle)
    law = f"friction {scene.world.friction:g}"
    if thing.dynamics == "native":
        passes = len(scene.object) > 1
        others = f"; it passes through other objects (dynamics = {MEETING} meets them)" if passes else ""
        if not scene.obstacle:
            return False, f"there are no obstacles{others}"
        law += f", {scene.world.stiffness:g} N/m a point"
        return True, f"{names}, {law}; {_points(thing)}{others}"
    group = next(group for group in groups(scene) if thing in [scene.object[i] for i in group])
    if not in_world(scene, group):
        alone = "" if len(scene.object) == 1 else "; it passes through other objects"
        return False, f"there are no obstacles{alone}"
    mates = [scene.object[i].name for i in group if scene.object[i] is not thing] if collide(scene) else []
    met = ", ".join([*([names] if names else []), *mates])
    engine = dynamics_of(thing.dynamics)
    shape = "; as its convex hull" if thing.shape.kind in engine.hulls else ""
    return True, f"{met}, {law}, restitution {scene.world.restitution:g}, in one {engine.label} world{shape}"


def _points(thing: Any) -> str:
    texts = {
        "box": "with its corners",
        "sphere": "with its lowest point",
        "ellipsoid": "with its lowest point",
        "capsule": "with the lowest points of its ends",
        "cylinder": "with its rims, eight fixed points each and the lowest",
        "mesh": "with the corners of its convex hull, nine at most on each plane",
    }
    return texts.get(thing.shape.kind, "with its lowest points")
