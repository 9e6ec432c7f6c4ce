"""Messages of the Haply Inverse service: JSON, in metres and newtons, z up; every field is validated.

The service omits default values, so a missing coordinate is zero, but a position without any coordinate is
invalid. The keys of a device's configuration are assumptions, not yet confirmed with a service.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from graspfx.protocols import DeviceError

KIND = "inverse3"
AXES = "x", "y", "z"
IDENTITY = "XYZ"  # identity basis: the service's own axes

Force = tuple[float, float, float]


def forces_text(forces: Mapping[str, Force]) -> str:
    """Return the message that sets the force of each device [N]."""
    devices = [
        {"device_id": name, "commands": {"set_cursor_force": {"values": dict(zip(AXES, force, strict=True))}}}
        for name, force in forces.items()
    ]
    return json.dumps({KIND: devices}, separators=(",", ":"), allow_nan=False)


def devices_in(text: str) -> dict[str, Mapping[str, Any]] | None:
    """Return the data of each device in a message, by id; None if the text is not such a message."""
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):
        return None
    each = message.get(KIND, []) if isinstance(message, dict) else None
    if not isinstance(each, list):
        return None
    return {
        device["device_id"]: device
        for device in each
        if isinstance(device, dict) and isinstance(device.get("device_id"), str)
    }


def position_in(device: Mapping[str, Any]) -> tuple[float, float, float] | None:
    """Return a device's position [m]; None if it is missing or not finite."""
    state = device.get("state")
    position = state.get("cursor_position") if isinstance(state, dict) else None
    if not isinstance(position, dict) or not position.keys() & set(AXES):
        return None
    values = [position.get(axis, 0.0) for axis in AXES]
    if any(isinstance(x, bool) or not isinstance(x, int | float) or not math.isfinite(x) for x in values):
        return None
    x, y, z = values
    return float(x), float(y), float(z)


def check_config(device: Mapping[str, Any], basis: str, damping: float) -> None:
    """Check that the service's settings of a device agree with those of the scene.

    Raises:
        DeviceError: If basis or damping differ, or there is a mount or a closed force gate.
    """
    name, config = device["device_id"], device.get("config")
    if not isinstance(config, dict):
        config = {}
    own = _part(config.get("basis"), "permutation", IDENTITY)
    if own != basis:
        raise _other(name, "basis", own, basis, "rotate the axes with the device's `frame`")
    mount = config.get("mount")
    if mount and not _is_identity(mount):
        raise _other(name, "mount", mount, "none", "set the position with the device's `frame`")
    viscous = _part(config.get("damping"), "scalar", 0.0)
    if isinstance(viscous, bool) or not isinstance(viscous, int | float) or abs(viscous - damping) > 1e-9:
        raise _other(name, "damping", viscous, f"{damping:g} N s/m", "set `damping` to the service's value")
    gate = _part(config.get("force_gate"), "enabled", True)
    if gate is False or (isinstance(gate, int | float) and gate == 0):
        raise DeviceError(f"the service blocks the force of {name}: open its force gate")


def _part(value: Any, key: str, default: Any) -> Any:
    """Return a setting given directly or under a key; the default if the setting is missing."""
    if isinstance(value, dict):
        value = value.get(key)
    return default if value is None else value


def _is_identity(value: Any) -> bool:
    """Tell whether a transform is the identity: positions 0, scales 1, rotation w 1."""
    if isinstance(value, dict):
        return all(
            part == 1 if key == "w" else _scale_is_one(part) if key == "scale" else _is_identity(part)
            for key, part in value.items()
        )
    return value is None or value == 0


def _scale_is_one(value: Any) -> bool:
    return all(part == 1 for part in value.values()) if isinstance(value, dict) else value == 1


def _other(name: str, key: str, own: Any, expected: str, do: str) -> DeviceError:
    own_text = json.dumps(own)[:80]
    return DeviceError(f"the service's {key} of {name} is {own_text}, but the scene expects {expected}: {do}")
