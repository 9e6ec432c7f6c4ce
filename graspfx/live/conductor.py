"""Command thread of a live run: executes commands in order, and merges pending values of the same key."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from contextlib import suppress
from threading import Condition, Thread
from typing import Any, NamedTuple

from graspfx.errors import InputError

LOOK = 0.1  # interval between checks of the run [s]


class _Request(NamedTuple):
    """Command: values to set, or an action."""

    future: Future[None]
    values: Mapping[str, Any] | None = None
    action: Callable[[], object] | None = None


class Conductor:
    """Thread that sets values and runs actions in the order of arrival.

    Consecutive pending values are set together, with the newest value of each key. If this fails, the values are set
    one by one.

    Args:
        apply: Function that sets values.
        look: Function called periodically.
    """

    def __init__(self, apply: Callable[[Mapping[str, Any]], object], look: Callable[[], object]) -> None:
        self._apply, self._look = apply, look
        self._requests: list[_Request] = []
        self._change = Condition()
        self._is_over = False
        self._thread = Thread(target=self._run, name="graspfx-live", daemon=True)
        self._thread.start()

    def set(self, values: Mapping[str, Any]) -> Future[None]:
        """Queue values to set, by key."""
        return self._ask(_Request(Future(), values=dict(values)))

    def do(self, action: Callable[[], object]) -> Future[None]:
        """Queue an action."""
        return self._ask(_Request(Future(), action=action))

    def end(self, action: Callable[[], object]) -> None:
        """Run a last action, then end the thread; pending requests fail."""
        with self._change:
            if self._is_over:
                return
            self._is_over = True
            waiting, self._requests = self._requests, []
            last = _Request(Future(), action=action)
            self._requests.append(last)
            self._change.notify()
        for each in waiting:
            if each.future.set_running_or_notify_cancel():
                each.future.set_exception(_over())
        last.future.result()
        self._thread.join()

    def _ask(self, request: _Request) -> Future[None]:
        with self._change:
            if self._is_over:
                request.future.set_exception(_over())
            else:
                self._requests.append(request)
                self._change.notify()
        return request.future

    def _run(self) -> None:
        while True:
            with self._change:
                if not self._requests:
                    self._change.wait(LOOK)
                batch = self._next()
                is_last = self._is_over and not self._requests
            if batch and batch[0].action is not None:
                _do(batch[0], batch[0].action)
            elif batch:
                self._set(batch)
            if is_last:
                return
            with suppress(Exception):  # for example a warning turned into an error, which was reported
                self._look()

    def _next(self) -> list[_Request]:
        """Take the next action, or all values before the next action."""
        batch: list[_Request] = []
        while self._requests and not (batch and (batch[0].action or self._requests[0].action)):
            request = self._requests.pop(0)
            if request.future.set_running_or_notify_cancel():
                batch.append(request)
        return batch

    def _set(self, batch: list[_Request]) -> None:
        values: dict[str, Any] = {}
        for each in batch:
            values |= each.values or {}
        try:
            self._apply(values)
        except BaseException as error:  # noqa: BLE001 - it belongs to the futures
            if len(batch) == 1:
                batch[0].future.set_exception(error)
                return
        else:
            for each in batch:
                each.future.set_result(None)
            return
        for each in batch:
            own = each.values or {}
            _do(each, lambda own=own: self._apply(own))  # type: ignore[misc]


def _do(request: _Request, action: Callable[[], object]) -> None:
    try:
        action()
    except BaseException as error:  # noqa: BLE001 - it belongs to the future
        request.future.set_exception(error)
    else:
        request.future.set_result(None)


def _over() -> InputError:
    return InputError("run", "closed", "an open run", "it was closed; start a new run")
