"""Values of a swept key: a list, or a range as it is typed, `20:70:25` or `1:1000:4:log`."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError
from graspfx.scene.budget import excess
from graspfx.scene.overrides import toml_value

MOST = 10_000_000  # values of a range, and variants of a sample
FORM = "FROM:TO:COUNT, FROM:TO:COUNT:log or values with commas, as in object.viscosity=0.8:1.5:15"
BOTH_ENDS = "both ends are among the values; a single value stands alone, as in object.viscosity=0.8"
Values = Sequence[Any] | NDArray[Any]


@dataclass(frozen=True)
class Range:
    """A range of numbers, both ends among them.

    Args:
        first, last: its ends.
        count: values that a grid has of it; 0 where only a sample can be drawn.
        log: whether ratios are even, and not differences.
    """

    first: float
    last: float
    count: int = 0
    log: bool = False

    def grid(self) -> NDArray[np.float64]:
        """Give evenly spaced values."""
        return (
            self.at(np.linspace(0.0, 1.0, self.count)) if self.log else np.linspace(self.first, self.last, self.count)
        )

    def at(self, share: NDArray[np.float64]) -> NDArray[np.float64]:
        """Give the values at shares of the way from the first to the last."""
        if self.log:
            values = np.exp(math.log(self.first) + share * (math.log(self.last) - math.log(self.first)))
            values = np.where(share == 0.0, self.first, values)
            return np.asarray(np.where(share == 1.0, self.last, values))
        return self.first + share * (self.last - self.first)


def read_over(text: str) -> tuple[str, Range | list[Any]]:
    """Read KEY=RANGE or KEY=V1,V2,... of a command line.

    Raises:
        InputError: anything else.
    """
    key, equals, values = text.partition("=")
    if not key.strip() or not equals or not values.strip():
        raise InputError("--over", text, f"KEY={FORM}")
    return key.strip(), read_values(values.strip(), "--over")


def read_values(text: str, argument: str) -> Range | list[Any]:
    """Read a range, or values with commas, each TOML, or text where it is none.

    Raises:
        InputError: neither.
    """
    span = _range(text, argument)
    if span is not None:
        return span
    if fault := excess(f"value = [{text}]"):
        raise InputError(argument, text, FORM, fault.message)
    try:
        values: list[Any] = toml_value(f"[{text}]", argument)
    except tomllib.TOMLDecodeError:
        if any(letter in text for letter in "[]{}\"'"):
            raise InputError(argument, text, FORM, "no value of a list is whole TOML, or a word") from None
        values = [_value(part.strip(), argument) for part in text.split(",")]
    if not values:
        raise InputError(argument, text, FORM)
    return values


def as_values(key: str, values: Any) -> Range | Values:
    """Take what stands for a key's values: a list or an array, a range, or the text of one.

    Raises:
        InputError: neither.
    """
    if isinstance(values, str):
        return read_values(values, f"values[{key!r}]")
    if isinstance(values, Range | np.ndarray):
        return values
    if isinstance(values, bytes | Mapping) or not hasattr(values, "__iter__"):
        raise InputError(f"values[{key!r}]", values, "a list of values, or a range as in '20:70:25'")
    return list(values)


def _range(text: str, argument: str) -> Range | None:
    parts = [part.strip() for part in text.split(":")]
    log = len(parts) > 2 and parts[-1] == "log"
    numbers = parts[:-1] if log else parts
    if len(parts) not in (2, 3, 4):
        return None
    try:
        first, last = float(parts[0]), float(parts[1])
    except ValueError:
        return None
    try:
        (count,) = map(int, numbers[2:] or "0")
    except ValueError:
        do = "COUNT is a whole number; a text of this form stands in quotes"
        raise InputError(argument, text, FORM, do) from None
    if not (math.isfinite(first) and math.isfinite(last)) or count > MOST or (len(numbers) == 3 and count < 1):
        raise InputError(argument, text, f"FROM:TO:COUNT with finite ends and from 1 to {MOST:,} values")
    if first == last and count != 1:
        raise InputError(argument, text, "FROM:TO:COUNT with two different ends", BOTH_ENDS)
    if first != last and count == 1:
        raise InputError(argument, text, "FROM:TO:COUNT with a COUNT of two or more", BOTH_ENDS)
    if log and min(first, last) <= 0.0:
        raise InputError(argument, text, "FROM:TO:COUNT:log with ends above zero")
    return Range(first, last, count, log)


def _value(text: str, argument: str) -> Any:
    try:
        return toml_value(text, argument)
    except tomllib.TOMLDecodeError:
        return text
