"""Page that shows the frames, the state and the stability of a running scene, and executes the user's orders."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from graspfx.assembly.live import value_of
from graspfx.errors import GraspFXError
from graspfx.live.frame import Frames, history_of
from graspfx.live.hardware_clamp import HardwareClamp, Outcome
from graspfx.live.margins import Margins
from graspfx.live.page.document import document, page_text
from graspfx.live.sliders import Slider, live_keys, value_in, values_of, widened
from graspfx.live.view.frame_feed import FrameFeed
from graspfx.live.view.page_server import Order, PageServer
from graspfx.recording.record import Recording
from graspfx.resource import Resource

if TYPE_CHECKING:
    from graspfx.live.certifier import MarginRow, Verdict
    from graspfx.live.live_run import LiveRun

FRAME = 1.0 / 50.0  # interval between frames without orders [s]
SHORTEST = 0.008  # shortest interval between frames after an order [s]
STATE = 0.25  # update interval of the state [s]
IDLE = 0.25  # interval between checks for pages [s]
EFFECT = 2  # ticks from an order to the first row that shows its effect
HELD = 0.5  # time in which a finger must have touched an object that is held [s]
REACH = 2.0  # largest component of a hand's offset, in extents of the scene
CLOSEST, WIDEST = 0.3, 0.15  # largest additional squeeze and opening of a hand, in extents


class Pace:
    """Measurement of the pace of a run relative to real time.

    Args:
        period: Sampling period T [s].
    """

    COUNT = 12  # samples over which the pace is measured
    SHORTEST, LONGEST = 1.0, 3.0  # shortest time for a reliable pace; longest gap between samples [s]

    def __init__(self, period: float) -> None:
        self._period = period
        self._counts: deque[tuple[int, float]] = deque(maxlen=self.COUNT)

    def text(self, tick: int, now: float, *, is_running: bool) -> str:
        """Return the pace as a text; empty if the run does not run, or until a second has been measured."""
        last = self._counts[-1] if self._counts else (tick, now)
        if not is_running or tick < last[0] or now > last[1] + self.LONGEST:
            self._counts.clear()
        if not is_running:
            return ""
        self._counts.append((tick, now))
        before, began = self._counts[0]
        if now <= began + self.SHORTEST:
            return ""
        return f"{(tick - before) * self._period / (now - began):.3f} of real time"


class LivePage(Resource):
    """Page that shows and controls a run.

    Args:
        run: Live run.
        sliders: Sliders of the scene.
        new_folder: Function that returns the folder of a new recording.
        port: Port number on 127.0.0.1; None for the first free port from 8080 on, 0 for any free port.
        tell: Function that prints a line on the terminal.

    Attributes:
        server: Server of the page.
        sliders: Sliders of the page, and the values requested by them.
        recording: File that is being recorded; None if nothing is recorded.
        last: File that was recorded last; None before the first recording.
    """

    def __init__(
        self, run: LiveRun, sliders: list[Slider], new_folder: Callable[[], Path], *, port: int | None = None,
        tell: Callable[[str], object] = print,
    ) -> None:  # fmt: skip
        self.run, self._new_folder, self._tell = run, new_folder, tell
        self._wake, self._awaited = threading.Event(), -1
        self._executor = ThreadPoolExecutor(1, "graspfx-page-orders")
        self._remark, self._fault, self._runs = "", "", run.run_number
        self.recording: Path | None = None
        self.last: Path | None = None
        self._pace, self._feed = Pace(run.period), FrameFeed(run)
        self._story = self._feed.story()
        self._extent = float(self._story["extent"])
        self._squeezes = _squeezes(self._extent)
        self._margins: Margins | None = None
        self._first = self._certified = run.scene  # scene at first, and when a certificate was requested last
        self._has_verdict = False  # whether there is a result that has not been sent
        self._clamp: HardwareClamp | None = None
        self.sliders = SliderOrders(sliders, self._set, self._say)
        self._story["run"] = self._described(sliders)
        self.server = PageServer(self, port)
        if run.has_hardware:  # before the server accepts orders
            self._margins = Margins(self._first, self._take)
            self._clamp = HardwareClamp(run.set, self._margins)
        try:
            self.server.__enter__()
        except BaseException:
            self._end_certificates()
            raise

    def close(self) -> None:
        """Close the page in all browsers and end the computation of stability; the run continues."""
        self.server.__exit__()
        self._executor.shutdown(wait=True, cancel_futures=True)
        self._end_certificates()

    def _end_certificates(self) -> None:
        if self._margins is not None:
            self._margins.close()  # first, because orders to hardware wait for its results
        if self._clamp is not None:
            self._clamp.close()

    def serve(self, stop: Callable[[], bool], seconds: float | None = None) -> None:
        """Serve the page until `stop` returns True, or for a number of seconds."""
        end = None if seconds is None else time.monotonic() + seconds
        next_state = 0.0
        while not stop() and (end is None or time.monotonic() < end):
            if not self.server.clients:
                self._watch()
                time.sleep(IDLE if end is None else min(IDLE, max(0.0, end - time.monotonic())))
                continue
            began = time.monotonic()
            try:
                self._certify()
                news = self._feed.news()
                if news is not None:
                    self.server.show(*news)
                if began >= next_state or self._has_verdict:
                    next_state, self._has_verdict = began + STATE, False
                    self._watch()
                    self.server.tell(self._state())
            except GraspFXError as error:  # such as during a reset of the run
                self._say(str(error))
            self._sleep(began)

    # What the page shows ------------------------------------------------------------------------------------------

    def document(self, path: str, host: str) -> str | None:
        """Return the page of the run for the path "/", and the page of the last recording for "/recording"."""
        if path == "/":
            return document(self._story, "live", f"ws://{host}")
        if path == "/recording" and self.last is not None:
            return page_text(Recording.load(self.last), self.run.scene.source.folder)
        return None

    def _described(self, sliders: list[Slider]) -> dict[str, Any]:
        run = self.run
        handles = [
            {
                "name": guide.name, "fingers": list(guide.fingers), "farthest": REACH * self._extent,
                "squeezes": self._squeezes if len(guide.fingers) > 1 else None,
            }
            for guide in run.guides
        ]  # fmt: skip
        return {
            "live": True, "hardware": run.has_hardware, "frames": self._feed.ticks, "handles": handles,
            "sliders": [each.to_dict() for each in sliders],
        }  # fmt: skip

    def _state(self) -> dict[str, Any]:
        state, verdict = self.run.state, None if self._margins is None else self._margins.latest()
        if verdict is not None:
            self.sliders.widen(verdict)
        alarm = f"FAULT: {self._fault}" if self._fault else ""
        if not alarm and verdict is not None and verdict.is_stable is False:
            alarm = "UNSTABLE with these gains: the grasp will shake"
        return {
            "going": state == "running", "alarm": alarm, "lines": self._lines(state), "remark": self._remark,
            "recording": self.recording is not None, "recorded": self.last is not None,
            "sliders": self.sliders.told(), "hands": self._goals(), "margins": margin_bars(verdict, self._loose()),
        }  # fmt: skip

    def _lines(self, state: str) -> list[str]:
        words = {"running": "running in real time", "paused": "paused", "ended": "ended"}
        pace = self._pace.text(self.run.tick, time.monotonic(), is_running=state == "running")
        lines = [words[state], *([pace] if pace else [])]
        if self.run.has_hardware:
            lines.append("HARDWARE IS ARMED: gains stay within the certificate")
        if self.recording is not None:
            lines.append(f"● recording to {self.recording}")
        elif self.last is not None:
            lines.append(f"recorded in {self.last}")
        return lines

    def _goals(self) -> list[dict[str, Any]]:
        goals = [self.run.goals(number) for number in range(len(self.run.guides))]
        return [{"offsets": offsets.tolist(), "squeeze": squeeze} for offsets, squeeze in goals]

    def _loose(self) -> dict[str, float]:
        """Return the objects that no finger has touched in the last half second, as in `Frames.loose`."""
        _, rows = self.run.rows(self.run.tick - int(HELD / self.run.period))
        return Frames(history_of(rows, self.run.layout, self.run.header)).loose

    def _watch(self) -> None:
        """Detect resets and faults, and print new faults on the terminal."""
        if self.run.run_number != self._runs:
            self._runs, self._fault = self.run.run_number, ""
        fault = self.run.fault
        text = str(fault.message) if fault is not None else self.run.cause
        if text and text != self._fault:
            self._tell(f"fault: {text}")
        self._fault = text

    def _say(self, text: str) -> None:
        self._remark = text

    # Certificate --------------------------------------------------------------------------------------------------

    def _certify(self) -> None:
        """Request the stability for the run's values if they have changed; with hardware, `HardwareClamp` does this."""
        if self._margins is None:
            self._margins = Margins(self._first, self._take)
        scene = self.run.scene
        if scene is not self._certified and self._clamp is None:
            self._certified = scene
            values = {key: value_of(scene, key) for key in live_keys(self.sliders.sliders)}
            self._margins.ask({key: value for key, value in values.items() if value != value_of(self._first, key)})

    def _take(self, verdict: Verdict) -> None:
        self._has_verdict = True
        self._changed()

    def _set(self, values: Mapping[str, Any]) -> Future[Any]:
        """Request values of live keys; with hardware, only certified values are set."""
        order: Future[Any] = (self._clamp or self.run).set(values)
        order.add_done_callback(lambda _: self._changed())
        return order

    # When the page changes ----------------------------------------------------------------------------------------

    def _sleep(self, began: float) -> None:
        """Wait until the time of the next frame or, if an order arrives before, for the row that shows its effect."""
        left = FRAME - (time.monotonic() - began)
        if not self._wake.wait(max(0.0, left)):
            return
        self._certify()
        time.sleep(max(0.0, SHORTEST - (time.monotonic() - began)))
        self._wake.clear()
        self.run.await_row(self._awaited, FRAME)

    def _changed(self) -> None:
        """Let the next frame show the first row with the effect of an order."""
        self._awaited = self.run.tick + EFFECT
        self._wake.set()

    # Orders: in the server's thread, which keeps their sequence ---------------------------------------------------

    def order(self, order: Order) -> bool:
        """Start the execution of an order from a page; return False if the order is not valid for this run."""
        if order.act == "set":
            if not self.sliders.accepts(order.number, order.value):
                return False
            self.sliders.set(self.sliders.sliders[order.number].key, order.value)
        elif order.act in ("lead", "squeeze"):
            return self._lead(order)
        else:
            action = self._actions(order.number).get(order.act)
            if action is None:
                return False
            self._executor.submit(self._do, action)
        return True

    def _actions(self, count: int) -> dict[str, Callable[[], object]]:
        """Return the action of each button; with hardware, only the buttons for recording have actions.

        Args:
            count: Number of ticks of the action "step".
        """
        recording: dict[str, Callable[[], object]] = {"record": self._record, "stop": self._stop}
        if self.run.has_hardware:
            return recording
        return recording | {
            "run": self.run.resume, "pause": self.run.pause, "reset": self._reset, "step": lambda: self.run.step(count)
        }  # fmt: skip

    def _lead(self, order: Order) -> bool:
        """Move a hand or one of its fingers, or change a hand's squeeze; return False if a value is out of range."""
        run, extent = self.run, self._extent
        if order.number >= len(run.guides):
            return False
        count = len(run.guides[order.number].fingers)
        if order.act == "squeeze":
            least, most, step = self._squeezes
            if count < 2 or not least - 0.5 * step <= 1e3 * order.value <= most + 0.5 * step:
                return False
            run.guide(order.number, None, order.value)
        else:
            offset = np.array(order.offset)
            is_far = len(offset) != run.layout.dimensions or np.abs(offset).max() > REACH * extent
            if is_far or (order.finger is not None and order.finger >= count):
                return False
            run.guide(order.number, offset, finger=order.finger)
        self._changed()
        return True

    def _do(self, action: Callable[[], object]) -> None:
        """Execute the action of a button, and show its error on the page."""
        try:
            action()
            self._say("")
        except (GraspFXError, OSError) as error:
            self._say(str(error))
        except Exception as error:  # noqa: BLE001 - no caller could handle it; the page shows it
            self._say(f"{type(error).__name__}: {error}")
        self._changed()

    def _reset(self) -> None:
        if self.recording is not None:
            self._stop()
        else:
            self.run.reset()

    def _record(self) -> None:
        if self.recording is None:
            self.recording = self.run.record(self._new_folder())
            self._tell(f"recording {self.recording}")

    def _stop(self) -> None:
        if self.recording is not None:
            self.last = self.run.stop_recording()
            self.recording = None
            self._tell(f"recorded {self.last}")


