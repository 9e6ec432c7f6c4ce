"""New gains on their way to hardware: certified first, clamped to a share of their limit, or refused with a reason."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, Protocol

from graspfx.live.clamp import SHARE, lower, shortfall
from graspfx.live.margins import Margins
from graspfx.live.stability_verdict import Verdict

PATIENCE = 20.0  # for a full certificate [s]
ROUNDS = 4  # of clamped values whose own certificate asks for less


class Steered(Protocol):
    """A run that takes new values."""

    def set(self, values: Mapping[str, Any]) -> Future[Any]:
        """Set values by live key; the future ends once the loop has them, or with the reason why not."""
        ...


@dataclass(frozen=True)
class Order:
    """An order to hardware, as it was carried out.

    Attributes:
        request: values by live key, as they were ordered.
        values: that were set; none where the order was refused.
        text: what was asked, what was set, and why; empty where it was set as asked.
    """

    request: Mapping[str, Any]
    values: Mapping[str, Any]
    text: str = ""

    @property
    def is_refused(self) -> bool:
        """Whether nothing was set."""
        return not self.values


class HardwareClamp:
    """A gate between sliders and a run with hardware: what is not certified does not pass.

    Values have to leave each limit of the certificate, with all gains as they will be, a share of room (`SHARE`), or as
    much as there is now where that is less; a larger stiffness is set to the largest that does, other values are
    refused. Orders that come while a certificate is computed wait and become one, in which the newest value of a key
    counts; the futures of all of them end with that.

    Args:
        run: whose values change.
        margins: of its scene; nobody else asks it.
    """

    def __init__(self, run: Steered, margins: Margins) -> None:
        self._run, self._margins = run, margins
        self._present: dict[str, Any] = {}  # that differ from the scene's
        self._verdict: Verdict | None = None
        self._changed = threading.Condition()
        self._waiting: dict[str, Any] = {}
        self._futures: list[Future[Order]] = []
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="graspfx hardware clamp", daemon=True)
        self._thread.start()

    def set(self, values: Mapping[str, Any]) -> Future[Order]:
        """Order values by live key; nothing waits here."""
        future: Future[Order] = Future()
        with self._changed:
            if self._closed:
                future.set_result(_late(values))
            else:
                self._waiting |= values
                self._futures.append(future)
                self._changed.notify_all()
        return future

    def close(self) -> None:
        """End; orders that still wait are refused."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._thread.join()

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._futures or self._closed)
                request, futures = self._waiting, self._futures
                self._waiting, self._futures = {}, []
                closed = self._closed
            try:
                order = _late(request) if closed else self._carry_out(request)
                for future in futures:
                    future.set_result(order)
            except Exception as error:  # noqa: BLE001 - raised where the order is waited for
                for future in futures:
                    future.set_exception(error)
            if closed:
                return

    def _carry_out(self, request: dict[str, Any]) -> Order:
        present = self._verdict = self._verdict or self._certificate(self._present)
        if present is None or present.is_stable is None:
            return self._refusal(request, f"there is no certificate of the values of now{_why(present)}")
        values, first = request, ""
        for _ in range(ROUNDS):
            verdict = self._certificate(self._present | values)
            if verdict is None or verdict.is_stable is None:
                return self._refusal(request, f"there is no certificate of it{_why(verdict)}")
            why = shortfall(verdict, present)
            if not why:
                try:
                    self._run.set(values).result()
                except Exception:
                    self._margins.ask(self._present, alone=True)  # a verdict on values that were not taken is none
                    raise
                self._present |= values
                self._verdict = verdict
                return Order(request, values, "" if values == request else _clamp_text(request, values, first))
            first = first or why
            less = lower(values, verdict, present)
            if less is None:
                return self._refusal(request, first)
            values = less
        return self._refusal(request, f"{first}; no smaller value was certified either")

    def _certificate(self, values: Mapping[str, Any]) -> Verdict | None:
        """Ask for the full verdict on values, and wait for it."""
        number = self._margins.ask(values, alone=True)
        verdict = self._margins.await_verdict(number, PATIENCE)
        return verdict if verdict is not None and verdict.number == number else None

    def _refusal(self, request: Mapping[str, Any], why: str) -> Order:
        self._margins.ask(self._present, alone=True)
        return Order(request, {}, f"refused: {_listed(request)}: {why}")


def _late(request: Mapping[str, Any]) -> Order:
    return Order(request, {}, f"refused: {_listed(request)}: the run has ended")


def _why(verdict: Verdict | None) -> str:
    return f": {verdict.error}" if verdict is not None and verdict.error else f" within {PATIENCE:g} s"


def _listed(values: Mapping[str, Any]) -> str:
    return ", ".join(
        f"{key} = {value:.5g}" if isinstance(value, float) else f"{key} = {value}" for key, value in values.items()
    )


def _clamp_text(request: Mapping[str, Any], values: Mapping[str, Any], why: str) -> str:
    return f"asked {_listed(request)}; set {_listed(values)}, at most {SHARE:g} of each limit: as asked, {why}"
