"""Messages that a page may send: every other one, and every one that is not in order, has no effect at all."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import msgspec

Check = Callable[[Any], bool]
FARTHEST = 1e6  # of a camera [m]
MOST_PIXELS = 1 << 16
LONGEST = 200  # letters of a name


def number(value: object) -> bool:
    """Tell whether a value is a finite number, and no camera is farther away."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= FARTHEST


def vector(length: int) -> Check:
    """Make the check of that many numbers."""
    return lambda value: isinstance(value, list) and len(value) == length and all(map(number, value))


def pixels(value: object) -> bool:
    """Tell whether a value is a count of pixels."""
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= MOST_PIXELS


def name(value: object) -> bool:
    """Tell whether a value is a short text."""
    return isinstance(value, str) and len(value) <= LONGEST


def change(value: object) -> bool:
    """Tell whether a value changes the value of a control, and nothing else of it."""
    if not isinstance(value, dict) or list(value) != ["value"]:
        return False
    new = value["value"]
    return name(new) if isinstance(new, str) else isinstance(new, bool | int | float) and math.isfinite(new)


GIZMO: Mapping[str, Check] = {"name": name, "owner": lambda value: value == ""}
FIELDS: Mapping[str, Mapping[str, Check]] = {  # of each message by its type
    "ViewerCameraMessage": {
        "wxyz": vector(4), "position": vector(3), "look_at": vector(3), "up_direction": vector(3),
        "fov": number, "near": number, "far": number, "image_height": pixels, "image_width": pixels,
    },
    "GuiUpdateMessage": {"uuid": name, "updates": change},
    "TransformControlsUpdateMessage": {**GIZMO, "wxyz": vector(4), "position": vector(3)},
    "TransformControlsDragStartMessage": GIZMO,
    "TransformControlsDragEndMessage": GIZMO,
}  # fmt: skip


def message_in(data: str | bytes) -> dict[str, Any] | None:
    """Read a message; None where it is none, or none that has an effect here.

    Args:
        data: as it came from the socket.
    """
    if not isinstance(data, bytes):
        return None
    try:
        message = msgspec.msgpack.decode(data)
    except (msgspec.DecodeError, ValueError, RecursionError):
        return None
    if not isinstance(message, dict):
        return None
    kind = message.get("type")
    checks = FIELDS.get(kind) if isinstance(kind, str) else None
    if checks is None or message.keys() - {"type"} != checks.keys():
        return None
    return message if all(check(message[key]) for key, check in checks.items()) else None
