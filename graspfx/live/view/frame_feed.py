"""Frames of a live run for pages; all frames cover the same number of ticks."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.live.frame import history_of
from graspfx.live.page.played_frames import motion_of, rows_per_frame
from graspfx.live.page.story import story_of
from graspfx.live.scenery import scenery
from graspfx.recording.record import Recording

if TYPE_CHECKING:
    from graspfx.live.live_run import LiveRun
    from graspfx.recording.header import Header

FloatArray = NDArray[np.float64]
LONGEST = 0.5  # longest time for which missed frames are read; older ticks are omitted [s]
PATIENCE = 1.0  # timeout for the first row of a run [s]


class News(NamedTuple):
    """New frames of a run.

    Attributes:
        run: Number of the run, `LiveRun.run_number`.
        first: Number of the first frame, counted from the beginning of the run.
        frames: Frames (k, w), from `Motion.vectors`. If not all ticks of the last frame have run, this frame is sent
            again later.
    """

    run: int
    first: int
    frames: FloatArray


class FrameFeed:
    """Reader of the frames of a run.

    Args:
        run: Live run.
    """

    def __init__(self, run: LiveRun) -> None:
        self._run = run
        is_line = run.layout.dimensions == 1
        self._apart = scenery(run.header, run.layout).apart if is_line else 0.0
        self._scene, self._header = run.scene, _header(run)
        self.ticks = rows_per_frame(run.period)
        self._number, self._next, self._tick = -1, 0, -1

    def story(self) -> dict[str, Any]:
        """Return the data of a page that shows this run, from the newest row if a row arrives within a second."""
        run = self._run
        run.await_row(0, PATIENCE)
        tick, rows = run.rows(run.tick) if run.ticks else (0, np.full((1, run.layout.width), np.nan))
        return story_of(self._history(tick, rows), run.scene.source.folder, source="live")

    def news(self) -> News | None:
        """Return the frames since the last call; None if there is no new row."""
        run = self._run
        if run.run_number != self._number:
            self._number, self._next, self._tick = run.run_number, 0, -1
        newest = run.tick
        if newest <= self._tick:
            return None
        since = max(self._next, self._begin(newest - int(LONGEST / run.period)))
        tick, rows = run.rows(since)
        late = self._begin(tick + self.ticks - 1) - tick  # rows of a frame that has lost its first rows
        if len(rows) <= late:
            return None
        tick, rows = tick + late, rows[late:]
        self._tick = tick + len(rows) - 1
        self._next = self._begin(self._tick + 1)
        return News(self._number, tick // self.ticks, motion_of(self._history(tick, rows), self._apart).vectors())

    def _begin(self, tick: int) -> int:
        """Return the first tick of the frame to which a tick belongs."""
        return tick // self.ticks * self.ticks

    def _history(self, tick: int, rows: FloatArray) -> Recording:
        """Return rows as a recording in which every tick is recorded, with the present values of the scene."""
        run = self._run
        if run.scene is not self._scene:
            self._scene, self._header = run.scene, _header(run)
        return history_of(rows, run.layout, self._header, changes=run.splits, tick=tick)


def _header(run: LiveRun) -> Header:
    """Return the header of a recording in which every tick is recorded, with the present values of the scene."""
    return replace(run.header, every=1, scene_table=run.scene.to_dict())
