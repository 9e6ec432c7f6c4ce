"""Guards of a scene's hardware: those of its table `safety`, where it has one, else the usual ones."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from graspfx.loop.realtime.guards import GUARDS, Guards

if TYPE_CHECKING:
    from graspfx.scene.tables.scene_table import SceneTable


DECAY = 0.02  # over which a safety chain takes forces away [s]


def guards_of(scene: SceneTable) -> Guards:
    """Give the guards of a scene's hardware.

    Where forces decay by themselves, when readings stop or a finger is too quick, they are given the time to.
    """
    table = getattr(scene, "safety", None)
    values: dict[str, Any] = {}
    if (soft_start := getattr(table, "soft_start", None)) is not None:
        values["soft_start"] = soft_start
    if (speed := getattr(table, "speed", None)) is not None:
        values["speed"] = max(GUARDS.speed, 2.0 * speed)
    if (hold := getattr(table, "hold", None)) is not None:
        values["hold"] = hold + math.ceil(DECAY / scene.period)
    if (watchdog := getattr(table, "watchdog", None)) is not None:
        values["late"] = max(1, round(watchdog / scene.period))
    return replace(GUARDS, **values)
