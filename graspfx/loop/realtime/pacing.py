"""Ticks on the wall's clock: absolute deadlines, how late ticks are, and the end of a run in which forces decay.

The rules are kernels on records, which Python's own loop and the one of machine code run alike.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from functools import cache, partial
from itertools import accumulate
from typing import Any, Protocol

import numpy as np

from graspfx.compile.kernel import keep_lowerings, kernel, source_function
from graspfx.compile.records import Floats, Record, floats, size_of
from graspfx.loop.columns import REST, RowTaker
from graspfx.loop.safety.trust import DECAY

FREE, PACED, DRIVEN = range(3)  # at once; by absolute deadlines; by the thread that calls
BINS = 4096  # of a microsecond each; the last one has all that is later
SHARES = {"p50": 0.5, "p99": 0.99, "p99.9": 0.999}
SLICE = 0.005  # [s]: a sleep is cut into pieces, between which a run may be stopped
SLACK = 1e-9  # of a period: by rounding the decay takes no tick more


class Clock(Protocol):
    """A clock that can be waited on."""

    def now(self) -> float:
        """Tell the time, which never runs back [s]."""
        ...

    def sleep(self, duration: float) -> None:
        """Wait for about so long [s]."""
        ...


class WallClock:
    """The clock of the machine."""

    def now(self) -> float:
        return time.perf_counter()

    def sleep(self, duration: float) -> None:
        time.sleep(duration)


# Lateness -------------------------------------------------------------------------------------------------------------


class Lateness(Record):
    """A histogram of times, as of how late ticks began after their deadlines; no memory grows with a run."""

    most: float  # [s]
    counts: Floats = floats("4096")

    def __init__(self, buffer: Any = None, offset: int = 0) -> None:
        super().__init__(np.zeros(1 + BINS).data if buffer is None else buffer, offset)

    def add(self, late: float) -> None:
        """Count a time [s]."""
        source_function(count_in)(self.buffer, self.offset, late)

    @property
    def figures(self) -> Mapping[str, float]:
        """Quantiles and the most [s], by name; nothing before the first tick.

        A quantile that lies beyond the bins is the most.
        """
        sums, most = list(accumulate(self.array(Lateness.counts).tolist())), self.most
        if not sums[-1]:
            return {}
        bins = {name: next(i for i, n in enumerate(sums) if n >= share * sums[-1]) for name, share in SHARES.items()}
        values = {name: min(1e-6 * (i + 1), most) if i < BINS - 1 else most for name, i in bins.items()}
        return {**values, "max": most}


@kernel
def count_in(times: Lateness, time: float) -> None:
    """Count a time in its bin [s]."""
    place = 0
    if time > 0.0:
        place = BINS - 1
        if time < 1e-6 * (BINS - 1):
            place = int(1e6 * time)
    times.counts[place] += 1.0
    if time > times.most:
        times.most = time


# Deadlines ------------------------------------------------------------------------------------------------------------


class ClockState(Record):
    """The clock of a loop: each tick has the deadline t_0 + k T, whatever the ones before it took.

    A tick that comes too late leaves out the whole periods that have passed: the next deadlines stay on the grid of the
    first, so that no lateness adds up.
    """

    mode: int
    is_begun: bool
    is_early: bool  # whether this tick was there before its deadline
    most: int  # periods in a row that may be left out
    period: float  # T [s]
    deadline: float  # of this tick [s]
    start: float  # of the first [s]
    late: float  # this tick after its deadline [s]
    wall: float  # this tick since the first [s]
    latest: float  # the most that one was late [s]
    left_out: int  # periods before this tick
    skipped: int  # all of them
    row: int  # those in a row, up to the last tick in time
    fatal: int  # those in a row that were too many
    lateness: Lateness  # of all ticks but the first, with the periods that they left out
    duration: Lateness  # of ticks without Python, from the reading to the row


@kernel
def set_deadline(clock: ClockState, time: float) -> float:
    """Give the time to wait for: t_0 + k T; at once where nothing is to be waited for."""
    if clock.mode != PACED or not clock.is_begun:
        clock.is_early = True
        if clock.is_begun:
            clock.deadline += clock.period
        else:
            clock.deadline = time
        return time
    clock.deadline += clock.period
    clock.is_early = clock.deadline > time
    return clock.deadline


@kernel
def arrive(clock: ClockState, time: float) -> int:
    """Begin a tick at this time; give the periods that are left out before it."""
    if not clock.is_begun:
        clock.is_begun = True
        clock.deadline, clock.start = time, time
        clock.late = 0.0
        clock.wall = 0.0
        clock.left_out = 0
        return 0
    if clock.mode == FREE:
        clock.wall += clock.period
        return 0
    late = time - clock.deadline
    skipped = 0
    if late >= clock.period:
        skipped = math.floor(late / clock.period)
    clock.deadline += skipped * clock.period
    clock.skipped += skipped
    if clock.is_early and skipped == 0:
        clock.row = 0
    else:
        clock.row += skipped
    clock.left_out = skipped
    count_in(clock.lateness, late)
    clock.late = late - skipped * clock.period
    if clock.late > clock.latest:
        clock.latest = clock.late
    clock.wall = clock.deadline + clock.late - clock.start
    if clock.mode == DRIVEN:  # the caller's clock is no slave of this one
        clock.deadline = time
    return skipped


@kernel
def is_late(clock: ClockState) -> int:
    """Tell whether too many periods in a row were left out, 1 or 0."""
    if clock.row <= clock.most:
        return 0
    if clock.fatal == 0:
        clock.fatal = clock.row
    return 1


class Pacer(ClockState):
    """Waits for the deadline of each tick.

    Args:
        period: T [s].
        clock: to wait on.
        machine: whether deadlines are worked out by machine code, which is compiled where it is not in the cache.
    """

    def __init__(self, period: float, clock: Clock | None = None, *, machine: bool = False) -> None:
        _rehearse()
        super().__init__(np.zeros(size_of(ClockState)).data)
        self.clock = clock or WallClock()
        self.mode, self.period = PACED, period
        self._set: Callable[..., float] = partial(source_function(set_deadline), self.buffer)
        self._arrive: Callable[..., float] = partial(source_function(arrive), self.buffer)
        if machine:
            from graspfx.compile.machine import compiled

            self._set, self._arrive = compiled(set_deadline).on(self.buffer), compiled(arrive).on(self.buffer)

    @property
    def outcome(self) -> dict[str, Any]:
        """Entries of the run's `Outcome`: periods left out, and how late ticks began."""
        return {"skipped": self.skipped, "late": self.lateness.figures}

    def wait(self, stop: Callable[[], bool] | None = None) -> int:
        """Wait for the next tick's deadline; return how many periods it leaves out.

        The first tick is at once, and its time is the grid's.

        Args:
            stop: asked every few milliseconds; where it is True the wait is over.
        """
        now = self.clock.now()
        if self.is_begun:
            now = self._sleep(self._set(0, now), stop)
        return int(self._arrive(0, now))

    def finish(self) -> None:
        """Wait for what is left to the deadline, where `stop` ended the wait."""
        self.late = self._sleep(self.deadline, None) - self.deadline
        self.wall = self.deadline + self.late - self.start

    def is_too_late(self) -> bool:
        """Tell whether more periods in a row were left out than `most`."""
        return bool(source_function(is_late)(self.buffer, self.offset))

    @property
    def late_text(self) -> str:
        """Say that ticks came too late for hardware."""
        return late_text(self.fatal, self.period, self.most)

    def _sleep(self, deadline: float, stop: Callable[[], bool] | None) -> float:
        """Wait for a deadline; give the time then: a sleep may have been as long as the machine was away [s]."""
        clock = self.clock
        while (now := clock.now()) < deadline and not (stop is not None and stop()):
            clock.sleep(min(max(deadline - clock.now(), 0.0), SLICE))  # as `stop` took its time
        return now


