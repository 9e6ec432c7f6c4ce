"""Page of a running scene: frames, charts and texts while a page is open, and the user's orders."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspfx.errors import GraspFXError
from graspfx.live.frame import Frame, Frames, history_of
from graspfx.live.scenery import scenery
from graspfx.live.view import words_on_page as words
from graspfx.live.view.certificate_panel import CertificatePanel
from graspfx.live.view.gain_sliders import GainSliders
from graspfx.live.view.hand_gizmos import HandGizmos
from graspfx.live.view.page_server import Server, page_server
from graspfx.live.view.replay_on_page import Pace, ReplayOnPage
from graspfx.live.view.scene_tree import SceneTree
from graspfx.live.view.strip_charts import StripCharts
from graspfx.recording.header import SPLIT, KeyChange
from graspfx.resource import Resource

if TYPE_CHECKING:
    from graspfx.live.live_run import LiveRun
    from graspfx.live.sliders import Slider

FRAME = 1.0 / 30.0  # interval between frames without orders [s]
SHORTEST = 0.008  # shortest interval between frames after an order [s]
CHARTS, TEXTS = 0.12, 0.5  # update interval of charts and of texts [s]
IDLE = 0.25  # interval between checks for pages [s]
EFFECT = 2  # ticks from an order to the first row that shows its effect
WIDTH = 340  # width of the panels [pixels]
STEP = 10  # ticks per press of Step


class LiveView(Resource):
    """Page that shows and controls a run.

    Args:
        run: Live run.
        sliders: Sliders of the scene.
        new_folder: Function that makes the folder of a recording.
        port: Port on 127.0.0.1; None for the first free one from 8080.
        tell: Function that prints a line on the terminal.
    """

    def __init__(
        self, run: LiveRun, sliders: list[Slider], new_folder: Callable[[], Path], *, port: int | None = None,
        tell: Callable[[str], object] = print,
    ) -> None:  # fmt: skip
        self.run, self._new_folder, self._tell = run, new_folder, tell
        self._wake, self._awaited = threading.Event(), -1
        self._executor = ThreadPoolExecutor(1, "graspfx-page-orders")
        self._remark = ""
        self._recording: Path | None = None
        self._last: Path | None = None
        self._replay: ReplayOnPage | None = None
        self._pace = Pace(run.period)
        self._runs, self._fault = run.run_number, ""
        self._scenery = drawn = scenery(run.scene)
        name = Path(run.scene.source.name).stem
        self.server: Server = page_server(f"GraspFX  {name}", port, fits=lambda message: self._hands.fits(message))
        viser = self.server.viser
        viser.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(55, 71, 79))
        with self._side_panel(viser):
            self._legend = viser.gui.add_html("")
            self._charts = StripCharts(viser, drawn.fingers, run.layout)
        viser.gui.add_html(words.PAGE_STYLE)
        self._status = viser.gui.add_html("")
        self._banner = viser.gui.add_html(words.banner("", panel=False))
        self._buttons(viser)
        self._note = viser.gui.add_html("<div></div>")
        self.certificate = CertificatePanel(run, self._changed)
        self._hands = HandGizmos(viser, drawn, run, self._changed)
        self.sliders = GainSliders(viser, sliders, self.certificate.order, self._say)
        self._margins = viser.gui.add_html(words.margins(None, {}))
        self._tree = SceneTree(viser, drawn)
        self._write(self._legend, words.legend(self._states(), self._tree.scale.text))

    def close(self) -> None:
        """Close all pages and end their computations; the run continues."""
        self.server.stop()
        self._executor.shutdown(wait=True, cancel_futures=True)
        self.certificate.close()

    def serve(self, stop: Callable[[], bool], seconds: float | None = None) -> None:
        """Serve the page until `stop` returns True, or for a number of seconds."""
        end = None if seconds is None else time.monotonic() + seconds
        next_charts = next_texts = 0.0
        while not stop() and (end is None or time.monotonic() < end):
            if not self.server.pages:
                self._watch()
                time.sleep(IDLE if end is None else min(IDLE, max(0.0, end - time.monotonic())))
                continue
            began = time.monotonic()
            self.certificate.start()
            try:
                frames = self._frames()
            except GraspFXError as error:  # such as during a reset of the run
                frames = None
                self._say(str(error))
            if frames is not None:
                self._draw(frames, charts=began >= next_charts)
            if began >= next_charts:
                next_charts = began + CHARTS
            if began >= next_texts or self.certificate.has_news():
                next_texts = began + TEXTS
                self._texts(frames)
            self.server.viser.flush()
            self._sleep(began)

    # Frames -------------------------------------------------------------------------------------------------------

    def _sleep(self, began: float) -> None:
        """Wait for the next frame, or for an order and the row that shows its effect."""
        left = FRAME - (time.monotonic() - began)
        if not self._wake.wait(max(0.0, left)):
            return
        time.sleep(max(0.0, SHORTEST - (time.monotonic() - began)))
        self._wake.clear()
        self.run.await_row(self._awaited, FRAME)

    def _changed(self) -> None:
        """Show the next frame with the row that shows the effect of an order."""
        self._awaited = self.run.tick + EFFECT
        self._wake.set()

    def _frames(self) -> Frames | None:
        replay = self._replay  # another thread may remove it
        if replay is not None:
            return replay.frames()
        tick, rows = self.run.rows(self.run.tick)
        if not len(rows):
            return None
        run, tick = self.run, tick + len(rows) - 1
        splits = [KeyChange(since, SPLIT, split) for since, split in run.splits]
        return Frames(history_of(rows[-1:], run.layout, run.header, changes=splits, tick=tick), self._scenery.apart)

    def _draw(self, frames: Frames, *, charts: bool) -> None:
        frame: Frame = frames[0]
        with self.server.viser.atomic():
            if self._tree.show(frame):
                self._write(self._legend, words.legend(self._states(), self._tree.scale.text))
            if self._charts.wants(frame.time):
                self._charts.add(frames)
            if charts:
                self._charts.draw()

    def _texts(self, frames: Frames | None) -> None:
        self._watch()
        replay = self._replay
        state = "replay" if replay is not None else self.run.state
        pace = self._pace.text(self.run.tick, time.monotonic(), is_running=self.run.state == "running")
        lines = [pace] if pace and replay is None else []
        if self.run.has_hardware:
            lines.append("HARDWARE IS ARMED: gains stay within the certificate")
        if self._recording is not None:
            lines.append(f"● recording to {self._recording}")
        elif self._last is not None:
            lines.append(f"recorded in {self._last}")
        if replay is not None:
            lines.append(f"{replay.file}; the run continues meanwhile")
        seconds = float(frames.time[-1]) if frames is not None else self.run.time
        self._write(self._status, words.status(state, seconds, lines))
        self._write(self._note, words.message(self._remark))
        verdict = self.certificate.latest()
        if verdict is not None:
            self.sliders.widen(verdict)
        self._write(self._margins, words.margins(verdict, self._loose()))
        unstable = verdict is not None and verdict.is_stable is False
        text = f"FAULT: {self._fault}" if self._fault else ""
        if unstable and not text:
            text = "UNSTABLE with these gains: the grasp will shake"
        self._write(self._banner, words.banner(text, panel=bool(text)))

    def _loose(self) -> dict[str, float]:
        """Find the objects that no finger has touched recently, as in `Frames.loose`."""
        _, rows = self.run.rows(self.run.tick - int(TEXTS / self.run.period))
        return Frames(history_of(rows, self.run.layout, self.run.header)).loose

    def _watch(self) -> None:
        """Detect faults and resets, with or without a page; print faults on the terminal."""
        if self.run.run_number != self._runs:
            self._runs, self._fault = self.run.run_number, ""
            self._hands.restart()
            self._charts.clear()
        fault = self.run.fault
        text = str(fault.message) if fault is not None else self.run.cause
        if text and text != self._fault:
            self._tell(f"fault: {text}")
        self._fault = text

    def _write(self, html: Any, content: str) -> None:
        if html.content != content:
            html.content = content

    def _states(self) -> tuple[str, ...]:
        columns = self.run.layout.columns
        touch = ("stick", "slide") if "status" in columns else ("touch",)
        return ("free", *touch, *(("limit",) if "saturated" in columns else ()))

    def _say(self, text: str) -> None:
        self._remark = text

    # Orders -------------------------------------------------------------------------------------------------------

    def _side_panel(self, viser: Any) -> Any:
        side = viser.gui.add_panel()
        tab = side.add_tab("Forces")
        side.dock_left()
        side.set_width(WIDTH)
        viser.gui.main_panel.dock_right()
        viser.gui.main_panel.set_width(WIDTH)
        return tab

    def _buttons(self, viser: Any) -> None:
        orders: dict[str, Callable[[], object]] = {} if self.run.has_hardware else {
            "Run": self.run.resume, "Pause": self.run.pause, "Step": lambda: self.run.step(STEP), "Reset": self._reset,
        }  # fmt: skip
        tapes: dict[str, Callable[[], object]] = {
            "Record": self._record, "Stop": self._stop, "Replay": self._begin_replay, "Live": self._end_replay,
        }  # fmt: skip
        for label, actions in (("run", orders), ("recording", tapes)):
            if actions:
                group = viser.gui.add_button_group(label, tuple(actions))
                group.on_click(self._presser(actions))

    def _presser(self, actions: Mapping[str, Callable[[], object]]) -> Callable[[Any], Any]:
        async def press(event: Any) -> None:
            if event.client_id is not None:
                self._executor.submit(self._do, actions[event.target.value])

        return press

    def _do(self, action: Callable[[], object]) -> None:
        """Execute a button's action; show errors on the page."""
        try:
            action()
            self._say("")
        except (GraspFXError, OSError) as error:
            self._say(str(error))
        except Exception as error:  # noqa: BLE001 - no caller could handle it; the page shows it
            self._say(f"{type(error).__name__}: {error}")
        self._changed()

    def _reset(self) -> None:
        self._end_replay()
        if self._recording is not None:
            self._stop()
        else:
            self.run.reset()

    def _record(self) -> None:
        self._end_replay()
        if self._recording is None:
            self._recording = self.run.record(self._new_folder())
            self._tell(f"recording {self._recording}")

    def _stop(self) -> None:
        if self._recording is not None:
            self._last = self.run.stop_recording()
            self._recording = None
            self._tell(f"recorded {self._last}")

    def _begin_replay(self) -> None:
        self._stop()
        if self._last is None:
            self._say("nothing has been recorded yet: press Record first")
            return
        self._end_replay()
        self._replay = ReplayOnPage(self.server.viser, self._last, self._scenery.apart)
        self._hands.show(False)

    def _end_replay(self) -> None:
        replay, self._replay = self._replay, None
        if replay is not None:
            replay.close()
            self._hands.show(True)
            self._charts.clear()
