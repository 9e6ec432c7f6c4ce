"""Orders of a page: where fingers are on its screen, in messages of one length, each taken only if it is sound."""

from __future__ import annotations

import math
from enum import IntEnum
from struct import Struct
from typing import NamedTuple

ORDER = Struct("<BBHIdd")  # kind, finger, zero, number, x [m], y [m]
MOST_FINGERS = 32
MOST_NUMBER = (1 << 32) - 1


class Kind(IntEnum):
    """Kinds of orders."""

    ALIVE = 0  # the page is there, and its fingers are where they were
    PRESS = 1  # a finger came down
    MOVE = 2
    LIFT = 3  # it went up


class Order(NamedTuple):
    """A sound order.

    Attributes:
        kind: of it.
        finger: that is meant; of `Kind.ALIVE` none.
        number: of the message; those of a connection rise.
        place: on the screen (2,) [m]; of `Kind.ALIVE` and `Kind.LIFT` none.
    """

    kind: Kind
    finger: int
    number: int
    place: tuple[float, float]


class Box(NamedTuple):
    """Places at which a finger may be on the screen [m]."""

    left: float
    bottom: float
    right: float
    top: float

    def contains(self, x: float, y: float) -> bool:
        """Tell whether a place is inside; one that is not finite is not."""
        return self.left <= x <= self.right and self.bottom <= y <= self.top


def read_order(data: bytes | str, fingers: int, box: Box) -> Order | str:
    """Read a message; a text says why it is none.

    Args:
        data: of the message.
        fingers: how many there are.
        box: in which places lie.
    """
    if isinstance(data, str) or len(data) != ORDER.size:
        return "length"
    kind, finger, zero, number, x, y = ORDER.unpack(data)
    if kind > Kind.LIFT or zero:
        return "kind"
    if finger >= fingers and kind != Kind.ALIVE:
        return "finger"
    if kind in (Kind.PRESS, Kind.MOVE):
        if not box.contains(x, y):
            return "place"
    elif not (math.isfinite(x) and math.isfinite(y)):
        return "place"
    return Order(Kind(kind), finger, number, (x, y))
