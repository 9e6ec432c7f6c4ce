"""Targets by their kernels: the methods to the bit, compiled to rounding, third parties' motions beside ours."""

from __future__ import annotations

import copy
import pickle
from bisect import bisect_right
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspfx.compile.kernel import written
from graspfx.compile.machine import compiled
from graspfx.compile.records import Floats
from graspfx.devices.simulated import PointDevice, connect
from graspfx.errors import InputError
from graspfx.loop.hand import Hand, JoinedHands, join
from graspfx.loop.motion.motion import Levels, Path, Reach, Rest, Sine, Sum
from graspfx.loop.motion.state import HandState, JoinedHandsState
from graspfx.loop.motion.targets import count_until, joined_target, target
from graspfx.loop.motion.turn import Turn
from graspfx.loop.plant import FusedHand
from tests.support.written import plain_python

FloatArray = NDArray[np.float64]

REST = np.random.default_rng(3).normal(0.0, 0.03, (5, 3))
TIMES = np.random.default_rng(4).uniform(-0.2, 2.5, 300).tolist()
WAY = Path([0.0, 0.3, 0.8, 2.0], np.random.default_rng(5).normal(0.0, 0.02, (4, 3)))
CLOSING = Levels([[0.006, 0.0, 0.3], [-0.004, 0.6, 0.0], [0.002, 1.0, 0.5]])
ALL = Sum([Sine(0.02, 1.5, [1.0, 1.0, 0.0], 0.1, 0.4), Rest(), Sum([Reach([0.0, 0.1, 0.05], 0.2, 0.5), WAY])])
TURNS = [
    Turn(Reach([1.2], 0.1, 0.6), [0.01, 0.0, -0.02], [0.0, 1.0, 1.0]),
    Turn(Sum([Sine(0.5, 1.0, [1.0]), CLOSING]), [0.0, 0.1, 0.0], 0),
]
FLAT = REST[:2, :2]

HANDS: dict[str, Any] = {
    "at rest": Hand(REST, 33.0),
    "every motion, levels and turns": Hand(REST, 33.0, 1.0, ALL, CLOSING, -REST, share=[1, 2, 0, -1, 1], turns=TURNS),
    "in the plane": Hand(FLAT, 33.0, 1.0, Sine(0.05, 0.5, [1, 0]), turns=[Turn(Sine(0.3, 1.0, [1.0]), [0.0, 0.1])]),
    "a line": Hand([[0.0], [0.1]], 33.0, 0.0, Levels([[0.1, 0.2, 0.5]]), 0.01, [[1.0], [-1.0]]),
}
HANDS["joined"] = JoinedHands(
    [HANDS["every motion, levels and turns"], HANDS["at rest"]], [3, 9, 0, 1, 2, 8, 7, 6, 5, 4]
)


def by_kernel(hand: Any, kernel: Any, o: int = 0) -> FloatArray:
    """Targets at TIMES from a copy of the hand's block that starts at S[o], (times, 2, n, d)."""
    S = np.concatenate([np.full(o, np.nan), hand.state])
    d, n, _ = hand.stiffness.shape
    rows = []
    for t in TIMES:
        kernel(S, o, t)
        rows.append([S[o + at : o + at + n * d].reshape(n, d).copy() for at in hand.ports])
    assert np.isnan(S[:o]).all()
    np.testing.assert_array_equal(S[o + hand.structure], hand.state[hand.structure])
    return np.array(rows)


@pytest.mark.parametrize("name", HANDS)
def test_the_kernel_on_the_block_is_the_method_to_the_bit(name: str) -> None:
    """As it is lowered, and as it is written."""
    hand = HANDS[name]
    assert isinstance(hand, FusedHand)
    got = by_kernel(hand, lambda S, o, t: hand.kernel(memoryview(S), o, t), 5)
    np.testing.assert_array_equal(got, [hand.target(t) for t in TIMES])
    joined = name == "joined"
    kernel: Any = written(joined_target if joined else target)
    kind: Any = JoinedHandsState if joined else HandState
    with plain_python():
        plain = by_kernel(hand, lambda S, o, t: kernel(kind(memoryview(S), o), t), 5)
    assert plain.tobytes() == got.tobytes()
    np.testing.assert_array_equal(hand.state[hand.structure], np.rint(hand.state[hand.structure]))


def test_compiled_targets_are_the_same_to_rounding() -> None:
    # Of positions below 0.3 m and velocities below 3 m/s, and of sines and cosines.
    kernel = compiled(HANDS["joined"].kernel)
    got = by_kernel(HANDS["joined"], kernel, 5)
    np.testing.assert_allclose(got, [HANDS["joined"].target(t) for t in TIMES], rtol=0, atol=3e-15)
    kernel = compiled(HANDS["a line"].kernel)
    for name in ("at rest", "in the plane", "a line"):
        expected = [HANDS[name].target(t) for t in TIMES]
        np.testing.assert_allclose(by_kernel(HANDS[name], kernel), expected, rtol=0, atol=3e-15)


