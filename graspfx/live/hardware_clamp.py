"""New gains on their way to hardware: certified first, clamped to a share of their limit, or refused with a reason."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, Protocol

from graspfx.live.clamp import SHARE, clamped, shortfall
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
        asked: values by live key.
        values: that were set; none where the order was refused.
        text: what was asked, what was set, and why; empty where it was set as asked.
    """

    asked: Mapping[str, Any]
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
    refused. While a certificate is computed the newest order counts, and those that it overtook are refused.

    Args:
        run: whose values change.
        margins: of its scene; nobody else asks it.
    """

    def __init__(self, run: Steered, margins: Margins) -> None:
        self._run, self._margins = run, margins
        self._present: dict[str, Any] = {}  # that differ from the scene's
        self._verdict: Verdict | None = None
        self._changed = threading.Condition()
        self._waiting: tuple[dict[str, Any], Future[Order]] | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="graspfx hardware clamp", daemon=True)
        self._thread.start()

    def set(self, values: Mapping[str, Any]) -> Future[Order]:
        """Order values by live key; nothing waits here."""
        future: Future[Order] = Future()
        asked = dict(values)
        with self._changed:
            if self._waiting is not None:
                before, overtaken = self._waiting
                asked = before | asked
                overtaken.set_result(Order(before, {}, f"{_listed(before)}: a newer order has come"))
            self._waiting = asked, future
            self._changed.notify_all()
        return future

    def close(self) -> None:
        """End; an order that still waits is refused."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._thread.join()

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting is not None or self._closed)
                if self._waiting is None:
                    return
                (asked, future), self._waiting = self._waiting, None
                if self._closed:
                    future.set_result(Order(asked, {}, f"{_listed(asked)}: the run has ended"))
                    return
            try:
                future.set_result(self._carry_out(asked))
            except Exception as error:  # noqa: BLE001 - raised where the order is waited for
                future.set_exception(error)

    def _carry_out(self, asked: dict[str, Any]) -> Order:
        present = self._verdict or self._certificate(1)
        if present is None or present.is_stable is None:
            return self._refusal(asked, "there is no certificate of the values of now" + _why(present))
        values, first = asked, ""
        for _ in range(ROUNDS):
            verdict = self._certificate(self._margins.ask(self._present | values))
            if verdict is None or verdict.is_stable is None:
                return self._refusal(asked, "there is no certificate of it" + _why(verdict))
            why = shortfall(verdict, present)
            if not why:
                self._run.set(values).result()
                self._present |= values
                self._verdict = verdict
                return Order(asked, values, "" if values == asked else _clamp_text(asked, values, first))
            if values is asked:
                first = why
            less = clamped(values, verdict, present)
            if less is None:
                return self._refusal(asked, why)
            values = less
        return self._refusal(asked, f"{first}; no smaller value was certified either")

    def _certificate(self, number: int) -> Verdict | None:
        """Wait for the full verdict on a request."""
        verdict = self._margins.await_verdict(number, PATIENCE)
        return verdict if verdict is not None and verdict.number == number else None

    def _refusal(self, asked: Mapping[str, Any], why: str) -> Order:
        self._margins.ask(self._present)
        return Order(asked, {}, f"refused: {_listed(asked)}: {why}")


def _why(verdict: Verdict | None) -> str:
    return f": {verdict.error}" if verdict is not None and verdict.error else f" within {PATIENCE:g} s"


def _listed(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{key} = {value:.5g}" if isinstance(value, float) else f"{key} = {value}" for key, value in values.items())


def _clamp_text(asked: Mapping[str, Any], values: Mapping[str, Any], why: str) -> str:
    return f"asked {_listed(asked)}; set {_listed(values)}, {SHARE:g} of the limit: {why}"
