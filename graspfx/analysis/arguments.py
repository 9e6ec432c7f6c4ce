"""Arguments of the limits, checked: numbers with their unit, counts of samples, names."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.errors import InputError, UnknownNameError
from graspfx.numeric import SMALLEST, finite

FloatArray = NDArray[np.float64]

LONGEST = 1000  # samples of delay: polynomials and matrices grow with them


def number(name: str, given: float, unit: str, *, zero: bool = True, negative: bool = False) -> float:
    """A finite number of zero or more; above zero unless `zero`; of any sign if `negative`."""
    value = numbers(name, given, unit, zero=zero, negative=negative)
    if value.ndim:
        raise InputError(name, given, f"one number [{unit}]", "arrays go to `limit_map`")
    return float(value)


def numbers(name: str, given: ArrayLike, unit: str, *, zero: bool = True, negative: bool = False) -> FloatArray:
    """The same for an array of any shape."""
    what = "finite numbers" if negative else "finite numbers, zero or above" if zero else "finite numbers above zero"
    value = finite(name, given, f"{what} [{unit}]")
    low = value < 0.0 if zero else value < SMALLEST
    if not negative and low.any():
        raise InputError(name, given, f"{what} [{unit}]")
    return value


def count(name: str, given: float, least: int = 0) -> int:
    """A whole number."""
    value = numbers(name, given, "1", negative=True)
    if value.ndim or value % 1.0 or value < least or isinstance(given, bool):
        raise InputError(name, given, f"a whole number, {least} or more")
    return int(value)


def one_of(kind: str, given: str, known: Iterable[str]) -> str:
    """A known name."""
    if str(given) not in known:
        raise UnknownNameError(kind, str(given), known)
    return given


def samples(name: str, given: float) -> int:
    """A delay."""
    lag = count(name, given)
    if lag > LONGEST:
        raise InputError(name, given, f"a whole number of samples, {LONGEST} at most", "take a longer period")
    return lag


def lag_of_object(given: int, integrator: str) -> int:
    """Samples by which the object's force is late; none where it is solved together with the object's new state."""
    lag = samples("object_delay", given)
    if lag and integrator == "implicit":
        raise InputError("object_delay", lag, "0 with the implicit integrator, whose force acts at once on the object")
    return lag
