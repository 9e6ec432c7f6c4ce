"""Validation of driver settings; each function raises an InputError with the setting's name if a value is invalid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspfx.protocols import LARGEST, InputError, finite

FloatArray = NDArray[np.float64]

MOST = 1_000_000  # largest count, unless stated otherwise


def number(name: str, value: object, least: float, most: float = LARGEST, expected: str = "") -> float:
    """Return a setting that must be a finite number from `least` to `most`.

    If `expected` is given, it describes the valid values in the error message.
    """
    expected = expected or f"a number from {least:g} to {most:g}"
    figure = finite(name, value, expected)
    if np.asarray(value).dtype == bool or figure.shape != () or not least <= figure <= most:
        raise InputError(name, value, expected)
    return float(figure)


def pair(name: str, value: object, least: float, expected: str = "", *, one: bool = False) -> tuple[float, float]:
    """Return a setting that must be two finite numbers of at least `least`; if `one`, a single number sets both."""
    expected = expected or f"two numbers of at least {least:g}"
    both = finite(name, value, expected)
    flags = [isinstance(each, bool | np.bool_) for each in (value if isinstance(value, list | tuple) else [value])]
    if both.shape not in ([(), (2,)] if one else [(2,)]) or any(flags) or (both < least).any():
        raise InputError(name, value, expected)
    first, second = np.broadcast_to(both, 2).tolist()
    return first, second


def whole(name: str, value: object, least: int, most: int = MOST) -> int:
    """Return a setting that must be an integer from `least` to `most`."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not least <= value <= most:
        raise InputError(name, value, f"an integer from {least} to {most}")
    return int(value)


def flag(name: str, value: object) -> bool:
    """Return a setting that must be a boolean; integers are not accepted."""
    if not isinstance(value, bool):
        raise InputError(name, value, "true or false")
    return value


def corners(workspace: object, dimensions: int) -> FloatArray:
    """Return the lower and upper corner of a workspace as a read-only array (2, dimensions) [m]."""
    expected = f"two corners of {dimensions} finite coordinates [m], each of the first corner below that of the second"
    both = finite("workspace", workspace, expected)
    if both.shape != (2, dimensions) or not (both[0] < both[1]).all():
        raise InputError("workspace", workspace, expected)
    both.flags.writeable = False
    return both


def port_name(value: object) -> str:
    """Return a setting that must be the name of a serial port or of an event file."""
    if not isinstance(value, str) or not value or "\0" in value:
        raise InputError("port", value, "the name of a port, such as /dev/ttyACM0 or /dev/input/event3")
    return value
