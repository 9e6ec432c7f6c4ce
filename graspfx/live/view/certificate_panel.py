"""Certificate beside the sliders: updated with each order, and required for orders to hardware."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

from graspfx.assembly.live import numbered, value_of
from graspfx.live.hardware_clamp import HardwareClamp, Outcome
from graspfx.live.margins import Margins

if TYPE_CHECKING:
    from graspfx.live.live_run import LiveRun
    from graspfx.live.stability_verdict import Verdict

Values = Mapping[str, Any]


class CertificatePanel:
    """Stability results for the run's values, and orders that change the values.

    Args:
        run: Run whose values change.
        wake: Function called after each new result or value.
    """

    def __init__(self, run: LiveRun, wake: Callable[[], None]) -> None:
        self._run, self._wake = run, wake
        self._margins: Margins | None = None
        self._clamp: HardwareClamp | None = None
        self._news = False
        self._lock, self._waiting = threading.Lock(), 0
        self._request: dict[str, Any] = {}  # values of the newest request, by key

    def start(self) -> None:
        """Start computing, unless already started."""
        if self._margins is None:
            self._margins = Margins(self._run.scene, self._take)
            self._clamp = HardwareClamp(self._run, self._margins) if self._run.has_hardware else None

    def order(self, values: Values) -> Future[Outcome]:
        """Set values of live keys; with hardware, set only certified values."""
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
        """Return the newest result; None before the first."""
        return None if self._margins is None else self._margins.latest()

    def has_news(self) -> bool:
        """Tell whether there was a new result since the last call."""
        news, self._news = self._news, False
        return news

    def close(self) -> None:
        """End the process that computes certificates."""
        if self._margins is not None:
            self._margins.close()  # first, because orders to hardware wait for its results
        if self._clamp is not None:
            self._clamp.close()

    def _take(self, verdict: Verdict) -> None:
        self._news = True
        self._wake()

    def _finish(self, order: Future[Outcome], values: Values, done: Future[None]) -> None:
        """Complete an order with the result of the run."""
        try:
            self._ask_for_now()
        finally:
            error = done.exception()
            if error is None:
                order.set_result(Outcome(values, values))
            else:
                order.set_exception(error)

    def _ask_for_now(self) -> None:
        """After the last pending order, request a result for the run's values if the newest request had other values.

        A result for values that the run has not accepted does not describe the run. If orders fail, the newest request
        may be for such values.
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
