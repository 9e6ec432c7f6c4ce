"""Real-time ticks: absolute deadlines, lateness, and the decay of forces at the end of a run.

The computations are kernels on records, which both the Python loop and the native loop use.
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

FREE, PACED, DRIVEN = range(3)  # ticks run without waiting, at absolute deadlines, or when a vendor's thread calls
BINS = 4096  # number of bins of one microsecond; the last bin also counts all longer times
SHARES = {"p50": 0.5, "p99": 0.99, "p99.9": 0.999}
SLICE = 0.005  # longest uninterrupted sleep [s]; a run can be stopped between two slices
SLACK = 1e-9  # tolerance in periods, so that rounding adds no tick to the decay


class Clock(Protocol):
    """Protocol of the clock by which a loop waits for its deadlines."""

    def now(self) -> float:
        """Return the present time [s], which never decreases."""
        ...

    def sleep(self, duration: float) -> None:
        """Wait for about `duration` seconds."""
        ...


class WallClock:
    """Monotonic clock of the system."""

    def now(self) -> float:
        return time.perf_counter()

    def sleep(self, duration: float) -> None:
        time.sleep(duration)


# Lateness -------------------------------------------------------------------------------------------------------------


class Lateness(Record):
    """Histogram of times, such as the lateness of ticks; it has a fixed number of bins."""

    most: float  # maximum [s]
    counts: Floats = floats("4096")

    def __init__(self, buffer: Any = None, offset: int = 0) -> None:
        super().__init__(np.zeros(1 + BINS).data if buffer is None else buffer, offset)

    def add(self, late: float) -> None:
        """Count a time [s]."""
        source_function(count_in)(self.buffer, self.offset, late)

    @property
    def figures(self) -> Mapping[str, float]:
        """Quantiles and maximum [s] by name; empty if no time was counted.

        If a quantile is in the last bin, the maximum replaces it.
        """
        sums, most = list(accumulate(self.array(Lateness.counts).tolist())), self.most
        if not sums[-1]:
            return {}
        bins = {name: next(i for i, n in enumerate(sums) if n >= share * sums[-1]) for name, share in SHARES.items()}
        values = {name: min(1e-6 * (i + 1), most) if i < BINS - 1 else most for name, i in bins.items()}
        return {**values, "max": most}


@kernel
def count_in(times: Lateness, time: float) -> None:
    """Count a time [s] in a histogram."""
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
    """Clock of a loop with deadlines t_0 + k T, where t_0 is the time of the first tick and T the sampling period.

    If a tick is late by one or more whole periods, these periods are skipped. The deadlines of later ticks do not
    depend on lateness, so lateness does not accumulate.
    """

    mode: int
    is_begun: bool
    is_early: bool  # whether the loop waited for this tick's deadline
    most: int  # largest permitted number of successive skipped periods
    period: float  # sampling period T [s]
    deadline: float  # deadline of this tick [s]
    start: float  # time of the first tick [s]
    late: float  # time of this tick after its deadline [s]
    wall: float  # time of this tick since the first [s]
    latest: float  # largest lateness of all ticks [s]
    left_out: int  # number of periods skipped before this tick
    skipped: int  # total number of skipped periods
    row: int  # number of periods skipped since the last tick that was not late
    fatal: int  # value of `row` when it first exceeded `most`, otherwise 0
    lateness: Lateness  # lateness of all ticks but the first, including skipped periods
    duration: Lateness  # duration of ticks in machine code, from reading to row


@kernel
def set_deadline(clock: ClockState, time: float) -> float:
    """Set the deadline of the next tick, and return the time until which to wait; `time` is the present time [s]."""
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
    """Start a tick at the present time [s]; return the number of periods that are skipped before the tick."""
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
    if clock.mode == DRIVEN:  # the clock of the vendor's thread is independent of this clock
        clock.deadline = time
    return skipped


@kernel
def is_late(clock: ClockState) -> int:
    """Return 1 if more than `most` successive periods were skipped, otherwise 0."""
    if clock.row <= clock.most:
        return 0
    if clock.fatal == 0:
        clock.fatal = clock.row
    return 1


class Pacer(ClockState):
    """Pacer, which lets each tick of a loop wait for its deadline.

    Args:
        period: Sampling period T [s].
        clock: Clock of the loop; None for the monotonic clock of the system.
        machine: Whether the deadlines are computed by machine code, which is compiled if it is not cached.
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
        """Entries of the run's `Outcome`: number of skipped periods and lateness of ticks."""
        return {"skipped": self.skipped, "late": self.lateness.figures}

    def wait(self, stop: Callable[[], bool] | None = None) -> int:
        """Wait for the deadline of the next tick; return the number of skipped periods.

        The first tick starts without waiting and defines t_0.

        Args:
            stop: Function called every few milliseconds; if it returns True, the wait ends before the deadline.
        """
        now = self.clock.now()
        if self.is_begun:
            now = self._sleep(self._set(0, now), stop)
        return int(self._arrive(0, now))

    def finish(self) -> None:
        """Wait for the deadline after `stop` has ended the wait early."""
        self.late = self._sleep(self.deadline, None) - self.deadline
        self.wall = self.deadline + self.late - self.start

    def is_too_late(self) -> bool:
        """Return whether more than `most` successive periods were skipped."""
        return bool(source_function(is_late)(self.buffer, self.offset))

    @property
    def late_text(self) -> str:
        """Message for a run with hardware whose ticks came too late."""
        return late_text(self.fatal, self.period, self.most)

    def _sleep(self, deadline: float, stop: Callable[[], bool] | None) -> float:
        """Wait for a deadline, or until `stop` returns True; return the time after the wait [s]."""
        clock = self.clock
        while (now := clock.now()) < deadline and not (stop is not None and stop()):
            clock.sleep(min(max(deadline - clock.now(), 0.0), SLICE))  # `stop` may have taken time
        return now