@cache
def _rehearse() -> None:
    """Run the rules once: what a kernel needs when it is first called is there before any deadline."""
    clock = ClockState(np.zeros(size_of(ClockState)).data)
    clock.mode, clock.period = PACED, 1.0
    for now in (1.0, 4.5):
        source_function(set_deadline)(clock.buffer, 0, now)
        source_function(arrive)(clock.buffer, 0, now)
        source_function(is_late)(clock.buffer, 0)
    source_function(go_on)(np.zeros(size_of(EndState)).data, 0, 0, 0, 0.0)
    keep_lowerings()


def late_text(row: int, period: float, most: int) -> str:
    """Say that ticks came too late for hardware.

    Args:
        row: periods in a row that were left out.
        period: T [s].
        most: that may be.
    """
    return (
        f"{row} periods of {period:g} s in a row were left out, {most} at most: this machine was too late for the "
        "hardware; all forces are zero"
    )


# The end --------------------------------------------------------------------------------------------------------------


class EndState(Record):
    """How a loop ends."""

    decay: int  # ticks in which forces decay; 0 for a loop that ends at once
    last: int  # the tick that it ends before
    is_stopped: bool  # before its time
    is_begun: bool  # whether forces decay
    start: int  # the tick from which on they do


@kernel
def go_on(end: EndState, k: int, stop: int, faulted: float) -> int:
    """Tell whether tick k is run, 1 or 0.

    Args:
        end: of the loop, where forces begin to decay in time.
        k: the tick.
        stop: not zero where the loop is to stop.
        faulted: not zero after a fault, when there is no force that could decay.
    """
    if stop != 0:
        if end.decay == 0 or faulted != 0.0:
            end.last = min(end.last, k)
            return 0
        if not end.is_stopped:
            end.is_stopped = True
            if k + end.decay < end.last:
                end.last = k + end.decay
    if k >= end.last:
        return 0
    if end.decay > 0 and not end.is_begun and k >= end.last - end.decay:
        end.is_begun = True
        end.start = k
    return 1


class Chain(Protocol):
    """The safety chain, whose gain decays at the end of a run."""

    def rest(self) -> None: ...


class SoftEnd(EndState):
    """The last ticks of a run with hardware: forces decay through the gain of the safety chain, on both sides.

    They are those of its duration, or as many more once it is to stop. Where fewer than two ticks would do it, the run
    ends at once.

    Args:
        chain: whose gain decays; None for a run that ends at once, as of simulations.
        period: T [s].
        last: number of the tick that the run would end before.
    """

    def __init__(self, chain: Chain | None, period: float, last: int) -> None:
        super().__init__(np.zeros(size_of(EndState)).data)
        ticks = decay_ticks(period)
        self._chain = chain if ticks > 1 else None
        self.decay, self.last = 0 if self._chain is None else ticks, last
        self._is_told = False

    def goes_on(self, k: int, *, stop: bool, faulted: bool) -> bool:
        """Tell whether tick k is run."""
        return bool(source_function(go_on)(self.buffer, self.offset, k, int(stop), float(faulted)))

    def tell(self, recorder: RowTaker | None) -> None:
        """Let forces decay once it is time to, and note from which tick on."""
        if self.is_begun and not self._is_told:
            assert self._chain is not None
            self._is_told = True
            self._chain.rest()
            if recorder is not None:
                recorder.change(self.start, {REST: "stop" if self.is_stopped else "end"})


def decay_ticks(period: float) -> int:
    """Count the ticks in which forces decay; in the last of them they are zero."""
    return max(1, math.ceil(DECAY / period - SLACK))
