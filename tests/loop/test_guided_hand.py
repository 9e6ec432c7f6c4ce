"""Guided hands: goals behind followers, exact over any step, and nothing else than the hand that they lead."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import InputError
from graspfx.loop.guided_hand import GuidedHand
from graspfx.loop.hand import Hand, join
from graspfx.loop.motion.motion import Motion, Reach, Rest, Sine
from graspfx.loop.motion.turn import Turn
from graspfx.protocols import Follower

REST = np.array([[-0.025, 0.0], [0.025, 0.0], [0.0, 0.03]])
INWARD = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, -1.0]])
LAG, OFFSET, SQUEEZE = 0.02, np.array([[0.01, -0.004], [0.002, 0.0], [-0.003, 0.006]]), 0.005


def hand_of(**others: Any) -> Hand:
    motion = Sine(0.05, 0.7, [1.0, 0.0], ramp=0.3)
    turns = [Turn(Reach([0.8], 0.1, 0.4), [0.01, 0.02])]
    values: dict[str, Any] = {
        "motion": motion,
        "squeeze": 0.008,
        "inward": INWARD,
        "share": [1.0, 0.5, 0.0],
        "turns": turns,
    }
    return Hand(REST, 60.0, 1.0, **(values | others))


def test_targets_are_those_of_the_hand_led_aside_by_the_follower() -> None:
    """The squeeze is closed before the turn, the offset comes after it; numbers are the follower's, to the bit."""
    plain, guided = hand_of(), GuidedHand(hand_of(), LAG, OFFSET, SQUEEZE)
    offset, squeeze, time = Follower(LAG, np.zeros((3, 2))), Follower(LAG, 0.0), 0.0
    r, v = guided.target(0.0)
    assert np.array_equal(r, plain.target(0.0)[0])
    assert np.array_equal(v, plain.target(0.0)[1])
    rng = np.random.default_rng(0)
    for _ in range(300):
        h = float(rng.choice([0.0, 0.001, 0.0005, 0.01, rng.random() * 0.01]))
        before, time = time, time + h
        offset.follow(OFFSET, time - before)
        squeeze.follow(SQUEEZE, time - before)
        r, v = guided.target(time)
        angle = Reach([0.8], 0.1, 0.4).at(time)
        turn = Turn(Reach([0.8], 0.1, 0.4), [0.01, 0.02])
        closer = hand_of(squeeze=_Closed(plain_squeeze(time), squeeze), turns=[turn])
        x, dx = closer.target(time)
        assert r == pytest.approx(x + offset.position, abs=1e-15)
        assert v == pytest.approx(dx + offset.velocity, abs=1e-13), angle
        again = guided.target(time)
        assert np.array_equal(again[0], r), "asked twice at one time"
        assert np.array_equal(again[1], v)
    assert offset.position == pytest.approx(OFFSET, abs=1e-9)


def plain_squeeze(time: float) -> tuple[float, float]:
    s = min(time / 0.5, 1.0)
    return 0.008 * s**3 * (10 - 15 * s + 6 * s * s), 0.008 * 30 * s * s * (1 - s) ** 2 / 0.5


class _Closed:
    """A squeeze that stands as it is told."""

    dimensions = 1

    def __init__(self, own: tuple[float, float], follower: Follower) -> None:
        self._value = own[0] + float(follower.position), own[1] + float(follower.velocity)

    def at(self, time: float) -> tuple[Any, Any]:
        return np.array([self._value[0]]), np.array([self._value[1]])


@pytest.mark.parametrize("lag", [0.003, 0.02, 0.7])
def test_the_kernels_follower_is_the_follower(lag: float) -> None:
    """Bits are the same for any lag, step and jump of the goal."""
    rng = np.random.default_rng(5)
    guided, follower, time = GuidedHand(Hand(0.0 * REST, 1.0), lag), Follower(lag, np.zeros((3, 2))), 0.0
    [goals] = guided.goals
    for k in range(400):
        if k % 20 == 0:
            goal = rng.normal(size=(3, 2))
            guided.state[goals[:-1]] = goal.ravel()
        before, time = time, time + float(rng.choice([0.0, 1e-3, 0.5e-3, rng.random() * lag]))
        if time > before:
            follower.follow(goal, time - before)
        r, v = guided.target(time)
        assert (r.tobytes(), v.tobytes()) == ((0.0 * REST + follower.position).tobytes(), follower.velocity.tobytes())
    stays = guided.target(0.5 * time)
    assert np.array_equal(stays[0], guided.target(time)[0]), "it does not go back"


