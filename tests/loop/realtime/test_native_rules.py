"""Rules of loops on the wall's clock against the same rules in plain words: deadlines, ends."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from graspfx.compile.records import size_for
from graspfx.loop.realtime.pacing import (
    DRIVEN,
    ClockState,
    EndState,
    Lateness,
    Pacer,
    SoftEnd,
    arrive,
    decay_ticks,
    go_on,
    set_deadline,
)
from tests.support.optional import require

PERIOD = 0.001


class Script:
    """A clock whose ticks take what a script says."""

    def __init__(self, lateness: list[float]) -> None:
        self.time, self.lateness = 100.0, lateness

    def now(self) -> float:
        return self.time

    def sleep(self, duration: float) -> None:
        self.time += duration + self.lateness.pop()


class Plain:
    """Deadlines t_0 + k T, and what a tick that comes too late leaves out."""

    def __init__(self, clock: Script) -> None:
        self.clock, self.deadline, self.start = clock, 0.0, -1.0
        self.skipped = self.row = self.left_out = 0
        self.late = self.wall = self.latest = self.most = 0.0
        self.counts = [0] * 4096

    def wait(self) -> int:
        clock = self.clock
        if self.start < 0.0:
            self.deadline = self.start = clock.now()
            return 0
        self.deadline += PERIOD
        is_early = clock.now() < self.deadline
        while clock.now() < self.deadline:
            clock.sleep(min(self.deadline - clock.now(), 0.005))
        late = clock.now() - self.deadline
        skipped = math.floor(late / PERIOD) if late >= PERIOD else 0
        self.deadline += skipped * PERIOD
        self.skipped += skipped
        self.row = 0 if is_early and not skipped else self.row + skipped
        self.late, self.left_out = late - skipped * PERIOD, skipped
        self.wall = self.deadline + self.late - self.start
        self.latest, self.most = max(self.latest, self.late), max(self.most, late)
        self.counts[min(max(int(1e6 * late), 0), 4095)] += 1
        return skipped


@pytest.mark.parametrize("machine", [False, True], ids=["source", "machine code"])
@pytest.mark.parametrize("seed", range(5))
def test_deadlines_stay_on_the_grid_of_the_first(seed: int, machine: bool) -> None:
    """Lateness, periods left out, wall and counts are the same to the bit, for ticks that come when they will."""
    random.seed(seed)
    late = [random.choice((0.0, 1e-5, 3e-4, 1.5e-3, 7.2e-3)) * random.random() for _ in range(2000)]
    one, other = Script([*late]), Script([*late])
    if machine:
        require("llvmlite")
    pacer, plain = Pacer(PERIOD, one, machine=machine), Plain(other)
    for _ in range(400):
        busy = random.choice((0.0, 2e-4, 2.5e-3)) * random.random()
        assert pacer.wait() == plain.wait()
        assert (pacer.deadline, pacer.late, pacer.row) == (plain.deadline, plain.late, plain.row)
        assert (pacer.skipped, pacer.left_out, pacer.wall) == (plain.skipped, plain.left_out, plain.wall)
        one.time += busy
        other.time += busy
    assert one.time == other.time
    assert (pacer.latest, pacer.lateness.most) == (plain.latest, plain.most)
    assert pacer.lateness.array(Lateness.counts).tolist() == plain.counts


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
    times = Lateness()
    for time in (-1.0, 0.0, 1.5e-6, 4.0945e-3, 4.0951e-3, 1.0, 1e300):
        times.add(time)
    bins = times.array(Lateness.counts)
    assert (bins[0], bins[1], bins[4094], bins[4095]) == (2.0, 1.0, 1.0, 3.0)
    assert times.most == 1e300


class Ending:
    """The last ticks of a run, in which forces decay: those of its duration, or as many more once it is to stop."""

    def __init__(self, last: int) -> None:
        self.ticks, self.last, self.is_stopped, self.start = decay_ticks(PERIOD), last, False, -1

    def goes_on(self, k: int, *, stop: bool, faulted: bool) -> bool:
        if stop and faulted:
            return False
        if stop and not self.is_stopped:
            self.is_stopped, self.last = True, min(self.last, k + self.ticks)
        if k < self.last and self.start < 0 and k >= self.last - self.ticks:
            self.start = k
        return k < self.last


@pytest.mark.parametrize("stop", [None, 0, 5, 85, 95])
@pytest.mark.parametrize("faulted", [False, True])
def test_forces_decay_in_the_last_ticks(stop: int | None, faulted: bool) -> None:
    rests: list[int] = []
    k: int
    chain = type("Chain", (), {"rest": lambda self: rests.append(k)})()
    soft, plain, k = SoftEnd(chain, PERIOD, 100), Ending(100), 0
    while True:
        asked = stop is not None and k >= stop
        runs = plain.goes_on(k, stop=asked, faulted=faulted)
        assert soft.goes_on(k, stop=asked, faulted=faulted) == runs
        if not runs:
            break
        soft.tell(None)
        k += 1
    assert k == (stop if faulted and stop is not None else min(100, 100 if stop is None else stop + plain.ticks))
    assert rests == ([plain.start] if plain.start >= 0 else [])
    assert soft.last <= plain.last


def test_a_run_without_a_chain_ends_at_once() -> None:
    soft = SoftEnd(None, PERIOD, 100)
    assert soft.goes_on(7, stop=False, faulted=False)
    assert not soft.goes_on(7, stop=True, faulted=False)
    assert soft.last == 7  # whoever looks on from outside sees the end
    end = EndState(np.zeros(size_for(EndState)))
    end.last = 3
    assert [go_on(end, k, 0, 0.0) for k in range(4)] == [1, 1, 1, 0]
