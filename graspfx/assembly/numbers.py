"""Which fields of a block each key of a scene reaches, as the arguments of what fills the block declare it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple


class Number(NamedTuple):
    """One argument of the function that fills a block.

    Attributes:
        keys: of the scene that it is made from; a table stands for all keys below it, `*` for a number in a list.
        fields: of the block's record that it goes to.
        make: makes it from the parts of a scene.
    """

    keys: tuple[str, ...]
    fields: tuple[str, ...]
    make: Callable[..., Any]


Numbers = Mapping[str, Number]


def arguments(numbers: Numbers, *parts: Any) -> dict[str, Any]:
    """Make all arguments from the parts of a scene."""
    return {name: number.make(*parts) for name, number in numbers.items()}


def fields_of(numbers: Numbers, key: str) -> frozenset[str]:
    """Name the fields that a key of a scene reaches."""
    plain = general(key)
    return frozenset(field for number in numbers.values() if reaches(number.keys, plain) for field in number.fields)


def reaches(keys: tuple[str, ...], key: str) -> bool:
    """Tell whether a key in its general form is one of these, or one below."""
    return any(key == each or key.startswith(f"{each}.") or each.startswith(f"{key}.") for each in keys)


def general(key: str) -> str:
    """Write a key for all numbers of a list: `finger.0.start` is `finger.*.start`, `object.mass` `object.*.mass`."""
    first, *rest = key.split(".")
    if first in ("object", "finger", "device", "hand", "obstacle"):
        rest = ["*", *(rest[1:] if rest and (rest[0] == "*" or rest[0].isdecimal()) else rest)]
    return ".".join([first, *rest])
