"""Reach of fingers that are led on a screen: no goal beyond their devices, whatever is touched."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.live.touch.finger_reach import FingerReach
from graspfx.live.touch.touch_run import TouchRun
from graspfx.screen.touch_address import gate_for, listen

pytestmark = pytest.mark.alone

pytest.importorskip("websockets", reason="touching needs websockets: pip install 'graspfx[touch]'")


def test_a_finger_led_to_each_corner_does_not_end_the_run() -> None:
    """The arms reach 0.246 m from their bases; a corner of the box is farther, and its finger stays at the end."""
    scene = gx.load("paper-waving", {"engine": "interpreted"})
    with listen("127.0.0.1", 0) as line, TouchRun(scene, line, gate_for(line, lan=False)) as touch:
        box, place = touch.box, touch.run.layout.columns["true_position"]
        assert touch.run.await_row(0, 10.0)
        for corner in ((box.left, box.top), (box.right, box.top), (box.left, box.bottom), (box.right, box.bottom)):
            for finger in (0, 1):
                touch.press(finger, corner)
                end = time.monotonic() + 1.2
                while time.monotonic() < end:
                    time.sleep(0.02)
                    assert touch.run.fault is None, f"finger {finger} on its way to {corner}"
            row = touch.run.row()
            assert row is not None
            tips = row[place.where].reshape(place.shape)
            assert (np.linalg.norm(tips - [[-0.04, -0.18], [0.04, -0.18]], axis=1) < 0.246).all()
        assert touch.fault == ""


def test_room_is_left_to_overshoot_in_a_box() -> None:
    """v sqrt(m/k) = 0.5 m/s sqrt(0.15 kg / 60 N/m) = 25 mm."""
    corners = np.array([-0.1, -0.1]), np.array([0.1, 0.1])
    device = SimpleNamespace(features=SimpleNamespace(workspace=corners, mass=0.15))
    hand = SimpleNamespace(stiffness=np.broadcast_to(60.0 * np.eye(1), (2, 1, 1)))
    servo: Any = SimpleNamespace(
        stations=[SimpleNamespace(fingers=np.array([0]), device=device)],
        plants=[SimpleNamespace(fingers=np.array([0]), hand=hand)],
    )
    reach = FingerReach(servo, 0, 0.5)
    assert reach.room == pytest.approx(0.025)
    assert reach.nearest(np.array([1.0, 0.02])) == pytest.approx([0.075, 0.02])
