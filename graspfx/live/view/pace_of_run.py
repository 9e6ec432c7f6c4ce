"""The pace of a run: seconds of it in a second on the wall, over the last few."""

from __future__ import annotations

from collections import deque

TEXTS = 12  # over which it is told
SHORTEST, LONGEST = 1.0, 3.0  # [s]: what is told of less is not sure; longer nobody has looked


class Pace:
    """A measure of the pace.

    Args:
        period: T [s].
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._counts: deque[tuple[int, float]] = deque(maxlen=TEXTS)

    def text(self, tick: int, now: float, *, is_running: bool) -> str:
        """Say the pace; nothing until it is sure."""
        if not is_running or (self._counts and (tick < self._counts[-1][0] or now > self._counts[-1][1] + LONGEST)):
            self._counts.clear()
        if not is_running:
            return ""
        self._counts.append((tick, now))
        before, began = self._counts[0]
        return f"{(tick - before) * self._period / (now - began):.3f} of real time" if now > began + SHORTEST else ""
