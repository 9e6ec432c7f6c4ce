"""The thread that steers a live run: order, the newest values, errors where they belong, and its end."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import CancelledError
from threading import Event
from typing import Any

import pytest

from graspfx.errors import InputError
from graspfx.live.live_run import Conductor


def test_of_values_that_wait_the_newest_holds_and_errors_go_to_who_asked() -> None:
    calls: list[Any] = []
    go, began = Event(), Event()

    def apply(values: Mapping[str, Any]) -> None:
        calls.append(dict(values))
        if "bad" in values:
            raise InputError("bad", values["bad"], "another")

    def block() -> None:
        began.set()
        go.wait(10.0)

    def look() -> None:
        raise UserWarning

    conductor = Conductor(apply, look)
    conductor.do(block)
    assert began.wait(10.0)
    futures = [conductor.set({"a": 1}), conductor.set({"b": 1}), conductor.set({"a": 2})]
    action = conductor.do(lambda: calls.append("action"))
    mixed = [conductor.set({"a": 3}), conductor.set({"bad": 1}), conductor.set({"c": 1})]
    cancelled = conductor.set({"never": 1})
    assert cancelled.cancel()
    go.set()
    for future in (*futures, action, mixed[0], mixed[2]):
        future.result(10.0)
    with pytest.raises(InputError, match="another"):
        mixed[1].result(10.0)
    with pytest.raises(CancelledError):
        cancelled.result(1.0)
    first, second, *rest = calls
    assert (first, second) == ({"a": 2, "b": 1}, "action")
    assert rest == [{"a": 3, "bad": 1, "c": 1}, {"a": 3}, {"bad": 1}, {"c": 1}]
    conductor.end(lambda: calls.append("end"))
    conductor.end(lambda: calls.append("never"))
    assert calls[-1] == "end"
    with pytest.raises(InputError, match="it was closed"):
        conductor.set({"a": 1}).result(1.0)


def test_what_waits_at_the_end_is_given_up() -> None:
    go, began = Event(), Event()

    def block() -> None:
        began.set()
        go.wait(10.0)

    conductor = Conductor(lambda values: None, lambda: None)
    blocked = conductor.do(block)
    assert began.wait(10.0)
    late = conductor.set({"a": 1})
    late.add_done_callback(lambda future: go.set())
    conductor.end(lambda: None)
    blocked.result(1.0)
    with pytest.raises(InputError, match="an open run"):
        late.result(1.0)