def test_times_are_counted_by_bisection() -> None:
    rng = np.random.default_rng(6)
    for count in (1, 2, 7, 64):
        times = np.sort(np.round(rng.uniform(0.0, 1.0, count), 2))
        for t in [*rng.uniform(-0.1, 1.1, 30), *times]:
            until = bisect_right(times.tolist(), t)
            assert count_until(Floats(times), count, t) == written(count_until)(Floats(times), count, t) == until


class Jump:
    """Another's motion: it says its numbers itself."""

    def __init__(self, *x: float) -> None:
        self.x, self.dimensions = np.array(x), len(x)

    def at(self, time: float) -> tuple[FloatArray, FloatArray]:
        return self.x * (time > 1.0), 0.0 * self.x


class Drifting(Sine):
    """One of ours whose course is another."""

    def at(self, time: float) -> tuple[FloatArray, FloatArray]:
        x, v = super().at(time)
        return x + 0.01 * time, v + 0.01


class Open:
    """Another's hand."""

    stiffness, damping = np.full((3, 1, 1), 20.0), np.zeros((3, 1, 1))

    def target(self, time: float) -> tuple[FloatArray, FloatArray]:
        return np.full((1, 3), time), np.ones((1, 3))


def test_motions_of_others_are_asked_and_the_hand_is_not_fused() -> None:
    along = np.array([1.0, 0.0, 0.0])
    drifting, sine = Drifting(0.02, 1.0, along), Sine(0.02, 1.0, along)
    hand = Hand(REST, 1.0, motion=Sum([drifting, Jump(0.0, 0.1, 0.0)]), squeeze=Jump(0.01), inward=np.ones((5, 3)))
    turned = Hand(REST, 1.0, turns=[Turn(Jump(0.5), [0.0, 0.0, 0.0], 2)])
    for other in (hand, turned, join([hand, HANDS["at rest"]]), join([HANDS["at rest"], Open()])):
        assert not isinstance(other, FusedHand)
    for t in (0.4, 1.5):
        late = t > 1.0
        x, v = sine.at(t)
        expected = REST + 0.01 * late / np.sqrt(3.0) + x + 0.01 * t + late * np.array([0.0, 0.1, 0.0])
        np.testing.assert_allclose(hand.target(t)[0], expected, rtol=0, atol=3e-17)
        np.testing.assert_allclose(hand.target(t)[1], np.tile(v + 0.01, (5, 1)), rtol=0, atol=3e-17)
        still = Hand(REST, 1.0, turns=[Turn(Levels([[0.5 * late, 0.0, 0.0]]), [0.0, 0.0, 0.0], 2)])
        np.testing.assert_array_equal(turned.target(t), still.target(t))
        both = join([Open(), hand], [1, 0, 2, 3, 4, 5]).target(t)
        np.testing.assert_array_equal(both[0][1], [t, t, t])
        np.testing.assert_array_equal(both[0][[0, 2, 3, 4, 5]], hand.target(t)[0])
        np.testing.assert_array_equal(both[1][1], [1.0, 1.0, 1.0])


def test_a_hand_with_targets_of_its_own_is_not_fused() -> None:
    class Trembling(Hand):
        def target(self, time: float) -> tuple[FloatArray, FloatArray]:
            r, v = super().target(time)
            return r + 1e-3, v

    hand = Trembling(REST, 33.0)
    assert not isinstance(hand, FusedHand)
    assert not isinstance(join([hand, HANDS["at rest"]]), FusedHand)
    np.testing.assert_allclose(
        join([HANDS["at rest"], hand]).target(0.0)[0], np.vstack([REST, REST + 1e-3]), atol=3e-17
    )


def test_a_turn_of_another_kind_is_refused() -> None:
    class Screw(Turn):
        def turned(self, time: float, r: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
            return r, v

    with pytest.raises(InputError, match="instances of Turn"):
        Hand(REST, 1.0, turns=[Screw(Reach([1.0]), [0.0, 0.0, 0.0], 2)])


@pytest.mark.parametrize("name", ["every motion, levels and turns", "joined"])
def test_a_plant_moves_alike_whether_it_sees_the_block_or_asks(name: str) -> None:
    class Asked:
        """A hand like it without its block."""

        def __init__(self, hand: Any) -> None:
            self.stiffness, self.damping, self.target = hand.stiffness, hand.damping, hand.target

    hand = HANDS[name]
    n = hand.stiffness.shape[1]
    places = []
    for held in (hand, Asked(hand)):
        plant = PointDevice.plant([connect(mass=0.1, dimensions=3, fingers=n)])
        plant.place(np.zeros((n, 3)))
        for _ in range(100):
            plant.advance(np.zeros((n, 3)), held, 0.01)
        places.append(plant.position)
    np.testing.assert_array_equal(*places)
    assert np.abs(places[0]).max() > 0.01


def test_targets_are_the_callers_and_hands_can_be_copied() -> None:
    hand = HANDS["joined"]
    before, _ = hand.target(0.3)
    kept = before.copy()
    hand.target(0.4)
    np.testing.assert_array_equal(before, kept)
    for other in (copy.deepcopy(hand), pickle.loads(pickle.dumps(hand))):
        other.target(0.9)
        np.testing.assert_array_equal(other.target(0.3), hand.target(0.3))