def _squeezes(extent: float) -> tuple[float, float, float]:
    """Return smallest value, largest value and step of a hand's additional squeeze [mm], rounded."""
    size = 1e3 * extent
    step = 10.0 ** math.floor(math.log10(size / 200.0))
    least, most = (50.0 * step * round(share * size / (50.0 * step)) for share in (-WIDEST, CLOSEST))
    return least, most, step


FULL_BAR = 10.0  # margin of a full bar; bars are logarithmic
EMPTY_BAR = 0.5
AMPLE = 1.5  # margin below which a bar is a warning


def margin_bars(verdict: Verdict | None, loose: Mapping[str, float]) -> dict[str, Any]:
    """Return the boxes and the bars by which a page shows a stability result.

    Args:
        verdict: Stability of the scene with all objects held; None before the first result.
        loose: Gap to the nearest finger [m] for each object that is not held, from `Frames.loose`. The results of these
            objects are not shown in green.
    """
    boxes = []
    if loose:
        apart = ", ".join(_apart(*each) for each in loose.items())
        boxes.append(_box("amber", f"NOT HELD: no finger touches {apart}", "touch the object from both sides"))
    rows: list[dict[str, Any]] = []
    if verdict is None:
        boxes.append(_box("grey", "Stability is being computed"))
    elif verdict.is_stable is None:
        boxes.append(_box("grey", "Stability is not known", verdict.error))
    else:
        kind = "red" if not verdict.is_stable else "grey" if loose else "green"
        words = (
            "UNSTABLE: the grasp will shake"
            if not verdict.is_stable
            else "stable when all objects are held"
            if loose
            else "stable"
        )
        how = "provisional, the complete result is being computed" if verdict.is_provisional else "complete"
        boxes.append(_box(kind, words, f"{how}; spectral radius {verdict.spectral_radius:.5f}"))
        rows = [_row(row, "grey" if row.name in loose else "green") for row in verdict.rows]
    faint = verdict is not None and verdict.is_provisional
    return {"boxes": boxes, "rows": rows, "faint": faint, "mark": _share(1.0)}


