"""Scenes that pick up, carry and turn keep momentum, the law of the lever and the law of drag."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import graspfx as gx
from graspfx.assembly.build import build
from graspfx.objects.floor.floor import FloorBody
from graspfx.recording.header import Header
from graspfx.recording.record import Recording
from graspfx.recording.recorder import Recorder
from tests.support.carriers import CARRIERS, require

FloatArray = NDArray[np.float64]

M, G = 0.15, np.array([0.0, 0.0, -9.81])  # of pick-and-place


@pytest.fixture(scope="module")
def picked() -> tuple[Recording, FloatArray]:
    """A run of pick-and-place, and the floor's force on the box in each of its samples [N]."""
    scene = gx.load("pick-and-place")
    floor = np.zeros((round(scene.duration / scene.period), 3))
    with build(scene) as servo:
        (mover,) = servo.movers
        body = mover.body
        assert isinstance(body, FloorBody)
        recorder = Recorder(servo.layout, Header(scene.period))
        for force in floor:
            servo.tick(recorder)
            recorder.drain()
            force[:] = body.contact_wrench[:3]
        assert body.associated == 0
    return recorder.finish(), floor


def test_a_picked_box_keeps_its_momentum(picked: tuple[Recording, FloatArray]) -> None:
    """m (v+ - v) = T (fingers + floor + m g) in every sample.

    There is no viscosity, and the exact integrator then adds T a to the velocity: what is left is rounding, 1e-15 of
    the weight's impulse.
    """
    recording, floor = picked
    impulse = recording.period * (recording.wrench[:, :3] + floor + M * G)
    gained = M * np.diff(recording.object_velocity, axis=0)
    weight = M * 9.81 * recording.period
    assert abs(gained - impulse[:-1]).max() < 1e-12 * weight
    assert abs(impulse.sum(axis=0)).max() < 1e-12 * weight * len(impulse)  # at rest before and after
    lifted = (floor == 0.0).all(axis=1)
    assert 900 < lifted.sum() < 1100  # 2 s in the air, of fingers and weight alone


def test_the_floor_only_pushes_and_rubs(picked: tuple[Recording, FloatArray]) -> None:
    """lambda_n >= 0 and |lambda_t| <= mu lambda_n, mu = 0.5."""
    _, floor = picked
    assert floor[:, 2].min() >= 0.0
    assert (np.hypot(floor[:, 0], floor[:, 1]) <= 0.5 * floor[:, 2] * (1.0 + 1e-9)).all()


@pytest.mark.parametrize("dynamics", CARRIERS)
def test_others_put_the_box_at_the_same_place(dynamics: str, picked: tuple[Recording, FloatArray]) -> None:
    """Within 5 um, of the 50 um that the edge which lands first shifts both: 1 um measured.

    Native corners sink by m g/(4 k) = 4 um into the floor and theirs do not; in the air both hang alike but for
    that.
    """
    require(dynamics)
    native, _ = picked
    other = gx.run(gx.load("pick-and-place", {"object.dynamics": dynamics}))
    assert not other.faults
    assert not other.touching[-1].any()
    assert abs(other.object_position[-1] - native.object_position[-1]).max() < 5e-6
    assert other.object_position[-1, 2] == pytest.approx(0.03, abs=1e-9 if dynamics == "bullet" else 5e-8)
    ours, theirs = native.object_orientation, other.object_orientation
    assert ours is not None and theirs is not None
    assert theirs[-1] == pytest.approx(ours[-1], abs=1e-5)
    hanging = (native.time > 2.1) & (native.time < 2.4)
    assert abs(native.object_position - other.object_position)[hanging].max() < 2e-5


@pytest.mark.parametrize("right", [0.05, 0.15])
def test_two_hands_share_a_bar_by_its_lever_arms(right: float) -> None:
    """Load times arm is the same on both sides; half of the weight each where the arms are equal.

    With arms of 150 and 50 mm the bar hangs askew by 25 mrad, and the arms are off by as much squared: 6e-4.
    """
    lift = {"kind": "reach", "displacement": [0.0, 0.0, 0.08], "begin": 0.6, "duration": 0.5}
    changes = {"hand.0.motion": lift, "hand.1.motion": lift, "hand.0.turn.angle": 0.0, "hand.1.turn.angle": 0.0}
    starts = {"finger.2.start": [right, -0.03, 0.015], "finger.3.start": [right, 0.03, 0.015]}
    force = gx.run(gx.load("carry-bar", {**changes, **starts}), duration=2.8).finger_force[-1, :, 2]
    assert force[:2].sum() == pytest.approx(0.5 * 9.81 * right / (0.15 + right), rel=6e-4)
    assert force.sum() == pytest.approx(0.5 * 9.81, rel=1e-4)


def test_a_knob_is_moved_by_its_moment_alone() -> None:
    """I w' = M - b_w w, and a push sideways is felt with kip whatever kep is: only the rotation is external."""
    knob = gx.run(gx.load("knob", {"coupling.external.stiffness": 200.0}))
    assert knob.wrench[-1, :2] == pytest.approx([4 * 0.003 * 300.0 * 500.0 / 800.0, 0.0], abs=1e-4)
    w = knob.objects["knob"].angular_velocity
    assert w is not None
    E = np.exp(-0.02 * knob.period / (0.5 * 0.1 * 0.025**2))  # a cylinder's moment of inertia, M held over the sample
    assert abs(E * w[:-1, 2] + (1.0 - E) / 0.02 * knob.wrench[:-1, 5] - w[1:, 2]).max() < 1e-12 * abs(w).max()