@cache
def _rehearse() -> None:
    """Call the kernels once, because the first call of a kernel takes longer and would delay a tick."""
    clock = ClockState(np.zeros(size_of(ClockState)).data)
    clock.mode, clock.period = PACED, 1.0
    for now in (1.0, 4.5):
        source_function(set_deadline)(clock.buffer, 0, now)
        source_function(arrive)(clock.buffer, 0, now)
        source_function(is_late)(clock.buffer, 0)
    source_function(go_on)(np.zeros(size_of(EndState)).data, 0, 0, 0, 0.0)
    keep_lowerings()


def late_text(row: int, period: float, most: int) -> str:
    """Return the message for a run with hardware whose ticks came too late.

    Args:
        row: Number of successive skipped periods.
        period: Sampling period T [s].
        most: Largest permitted number of successive skipped periods.
    """
    return (
        f"{row} successive periods of {period:g} s were skipped, expected at most {most}: the machine was too slow "
        "for the hardware; all forces are zero"
    )


# The end --------------------------------------------------------------------------------------------------------------


class EndState(Record):
    """State of the end of a loop."""

    decay: int  # number of ticks in which forces decay; 0 if the loop ends without decay
    last: int  # tick before which the loop ends
    is_stopped: bool  # whether the loop was stopped early
    is_begun: bool  # whether the decay of forces has begun
    start: int  # first tick of the decay


@kernel
def go_on(end: EndState, k: int, stop: int, faulted: float) -> int:
    """Return 1 if tick k must be run, otherwise 0; start the decay of forces when it is due.

    The decay starts early enough that the forces are zero when the loop ends.

    Args:
        end: State of the end of the loop.
        k: Index of the tick.
        stop: Nonzero if the loop must stop.
        faulted: Nonzero after a fault; all forces are then already zero.
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
    """Protocol of a safety chain, whose gain decays at the end of a run."""

    def rest(self) -> None: ...


class SoftEnd(EndState):
    """End of a run with hardware, at which forces decay to zero.

    The gain of the safety chain decays, and with it the forces on operator and object. The decay takes the last ticks
    of the run or, after a stop, the same number of further ticks. If the decay would take fewer than two ticks, the run
    ends without decay.

    Args:
        chain: Safety chain whose gain decays; None for a run that ends without decay, such as a run without hardware.
        period: Sampling period T [s].
        last: Tick before which the run ends if it is not stopped earlier.
    """

    def __init__(self, chain: Chain | None, period: float, last: int) -> None:
        super().__init__(np.zeros(size_of(EndState)).data)
        ticks = decay_ticks(period)
        self._chain = chain if ticks > 1 else None
        self.decay, self.last = 0 if self._chain is None else ticks, last
        self._is_told = False

    def goes_on(self, k: int, *, stop: bool, faulted: bool) -> bool:
        """Return whether tick k must be run."""
        return bool(source_function(go_on)(self.buffer, self.offset, k, int(stop), float(faulted)))

    def tell(self, recorder: RowTaker | None) -> None:
        """If the decay of forces is due, start it in the safety chain and record the first tick of the decay."""
        if self.is_begun and not self._is_told:
            assert self._chain is not None
            self._is_told = True
            self._chain.rest()
            if recorder is not None:
                recorder.change(self.start, {REST: "stop" if self.is_stopped else "end"})


def decay_ticks(period: float) -> int:
    """Return the number of ticks in which forces decay; in the last of these ticks, the forces are zero."""
    return max(1, math.ceil(DECAY / period - SLACK))
