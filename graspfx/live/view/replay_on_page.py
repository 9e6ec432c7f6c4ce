"""Replay of a recording on a live page, in real time or by a slider; and the pace of a run for its status."""

from __future__ import annotations

import time
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspfx.live.frame import Frames
from graspfx.recording.record import Recording

if TYPE_CHECKING:
    import viser

TEXTS = 12  # number of samples over which the pace is measured
SHORTEST, LONGEST = 1.0, 3.0  # shortest time for a reliable pace; longest gap between samples [s]


class Pace:
    """Pace of a run relative to real time.

    Args:
        period: Sampling period T [s].
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._counts: deque[tuple[int, float]] = deque(maxlen=TEXTS)

    def text(self, tick: int, now: float, *, is_running: bool) -> str:
        """Return the pace as a text; empty until it is reliable."""
        if not is_running or (self._counts and (tick < self._counts[-1][0] or now > self._counts[-1][1] + LONGEST)):
            self._counts.clear()
        if not is_running:
            return ""
        self._counts.append((tick, now))
        before, began = self._counts[0]
        return f"{(tick - before) * self._period / (now - began):.3f} of real time" if now > began + SHORTEST else ""


REFRESH = 0.1  # update interval of the slider [s]


class ReplayOnPage:
    """Recording with its playback position.

    Args:
        server: Server of the page.
        file: File of the recording.
        apart: Lateral distance between fingers on a line [m].
    """

    def __init__(self, server: viser.ViserServer, file: Path, apart: float) -> None:
        self.recording = Recording.load(file)
        self.file, self._apart = file, apart
        self.end = float(self.recording.end)
        self._at, self._wall, self._refreshed = 0.0, time.perf_counter(), 0.0
        self._playing = True
        self._slider: Any = server.gui.add_slider("replay [s]", 0.0, max(self.end, 1e-3), 1e-3, 0.0)
        self._slider.on_update(self._seek)

    def frames(self) -> Frames:
        """Return the present row."""
        now = time.perf_counter()
        if self._playing:
            self._at += now - self._wall
            if self._at >= self.end:
                self._at = 0.0
            if now - self._refreshed > REFRESH:
                self._slider.value, self._refreshed = round(self._at, 3), now
        self._wall = now
        count = len(self.recording)
        k = min(count - 1, int(self._at / self.end * count)) if self.end > 0.0 else 0
        return Frames(self.recording.part(k, k + 1), self._apart)

    async def _seek(self, event: Any) -> None:
        if event.client_id is not None:
            self._playing, self._at = False, float(event.target.value)

    def close(self) -> None:
        """Remove the slider from the page."""
        self._slider.remove()
