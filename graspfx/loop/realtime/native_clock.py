"""Deadlines of a loop without Python: the rule of `Pacer`, as kernels."""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Record, floats

FREE, PACED, DRIVEN = range(3)  # at once; by absolute deadlines; by the thread that calls
BINS = 4096  # of a microsecond


class ClockState(Record):
    """The clock of a loop, and how late its ticks were."""

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
    most_late: float  # with the periods that it left out [s]
    longest: float  # the most that a tick took, from its reading to its row [s]
    left_out: int  # periods before this tick
    skipped: int  # all of them
    row: int  # those in a row
    fatal: int  # those in a row that were too many
    lateness: Floats = floats("4096")  # counts of ticks by how late they began, as `Lateness` has them
    duration: Floats = floats("4096")  # by how long they took


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
    if late > clock.most_late:
        clock.most_late = late
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


@kernel
def count_tick(clock: ClockState, duration: float) -> None:
    """Count a tick by how long it took [s]."""
    count_in(clock.duration, duration)
    if duration > clock.longest:
        clock.longest = duration


@kernel
def count_in(bins: Floats, time: float) -> None:
    """Count a time in its bin [s]."""
    place = 0
    if time > 0.0:
        place = BINS - 1
        if time < 1e-6 * (BINS - 1):
            place = int(1e6 * time)
    bins[place] += 1.0
