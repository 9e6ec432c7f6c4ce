"""The certificate beside the sliders: begun with the first page, asked at each order, a gate where there is hardware."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

from graspfx.errors import InputError
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

    def start(self) -> None:
        """Begin to compute, where this has not begun."""
        if self._margins is None:
            self._margins = Margins(self._run.scene, self._take)
            self._clamp = HardwareClamp(self._run, self._margins) if self._run.has_hardware else None

    def order(self, values: Values) -> Future[Values]:
        """Set live keys; with hardware only what is certified. The future ends with the values that were set."""
        self.start()
        assert self._margins is not None
        result: Future[Values] = Future()
        if self._clamp is not None:
            self._clamp.set(values).add_done_callback(lambda order: self._settle(order, result))
        else:
            self._margins.ask(values)
            self._run.set(values).add_done_callback(lambda done: self._end(done, values, result))
        return result

    def latest(self) -> Verdict | None:
        """Give the newest verdict; None before the first."""
        return None if self._margins is None else self._margins.latest()

    def has_news(self) -> bool:
        """Tell whether a verdict has come since the last call."""
        news, self._news = self._news, False
        return news

    def close(self) -> None:
        """End its process."""
        if self._clamp is not None:
            self._clamp.close()
        if self._margins is not None:
            self._margins.close()

    def _take(self, verdict: Verdict) -> None:
        self._news = True
        self._wake()

    def _end(self, done: Future[None], values: Values, result: Future[Values]) -> None:
        error = done.exception()
        if error is not None:
            result.set_exception(error)
        else:
            result.set_result(values)
        self._wake()

    def _settle(self, order: Future[Order], result: Future[Values]) -> None:
        error = order.exception()
        if error is not None:
            result.set_exception(error)
        elif order.result().text:
            outcome = order.result()
            result.set_exception(_Clamped(outcome))
        else:
            result.set_result(order.result().values)
        self._wake()


class _Clamped(InputError):
    """An order that was not carried out as it was asked."""

    def __init__(self, order: Order) -> None:
        super().__init__("order", dict(order.asked), "what the certificate allows", order.text)
        self.order = order
