"""Guards of a scene's hardware: those of its table `safety`, where it has one, else the usual ones."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from graspfx.assembly.safety_limits import chain_table
from graspfx.loop.realtime.readings import GUARDS, Guards
from graspfx.loop.safety.trust import DECAY

if TYPE_CHECKING:
    from graspfx.assembly.resolve import Parts


def guards_of(parts: Parts) -> Guards:
    """Give the guards of a scene's hardware.

    Where forces decay by themselves, when readings stop or a finger is too quick, they are given the time to.
    """
    table = chain_table(parts.scene, parts.wires)
    if table is None:
        return GUARDS
    period = parts.scene.period
    values: dict[str, Any] = {"soft_start": table.soft_start, "hold": table.hold + math.ceil(DECAY / period)}
    if table.speed is not None:
        values["speed"] = max(GUARDS.speed, 2.0 * table.speed)
    if table.watchdog is not None:
        values["late"] = max(1, round(table.watchdog / period))
    return replace(GUARDS, **values)
