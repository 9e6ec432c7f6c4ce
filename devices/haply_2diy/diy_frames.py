"""Frames of the 2DIY's line: little-endian, without a beginning, a length or a checksum.

Ports ascend in every frame: port 1 is motor and encoder 2, port 2 is motor and encoder 1. The board answers a frame of
torques with the device's number and the angles; it answers nothing else.
"""

from __future__ import annotations

import math
import struct

SETUP, TORQUE = 1, 2
PORTS = 0b11  # of motors and of encoders
COUNTERCLOCKWISE = 1

ANGLES = struct.Struct("<B2f")  # the answer: device, then angles of encoders 2 and 1 [deg]


def setup_frame(device: int, home: tuple[float, float], counts: float) -> bytes:
    """Write the set-up: two motors, two encoders, no sensors; home [deg] is what encoders 1 and 2 show from then on."""
    first, second = home
    head = bytes([SETUP, device, PORTS, COUNTERCLOCKWISE, COUNTERCLOCKWISE, PORTS, COUNTERCLOCKWISE, COUNTERCLOCKWISE])
    return head + struct.pack("<BB4f", 0, 0, second, counts, first, counts)


def torque_frame(device: int, first: float, second: float) -> bytes:
    """Write the torques of motors 1 and 2 [N m]."""
    return struct.pack("<BB2f", TORQUE, device, second, first)


def angles_in(answer: bytes, device: int) -> tuple[float, float] | None:
    """Read the angles of encoders 1 and 2 [deg] from an answer; None if it cannot be this device's."""
    if len(answer) != ANGLES.size:
        return None
    identity, second, first = ANGLES.unpack(answer)
    if identity != device or not (math.isfinite(first) and math.isfinite(second)):
        return None
    return first, second
