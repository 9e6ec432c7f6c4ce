"""Numbers that come from outside: real, finite, and of a size with which every formula stays finite."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError

FloatArray = NDArray[np.float64]

LARGEST = 1e40
"""Largest number in SI units; the squares and products that formulas take of it are still numbers."""
FINITE = 1e300
FEW = 100  # numbers that Python adds up before numpy has looked at them
SMALLEST = 1e-60
"""Least of what must be above zero, in SI units; its inverse is still a number."""


def real(name: str, argument: object, expected: str = "", do: str = "") -> FloatArray:
    """Copy real numbers of any shape, NaN and infinity among them, as a float array.

    Args:
        name: the argument, as its caller wrote it.
        expected, do: for the error.

    Raises:
        InputError: what is not a rectangular array of real numbers.
    """
    try:
        raw = np.asarray(argument)
        if raw.dtype.kind in "biufO":
            return np.array(raw, dtype=float)
    except (TypeError, ValueError, OverflowError):
        pass
    raise InputError(name, argument, expected or "numbers in a rectangular array", do)


def finite(name: str, argument: object, expected: str = "", do: str = "", *, largest: float = LARGEST) -> FloatArray:
    """Copy finite numbers within +-largest, which is infinite for directions of any length, as a float array.

    Raises:
        InputError: as `real`, and what is not finite or too large.
    """
    value = real(name, argument, expected, do)
    if value.size <= FEW and sum(map(abs, value.ravel().tolist())) <= min(largest, FINITE):
        return value  # none is NaN or more than their sum
    expected = expected or "finite values"
    if not np.isfinite(value).all():
        raise InputError(name, argument, expected, do or "find where the NaN or infinity comes from")
    if np.abs(value).max(initial=0.0) > largest:
        raise InputError(name, argument, expected, do or f"no more than {largest:g} in SI units: check the units")
    return value


def number(name: str, argument: object, expected: str, do: str = "", *, zero: bool = True) -> float:
    """Check one number of zero or more; of SMALLEST or more unless `zero`.

    Raises:
        InputError: as `finite`, and a negative number, zero where that is refused, or more than one.
    """
    value = finite(name, argument, expected, do)
    if value.ndim or not (value >= 0.0 if zero else value >= SMALLEST):
        raise InputError(name, argument, expected, do)
    return float(value)
