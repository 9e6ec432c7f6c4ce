"""Checks of numeric input: real, finite, and within bounds for which no formula overflows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError

FloatArray = NDArray[np.float64]

LARGEST = 1e40
"""Largest accepted magnitude of a number in SI units; its square does not overflow."""
FINITE = 1e300
FEW = 100  # size up to which a sum in Python is faster than NumPy
SMALLEST = 1e-60
"""Smallest accepted positive number in SI units; its inverse does not overflow."""


def real(name: str, argument: object, expected: str = "", do: str = "") -> FloatArray:
    """Return a copy of real numbers of any shape as a float array; NaN and infinity are accepted.

    Args:
        name: Name of the argument, for the error message.
        argument: Numbers to copy.
        expected, do: Description of a valid value, and advice to the user, for the error message.

    Raises:
        InputError: If the argument is not a rectangular array of real numbers.
    """
    try:
        raw = np.asarray(argument)
        if raw.dtype.kind in "biufO":
            return np.array(raw, dtype=float)
    except (TypeError, ValueError, OverflowError):
        pass
    raise InputError(name, argument, expected or "numbers in a rectangular array", do)


def finite(name: str, argument: object, expected: str = "", do: str = "", *, largest: float = LARGEST) -> FloatArray:
    """Return a copy of finite numbers as a float array, after a check that no magnitude exceeds `largest`.

    Raises:
        InputError: As for `real`, or if a number is not finite or its magnitude exceeds `largest`.
    """
    value = real(name, argument, expected, do)
    if value.size <= FEW and sum(map(abs, value.ravel().tolist())) <= min(largest, FINITE):
        return value  # none is NaN, and none exceeds the sum
    expected = expected or "finite values"
    if not np.isfinite(value).all():
        raise InputError(name, argument, expected, do or "find the calculation that gave NaN or infinity")
    if np.abs(value).max(initial=0.0) > largest:
        raise InputError(name, argument, expected, do or f"use at most {largest:g} in SI units: check the units")
    return value


def single(name: str, argument: object, expected: str) -> float:
    """Return one real number; infinity is accepted, and NaN is not.

    Raises:
        InputError: As for `real`, or if the argument is NaN, or not a single number.
    """
    value = real(name, argument, expected)
    if value.ndim or np.isnan(value):
        raise InputError(name, argument, expected)
    return float(value)


def number(name: str, argument: object, expected: str, do: str = "", *, zero: bool = True) -> float:
    """Return one number that is zero or above; if `zero` is False, at least SMALLEST.

    Raises:
        InputError: As for `finite`, or if the argument is not a single number, or is below the bound.
    """
    value = finite(name, argument, expected, do)
    if value.ndim or not (value >= 0.0 if zero else value >= SMALLEST):
        raise InputError(name, argument, expected, do)
    return float(value)


def count(name: str, argument: object, least: int = 0) -> int:
    """Return an integer, which must be `least` or more.

    Raises:
        InputError: As for `finite`, or if the number is not whole, or too small, or there are several.
    """
    if type(argument) is int and least <= argument <= LARGEST:
        return argument
    expected = f"a whole number, {least} or more"
    value = finite(name, argument, expected)
    if value.ndim or value % 1.0 or value < least or isinstance(argument, bool | np.bool_):
        raise InputError(name, argument, expected)
    return int(value)


def each(name: str, argument: object, n: int, expected: str, *, largest: float = LARGEST) -> FloatArray:
    """Return n numbers (n,) that are zero or above, from n numbers or from one number for all.

    Raises:
        InputError: As for `finite`, or if a number is negative, or the shape is neither () nor (n,).
    """
    value = finite(name, argument, expected, largest=largest)
    if value.shape not in ((), (n,)) or (value < 0.0).any():
        raise InputError(name, argument, expected)
    return np.broadcast_to(value, (n,))


def fraction(name: str, argument: float) -> float:
    """Return a relative tolerance; raise InputError if the argument is not in [0, 1)."""
    if type(argument) is float and 0.0 <= argument < 1.0:
        return argument
    value = number(name, argument, "a relative tolerance in [0, 1)")
    if value >= 1.0:
        raise InputError(name, argument, "a relative tolerance in [0, 1)")
    return value
