"""What of a scene meets what: objects, obstacles and one another; its faults, and how the plan says it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from graspfx.errors import InputError
from graspfx.objects.kernels import SIZE
from graspfx.objects.surroundings import Obstacle, placed
from graspfx.scene import bodies
from graspfx.scene.fields import NotValid
from graspfx.scene.parts import Object, SceneTable

Location = tuple[str | int, ...]
Found = tuple[Location, str]

FLAT = ("half-space", "plane")
DEEP = 1e-5  # how far inside an obstacle an object may start [m]: what is more is no rounding, nor its weight's sinking


def moves(scene: SceneTable, thing: Object) -> bool:
    """Whether any freedom of an object is free."""
    return any(scene.free(thing))


def collide(scene: SceneTable) -> bool:
    """Whether objects that share a world meet one another."""
    return scene.world.collide if scene.world.collide is not None else scene.dimensions == 3


def groups(scene: SceneTable) -> list[list[int]]:
    """The objects that are moved together, by number: natively each alone, otherwise those of a world."""
    found: list[list[int]] = []
    for i, thing in enumerate(scene.object):
        mates = [group for group in found if scene.object[group[0]].dynamics == thing.dynamics != "native"]
        if mates and (scene.obstacle or collide(scene)):
            mates[0].append(i)
        else:
            found.append([i])
    return found


def in_world(scene: SceneTable, group: Sequence[int]) -> bool:
    """Whether the objects of a group meet anything: an obstacle, or one another."""
    things = [scene.object[i] for i in group]
    if scene.obstacle:
        return any(thing.shape is not None and moves(scene, thing) for thing in things)
    return len(group) > 1


def obstacles(scene: SceneTable, folder: Path | None) -> list[Obstacle]:
    """The scene's obstacles in their places."""
    return [
        placed(table.name, bodies.make_shape(table, folder), scene.dimensions, *bodies.place(table, folder))
        for table in scene.obstacle
    ]


def faults(scene: SceneTable, folder: Path | None, known: Sequence[Found]) -> Iterator[Found]:
    """What objects cannot meet, or not with these dynamics; nothing where an object or obstacle has its own fault."""
    if any(at[:1] in (("object",), ("obstacle",), ("world",), ("gravity",)) for at, _ in known):
        return
    yield from _together(scene)
    if not scene.obstacle:
        return
    native = [thing.name for thing in scene.object if _meets(scene, thing, "native")]
    for i, table in enumerate(scene.obstacle):
        if native and table.shape.kind not in FLAT:
            yield (
                ("obstacle", i, "shape", "kind"),
                f"{', '.join(native)} with native dynamics can meet a half-space or a plane, not a {table.shape.kind}; "
                "dynamics = 'bullet' meets any",
            )
    if native and scene.world.restitution > 0.0:
        yield (
            ("world", "restitution"),
            f"{', '.join(native)} with native dynamics does not bounce: expected 0; dynamics = 'bullet' does",
        )
    for i, thing in enumerate(scene.object):
        if thing.shape is not None and thing.shape.kind in FLAT and moves(scene, thing):
            yield (
                ("object", i, "shape", "kind"),
                f"a {thing.shape.kind} has no end: among obstacles lock its freedoms, or make it an [[obstacle]]",
            )
        elif thing.shape is not None and moves(scene, thing):
            yield from _inside(scene, i, thing, folder)


def _together(scene: SceneTable) -> Iterator[Found]:
    if scene.world.collide and len(scene.object) > 1:
        for i, thing in enumerate(scene.object):
            if thing.dynamics == "native" and moves(scene, thing):
                yield ("object", i, "dynamics"), "native objects meet no other object; world.collide needs 'bullet'"
    wanted = bool(scene.world.collide)
    for group in groups(scene):
        if not in_world(scene, group):
            continue
        for i in group:
            thing = scene.object[i]
            if thing.dynamics != "bullet":
                continue
            if scene.dimensions != 3:
                what = "world.collide" if wanted and not scene.obstacle else "obstacles"
                yield (
                    ("object", i, "dynamics"),
                    f"a PyBullet world is in space, not in {scene.dimensions} dimension(s): {what} need dimensions = 3"
                    + ("" if what == "world.collide" else ", or dynamics = 'native' and half-spaces or planes"),
                )
            elif thing.shape is not None and moves(scene, thing) and not all(scene.free(thing)):
                yield (
                    ("object", i, "free"),
                    "PyBullet locks no single freedom of a body that meets others: expected all free or none; "
                    "dynamics = 'native' on half-spaces and planes, or world.collide = false without obstacles",
                )


def _meets(scene: SceneTable, thing: Object, dynamics: str) -> bool:
    return thing.dynamics == dynamics and thing.shape is not None and moves(scene, thing)


def _inside(scene: SceneTable, i: int, thing: Object, folder: Path | None) -> Iterator[Found]:
    """Where a shape begins below a half-space or across a plane; other pairs would need a search."""
    from graspfx.objects.floor import clearance

    state = np.zeros(SIZE)
    try:
        bodies.fill(scene, thing, state, folder)
        shape = bodies.make_shape(thing, folder)
        for table, obstacle in zip(scene.obstacle, obstacles(scene, folder), strict=True):
            if table.shape.kind in FLAT:
                height = clearance(shape, scene.dimensions, state, obstacle)
                if height < -DEEP:
                    yield (
                        ("object", i, "position"),
                        f"the object starts {-1e3 * height:.4g} mm inside the obstacle {table.name!r}: expected its "
                        "lowest point on or above it",
                    )
    except (InputError, NotValid):
        return  # has a fault of its own


# What the plan says ---------------------------------------------------------------------------------------------------


def meeting(scene: SceneTable, thing: Object) -> tuple[bool, str]:
    """Whether an object meets anything, and what and how."""
    if thing.shape is None:
        return False, "it has no shape: it meets nothing"
    if not moves(scene, thing) and thing.dynamics == "native":
        return False, "every freedom is locked: nothing moves it, and native objects pass through it"
    names = ", ".join(table.name for table in scene.obstacle)
    law = f"friction {scene.world.friction:g}"
    if thing.dynamics == "native":
        others = "" if len(scene.object) == 1 else "; it passes through other objects (dynamics = 'bullet' meets them)"
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
    shape = "; as its convex hull" if thing.shape.kind in ("ellipsoid", "mesh") else ""
    engine = "PyBullet" if thing.dynamics == "bullet" else thing.dynamics
    return True, f"{met}, {law}, restitution {scene.world.restitution:g}, in one {engine} world{shape}"


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
