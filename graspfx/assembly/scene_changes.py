"""Differences between two scenes as data, in words."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

LONGEST = 60  # letters of a value that is said


def scene_changes(there: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """Say where the table of a scene is another one than it was, key by key."""
    return [f"the scene's {key} is {brief(one)} there, {brief(two)} here" for key, one, two in _changes(there, here)]


def brief(value: Any) -> str:
    """Write a value as JSON has it, in few letters."""
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def _changes(one: Any, two: Any, key: str = "") -> Iterator[tuple[str, Any, Any]]:
    if isinstance(one, Mapping) and isinstance(two, Mapping):
        for name in dict.fromkeys([*one, *two]):
            yield from _changes(one.get(name), two.get(name), f"{key}.{name}" if key else str(name))
    elif isinstance(one, list) and isinstance(two, list) and len(one) == len(two):
        for k, (a, b) in enumerate(zip(one, two, strict=True)):
            yield from _changes(a, b, f"{key}.{k}")
    elif one != two:
        yield key, one, two
