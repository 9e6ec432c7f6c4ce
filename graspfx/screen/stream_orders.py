"""Orders of a stream's clients, JSON of a few forms, each taken only if it is sound."""

from __future__ import annotations

import json
import math
from typing import Any, NamedTuple

LONGEST = 512  # bytes of an order
MOST_NUMBER = (1 << 53) - 1  # what every JSON reader has as a whole number
KEYS = {
    "goal": {"type", "number", "guide", "offset", "squeeze"},
    "release": {"type", "number", "guide"},
    "alive": {"type", "number"},
}


class StreamOrder(NamedTuple):
    """A sound order.

    Attributes:
        kind: "goal", "release" (which gives a guide up, and leaves its goal) or "alive".
        number: of the message; those of a connection rise.
        guide: that is meant; -1 of "alive".
        offset: by which it goes aside (3,) [m]; None leaves it.
        squeeze: that is added to its hand's [m]; None leaves it.
    """

    kind: str
    number: int
    guide: int = -1
    offset: tuple[float, float, float] | None = None
    squeeze: float | None = None


def read_stream_order(data: bytes | str, guides: int, farthest: float, closest: float) -> StreamOrder | str:
    """Read a message; a text says why it is none.

    Args:
        data: of the message.
        guides: how many there are.
        farthest: that a component of an offset may be [m].
        closest: that a squeeze may be, either way [m].
    """
    if not isinstance(data, str) or len(data) > LONGEST:
        return "length"
    try:
        table = json.loads(data, parse_constant=_refuse)
    except (ValueError, RecursionError):
        return "json"
    kind = table.get("type") if isinstance(table, dict) else None
    if not isinstance(kind, str) or kind not in KEYS or not table.keys() <= KEYS[kind]:
        return "kind"
    number, guide = table.get("number"), table.get("guide", -1)
    if type(number) is not int or not 0 < number <= MOST_NUMBER:
        return "number"
    if kind == "alive":
        return StreamOrder(kind, number)
    if type(guide) is not int or not 0 <= guide < guides:
        return "guide"
    if kind == "release":
        return StreamOrder(kind, number, guide)
    offset, squeeze = table.get("offset"), table.get("squeeze")
    if offset is not None:
        if not (isinstance(offset, list) and len(offset) == 3 and all(_is_within(each, farthest) for each in offset)):
            return "place"
        offset = tuple(map(float, offset))
    if squeeze is not None and not _is_within(squeeze, closest):
        return "place"
    return StreamOrder(kind, number, guide, offset, None if squeeze is None else float(squeeze))


def _is_within(value: Any, most: float) -> bool:
    return type(value) in (int, float) and math.isfinite(value) and abs(value) <= most


def _refuse(word: str) -> float:
    raise ValueError(word)
