"""The end of a run with hardware: forces decay through the gain of the safety chain, on both sides."""

from __future__ import annotations

import math

from graspfx.loop.recording.header import REST
from graspfx.loop.recording.row_taker import RowTaker
from graspfx.loop.safety.chain import SafetyChain
from graspfx.loop.safety.trust import DECAY

SLACK = 1e-9  # of a period: by rounding the decay takes no tick more


def decay_ticks(period: float) -> int:
    """Count the ticks in which forces decay; in the last of them they are zero."""
    return max(1, math.ceil(DECAY / period - SLACK))


class SoftEnd:
    """The last ticks of a run: those of its duration, or as many more once it is to stop.

    Where fewer than two ticks would do it, the run ends at once.

    Args:
        chain: whose gain decays; None for a run that ends at once, as of simulations.
        period: T [s].
        last: number of the tick that the run would end before.

    Attributes:
        last: number of the tick that it ends before.
    """

    def __init__(self, chain: SafetyChain | None, period: float, last: int) -> None:
        self._ticks, self.last = decay_ticks(period), last
        self._chain = chain if self._ticks > 1 else None
        self._is_stopped = self._is_begun = False

    def stop(self, k: int, *, faulted: bool) -> bool:
        """End the run before its time, from tick k on; return whether there are ticks left to run."""
        if self._chain is None or faulted:
            return False
        if not self._is_stopped:
            self._is_stopped = True
            self.last = min(self.last, k + self._ticks)
        return True

    def begin(self, k: int, recorder: RowTaker | None) -> None:
        """Let forces decay from tick k on, if it is time to."""
        if self._chain is not None and not self._is_begun and k >= self.last - self._ticks:
            self._is_begun = True
            self._chain.rest()
            if recorder is not None:
                recorder.change(k, {REST: "stop" if self._is_stopped else "end"})
