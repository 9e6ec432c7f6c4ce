"""Frames of the 2DIY's serial line: little-endian, without start byte, length or checksum.

Ports are in ascending order: port 1 is motor and encoder 2, port 2 is motor and encoder 1. The board answers a frame
of torques with the device's number and the angles; it answers no other frame.
"""

from __future__ import annotations

import math
import struct

SETUP, TORQUE = 1, 2
PORTS = 0b11  # bits of the motors' and encoders' ports
COUNTERCLOCKWISE = 1

ANGLES = struct.Struct("<B2f")  # answer: device, then angles of encoders 2 and 1 [deg]


def setup_frame(device: int, home: tuple[float, float], counts: float) -> bytes:
    """Return the set-up frame: two motors, two encoders, no sensors, and angles `home` of encoders 1 and 2 [deg]."""
    first, second = home
    head = bytes([SETUP, device, PORTS, COUNTERCLOCKWISE, COUNTERCLOCKWISE, PORTS, COUNTERCLOCKWISE, COUNTERCLOCKWISE])
    return head + struct.pack("<BB4f", 0, 0, second, counts, first, counts)


def torque_frame(device: int, first: float, second: float) -> bytes:
    """Return the frame with the torques of motors 1 and 2 [N m]."""
    return struct.pack("<BB2f", TORQUE, device, second, first)


def angles_in(answer: bytes, device: int) -> tuple[float, float] | None:
    """Return the angles of encoders 1 and 2 [deg] in an answer; None if it is damaged or from another device."""
    if len(answer) != ANGLES.size:
        return None
    identity, second, first = ANGLES.unpack(answer)
    if identity != device or not (math.isfinite(first) and math.isfinite(second)):
        return None
    return first, second
