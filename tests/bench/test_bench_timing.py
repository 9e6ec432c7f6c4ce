"""Benchmarks' timing: what is wrong or missing is not timed, methods take turns, times are per operation."""

from __future__ import annotations

import gc
import math
import os
from collections.abc import Callable
from functools import partial
from itertools import count

import pytest

from graspfx.bench.timing import (
    THREADS,
    Case,
    Effort,
    Method,
    clocked,
    each,
    environment,
    interleaved,
    measure,
    missing,
    one_blas_thread,
)

BRIEF = Effort(rounds=4, batch=1000, most=10**9, singles=3)


def case(*methods: Method, bound: float | None = None, unit: str = "m") -> Case:
    return Case("test", "a case", unit, methods, bound)


def never() -> None:
    raise AssertionError("called, though its error was to be found out first")


def fails() -> float:
    raise ZeroDivisionError("no pivot")


@pytest.mark.parametrize("error", [1e-3, lambda: 1e-3, math.nan, lambda: math.inf, fails])
def test_wrong_method_is_refused_before_it_is_timed(error: Callable[[], float] | float) -> None:
    [wrong, right] = measure(case(Method("wrong", never, error), Method("right", int, 1e-9), bound=1e-6), BRIEF)
    assert (wrong.state, wrong.time_us) == ("wrong", None)
    assert right.state == "timed" and right.time_us is not None and right.error == 1e-9
    if error == 1e-3:
        assert wrong.error == 1e-3 and "beyond 1.0e-06" in wrong.note
    if error is fails:
        assert "no pivot" in wrong.note


def test_without_a_bound_the_error_is_what_is_shown() -> None:
    [row] = measure(case(Method("rough", int, 12.0)), BRIEF)
    assert row.state == "timed" and row.error == 12.0


def test_missing_peer_is_a_row_that_says_what_to_install() -> None:
    [row] = measure(case(missing("peer", "some-package")), BRIEF)
    assert (row.state, row.time_us, row.error) == ("missing", None, None)
    assert row.note == "not installed: pip install some-package"


def test_errors_of_our_own_are_not_taken_for_a_missing_answer() -> None:
    with pytest.raises(KeyError):
        measure(case(Method("broken", int, lambda: dict[str, int]()["nothing"])), BRIEF)


def test_methods_take_turns_and_each_begins_a_round() -> None:
    order: list[str] = []
    interleaved([Method(name, partial(order.append, name), 0.0) for name in "abc"], Effort(3, 1, 10**9, 1))
    assert "".join(order) == "aabbcc" + "abc" + "bca" + "cab"  # first: one call to warm up, one to see how long it is


def test_times_are_per_operation() -> None:
    def slow(_: int) -> int:
        return sum(range(2000))

    [one], [many] = (
        [min(times)] for times in interleaved(
            [Method("one", each(slow, [0]), 0.0), Method("many", each(slow, range(50)), 0.0, calls=50)],
            Effort(20, 200_000, 10**9, 1),
        )
    )  # fmt: skip
    assert 0.5 < many / one < 2.0


def test_a_slow_method_leaves_after_its_share_and_others_go_on() -> None:
    calls = count()

    def slow() -> None:
        next(calls)
        sum(range(100_000))

    slow_times, quick_times = interleaved(
        [Method("slow", slow, 0.0), Method("quick", int, 0.0)],
        Effort(rounds=9, batch=1, most=300_000, singles=1),
    )
    assert (len(slow_times), len(quick_times)) == (1, 9)
    assert next(calls) == 3  # one to warm up, one to see how long it takes, and one round


def test_collector_is_off_while_timing_and_on_again_after() -> None:
    seen: list[bool] = []
    interleaved([Method("a", lambda: seen.append(gc.isenabled()), 0.0)], BRIEF)
    assert seen and not any(seen) and gc.isenabled()


def test_each_goes_through_all_inputs() -> None:
    seen: list[int] = []
    clocked(each(seen.append, [1, 2, 3]), 2)
    assert seen == [1, 2, 3, 1, 2, 3]


def test_spread_of_single_calls() -> None:
    lengths = iter([*range(1000, 11_000, 1000), 1000, 1000])

    def call() -> None:
        sum(range(next(lengths)))

    [row] = measure(case(Method("ticks", call, 0.0, singly=True)), BRIEF)
    assert next(lengths, None) is None  # four rounds of three calls and no others
    assert row.quantiles is not None and row.time_us is not None
    assert row.time_us <= row.quantiles["p50"] <= row.quantiles["p99"] <= row.quantiles["p99.9"] <= row.quantiles["max"]


def test_one_blas_thread_is_for_what_is_loaded_within(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(THREADS[0], "7")
    for name in THREADS[1:]:
        monkeypatch.delenv(name, raising=False)
    with one_blas_thread():
        assert [os.environ[name] for name in THREADS] == ["7", "1", "1", "1"]
        assert not set(THREADS) & set(environment())
    assert [os.environ.get(name) for name in THREADS] == ["7", None, None, None]
