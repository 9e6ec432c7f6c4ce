"""Conformance tests for pytest: they check the observable requirements of devices and scenes."""

from __future__ import annotations

from graspfx.testing.device_promises import check_device, driver
from graspfx.testing.promise import BlindSpot, ConformanceError, DeviceReport
from graspfx.testing.scene_promises import check_scene

__all__ = ["BlindSpot", "ConformanceError", "DeviceReport", "check_device", "check_scene", "driver"]


def __dir__() -> list[str]:
    return sorted(__all__)
