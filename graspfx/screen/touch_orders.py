"""Orders of a touch-screen page: binary messages of fixed length with a finger's position, checked on arrival."""

from __future__ import annotations

import math
from enum import IntEnum
from struct import Struct
from typing import NamedTuple

ORDER = Struct("<BBHIdd")  # kind, finger, zero, number, x [m], y [m]
MOST_FINGERS = 32
MOST_NUMBER = (1 << 32) - 1


class Kind(IntEnum):
    """Kinds of orders from a touch screen."""

    ALIVE = 0  # sign of life; no finger has moved
    PRESS = 1  # a finger was put down
    MOVE = 2
    LIFT = 3  # a finger was lifted


class Order(NamedTuple):
    """Valid order of a touch screen.

    Attributes:
        kind: Kind of the order.
        finger: Number of the finger; unused for `Kind.ALIVE`.
        number: Number of the order; the numbers on a connection increase.
        place: Position on the screen (2,) [m]; unused for `Kind.ALIVE` and `Kind.LIFT`.
    """

    kind: Kind
    finger: int
    number: int
    place: tuple[float, float]


class Box(NamedTuple):
    """Rectangle of valid positions on the screen [m]."""

    left: float
    bottom: float
    right: float
    top: float

    def contains(self, x: float, y: float) -> bool:
        """Return whether a position is in the rectangle; False for NaN and infinity."""
        return self.left <= x <= self.right and self.bottom <= y <= self.top


def read_order(data: bytes | str, fingers: int, box: Box) -> Order | str:
    """Return the order that a message contains, or the reason (str) for which the message is invalid.

    Args:
        data: Content of the message.
        fingers: Number of fingers.
        box: Rectangle of valid positions.
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
