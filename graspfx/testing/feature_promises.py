"""Conformance of what a device tells about itself before it is opened."""

from __future__ import annotations

import math

import numpy as np

from graspfx.loop.device import Device, Features
from graspfx.testing.promise import Promises


def check_features(device: Device, promises: Promises) -> Features:
    """Check the features that a device tells before it is opened, and give them."""
    with promises("features are told before `open`, and what is not known is None, never zero") as promise:
        features = device.features
        k, d = features.fingers, features.dimensions
        promise.holds(_whole(k) and k >= 1, f"fingers = {k!r}, which is no count of channels")
        promise.holds(_whole(d) and 1 <= d <= 3, f"dimensions = {d!r}, which is not 1, 2 or 3")
        for name in ("continuous_force", "peak_force", "stiffness", "mass", "resolution", "watchdog", "rate"):
            value = getattr(features, name)
            nothing = name == "continuous_force" and value == 0.0 and features.peak_force is None
            good = value is None or nothing or (math.isfinite(value) and value > 0.0)
            promise.holds(good, f"{name} = {value!r}")
        for name in ("damping", "friction", "latency", "lateness"):
            value = getattr(features, name)
            promise.holds(value is None or (math.isfinite(value) and value >= 0.0), f"{name} = {value!r}")
        delay = features.delay
        promise.holds(
            delay is None or (_whole(delay) and delay >= 0), f"delay = {delay!r}, which is no count of samples"
        )
        if features.continuous_force is not None and features.peak_force is not None:
            finding = f"continuous_force {features.continuous_force} N above peak_force {features.peak_force} N"
            promise.holds(features.continuous_force <= features.peak_force, finding)
        if features.workspace is not None:
            lower, upper = (np.asarray(corner, dtype=float) for corner in features.workspace)
            promise.holds(
                lower.shape == upper.shape == (d,) and np.isfinite((lower, upper)).all() and (lower < upper).all(),
                f"workspace = {features.workspace!r}, which is no pair of a lower and a higher corner ({d},)",
            )
    return features


def _whole(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)
