"""Every scene on the shelf: loads, says its plan, runs without a fault, stays bounded, repeats to the bit."""

from __future__ import annotations

import numpy as np
import pytest

import graspfx as gx
from graspfx import plugins
from graspfx.scene.plan import plan


@pytest.fixture(params=sorted(plugins.names("scenes")))
def scene(request: pytest.FixtureRequest) -> gx.Scene:
    return gx.load(request.param)


def test_says_its_title_and_plan(scene: gx.Scene) -> None:
    assert scene.title
    assert {row.step for row in plan(scene)} >= {"split", "impedance", "move"}


def test_runs_whole_and_stays_bounded(scene: gx.Scene) -> None:
    """No fault; forces below 2 N and motions below 0.2 m, several times what the scenes mean to do."""
    rec = gx.run(scene)
    assert len(rec) == round(scene.duration / scene.period)
    assert not rec.faults
    assert np.isfinite(rec.rows).all()
    assert np.abs(rec.finger_force).max() < 2.0
    assert np.abs(rec.finger_position).max() < 0.2 and np.abs(rec.object_position).max() < 0.2


def test_repeats_to_the_bit(scene: gx.Scene) -> None:
    assert np.array_equal(gx.run(scene, duration=0.3).rows, gx.run(scene, duration=0.3).rows)


def test_wrench_is_the_forces_sum_and_the_devices_get_their_negative(scene: gx.Scene) -> None:
    """f_v = G f (eq. 2), the moment about the object's centre from the fingertips."""
    rec = gx.run(scene, duration=1.0)
    d = scene.dimensions
    assert np.abs(rec.wrench[:, :d] - rec.finger_force.sum(axis=1)).max() < 1e-15
    if d == 2:
        arms = rec.finger_position - rec.object_position[:, None, :]
        moment = (arms[..., 0] * rec.finger_force[..., 1] - arms[..., 1] * rec.finger_force[..., 0]).sum(axis=1)
        assert np.abs(rec.wrench[:, 2] - moment).max() < 1e-16
