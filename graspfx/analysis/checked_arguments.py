"""Checks of the analysis functions' arguments: numbers with units, numbers of samples, names."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.errors import InputError, UnknownNameError
from graspfx.numeric import SMALLEST, count, finite

FloatArray = NDArray[np.float64]

LONGEST = 1000  # largest delay [samples]; sizes of polynomials and matrices grow with the delay


def number(name: str, argument: float, unit: str, *, zero: bool = True, negative: bool = False) -> float:
    """Check a finite number: of any sign if `negative`, otherwise not below zero if `zero`, otherwise above zero."""
    value = numbers(name, argument, unit, zero=zero, negative=negative)
    if value.ndim:
        raise InputError(
            name, argument, f"one number [{unit}]", "pass arrays to `wall_limit_map` or `external_limit_map`"
        )
    return float(value)


def numbers(name: str, argument: ArrayLike, unit: str, *, zero: bool = True, negative: bool = False) -> FloatArray:
    """Check that every entry of `argument` is a finite number with the sign that `number` permits; return the array."""
    expected = (
        "finite numbers" if negative else "finite numbers, zero or above" if zero else "finite numbers above zero"
    )
    value = finite(name, argument, f"{expected} [{unit}]")
    low = value < 0.0 if zero else value < SMALLEST
    if not negative and low.any():
        raise InputError(name, argument, f"{expected} [{unit}]")
    return value


def one_of(kind: str, name: str, names: Iterable[str]) -> str:
    """Check that `name` is one of `names`; `kind` is used in the error message."""
    if str(name) not in names:
        raise UnknownNameError(kind, str(name), names)
    return name


def samples(name: str, argument: float) -> int:
    """Check a delay: an integer from 0 to `LONGEST` [samples]."""
    lag = count(name, argument)
    if lag > LONGEST:
        raise InputError(name, argument, f"a whole number of samples, at most {LONGEST}", "use a longer period")
    return lag


def lag_of_object(object_delay: int, integrator: str) -> int:
    """Check the delay of the force on the object [samples], which must be zero for the integrator "implicit"."""
    lag = samples("object_delay", object_delay)
    if lag and integrator == "implicit":
        raise InputError("object_delay", lag, 'zero for the integrator "implicit", whose force is not delayed')
    return lag