def _box(kind: str, words: str, note: str = "") -> dict[str, str]:
    return {"kind": kind, "words": words, "note": note}


def _apart(name: str, gap: float) -> str:
    """Return the name of an object and, if known, the distance to the nearest finger as a text."""
    away = f"{gap:.3g} m" if gap >= 1.0 else f"{1e3 * max(gap, 0.0):.3g} mm"
    return name + (f" (the nearest finger is {away} away)" if math.isfinite(gap) else "")


def _row(row: MarginRow, ample: str) -> dict[str, Any]:
    margin, has_limit = row.margin, math.isfinite(row.margin)
    where = f", lost at {row.frequency:.3g} Hz" if math.isfinite(row.frequency) else ""
    return {
        "name": row.mode, "margin": f"{margin:.2f} ×" if has_limit else "no limit",
        "share": _share(margin) if has_limit else 1.0,
        "kind": "red" if margin < 1.0 else "amber" if margin < AMPLE else ample,
        "words": f"limit {row.limit:.4g} N/m{where}" if math.isfinite(row.limit) else "",
    }  # fmt: skip


def _share(margin: float) -> float:
    least, most = math.log(EMPTY_BAR), math.log(FULL_BAR)
    return min(1.0, max(0.02, (math.log(max(margin, 1e-9)) - least) / (most - least)))


