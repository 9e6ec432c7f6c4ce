"""Every setting of the devices on the shelf, given what it cannot be; their motion stands in `test_stress_scenes`."""

from __future__ import annotations

from typing import Any

import pytest

from graspfx import plugins
from tests.support.bad_values import bad_values, outcome
from tests.support.families import family

SETTINGS = family("devices: bad settings", "an error of GraspFX, or a device")

GOOD: dict[str, dict[str, Any]] = {
    "simulated": {
        "mass": 0.1, "dimensions": 2, "damping": 0.2, "fingers": 1, "resolution": 1e-5, "velocity_window": 8,
        "delay": 1, "force_limit": 5.0, "workspace": ([-1.0, -1.0], [1.0, 1.0]),
    },
    "two-link": {
        "base": [0.0, 0.0], "elbow": "left", "links": [0.128, 0.128], "link_masses": [0.1, 0.1], "counts": 4000,
        "gear": 15.0, "zero": [0.0, 0.0], "torque_limit": 0.06, "margin": 0.01, "velocity_window": 8, "delay": 0,
        "drive": "base", "joint_damping": [1e-4, 1e-4],
    },
}  # fmt: skip


@pytest.mark.parametrize("name", GOOD)
def test_every_setting(name: str) -> None:
    connect = plugins.load("devices", name).connect
    assert not outcome(connect, GOOD[name])
    silent = []
    for key, value in GOOD[name].items():
        for bad in bad_values(value):
            SETTINGS.tried()
            found = outcome(connect, {**GOOD[name], key: bad})
            if found:
                silent.append(f"{key} = {bad!r:.60}: {found:.100}")
    assert not silent, "\n".join(silent)
