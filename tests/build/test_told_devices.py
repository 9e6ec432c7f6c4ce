"""Forces as devices are told them: none after one of them failed, and none that depends on the period."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.build import pace
from tests.support.hardware import VirtualClock, driver, fakes

CART: dict[str, Any] = {
    "dimensions": 1, "period": 0.005, "duration": 0.8, "engine": "interpreted",
    "object": {"mass": 0.1, "viscosity": 0.8, "shape": {"kind": "box", "size": [0.05]}},
    "coupling": {"external": {"stiffness": 30.0}, "internal": {"stiffness": 70.0}, "absent": "follow", "enter": "ramp"},
}  # fmt: skip


def test_after_one_device_has_failed_the_next_is_told_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the tick in which the first one's `write` raises, the second one is stopped instead; both felt it before."""
    monkeypatch.setattr(pace, "WallClock", VirtualClock)
    file = driver(tmp_path)
    fingers = [
        {"start": [-0.02], "device": {"name": str(file), "position": [[-0.02]], "evil": "write raises OSError"}},
        {"start": [0.02], "device": {"name": str(file), "position": [[0.02]]}},
    ]
    recording = gx.run(gx.Scene(**CART, finger=fingers), real_time=True)
    first, second = (fake for fake in fakes(file) if fake.log)
    assert recording.faults[0].tick == first.at
    assert [first.forces[-1][0], second.forces[-1][0]] == [first.at, first.at - 1]
    assert first.forces[-2][1].any() and second.forces[-1][1].any()
    after = [what for reads, what in second.log if reads > second.forces[-1][0] + 42]
    assert after and all(what in ("stop", "close") for what in after)
    assert np.array_equal(recording.displayed_force[first.at :], np.zeros_like(recording.displayed_force[first.at :]))


def test_displayed_forces_do_not_scale_with_the_period() -> None:
    """A squeeze at rest is the same for periods of 5, 2.5 and 1 ms; others display force times the period."""
    forces = []
    for period in (0.005, 0.0025, 0.001):
        changes = {
            "engine": "interpreted", "period": period,
            "coupling.internal.stiffness": 30.0, "finger.*.hand.damping": 3.0,
            "finger.0.hand.rest": [0.01], "finger.1.hand.rest": [-0.01],
        }  # fmt: skip
        recording = gx.run(gx.load("reference-1dof", changes), duration=4.0)
        forces.append(recording.displayed_force[-1].ravel())
    assert np.abs(forces[0]).min() > 0.05
    assert forces[1] == pytest.approx(forces[0], rel=1e-6)
    assert forces[2] == pytest.approx(forces[0], rel=1e-6)
