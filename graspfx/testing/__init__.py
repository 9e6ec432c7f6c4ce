"""The conformance kits: what every device and every scene promises, checked on one from pytest."""

from __future__ import annotations

from graspfx.testing.device import check_device
from graspfx.testing.promise import ConformanceError
from graspfx.testing.scene import check_scene

__all__ = ["ConformanceError", "check_device", "check_scene"]
