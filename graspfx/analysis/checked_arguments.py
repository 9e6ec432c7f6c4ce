"""Checked arguments of the limits: numbers with units, delays, names."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.errors import InputError, UnknownNameError
from graspfx.numeric import SMALLEST, count, finite

FloatArray = NDArray[np.float64]

LONGEST = 1000  # largest delay [samples]; sizes of polynomials and matrices grow with the delay


def number(name: str, argument: float, unit: str, *, zero: bool = True, negative: bool = False) -> float:
    """Check a finite number above zero; `zero` also permits zero, and `negative` any sign."""
    value = numbers(name, argument, unit, zero=zero, negative=negative)
    if value.ndim:
        raise InputError(
            name, argument, f"one number [{unit}]", "pass arrays to `wall_limit_map` or `external_limit_map`"
        )
    return float(value)


def numbers(name: str, argument: ArrayLike, unit: str, *, zero: bool = True, negative: bool = False) -> FloatArray:
    """Check an array of finite numbers by the rules of `number`."""
    expected = (
        "finite numbers" if negative else "finite numbers, zero or above" if zero else "finite numbers above zero"
    )
    value = finite(name, argument, f"{expected} [{unit}]")
    low = value < 0.0 if zero else value < SMALLEST
    if not negative and low.any():
        raise InputError(name, argument, f"{expected} [{unit}]")
    return value


def one_of(kind: str, name: str, names: Iterable[str]) -> str:
    """Check that a name is known."""
    if str(name) not in names:
        raise UnknownNameError(kind, str(name), names)
    return name


def samples(name: str, argument: float) -> int:
    """Check a delay: an integer from 0 to `LONGEST` [samples]."""
    lag = count(name, argument)
    if lag > LONGEST:
        raise InputError(name, argument, f"a whole number of samples, {LONGEST} at most", "use a longer period")
    return lag


def lag_of_object(object_delay: int, integrator: str) -> int:
    """Check the delay of the force on the object [samples], which must be zero with the implicit integrator."""
    lag = samples("object_delay", object_delay)
    if lag and integrator == "implicit":
        raise InputError("object_delay", lag, "0 with the implicit integrator, whose force acts at once on the object")
    return lag
