"""Viser page of a recording: playback at several speeds and scrubbing, with the scene and charts of a live page."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspfx.errors import InputError
from graspfx.live.frame import STATES, Frames
from graspfx.live.scenery import recorded_scenery
from graspfx.live.view import words_on_page as words
from graspfx.live.view.page_server import Server, page_server
from graspfx.live.view.scene_tree import SceneTree
from graspfx.live.view.strip_charts import EVERY, SECONDS, StripCharts
from graspfx.resource import Resource

if TYPE_CHECKING:
    from graspfx.recording.record import Recording

FRAME = 1.0 / 30.0  # interval between frames [s]
IDLE = 0.25  # interval between checks for pages [s]
CHARTS, TEXTS = 0.12, 0.3  # update interval of charts, and of texts and the slider [s]
SETTLED = 0.15  # delay after a seek before the charts are filled [s]
WIDTH = 340  # width of the panels [pixels]
SPEEDS = {"0.1 ×": 0.1, "0.25 ×": 0.25, "0.5 ×": 0.5, "1 ×": 1.0, "2 ×": 2.0}
MOST_VALUES = 12  # values of the scene listed


class RecordingView(Resource):
    """Page that plays a recording; only the rows that are shown are read.

    Args:
        recording: Recording of any length.
        folder: Folder of relative mesh paths; None for the scene's folder.
        port: Port on 127.0.0.1; None for the first free one from 8080, 0 for any.

    Attributes:
        server: Server of the page.
        time: Time shown [s].
        playing: Whether the recording is playing.
        speed: Playback speed relative to real time.

    Raises:
        InputError: The recording has no ticks, or the port is in use.
        MissingPackageError: viser is not installed.
    """

    def __init__(self, recording: Recording, *, folder: Path | None = None, port: int | None = None) -> None:
        if not len(recording):
            raise InputError("recording", 0, "a recording with at least one tick")
        self.recording = recording
        self.time, self.playing, self.speed = 0.0, False, 1.0
        self._lock = threading.Lock()
        self._sought, self._stale = -SETTLED, True
        self._scenery = scene = recorded_scenery(recording.header, recording.layout, folder)
        name = recording.header.title or Path(recording.header.scene).stem or "a recording"
        self.server: Server = page_server(f"GraspFX  {name}", port)
        viser = self.server.viser
        viser.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(55, 71, 79))
        side = viser.gui.add_panel()
        with side.add_tab("Forces"):
            self._legend = viser.gui.add_html("")
            self._charts = StripCharts(viser, scene.fingers, recording.layout)
        side.dock_left()
        side.set_width(WIDTH)
        viser.gui.main_panel.dock_right()
        viser.gui.main_panel.set_width(WIDTH)
        viser.gui.add_html(words.PAGE_STYLE)
        self._status = viser.gui.add_html("")
        self._slider: Any = viser.gui.add_slider("time [s]", 0.0, max(self.end, 1e-6), self._step, 0.0)
        self._slider.on_update(self._seek)
        orders: dict[str, Callable[[], object]] = {
            "Play": self.play, "Pause": self.pause, "‹": lambda: self.step(-1), "›": lambda: self.step(1),
            "Begin": lambda: self.go(0.0),
        }  # fmt: skip
        speeds: dict[str, Callable[[], object]] = {text: self._chooser(speed) for text, speed in SPEEDS.items()}
        for label, actions in (("play", orders), ("speed", speeds)):
            viser.gui.add_button_group(label, tuple(actions)).on_click(self._presser(actions))
        viser.gui.add_html(_values(recording))
        self._tree = SceneTree(viser, scene)
        columns = recording.layout.columns
        touch = ("stick", "slide") if "status" in columns else ("touch",)
        self._states = [
            each for each in STATES if each in ("free", *touch) or (each == "limit" and "saturated" in columns)
        ]
        self._write(self._legend, words.legend(self._states, self._tree.scale.text))

    def close(self) -> None:
        """Close all pages."""
        self.server.stop()

    @property
    def end(self) -> float:
        """Time of the last row [s]."""
        return (len(self.recording) - 1) * self.recording.row_period

    @property
    def row(self) -> int:
        """Number of the row shown."""
        return self._row_at(self.time)

    def go(self, time: float) -> None:
        """Show a time [s]."""
        with self._lock:
            self.time = min(max(time, 0.0), self.end)
            self._sought, self._stale = now(), True

    def play(self) -> None:
        """Start playback, from the beginning if the end was reached."""
        if self.time >= self.end:
            self.go(0.0)
        self.playing = True

    def pause(self) -> None:
        """Stop playback."""
        self.playing = False

    def step(self, steps: int) -> None:
        """Move by some steps of the slider, and stop playback."""
        self.pause()
        self.go(round(self.time / self._step + steps) * self._step)

    def serve(self, stop: Callable[[], bool], seconds: float | None = None) -> None:
        """Serve the page until `stop` returns True, or for a number of seconds."""
        last = began = now()
        end = None if seconds is None else began + seconds
        charts = texts = 0.0
        drawn = -1
        while not stop() and (end is None or now() < end):
            began, elapsed = now(), now() - last
            last = began
            if not self.server.pages:
                time.sleep(IDLE if end is None else min(IDLE, max(0.0, end - began)))
                last, drawn = now(), -1
                continue
            self._advance(elapsed)
            if self.row != drawn or self._stale:
                drawn = self.row
                self._draw(drawn, charts=began >= charts)
                if began >= charts:
                    charts = began + CHARTS
            if began >= texts:
                texts = began + TEXTS
                self._texts()
            self.server.viser.flush()
            time.sleep(max(0.0, FRAME - (now() - began)))

    @property
    def _step(self) -> float:
        """Step of the slider: the row period, at least 1 ms [s]."""
        return max(self.recording.row_period, 1e-3)

    def _row_at(self, time: float) -> int:
        return min(len(self.recording) - 1, max(0, round(time / self.recording.row_period)))

    def _advance(self, elapsed: float) -> None:
        with self._lock:
            if self.playing:
                self.time = min(self.time + self.speed * min(elapsed, 0.2), self.end)
                self.playing = self.time < self.end

    def _draw(self, row: int, *, charts: bool) -> None:
        frames = self._frames(row)
        with self.server.viser.atomic():
            if self._tree.show(frames[0]):
                self._write(self._legend, words.legend(self._states, self._tree.scale.text))
            if self._stale and now() - self._sought >= SETTLED:
                self._fill(row)
                charts = True
            if not self._stale and self._charts.wants(float(frames.time[0])):
                self._charts.add(frames)
            if charts and not self._stale:
                self._charts.draw()

    def _fill(self, row: int) -> None:
        """Fill the charts with the seconds before a row."""
        self._stale = False
        self._charts.clear()
        every = max(1, round(EVERY / self.recording.row_period))
        for k in range(max(row % every, row - int(SECONDS / self.recording.row_period)), row + 1, every):
            self._charts.add(self._frames(k))

    def _frames(self, row: int) -> Frames:
        return Frames(self.recording.part(row, row + 1), self._scenery.apart)

    def _texts(self) -> None:
        seconds = round(self.time, 6)
        if abs(float(self._slider.value) - seconds) > 0.5 * self._step:
            self._slider.value = min(seconds, self._slider.max)
        state = f"plays at {self.speed:g} × real time" if self.playing else "is paused"
        self._write(self._status, words.status(state, self.time, _remarks(self.recording, self.time)))

    def _write(self, html: Any, content: str) -> None:
        if html.content != content:
            html.content = content

    def _chooser(self, speed: float) -> Callable[[], None]:
        def choose() -> None:
            self.speed = speed

        return choose

    def _presser(self, actions: dict[str, Callable[[], object]]) -> Callable[[Any], Any]:
        async def press(event: Any) -> None:
            if event.client_id is not None:
                actions[event.target.value]()

        return press

    async def _seek(self, event: Any) -> None:
        if event.client_id is not None:
            self.pause()
            self.go(float(event.target.value))


def now() -> float:
    """Read the clock [s]."""
    return time.monotonic()


def _remarks(recording: Recording, time: float) -> list[str]:
    """List the faults and changes of the run up to a time."""
    T = recording.period
    changes = [f"{change.key} = {change.value!r} since {change.tick * T:.3f} s" for change in recording.changes
               if change.tick * T <= time]  # fmt: skip
    faults = [
        f"FAULT at {fault.tick * T:.3f} s: {fault.message}" for fault in recording.faults if fault.tick * T <= time
    ]
    return [*faults, *changes[-3:]]


def _values(recording: Recording) -> str:
    from html import escape

    from graspfx.live.page.listed_values import values_of

    rows = "".join(
        f"<div class=row><span>{escape(each['label'])}</span>"
        f"<span>{escape(each['values'][0][1])} {escape(each['unit'])}</span></div>"
        for each in values_of(recording)[:MOST_VALUES]
    )
    return f"<div class=gfx><b>At the start</b>{rows}</div>"
