"""The end of a loop without Python: the rule of `SoftEnd`, as a kernel."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Record


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
