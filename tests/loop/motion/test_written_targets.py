"""Kernels of hands: as they are written and lowered they give the same bits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from graspfx.compile.kernel import written
from graspfx.compile.records import Floats
from graspfx.loop.hand import Hand, JoinedHands
from graspfx.loop.motion.motion import Levels, Motion, Path, Reach, Sine, Sum
from graspfx.loop.motion.state import Course, Displacement, HandState, JoinedHandsState, Turning
from graspfx.loop.motion.targets import count_until, displace, joined_target, target, turn
from graspfx.loop.motion.turn import Turn

RNG = np.random.default_rng(17)
TIMES = RNG.uniform(-0.3, 2.6, 40).tolist()
CLOSING = Levels([[0.006, 0.0, 0.3], [-0.004, 0.6, 0.0], [0.002, 1.0, 0.5]])


def way(d: int) -> Motion:
    """Sum a motion of each kind."""
    u = RNG.normal(size=d)
    path = Path([0.0, 0.3, 0.8, 2.0], RNG.normal(0.0, 0.02, (4, d)))
    return Sum([Sine(0.02, 1.5, u, 0.1, 0.4), Reach(0.1 * u, 0.2, 0.5), path, Sine(0.01, 0.5, u)])


def turns(d: int) -> list[Turn]:
    """Turn twice, in space about different axes."""
    angles = Reach([1.2], 0.1, 0.6), Sum([Sine(0.5, 1.0, [1.0]), CLOSING])
    axes = ([0.0, 1.0, 1.0], 0) if d == 3 else (None, None)
    return [Turn(angle, RNG.normal(0.0, 0.1, d), axis) for angle, axis in zip(angles, axes, strict=True)]


def hand(n: int, d: int, turning: bool) -> Hand:
    """Make a hand with a motion of each kind, levels and perhaps turns."""
    rest = RNG.normal(0.0, 0.03, (n, d))
    return Hand(rest, 33.0, 1.0, way(d), CLOSING, -rest, turns=turns(d) if turning else ())


@pytest.mark.parametrize(("d", "turning"), [(1, False), (2, False), (2, True), (3, False), (3, True)])
def test_hands(d: int, turning: bool) -> None:
    one = hand(3, d, turning).state
    other, before = one.copy(), one.copy()
    for t in TIMES:
        written(target)(HandState(one.data), t)
        target(HandState(other.data), t)
        assert one.tobytes() == other.tobytes()
    assert one.tobytes() != before.tobytes()


def test_joined_hands() -> None:
    one = JoinedHands([hand(2, 3, True), Hand(np.zeros((1, 3)), 1.0), hand(3, 3, False)], [5, 0, 2, 1, 4, 3]).state
    other = one.copy()
    for t in TIMES:
        written(joined_target)(JoinedHandsState(one.data), t)
        joined_target(JoinedHandsState(other.data), t)
        assert one.tobytes() == other.tobytes()


@pytest.mark.parametrize("d", [1, 2, 3])
def test_motions(d: int) -> None:
    course: Any = HandState(hand(2, d, False).state).motion
    one, other = np.full(6, np.nan), np.full(6, np.nan)
    for t in TIMES:
        written(displace)(Course(course.buffer, course.offset), t, Displacement(one))
        displace(Course(course.buffer, course.offset), t, Displacement(other))
        assert one.tobytes() == other.tobytes()
        assert not one[[*range(d, 3), *range(3 + d, 6)]].any()


@pytest.mark.parametrize("d", [2, 3])
def test_turns(d: int) -> None:
    codes = set()
    for each in turns(d):
        one, other = each.laid_out.entries.copy(), each.laid_out.entries.copy()
        r, v = RNG.normal(size=4 * d), RNG.normal(size=4 * d)
        r_, v_ = r.copy(), v.copy()
        for t in TIMES:
            code = written(turn)(Turning(one), t, Floats(r), Floats(v), 4, d)
            assert code == turn(Turning(other), t, Floats(r_), Floats(v_), 4, d)
            codes.add(code)
            assert (r.tobytes(), v.tobytes(), one.tobytes()) == (r_.tobytes(), v_.tobytes(), other.tobytes())
    assert codes == {0, 1}


def test_times_are_counted_alike() -> None:
    times = np.sort(RNG.uniform(0.0, 1.0, 9))
    for t in [*RNG.uniform(-0.1, 1.1, 20), *times]:
        count = written(count_until)(Floats(times), 9, float(t))
        assert count == count_until(Floats(times), 9, float(t)) == int(np.searchsorted(times, t, "right"))
