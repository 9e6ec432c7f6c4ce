"""Keys of a scene: where a value stands in nested tables, and its name with dots."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from graspfx.errors import Fault

Key = tuple[str | int, ...]


PART = re.compile(r'"([^"]*)"|([^.]+)')

LISTS = ("object", "finger", "device", "hand", "obstacle")  # tables of which a scene may have several
NAMES = ("label", "name")  # of such a table, its own first: a device's `name` is its driver's


def dotted(key: Sequence[str | int]) -> str:
    """Write a key with dots; a part that has dots of its own stands in quotes."""
    return ".".join(f'"{part}"' if "." in str(part) else str(part) for part in key)


def parts_of(text: str) -> Key:
    """Read a key that was written by `dotted`."""
    return tuple(quoted or (int(bare) if bare.isdecimal() else bare) for quoted, bare in PART.findall(text))


def number_of(name: str, tables: Sequence[Mapping[str, Any]]) -> int | None:
    """Find the table of that label or name among several, the first; None for none."""
    for key in NAMES:
        for i, table in enumerate(tables):
            if table.get(key) == name:
                return i
    return None


def key_in(data: Any, location: Sequence[str | int]) -> Key:
    """Find where a validator's location stands in the data: without its marks of alternatives and keys."""
    key: list[str | int] = []
    for part in location:
        if isinstance(part, str) and (part.startswith("<") or part == "[key]"):
            continue
        if isinstance(part, int) and isinstance(data, Mapping):
            continue  # a lone table where a list of tables may stand
        key.append(part)
        if isinstance(part, int):
            data = data[part] if isinstance(data, Sequence) and part < len(data) else None
        else:
            data = data.get(part) if isinstance(data, Mapping) else None
    return tuple(key)


def as_faults(data: Mapping[str, Any], findings: Iterable[tuple[Key, str]]) -> list[Fault]:
    """Write faults by dotted key, as the data writes it."""
    return [Fault(dotted(key_in(data, at)), text) for at, text in findings]


def reaches(keys: tuple[str, ...], key: str) -> bool:
    """Tell whether a key in its general form is one of these, or one below."""
    return any(key == each or key.startswith(f"{each}.") or each.startswith(f"{key}.") for each in keys)


def general(key: str) -> str:
    """Write a key for all numbers of a list: `finger.0.start` is `finger.*.start`, `object.mass` `object.*.mass`."""
    first, *rest = key.split(".")
    if first in ("object", "finger", "device", "hand", "obstacle"):
        rest = ["*", *(rest[1:] if rest and (rest[0] == "*" or rest[0].isdecimal()) else rest)]
    return ".".join([first, *rest])
