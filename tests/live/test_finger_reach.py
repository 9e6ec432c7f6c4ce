"""Reach of fingers that are led on a screen: no goal beyond their devices, whatever is touched."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.live.guides import FingerReach, GoalWalk, guided_scene
from graspfx.live.touch_run import SPEED, TouchRun, touched_scene
from graspfx.screen.gate import gate_for, listen
from tests.support.waiting import wait_until

pytest.importorskip("websockets", reason="touching needs websockets: pip install 'graspfx[touch]'")


def test_a_finger_led_to_each_corner_does_not_end_the_run() -> None:
    """The arms reach 0.246 m from their bases; a corner of the box is farther, and its finger stays at the end."""
    scene = gx.load("paper-waving", {"engine": "interpreted"})
    with listen("127.0.0.1", 0) as line, TouchRun(scene, line, gate_for(line, lan=False)) as touch:
        box, run = touch.box, touch.run

        def column(name: str) -> Any:
            row, place = run.row(), run.layout.columns[name]
            assert row is not None
            return row[place.where].reshape(place.shape)

        def rests(finger: int, corner: tuple[float, float]) -> bool:
            """Tell whether a finger stays at its goal, which is as near to the corner as it may go."""
            assert run.fault is None
            goal = run.guides[finger].position + run.goal(finger)[0]
            end = touch._reaches[finger].nearest(np.array(corner))
            misses = goal - end, column("true_position")[finger] - goal, 0.1 * column("finger_velocity")[finger]
            return float(np.linalg.norm(misses, axis=1).max()) < 1e-3

        assert run.await_row(0, 60.0)
        corners = [(box.left, box.top), (box.right, box.bottom), (box.right, box.top), (box.left, box.bottom)]
        for each in zip(corners, (corners[k] for k in (1, 0, 3, 2)), strict=True):
            for finger in (0, 1):
                touch.press(finger, each[finger])
            wait_until(lambda each=each: rests(0, each[0]) and rests(1, each[1]))  # type: ignore[misc]
            tips = column("true_position")
            assert (np.linalg.norm(tips - [[-0.04, -0.18], [0.04, -0.18]], axis=1) < 0.246).all()
        assert touch.fault == ""


def test_a_touch_far_away_brings_its_finger_without_a_jump() -> None:
    """The goal goes at half a metre a second, and the fingertip overshoots it as 0.15 kg on 60 N/m and 1.2 N s/m do.

    At most 0.5 m/s (1 + exp(-zeta pi / sqrt(1 - zeta^2))) = 0.77 m/s, zeta = 0.2. With a goal that leaps 85 mm the
    follower alone would go at 0.0854 m / (0.02 s e) = 1.6 m/s.
    """
    scene, key = gx.load("paper-waving", {"engine": "interpreted"}), "finger.0.hand.guide.offset"
    walk = GoalWalk(SPEED)
    with gx.open(guided_scene(touched_scene(scene)), live=[key]) as session:
        session.step(1)
        start = np.array(session.recording.true_position)[0, 0]
        target = start - 0.06  # within the arm's reach
        goal: Any = walk.aim(target, start, 0.0)
        for tick in range(1, 301):
            if goal is not None:
                session.set({key: [(goal - start).tolist()]})
            session.step(1)
            goal = walk.step(tick * scene.period)
        motion = np.array(session.recording.true_position)[:, 0]
    assert np.linalg.norm(motion[-1] - target) < 1e-3
    assert 0.3 < np.linalg.norm(np.diff(motion, axis=0), axis=1).max() / scene.period < 0.8


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