class SliderOrders:
    """Values that are requested by sliders, and values that are set in the run.

    Args:
        sliders: Sliders of the scene.
        order: Function that requests values by live key and returns a future. The result of the future is None if these
            values were set, or an `Outcome` with the values that were set.
        remark: Function that shows a message on the page; an empty text removes the message.

    Attributes:
        sliders: Sliders with their present ranges.
        values: Values that are set in the run, by the key of the slider.
        shown: Values that the page shows, by the key of the slider: the requested value while a request is pending,
            otherwise the value that is set.
    """

    def __init__(
        self, sliders: Sequence[Slider], order: Callable[[Mapping[str, Any]], Future[Any]],
        remark: Callable[[str], None],
    ) -> None:  # fmt: skip
        self._order, self._remark = order, remark
        self._lock = threading.Lock()
        self.sliders = list(sliders)
        self.values = {slider.key: slider.value for slider in sliders}
        self.shown = dict(self.values)  # with pending requests, because factors of one stiffness are set together
        self._newest = dict.fromkeys(self.values, 0)

    def told(self) -> list[tuple[float, float, float, float]]:
        """Return value, least, most and step of each slider."""
        return [(self.shown[each.key], each.least, each.most, each.step) for each in self.sliders]

    def widen(self, verdict: Verdict) -> None:
        """Extend the ranges of the sliders beyond the stability limits, if the result is complete."""
        if not verdict.is_provisional:
            self.sliders = [widened(each, verdict) for each in self.sliders]

    def accepts(self, number: int, value: float) -> bool:
        """Return whether a slider has this number and its range includes the value."""
        return number < len(self.sliders) and self.sliders[number].least <= value <= self.sliders[number].most

    def set(self, key: str, value: float) -> None:
        """Request a value of a slider; if it is reduced or refused, the slider shows the value that is set."""
        slider = next(each for each in self.sliders if each.key == key)
        with self._lock:
            self._newest[key] += 1
            number = self._newest[key]
            self.shown[key] = value
            order = values_of(slider, self.sliders, self.shown)
        self._order(order).add_done_callback(lambda future: self._settle(key, number, value, order, future))

    def _settle(self, key: str, number: int, value: float, order: Mapping[str, Any], future: Future[Any]) -> None:
        """Store the result of a request; the slider shows it unless a newer request for the slider is pending."""
        error = future.exception()
        outcome = None if error is not None else future.result() or Outcome(order)
        with self._lock:
            if outcome is not None:
                told = {each.key: value_in(each, outcome.values) for each in self.sliders}
                self.values.update({name: each for name, each in told.items() if each is not None})
            is_newest = number == self._newest[key]
            if is_newest:
                self.shown[key] = self.values[key]
        if error is not None:
            self._remark(f"{key} = {value:.5g} was not set: {error}")
        elif is_newest and outcome is not None:
            self._remark(outcome.text)
