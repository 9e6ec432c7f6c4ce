"""The conformance kits: promises of devices and scenes, checked from pytest as far as they can be seen."""

from __future__ import annotations

from graspfx.testing.conformance import BlindSpot, DeviceReport
from graspfx.testing.device_promises import check_device
from graspfx.testing.promise import ConformanceError
from graspfx.testing.scene_promises import check_scene
from graspfx.testing.shelf import driver

__all__ = ["BlindSpot", "ConformanceError", "DeviceReport", "check_device", "check_scene", "driver"]


def __dir__() -> list[str]:
    return sorted(__all__)
