"""Largest forces that a scene's devices report, limits of the safety chain, and guards of hardware."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.wiring import Wire, table_at
from graspfx.errors import InputError
from graspfx.loop.device import LimitedDevice, fused, is_hardware
from graspfx.loop.realtime.readings import GUARDS, Guards
from graspfx.loop.safety.chain import SafetyLimits
from graspfx.loop.safety.trust import DECAY

if TYPE_CHECKING:
    from graspfx.scene.model import Scene
    from graspfx.scene.tables.safety_table import Safety


FloatArray = NDArray[np.float64]


def force_limits(fingers: int, wired: Sequence[Wire]) -> FloatArray | None:
    """Return the largest force of each finger, (fingers,) [N]; inf if the finger's device reports none.

    Return None if all forces are inf and cannot change during a run.

    Raises:
        InputError: If a device's `features.peak_force` is not above zero.
    """
    limits = np.full(fingers, np.inf)
    for wire in wired:
        limits[wire.used] = peak_force(wire)
    return limits if np.isfinite(limits).any() or any(changes(wire) for wire in wired) else None


def peak_force(wire: Wire) -> float:
    """Return the largest force that a device reports [N]; inf if it reports none."""
    peak = wire.features.peak_force
    if peak is None:
        return math.inf
    if isinstance(peak, bool) or not peak > 0.0:
        raise InputError(
            "features.peak_force", peak, "a force above zero [N], or None",
            f"correct the driver {type(wire.device).__qualname__}, which reports this force",
        )  # fmt: skip
    return float(peak)


def changes(wire: Wire) -> bool:
    """Return whether the largest force of a device may change during a run."""
    return isinstance(wire.device, LimitedDevice)


def may_hide(wire: Wire) -> bool:
    """Return whether a device reports no largest force, but its driver may limit forces."""
    return math.isinf(peak_force(wire)) and not (changes(wire) or is_forceless(wire)) and fused(wire.device) is None


def is_forceless(wire: Wire) -> bool:
    """Return whether a device declares that it displays no force."""
    return wire.features.continuous_force == 0.0


def forceless_text(scene: Scene, wired: Sequence[Wire]) -> str:
    """Return a text that lists the devices that display no force, with their fingers."""
    return _listing(scene, [wire for wire in wired if is_forceless(wire)])


def limit_text(scene: Scene, wired: Sequence[Wire]) -> str:
    """Return a text that lists the devices that report a largest force, with the force and their fingers."""
    return "; ".join(_limit_of(scene, wire) for wire in wired if changes(wire) or math.isfinite(peak_force(wire)))


def hidden_text(scene: Scene, wired: Sequence[Wire]) -> str:
    """Return a text that lists the devices whose drivers may limit forces without reporting it (`may_hide`)."""
    return _listing(scene, [wire for wire in wired if may_hide(wire)])


def _listing(scene: Scene, wired: Sequence[Wire]) -> str:
    return ", ".join(f"{_fingers(scene, wire)} ({type(wire.device).__qualname__})" for wire in wired)


def _limit_of(scene: Scene, wire: Wire) -> str:
    peak = peak_force(wire)
    text = f"{peak:.4g} N" if math.isfinite(peak) else "a limit"
    text += " reported in every sample" if changes(wire) else ""
    first = int(wire.used[0])
    return f"{_fingers(scene, wire)} {text} ({table_at(scene, first)[1].name})"


def _fingers(scene: Scene, wire: Wire) -> str:
    return ", ".join(scene.finger_names[f] for f in wire.used)


CONTINUOUS = 0.6  # fraction of a device's continuous force that may be displayed
DEFAULT = 3.0  # limit of a finger whose device reports no continuous force [N]


def chain_table(scene: Scene, wired: Sequence[Wire]) -> Safety | None:
    """Return the table `safety` of a scene, or default values if it is missing in a scene with hardware or a host.

    Return None if the table is missing in a simulation without a host.
    """
    if scene.safety is not None or (scene.host is None and not any(is_hardware(wire.device) for wire in wired)):
        return scene.safety
    from graspfx.scene.tables.safety_table import Safety  # a cached scene skips the checks of tables

    return Safety()


def safety_limits(scene: Scene, wired: Sequence[Wire]) -> SafetyLimits | None:
    """Return the limits that the safety chain applies to the fingers; None for a scene without a safety chain."""
    table = chain_table(scene, wired)
    if table is None:
        return None
    n, d = len(scene.finger), scene.dimensions
    lower, upper = np.full((n, d), -np.inf), np.full((n, d), np.inf)
    force, scale = np.full(n, DEFAULT), np.ones(n)
    vouched = np.inf if scene.host is None else float(scene.host.speed)  # speed that the energy tanks of a host allow
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
        speed=np.minimum(np.array([_own(scene, table, f, "speed") or np.inf for f in range(n)]) * scale, vouched),
        lower=lower,
        upper=upper,
        hold=table.hold,
        soft_start=table.soft_start,
    )


def _own(scene: Scene, table: Safety, f: int, name: str) -> Any:
    """Return the limit `name` of finger f: that in the finger's table `safety`, otherwise that in the scene's table."""
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


def guards_of(scene: Scene, wired: Sequence[Wire]) -> Guards:
    """Return the guards of a scene's hardware, which leave time for forces to decay after a fault."""
    table = chain_table(scene, wired)
    if table is None:
        return GUARDS
    period = scene.period
    values: dict[str, Any] = {"soft_start": table.soft_start, "hold": table.hold + math.ceil(DECAY / period)}
    if table.speed is not None:
        values["speed"] = max(GUARDS.speed, 2.0 * table.speed)
    if table.watchdog is not None:
        values["late"] = max(1, round(table.watchdog / period))
    return replace(GUARDS, **values)
