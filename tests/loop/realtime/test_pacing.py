"""Deadlines of ticks: absolute, with whole periods left out where one is late."""

from __future__ import annotations

import pytest

from graspfx.loop.realtime.pacing import Pacer, WallClock

T = 0.001


class Clock:
    """A clock that goes on where it is told to, and oversleeps."""

    def __init__(self, oversleeps: float = 0.0) -> None:
        self.time, self.oversleeps = 100.0, oversleeps

    def now(self) -> float:
        return self.time

    def sleep(self, duration: float) -> None:
        self.time += duration + self.oversleeps


def test_no_lateness_adds_up() -> None:
    """Each tick takes 0.3 ms and each sleep 0.2 ms too long: after 10 s the ticks are where they began, on the grid."""
    clock = Clock(0.2e-3)
    pacer = Pacer(T, clock)
    for k in range(10_001):
        assert pacer.wait() == 0
        assert clock.time - 100.0 == pytest.approx(k * T + (0.2e-3 if k else 0.0), abs=1e-9)
        clock.time += 0.3e-3
    assert pacer.skipped == 0
    assert pacer.latest == pytest.approx(0.2e-3, abs=1e-9)


def test_a_late_tick_leaves_out_whole_periods() -> None:
    """Late by 2.4 periods: two are left out, and the tick is at once; the next one is on the grid again."""
    clock = Clock()
    pacer = Pacer(T, clock)
    pacer.wait()
    clock.time += 3.4e-3
    assert pacer.wait() == 2
    assert clock.time == pytest.approx(100.0034)
    assert (pacer.row, pacer.skipped) == (2, 2)
    clock.time += 2.7e-3  # at 6.1, where 4 is due: two more in a row
    assert pacer.wait() == 2
    assert (pacer.row, pacer.skipped) == (4, 4)
    assert pacer.wait() == 0
    assert clock.time == pytest.approx(100.007)
    assert (pacer.row, pacer.skipped) == (0, 4)


def test_a_sleep_that_was_too_long_is_late() -> None:
    """The machine was away for 50 ms while a tick waited: that very tick leaves out the periods that have passed."""
    clock = Clock()
    pacer = Pacer(T, clock)
    pacer.wait()
    clock.oversleeps = 50.5e-3
    assert pacer.wait() == 50
    assert pacer.row == 50
    clock.oversleeps = 0.0
    assert pacer.wait() == 0
    assert clock.time == pytest.approx(100.052)
    assert pacer.row == 0


def test_a_wait_ends_where_the_run_is_stopped() -> None:
    """A sleep of a second is cut: the run that is stopped in it ends within 5 ms."""
    clock = Clock()
    pacer = Pacer(1.0, clock)
    pacer.wait()
    pacer.wait(lambda: clock.time > 100.5)
    assert clock.time == pytest.approx(100.5, abs=0.006)


def test_the_clock_of_the_machine_does_not_run_back() -> None:
    clock = WallClock()
    before = clock.now()
    clock.sleep(0.001)
    assert clock.now() >= before + 0.001
