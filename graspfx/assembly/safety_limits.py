"""The limits of a scene's safety chain, finger by finger: its own, the scene's, or what its device tells.

A person holds the device: forces, their growth and speeds that a scene states are those at the device. In the scene
they are as much smaller or larger as its frame makes them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.wiring import Wire
from graspfx.loop.device import is_hardware
from graspfx.loop.safety.chain import SafetyLimits

if TYPE_CHECKING:
    from graspfx.scene.model import Scene
    from graspfx.scene.tables.safety_table import Safety

FloatArray = NDArray[np.float64]

CONTINUOUS = 0.6  # of a device's continuous force may be displayed
DEFAULT = 3.0  # of a finger whose device tells none [N]


def chain_table(scene: Scene, wired: Sequence[Wire]) -> Safety | None:
    """Give the table of a scene's safety chain; with hardware a scene without one has the usual values.

    None for a simulation without the table.
    """
    if scene.safety is not None or not any(is_hardware(wire.device) for wire in wired):
        return scene.safety
    from graspfx.scene.tables.safety_table import Safety  # a scene from the cache goes without what checks tables

    return Safety()


def safety_limits(scene: Scene, wired: Sequence[Wire]) -> SafetyLimits | None:
    """Give the limits of all fingers; None for a scene without a safety chain."""
    table = chain_table(scene, wired)
    if table is None:
        return None
    n, d = len(scene.finger), scene.dimensions
    lower, upper = np.full((n, d), -np.inf), np.full((n, d), np.inf)
    force, scale = np.full(n, DEFAULT), np.ones(n)
    for wire in wired:
        scale[wire.used] = wire.fitting.scale
        for f in wire.used.tolist():
            force[f] = _largest(scene, table, wire, f)
            box = _box(scene, table, wire, f)
            if box is not None:
                lower[f], upper[f] = box
    return SafetyLimits(
        force=force,
        rate=np.array([_own(scene, table, f, "rate") or np.inf for f in range(n)]) / scale,
        speed=np.array([_own(scene, table, f, "speed") or np.inf for f in range(n)]) * scale,
        lower=lower,
        upper=upper,
        hold=table.hold,
        soft_start=table.soft_start,
    )


def _own(scene: Scene, table: Safety, f: int, name: str) -> Any:
    """Give a limit of finger f: its own, or the scene's."""
    own = scene.finger[f].safety
    value = None if own is None else getattr(own, name)
    return getattr(table, name) if value is None else value


def _largest(scene: Scene, table: Safety, wire: Wire, f: int) -> float:
    force = _own(scene, table, f, "force")
    if force is not None:
        return float(force) / wire.fitting.scale
    continuous = wire.features.continuous_force
    return CONTINUOUS * float(continuous) if continuous else DEFAULT / wire.fitting.scale


def _box(scene: Scene, table: Safety, wire: Wire, f: int) -> tuple[Any, Any] | None:
    box = _own(scene, table, f, "workspace")
    if box == "none":
        return None
    return wire.features.workspace if box == "device" else box
