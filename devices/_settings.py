"""Validation of driver settings; an InputError names the setting."""

from __future__ import annotations

from graspfx.protocols import LARGEST, InputError, finite


def number(name: str, value: object, least: float, most: float = LARGEST) -> float:
    """Return a finite number between two bounds."""
    expected = f"a number from {least:g} to {most:g}"
    figure = finite(name, value, expected)
    if isinstance(value, bool) or figure.shape != () or not least <= figure <= most:
        raise InputError(name, value, expected)
    return float(figure)


def pair(name: str, value: object, least: float) -> tuple[float, float]:
    """Return two finite numbers that are at least `least`."""
    expected = f"two numbers of at least {least:g}"
    both = finite(name, value, expected)
    if both.shape != (2,) or (both < least).any():
        raise InputError(name, value, expected)
    return float(both[0]), float(both[1])


def whole(name: str, value: object, least: int, most: int) -> int:
    """Return an integer between two bounds."""
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise InputError(name, value, f"an integer from {least} to {most}")
    return value


def port_name(value: object) -> str:
    """Return the name of a serial port."""
    if not isinstance(value, str) or not value or "\0" in value:
        raise InputError("port", value, "the name of a serial port, such as /dev/ttyACM0")
    return value
