"""New gains on their way to hardware: certified first, clamped to a share of their limit, or refused with a reason."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, Protocol

from graspfx.assembly.live import GAINS
from graspfx.assembly.numbers import general
from graspfx.live.margins import Margins
from graspfx.live.stability_verdict import MarginRow, Verdict

SHARE = 0.9  # of a limit: the most that hardware gets
INSIDE = 1e-3  # relative: how far below that a clamped gain is, as the rest that it leads to has another limit
SAME = 1e-6  # relative: a gain that is as large as before
MODES = {key: key.split(".")[1] for key in GAINS if key.endswith("stiffness")}  # external, internal


def shortfall(verdict: Verdict, present: Verdict) -> str:
    """Say why values are not for hardware; no text where they are.

    Each margin has to be 1/0.9 or more; one that is less now must not shrink.

    Args:
        verdict: in full, on the values.
        present: in full, on those that hardware has.
    """
    for row, needed in _short(verdict, present):
        text = f"{row.mode} margin {row.margin:.3f}" if math.isfinite(row.margin) else row.mode
        lost = "" if math.isnan(row.frequency) else f", beyond which it shakes at {row.frequency:.3g} Hz"
        return f"{text}, {needed:.3f} needed; limit {row.limit:.4g} N/m{lost}"
    if not verdict.is_stable:
        return f"not stable: spectral radius {verdict.spectral_radius:.6f}"
    return ""


def lower(values: Mapping[str, Any], verdict: Verdict, present: Verdict) -> dict[str, Any] | None:
    """Lower stiffness that is beyond 0.9 of its limit to that; None where none is left above that of now.

    Args:
        values: by live key, that fall short.
        verdict: in full, on them.
        present: in full, on those that hardware has.
    """
    less = dict(values)
    for key, value in values.items():
        mode = MODES.get(general(key))
        if mode is None or not isinstance(value, int | float):
            continue
        rows = [row for row in present.rows if row.mode == mode]
        now = min((row.gain for row in rows), default=0.0)
        most = min((SHARE * row.limit for row in rows), default=math.inf)  # near what hardware has
        if value <= max(most, now):
            short = [row.margin / needed for row, needed in _short(verdict, present) if _grows(row, mode)]
            if not short:
                continue
            most = float(value) * min(short)
        most *= 1.0 - INSIDE
        if value > most and not value > now >= most * (1.0 - SAME):
            less[key] = most
    return None if less == dict(values) else less


def _short(verdict: Verdict, present: Verdict) -> Iterator[tuple[MarginRow, float]]:
    """Give rows with too small a margin, and the one that they need."""
    for row in verdict.rows:
        before = min((each.margin for each in present.rows if _kind(each) == _kind(row)), default=math.inf)
        needed = min(1.0 / SHARE, before * (1.0 - SAME))
        if row.margin < needed:
            yield row, needed


def _kind(row: MarginRow) -> tuple[str, str]:
    """Name what a row is of: fingers that push are the weakest, whoever they are."""
    return row.name, row.mode if row.is_mode else "pushing"


def _grows(row: MarginRow, mode: str) -> bool:
    """Tell whether a row's gain is that of a mode, or all gains together."""
    return row.mode == mode or not row.mode.startswith(("external", "internal"))


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
