"""Orders of a page: sound ones are read, and nothing else leads anywhere."""

from __future__ import annotations

import math
import random
import struct

import pytest

from graspfx.screen.touch_orders import ORDER, Box, Kind, Order, read_order

BOX = Box(-0.15, -0.1, 0.15, 0.1)


def test_orders_are_read() -> None:
    """The bytes are those of the page: kind, finger, two of zero, number, x, y, the least byte first."""
    assert ORDER.size == 24
    data = bytes([1, 1, 0, 0, 7, 1, 0, 0]) + struct.pack("<dd", 0.15, -0.1)
    assert read_order(data, 2, BOX) == Order(Kind.PRESS, 1, 263, (0.15, -0.1))
    assert read_order(ORDER.pack(0, 200, 0, 1, 9.0, 9.0), 2, BOX) == Order(Kind.ALIVE, 200, 1, (9.0, 9.0))
    assert read_order(ORDER.pack(3, 0, 0, 1, 0.0, 0.0), 2, BOX) == Order(Kind.LIFT, 0, 1, (0.0, 0.0))


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "length"),
        ("a text", "length"),
        (bytes(23), "length"),
        (bytes(25), "length"),
        (ORDER.pack(4, 0, 0, 1, 0.0, 0.0), "kind"),
        (ORDER.pack(1, 0, 1, 1, 0.0, 0.0), "kind"),
        (ORDER.pack(1, 2, 0, 1, 0.0, 0.0), "finger"),
        (ORDER.pack(3, 255, 0, 1, 0.0, 0.0), "finger"),
        (ORDER.pack(1, 0, 0, 1, 0.1500001, 0.0), "place"),
        (ORDER.pack(2, 0, 0, 1, 0.0, math.nan), "place"),
        (ORDER.pack(2, 0, 0, 1, -math.inf, 0.0), "place"),
        (ORDER.pack(3, 0, 0, 1, math.nan, 0.0), "place"),
    ],
)
def test_others_are_not(data: bytes | str, reason: str) -> None:
    assert read_order(data, 2, BOX) == reason


def test_no_bytes_lead_out_of_the_box() -> None:
    """Random bytes and damaged orders: whatever is read is sound."""
    chance = random.Random(1)
    sound = 0
    for _ in range(20_000):
        data = bytearray(ORDER.pack(chance.randrange(4), chance.randrange(2), 0, 5, 0.01, 0.02))
        for _ in range(chance.randrange(4)):
            data[chance.randrange(24)] = chance.randrange(256)
        order = read_order(bytes(data), 2, BOX)
        if isinstance(order, Order):
            sound += 1
            assert all(map(math.isfinite, order.place))
            if order.kind in (Kind.PRESS, Kind.MOVE):
                assert order.finger < 2 and abs(order.place[0]) <= 0.15 and abs(order.place[1]) <= 0.1
    assert 5_000 < sound < 20_000
