"""The certificate beside the sliders: begun with the first page, asked at each order, a gate to hardware."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

from graspfx.assembly.live import numbered, value_of
from graspfx.live.hardware_clamp import HardwareClamp, Order
from graspfx.live.margins import Margins

if TYPE_CHECKING:
    from graspfx.live.live_run import LiveRun
    from graspfx.live.stability_verdict import Verdict

Values = Mapping[str, Any]


class CertificatePanel:
    """Verdicts on the run's values, and orders that change them.

    Args:
        run: whose values change.
        wake: called as a verdict or a value has come.
    """

    def __init__(self, run: LiveRun, wake: Callable[[], None]) -> None:
        self._run, self._wake = run, wake
        self._margins: Margins | None = None
        self._clamp: HardwareClamp | None = None
        self._news = False
        self._lock, self._waiting = threading.Lock(), 0
        self._request: dict[str, Any] = {}  # values of the newest request, by key

    def start(self) -> None:
        """Begin to compute, where this has not begun."""
        if self._margins is None:
            self._margins = Margins(self._run.scene, self._take)
            self._clamp = HardwareClamp(self._run, self._margins) if self._run.has_hardware else None

    def order(self, values: Values) -> Future[Order]:
        """Set live keys; with hardware only what is certified."""
        self.start()
        assert self._margins is not None
        if self._clamp is not None:
            order = self._clamp.set(values)
        else:
            with self._lock:
                self._waiting += 1
                self._request |= values
                self._margins.ask(values)
            order = Future()
            self._run.set(values).add_done_callback(lambda done: self._finish(order, values, done))
        order.add_done_callback(lambda _: self._wake())
        return order

    def latest(self) -> Verdict | None:
        """Give the newest verdict; None before the first."""
        return None if self._margins is None else self._margins.latest()

    def has_news(self) -> bool:
        """Tell whether a verdict has come since the last call."""
        news, self._news = self._news, False
        return news

    def close(self) -> None:
        """End its process."""
        if self._margins is not None:
            self._margins.close()  # first: orders to hardware wait for its verdicts
        if self._clamp is not None:
            self._clamp.close()

    def _take(self, verdict: Verdict) -> None:
        self._news = True
        self._wake()

    def _finish(self, order: Future[Order], values: Values, done: Future[None]) -> None:
        """End an order as the run has taken it, or not."""
        try:
            self._ask_for_now()
        finally:
            error = done.exception()
            if error is None:
                order.set_result(Order(values, values))
            else:
                order.set_exception(error)

    def _ask_for_now(self) -> None:
        """Ask for a verdict on the run's values after the last order on its way, where the newest is on others.

        A verdict on values that the run has not taken is none on the run; of orders that fail, each another one may
        have been asked for last.
        """
        with self._lock:
            self._waiting -= 1
            if self._waiting or self._margins is None:
                return
            scene = self._run.scene
            now = {key: value_of(scene, numbered(scene, key)) for key in self._request}
            if now != self._request:
                self._request = now
                self._margins.ask(now)
