"""Emulators of the hardware behind drivers: what is on the wire can be looked at, and the wire fails on demand."""

from __future__ import annotations

from graspfx.testing.wire.diy_wire import DiyWire
from graspfx.testing.wire.event_wire import EventWire
from graspfx.testing.wire.force_dimension_wire import ForceDimensionWire
from graspfx.testing.wire.inverse_wire import InverseWire
from graspfx.testing.wire.open_haptics_wire import OpenHapticsWire
from graspfx.testing.wire.rig_wire import RigWire
from graspfx.testing.wire.screen_wire import ScreenWire
from graspfx.testing.wire.serial_wire import SerialWire
from graspfx.testing.wire.wire import FAILURES, Failure, Wire

__all__ = [
    "FAILURES",
    "DiyWire",
    "EventWire",
    "Failure",
    "ForceDimensionWire",
    "InverseWire",
    "OpenHapticsWire",
    "RigWire",
    "ScreenWire",
    "SerialWire",
    "Wire",
]


def __dir__() -> list[str]:
    return sorted(__all__)
