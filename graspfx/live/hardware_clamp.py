"""Safe changes of gains with hardware: new gains are certified, and then set, reduced or refused."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

from graspfx.assembly.live import GAINS
from graspfx.live.certifier import MarginRow, Verdict
from graspfx.live.margins import Margins
from graspfx.scene.keys import general

SHARE = 0.9  # largest gain with hardware, relative to its limit
INSIDE = 1e-3  # relative distance of a clamped gain below that share, because a new equilibrium has another limit
SAME = 1e-6  # relative difference up to which gains are equal
MODES = {key: key.split(".")[1] for key in GAINS if key.endswith("stiffness")}  # external, internal


def shortfall(verdict: Verdict, present: Verdict) -> str:
    """Return the reason why new values are not allowed with hardware; empty if they are allowed.

    Each margin must be at least 1/0.9, or at least its present value if the present value is smaller.

    Args:
        verdict: Complete stability result for the new values.
        present: Complete stability result for the present values.
    """
    for row, needed in _short(verdict, present):
        text = f"{row.mode} margin {row.margin:.3f}" if math.isfinite(row.margin) else row.mode
        lost = "" if math.isnan(row.frequency) else f", unstable beyond it at {row.frequency:.3g} Hz"
        return f"{text}, {needed:.3f} needed; limit {row.limit:.4g} N/m{lost}"
    if not verdict.is_stable:
        return f"not stable: spectral radius {verdict.spectral_radius:.6f}"
    return ""


def lower(values: Mapping[str, Any], verdict: Verdict, present: Verdict) -> dict[str, Any] | None:
    """Lower the stiffnesses in refused values to just below 0.9 of their limits.

    If a stiffness above its present value can only be allowed by lowering it to or below the present value, it is not
    changed. The result is None if no stiffness is changed.

    Args:
        values: Values by live key that are not allowed.
        verdict: Complete stability result for these values.
        present: Complete stability result for the present values.
    """
    less = dict(values)
    for key, value in values.items():
        mode = MODES.get(general(key))
        if mode is None or not isinstance(value, int | float):
            continue
        rows = [row for row in present.rows if row.mode == mode]
        now = min((row.gain for row in rows), default=0.0)
        most = min((SHARE * row.limit for row in rows), default=math.inf)  # limit near the present values
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
    """Yield each row whose margin is too small, together with the required margin."""
    for row in verdict.rows:
        before = min((each.margin for each in present.rows if _kind(each) == _kind(row)), default=math.inf)
        needed = min(1.0 / SHARE, before * (1.0 - SAME))
        if row.margin < needed:
            yield row, needed


def _kind(row: MarginRow) -> tuple[str, str]:
    """Return the key by which rows are compared: object and mode; all sets of pushing fingers have the same mode."""
    return row.name, row.mode if row.is_mode else "pushing"


def _grows(row: MarginRow, mode: str) -> bool:
    """Return whether the gain of a row increases with the gain of a mode."""
    return row.mode == mode or not row.mode.startswith(("external", "internal"))


PATIENCE = 20.0  # timeout for a full certificate [s]
ROUNDS = 4  # attempts to find values that are certified


@dataclass(frozen=True)
class Outcome:
    """Result of a request to set values with hardware.

    Attributes:
        values: Values that were set; empty if the request was refused.
        text: Explanation if the request was refused or lower values were set; otherwise empty.
    """

    values: Mapping[str, Any]
    text: str = ""


class HardwareClamp:
    """Filter between sliders and a run with hardware that passes only certified values.

    With the new values, each gain must be at most 0.9 of its limit, or its margin must not be smaller than at present.
    A stiffness that is too large is reduced until it satisfies this condition; other values are refused. Requests that
    arrive while a certificate is computed are merged into one request, with the newest value of each key, and their
    futures complete together.

    Args:
        apply: Function of a dict from live key to value that sets these values in the run. It returns a future, which
            completes when the loop uses the values, or with an exception.
        margins: Certificates of the run's scene. No other object may send requests to it.
    """

    def __init__(self, apply: Callable[[Mapping[str, Any]], Future[Any]], margins: Margins) -> None:
        self._apply, self._margins = apply, margins
        self._present: dict[str, Any] = {}  # values that differ from the scene's
        self._verdict: Verdict | None = None
        self._changed = threading.Condition()
        self._waiting: dict[str, Any] = {}
        self._futures: list[Future[Outcome]] = []
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="graspfx hardware clamp", daemon=True)
        self._thread.start()

    def set(self, values: Mapping[str, Any]) -> Future[Outcome]:
        """Request new values by live key, without waiting for the result."""
        future: Future[Outcome] = Future()
        with self._changed:
            if self._closed:
                future.set_result(_late(values))
            else:
                self._waiting |= values
                self._futures.append(future)
                self._changed.notify_all()
        return future

    def close(self) -> None:
        """Refuse all pending requests and end the thread."""
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
            except Exception as error:  # noqa: BLE001 - the caller gets it from the future
                for future in futures:
                    future.set_exception(error)
            if closed:
                return

    def _carry_out(self, request: dict[str, Any]) -> Outcome:
        present = self._verdict = self._verdict or self._certificate(self._present)
        if present is None or present.is_stable is None:
            return self._refusal(request, f"there is no certificate for the present values{_why(present)}")
        values, first = request, ""
        for _ in range(ROUNDS):
            verdict = self._certificate(self._present | values)
            if verdict is None or verdict.is_stable is None:
                return self._refusal(request, f"there is no certificate for these values{_why(verdict)}")
            why = shortfall(verdict, present)
            if not why:
                try:
                    self._apply(values).result()
                except Exception:
                    self._margins.ask(self._present)  # the result for refused values is void
                    raise
                self._present |= values
                self._verdict = verdict
                return Outcome(values, "" if values == request else _clamp_text(request, values, first))
            first = first or why
            less = lower(values, verdict, present)
            if less is None:
                return self._refusal(request, first)
            values = less
        return self._refusal(request, f"{first}; no smaller value was certified either")

    def _certificate(self, values: Mapping[str, Any]) -> Verdict | None:
        """Request the complete result for these values and wait for it; return None after a timeout."""
        number = self._margins.ask(values)
        verdict = self._margins.await_verdict(number, PATIENCE)
        return verdict if verdict is not None and verdict.number == number else None

    def _refusal(self, request: Mapping[str, Any], why: str) -> Outcome:
        self._margins.ask(self._present)
        return Outcome({}, f"refused: {_listed(request)}: {why}")


def _late(request: Mapping[str, Any]) -> Outcome:
    return Outcome({}, f"refused: {_listed(request)}: the run has ended")


def _why(verdict: Verdict | None) -> str:
    return f": {verdict.error}" if verdict is not None and verdict.error else f" within {PATIENCE:g} s"


def _listed(values: Mapping[str, Any]) -> str:
    return ", ".join(
        f"{key} = {value:.5g}" if isinstance(value, float) else f"{key} = {value}" for key, value in values.items()
    )


def _clamp_text(request: Mapping[str, Any], values: Mapping[str, Any], why: str) -> str:
    return f"requested {_listed(request)}; set {_listed(values)}, at most {SHARE:g} of each limit. The request: {why}"
