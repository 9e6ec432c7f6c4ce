"""Kernels of the loop without Python against the rules of Python's: deadlines, ends."""

from __future__ import annotations

import random

import numpy as np
import pytest

from graspfx.compile.records import Floats, size_for
from graspfx.loop.realtime.native_clock import DRIVEN, PACED, ClockState, arrive, count_in, set_deadline
from graspfx.loop.realtime.native_end import EndState, go_on
from graspfx.loop.realtime.pacing import Pacer
from graspfx.loop.realtime.soft_end import SoftEnd, decay_ticks

PERIOD = 0.001


class Script:
    """A clock whose ticks take what a script says."""

    def __init__(self, lateness: list[float]) -> None:
        self.time, self.lateness = 100.0, lateness

    def now(self) -> float:
        return self.time

    def sleep(self, duration: float) -> None:
        self.time += duration + self.lateness.pop()


@pytest.mark.parametrize("seed", range(5))
def test_deadlines_are_those_of_the_pacer(seed: int) -> None:
    """Lateness, periods left out, wall and counts are the same to the bit, for ticks that come when they will."""
    random.seed(seed)
    late = [random.choice((0.0, 1e-5, 3e-4, 1.5e-3, 7.2e-3)) * random.random() for _ in range(2000)]
    own, other = Script([*late]), Pacer(PERIOD)
    pacer = Pacer(PERIOD, own)
    clock = ClockState(np.zeros(size_for(ClockState)))
    clock.mode, clock.period = PACED, PERIOD
    for _ in range(400):
        busy = random.choice((0.0, 2e-4, 2.5e-3)) * random.random()
        before = own.time
        skipped = pacer.wait()
        deadline = set_deadline(clock, before)
        assert deadline <= own.time or deadline == before
        assert arrive(clock, own.time) == skipped
        assert (clock.deadline, clock.late, clock.row) == (pacer.deadline, pacer.late, pacer.row)
        assert (clock.skipped, clock.left_out) == (pacer.skipped, pacer.left_out)
        assert clock.wall == pacer.wall
        own.time += busy
    assert clock.latest == pacer.latest
    assert clock.most_late == pacer.lateness.most
    assert clock.array(ClockState.lateness).tolist() == pacer.lateness.counts
    assert other.deadline is None


def test_a_caller_with_the_clock_is_never_late_for_long() -> None:
    """Its period may be another than ours: nothing adds up; only a tick that comes periods later leaves some out."""
    clock = ClockState(np.zeros(size_for(ClockState)))
    clock.mode, clock.period = DRIVEN, PERIOD
    time, skips = 5.0, []
    for step in [1.2e-3] * 50 + [3.4e-3, 1e-3, 0.2e-3, 1e-3]:
        set_deadline(clock, time)
        skips.append(arrive(clock, time))
        time += step
    assert skips == [0] * 51 + [2, 0, 0]
    assert clock.row in (0, 2)
    assert clock.latest < PERIOD


def test_times_are_counted_by_the_microsecond() -> None:
    bins = np.zeros(4096)
    for time in (-1.0, 0.0, 1.5e-6, 4.0945e-3, 4.0951e-3, 1.0, 1e300):
        count_in(Floats(bins), time)
    assert (bins[0], bins[1], bins[4094], bins[4095]) == (2.0, 1.0, 1.0, 3.0)


@pytest.mark.parametrize("stop", [None, 0, 5, 85, 95])
@pytest.mark.parametrize("faulted", [False, True])
def test_a_loop_ends_as_pythons_does(stop: int | None, faulted: bool) -> None:
    last = 100
    chain = type("Chain", (), {"rest": lambda self: None})()
    soft, end = SoftEnd(chain, PERIOD, last), EndState(np.zeros(size_for(EndState)))
    end.decay, end.last = decay_ticks(PERIOD), last
    k, told = 0, False
    while True:
        asked = stop is not None and k >= stop
        runs = k < soft.last
        if runs and asked and not told:
            told, runs = True, soft.stop(k, faulted=faulted)
            runs = runs and k < soft.last
        assert go_on(end, k, int(asked), float(faulted)) == int(runs)
        if not runs:
            break
        soft.begin(k, None)
        assert bool(end.is_begun) == soft._is_begun
        k += 1
    assert end.last == soft.last or faulted
