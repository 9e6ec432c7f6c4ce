"""Frames of the rig's serial line: COBS of a message and its CRC, ended by a zero; firmware/rig.h defines them."""

from __future__ import annotations

import binascii
import struct
from enum import IntEnum
from typing import NamedTuple

VERSION, AXES = 2, 4

ABOUT = struct.Struct("<BBBBi4iII")
STATE = struct.Struct("<BHBBI8i")
RUN = struct.Struct("<BHI4i")
LONG = struct.Struct("<BHI")
SHORT = struct.Struct("<BH")


class Kind(IntEnum):
    """The first byte of a message."""

    HELLO = 0x01
    ARM = 0x02
    STOP = 0x03
    RUN = 0x10
    POLL = 0x11
    ABOUT = 0x81
    STATE = 0x90


class Mode(IntEnum):
    """The controller's state."""

    IDLE = 0
    ARMED = 1
    RUNNING = 2
    FAULT = 3


FAULTS = (
    "no fault",
    "watchdog: no torques arrived for 5 ms, or for 5 s after the motors were switched on",
    "overspeed: a joint turned faster than the controller allows",
    "overcurrent: a motor driver has switched itself off",
    "encoder: a sensor returns no counts",
    "emergency stop: button pressed, deadman switch released, or motor supply off",
    "noise: ten damaged frames in a row",
)


class About(NamedTuple):
    """The controller's answer to HELLO."""

    version: int
    axes: int
    mode: int
    watchdog: float  # [s]
    limits: tuple[float, ...]  # torque limits of the motors [N m]
    nonce: int  # nonce of the answered HELLO
    session: int  # session number for ARM and RUN


class State(NamedTuple):
    """The controller's answer to POLL, ARM or STOP."""

    number: int  # number of the answered message
    mode: int
    fault: int
    microseconds: int  # controller's clock, modulo 2^32
    counts: tuple[int, ...]
    rates: tuple[int, ...]  # [counts/s]


def framed(message: bytes) -> bytes:
    """Frame a message: COBS(message, CRC-16/CCITT-FALSE), then 0."""
    out = bytearray()
    for part in (message + struct.pack("<H", binascii.crc_hqx(message, 0xFFFF))).split(b"\0"):
        out.append(len(part) + 1)
        out += part
    out.append(0)
    return bytes(out)


def unframed(frame: bytes) -> bytes | None:
    """Return the message of a frame without its end; None if it is damaged."""
    out, at = bytearray(), 0
    while at < len(frame):
        run = frame[at]
        if run == 0 or at + run > len(frame):
            return None
        out += frame[at + 1 : at + run]
        at += run
        if at < len(frame):
            out.append(0)
    message = bytes(out[:-2])
    if len(message) < SHORT.size or binascii.crc_hqx(message, 0xFFFF) != int.from_bytes(out[-2:], "little"):
        return None
    return message


def short_frame(kind: Kind, number: int = 0) -> bytes:
    """Return a STOP or POLL frame."""
    return framed(SHORT.pack(kind, number & 0xFFFF))


def long_frame(kind: Kind, word: int) -> bytes:
    """Return a HELLO frame with a nonce, or an ARM frame with a session."""
    return framed(LONG.pack(kind, 0, word))


def run_frame(number: int, session: int, torques: tuple[float, ...]) -> bytes:
    """Return a RUN frame with the session and the motors' torques (4,) [N m]."""
    return framed(RUN.pack(Kind.RUN, number & 0xFFFF, session, *(round(1e6 * torque) for torque in torques)))


def about_in(message: bytes) -> About | None:
    """Return the content of ABOUT; None for another message."""
    if len(message) != ABOUT.size or message[0] != Kind.ABOUT:
        return None
    _, version, axes, mode, watchdog, *limits, nonce, session = ABOUT.unpack(message)
    return About(version, axes, mode, 1e-6 * watchdog, tuple(1e-6 * limit for limit in limits), nonce, session)


def state_in(message: bytes) -> State | None:
    """Return the content of STATE; None for another message."""
    if len(message) != STATE.size or message[0] != Kind.STATE:
        return None
    _, number, mode, fault, microseconds, *axes = STATE.unpack(message)
    return State(number, mode, fault, microseconds, tuple(axes[::2]), tuple(axes[1::2]))
