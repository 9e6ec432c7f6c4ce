"""Values of a scene that look as if they were in millimetres, grams or degrees."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from graspfx.build.holdings import holdings
from graspfx.build.resolve import resolve
from graspfx.scene.model import Scene
from graspfx.scene.tables.hands import MadeHand, Reach, SharedMadeHand, Step, TurnReach
from graspfx.scene.tables.reading import listed

FARTHEST = 5.0  # [m]: of a finger from its object at first, and of a reach: more than an arm
LARGEST = 0.1  # [m]: a fingertip's radius, and a squeeze
TURN = 4.0 * np.pi  # [rad]: two whole turns of a wrist
HEAVIEST = 100.0  # [kg]


def unit_notes(scene: Scene) -> list[str]:
    """Write a sentence for each such value, by its key."""
    return [f"{key} = {value:g} {unit}: check the unit" for key, value, unit in _suspects(scene)]


def _suspects(scene: Scene) -> Iterator[tuple[str, float, str]]:
    start = resolve(scene).start
    for i, finger in enumerate(scene.finger):
        thing = scene.object[scene.finger_objects[i]]
        away = start[i] - np.array(thing.position or 0.0)
        if np.linalg.norm(away) > FARTHEST:
            yield f"finger.{i}.start from its object", float(np.linalg.norm(away)), "m"
        if finger.radius > LARGEST:
            yield f"finger.{i}.radius", finger.radius, "m"
        if finger.pad is not None and finger.pad.stiffness * LARGEST**1.5 < 1.0:  # deeper than that at 1 N
            yield f"finger.{i}.pad.stiffness", finger.pad.stiffness, "N/m^1.5"
    for i, thing in enumerate(scene.object):
        if thing.mass is not None and thing.mass > HEAVIEST:
            yield f"object.{i}.mass", thing.mass, "kg"
    for holding in holdings(scene):
        table, at = holding.table, ".".join(map(str, holding.at))
        if table is None or isinstance(table, MadeHand | SharedMadeHand):
            continue
        squeezes = [each.to if isinstance(each, Step) else each for each in listed(table.squeeze)]
        yield from ((f"{at}.squeeze", each, "m") for each in squeezes if abs(each) > LARGEST)
        reaches = [np.linalg.norm(each.displacement) for each in listed(table.motion) if isinstance(each, Reach)]
        yield from ((f"{at}.motion.displacement", float(each), "m") for each in reaches if each > FARTHEST)
        turns = [each for each in listed(table.turn) if isinstance(each, TurnReach)]
        yield from ((f"{at}.turn.angle", each.angle, "rad") for each in turns if abs(each.angle) > TURN)
