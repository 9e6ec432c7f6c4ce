"""Keys of a scene, which are paths in nested tables, and their dotted names."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from graspfx.errors import Fault

Key = tuple[str | int, ...]  # names and numbers that lead to a table or a value of a scene
Finding = tuple[Key, str]  # a fault and its place


PART = re.compile(r'"([^"]*)"|([^.]+)')

LISTS = ("object", "finger", "device", "hand", "obstacle")  # tables that a scene may have several times
NAMES = ("label", "name")  # keys that name such a table, in order; the `name` of a device is that of its driver


def dotted(key: Sequence[str | int]) -> str:
    """Return a key with its parts joined by dots; a part that contains a dot is quoted."""
    return ".".join(f'"{part}"' if "." in str(part) else str(part) for part in key)


def parts_of(text: str) -> Key:
    """Return the key that `dotted` converts to this text."""
    return tuple(quoted or (int(bare) if bare.isdecimal() else bare) for quoted, bare in PART.findall(text))


def number_of(name: str, tables: Sequence[Mapping[str, Any]]) -> int | None:
    """Return the index of the first table with this label or, if there is none, this name; None if there is neither."""
    for key in NAMES:
        for i, table in enumerate(tables):
            if table.get(key) == name:
                return i
    return None


def key_in(data: Any, location: Sequence[str | int]) -> Key:
    """Convert the location of a fault in Pydantic's errors to a key of the data."""
    key: list[str | int] = []
    for part in location:
        if isinstance(part, str) and (part.startswith("<") or part == "[key]"):
            continue
        if isinstance(part, int) and isinstance(data, Mapping):
            continue  # a single table in place of a list of tables
        key.append(part)
        if isinstance(part, int):
            data = data[part] if isinstance(data, Sequence) and part < len(data) else None
        else:
            data = data.get(part) if isinstance(data, Mapping) else None
    return tuple(key)


def as_faults(data: Mapping[str, Any], findings: Iterable[tuple[Key, str]]) -> list[Fault]:
    """Return faults with dotted keys from pairs of a key and a message."""
    return [Fault(dotted(key_in(data, at)), text) for at, text in findings]


def reaches(keys: tuple[str, ...], key: str) -> bool:
    """Return whether a key, in its general form, equals one of the keys, or is below or above one of them."""
    return any(key == each or key.startswith(f"{each}.") or each.startswith(f"{key}.") for each in keys)


def general(key: str) -> str:
    """Return a key with `*` for the table of a list: `finger.0.start` as `finger.*.start`, `object.mass` likewise."""
    first, *rest = key.split(".")
    if first in LISTS:
        rest = ["*", *(rest[1:] if rest and (rest[0] == "*" or rest[0].isdecimal()) else rest)]
    return ".".join([first, *rest])


# Former names --------------------------------------------------------------------------------------------------------


FORMER = {  # for each driver: former name and current name of a setting
    "simulated": {"friction": "damping"},
    "two-link": {"joint_friction": "joint_damping"},
}


def current_setting(driver: object, key: str) -> str:
    """Return the current name of a setting of a driver; `key` is the current or a former name."""
    return FORMER.get(str(driver), {}).get(key, key)


def other_names(driver: object, key: str) -> set[str]:
    """Return all names of a setting of a driver, current and former, except `key`."""
    names = FORMER.get(str(driver), {})
    return {name for pair in names.items() if key in pair for name in pair} - {key}
