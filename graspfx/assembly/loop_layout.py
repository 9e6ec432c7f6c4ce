"""Columns of a run on the wall's clock: its devices by name, their switches, and what came over their wires."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from graspfx.assembly.force_limits import changes
from graspfx.assembly.wiring import Wire
from graspfx.loop.device import RawDevice


def loop_fields(wired: Sequence[Wire], fingers: Sequence[str]) -> dict[str, Any]:
    """Give the fields of a `Layout` that such a run has."""
    devices = device_names(wired, fingers)
    own = [(name, wire.device) for name, wire in zip(devices, wired, strict=True)]
    raw = [(name, device.raw) for name, device in own if isinstance(device, RawDevice)]
    return {
        "timed": True,
        "varying": any(changes(wire) for wire in wired),
        "switched": any(wire.features.switches for wire in wired),
        "devices": devices,
        "raw": tuple((name, len(numbers), str(numbers.dtype)) for name, numbers in raw),
    }


def device_names(wired: Sequence[Wire], fingers: Sequence[str]) -> tuple[str, ...]:
    """Name each device by the first finger that it moves."""
    return tuple(fingers[int(wire.used[0])] for wire in wired)
