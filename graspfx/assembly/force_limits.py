"""The largest forces that a scene's devices tell, and which devices tell none though they may have one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.wiring import Wire, table_at
from graspfx.errors import InputError
from graspfx.loop.device import LimitedDevice, fused

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]


def force_limits(fingers: int, wired: Sequence[Wire]) -> FloatArray | None:
    """Give the largest force of each of so many fingers [N], infinite where its device tells none; None if all do.

    Raises:
        InputError: a device's `features.peak_force` is no force above zero.
    """
    limits = np.full(fingers, np.inf)
    for wire in wired:
        limits[wire.used] = peak_force(wire)
    return limits if np.isfinite(limits).any() or any(changes(wire) for wire in wired) else None


def peak_force(wire: Wire) -> float:
    """Give the largest force of a device [N], infinite where it tells none."""
    peak = wire.features.peak_force
    if peak is None:
        return math.inf
    if isinstance(peak, bool) or not peak > 0.0:
        raise InputError(
            "features.peak_force", peak, "a force above zero [N], or None",
            f"as the driver {type(wire.device).__qualname__} tells it",
        )  # fmt: skip
    return float(peak)


def changes(wire: Wire) -> bool:
    """Tell whether a device's largest force depends on where it stands."""
    return isinstance(wire.device, LimitedDevice)


def may_hide(wire: Wire) -> bool:
    """Tell whether a device tells no largest force, but writes by code of its own, in which there may be one."""
    return math.isinf(peak_force(wire)) and not (changes(wire) or is_forceless(wire)) and fused(wire.device) is None


def is_forceless(wire: Wire) -> bool:
    """Tell whether a device says that it displays no force."""
    return wire.features.continuous_force == 0.0


def forceless_text(scene: Scene, wired: Sequence[Wire]) -> str:
    """List the devices that display no force."""
    return _listing(scene, [wire for wire in wired if is_forceless(wire)])


def limit_text(scene: Scene, wired: Sequence[Wire]) -> str:
    """List the devices that tell a largest force, with it and whose they are."""
    return "; ".join(_limit_of(scene, wire) for wire in wired if changes(wire) or math.isfinite(peak_force(wire)))


def hidden_text(scene: Scene, wired: Sequence[Wire]) -> str:
    """List the devices in whose own code there may be a limit that they do not tell."""
    return _listing(scene, [wire for wire in wired if may_hide(wire)])


def _listing(scene: Scene, wired: Sequence[Wire]) -> str:
    return ", ".join(f"{_fingers(scene, wire)} ({type(wire.device).__qualname__})" for wire in wired)


def _limit_of(scene: Scene, wire: Wire) -> str:
    peak = peak_force(wire)
    text = f"{peak:.4g} N" if math.isfinite(peak) else "a limit"
    text += " as it tells in every sample" if changes(wire) else ""
    first = int(wire.used[0])
    return f"{_fingers(scene, wire)} {text} ({table_at(scene, first)[1].name})"


def _fingers(scene: Scene, wire: Wire) -> str:
    return ", ".join(scene.finger_names[f] for f in wire.used)