def test_a_settled_guide_is_at_its_goals_and_one_without_goals_is_no_guide() -> None:
    still = Hand(REST, 60.0, 1.0, inward=INWARD, squeeze=0.0)
    guided = GuidedHand(still, LAG, OFFSET, SQUEEZE, settled=True)
    for time in (0.0, 0.1, 7.0):
        r, v = guided.target(time)
        assert r == pytest.approx(REST + OFFSET + SQUEEZE * INWARD, abs=1e-16)
        assert not v.any()
    assert not guided.still
    for motion in (Rest(), Sine(0.05, 0.7, [1.0, 0.0])):
        plain, other = hand_of(motion=motion), GuidedHand(hand_of(motion=motion), LAG)
        for time in (0.0, 0.3, 1.1):
            assert np.array_equal(plain.target(time), other.target(time))


def test_hands_are_joined_guided_and_not() -> None:
    hands: list[Any] = [
        GuidedHand(hand_of(), LAG, OFFSET, SQUEEZE),
        Hand(REST[:1], 5.0),
        GuidedHand(hand_of(), 0.1, -OFFSET),
    ]
    alone: list[Any] = [
        GuidedHand(hand_of(), LAG, OFFSET, SQUEEZE),
        Hand(REST[:1], 5.0),
        GuidedHand(hand_of(), 0.1, -OFFSET),
    ]
    order = [6, 0, 1, 2, 3, 4, 5]
    joined: Any = join(hands, order)
    assert [len(goals) for goals in joined.goals] == [7, 7]
    for time in (0.0, 0.004, 0.01, 0.01, 0.3):
        targets = [np.concatenate(each)[order] for each in zip(*(hand.target(time) for hand in alone), strict=True)]
        assert np.array_equal(joined.target(time), targets)
    followers = joined.state[joined.followers].copy()
    other = join([GuidedHand(hand_of(), LAG, 0.0, 0.001), Hand(REST[:1], 5.0), GuidedHand(hand_of(), 0.1)], order)
    joined.adopt(other)
    assert np.array_equal(joined.state[joined.followers], followers), "followers go on"
    assert joined.state[joined.goals[0]].tolist() == [0.0] * 6 + [0.001]
    with pytest.raises(InputError, match="the same numbers and kinds of motions"):
        joined.adopt(join([hand_of(), Hand(REST[:1], 5.0), hand_of()], order))


def test_what_is_no_guide_is_refused() -> None:
    class Other:
        dimensions = 2

        def at(self, time: float) -> tuple[Any, Any]:
            return np.zeros(2), np.zeros(2)

    other: Motion = Other()
    with pytest.raises(InputError, match="motions of this package only"):
        GuidedHand(hand_of(motion=other), LAG)
    for lag in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(InputError, match="a finite time above zero"):
            GuidedHand(hand_of(), lag)
    for offset in ([0.0], [[0.0, 0.0]], [np.nan, 0.0], np.zeros((2, 3))):
        with pytest.raises(InputError, match=r"finite components \(2,\), or one vector per finger \(3, 2\)"):
            GuidedHand(hand_of(), LAG, offset)
    with pytest.raises(InputError, match="a finite distance"):
        GuidedHand(hand_of(), LAG, 0.0, np.inf)


@pytest.mark.parametrize("name", ["paper-waving", "sphere-three-fingers"])
def test_a_guide_without_goals_changes_no_number_of_a_run(name: str) -> None:
    scene, guide = gx.load(name), "hand.0.guide" if name.startswith("sphere") else "finger.*.hand.guide"
    plain, guided = gx.run(scene, duration=0.6), gx.run(scene.replace({guide: {}}), duration=0.6)
    for column in ("finger_position", "finger_velocity", "finger_force", "object_position"):
        assert np.array_equal(getattr(plain, column), getattr(guided, column)), column
    goals = {f"{guide}.offset": [0.004] * scene.dimensions, f"{guide}.squeeze": 0.002}
    runs = [gx.run(scene.replace({**goals, "engine": engine}), duration=0.6) for engine in ("interpreted", "compiled")]
    for column in ("finger_position", "finger_velocity", "finger_force", "object_position"):
        assert np.array_equal(getattr(runs[0], column), getattr(runs[1], column)), column
    assert np.abs(runs[0].finger_position - plain.finger_position).max() > 1e-3
