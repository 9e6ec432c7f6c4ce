"""How methods are timed: checked first, then in turns in one process, many times over."""

from __future__ import annotations

import gc
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import repeat
from statistics import median
from time import perf_counter_ns

from graspfx.bench.case import Case, Method
from graspfx.errors import MissingPackageError

TIMED, WRONG, MISSING = "timed", "wrong", "missing"
QUANTILES = {"p50": 0.5, "p99": 0.99, "p99.9": 0.999, "max": 1.0}
NUMERICAL = (ArithmeticError, ValueError, RuntimeError)  # what numerical libraries raise where they find no answer


@dataclass(frozen=True)
class Effort:
    """How much is spent on a method.

    Attributes:
        rounds: in each of which every method of a case is timed once, one after another.
        batch: the least time that is taken at once [ns]: a method is called as often as it takes.
        most: time spent on a method, from which on it takes part in no further round [ns].
        least: rounds in which it takes part however long they are.
        singles: calls in a round of a method whose calls are timed one by one.
    """

    rounds: int
    batch: int
    most: int
    least: int
    singles: int


FULL = Effort(rounds=40, batch=5_000_000, most=2_000_000_000, least=3, singles=500)
QUICK = Effort(rounds=7, batch=500_000, most=100_000_000, least=1, singles=200)


@dataclass(frozen=True)
class Row:
    """A line of the report: one method in one case.

    Attributes:
        time_us: of one operation, the best round's [us]: what others on the machine disturbed least; None if not timed.
        median_us: over all rounds [us].
        error: the largest against the oracle, in `unit`; None if there is none.
        ratio: time over that of the case's reference, or of its quickest method.
        state: "timed", "wrong" (not timed: its error is beyond its bound) or "missing" (not installed).
        quantiles: of single operations by name [us], where their spread is what is measured.
    """

    benchmark: str
    case: str
    method: str
    time_us: float | None
    error: float | None
    note: str
    unit: str = ""
    median_us: float | None = None
    ratio: float | None = None
    state: str = TIMED
    quantiles: dict[str, float] | None = None


def measure(case: Case, effort: Effort) -> list[Row]:
    """Measure a row per method, in the case's order; what is wrong or missing is not timed."""
    checked, single = [], {}
    for i, method in enumerate(case.methods):
        if method.once:
            with collector_off():
                single[i] = [1e-3 * clocked(method.call, 1) / method.calls]
        checked.append(check(case, method))
    right = [i for i, row in enumerate(checked) if row.state == TIMED]
    repeated = [i for i in right if i not in single]
    times = {i: single[i] for i in right if i in single}
    times |= zip(repeated, interleaved([case.methods[i] for i in repeated], effort), strict=True)
    for i, seconds in times.items():
        checked[i] = _timed(checked[i], seconds, case.methods[i].singly)
    return with_ratios(checked, case.reference)


def with_ratios(rows: Sequence[Row], reference: str) -> list[Row]:
    """Divide the times of one case by that of the method of reference, else by that of the quickest."""
    times = {row.method: row.time_us for row in rows if row.time_us is not None}
    one = times.get(reference) if reference else min(times.values(), default=None)
    return [row if row.time_us is None or not one else replace(row, ratio=row.time_us / one) for row in rows]


def check(case: Case, method: Method) -> Row:
    """Write the row of a method before it is timed: its error, and whether that is within its bound."""
    bound = case.bound if method.bound is None else method.bound
    try:
        error = float(method.error() if callable(method.error) else method.error)
    except MissingPackageError as absent:
        return _row(case, method, None, MISSING, f"not installed: pip install {absent.package}")
    except NUMERICAL as failure:
        return _row(case, method, None, WRONG, f"fails: {' '.join(str(failure).split()) or type(failure).__name__}")
    if not math.isfinite(error):
        return _row(case, method, None, WRONG, "wrong: its result is not finite")
    if bound is not None and error > bound:
        return _row(case, method, error, WRONG, f"wrong: its error is beyond {bound:.1e}")
    return _row(case, method, error, TIMED, "")


def interleaved(methods: Sequence[Method], effort: Effort) -> list[list[float]]:
    """Time one operation [us] of each method, round by round; every round starts with another method."""
    seconds: list[list[float]] = [[] for _ in methods]
    rounds, spent = [0] * len(methods), [0] * len(methods)
    with collector_off():
        numbers = [0 if m.singly else _repetitions(m.call, effort.batch) for m in methods]
        for turn in range(effort.rounds):
            for k in range(len(methods)):
                i = (turn + k) % len(methods)
                if spent[i] > effort.most and rounds[i] >= effort.least:
                    continue
                each = numbers[i] or 1
                times = [clocked(methods[i].call, each) for _ in range(1 if numbers[i] else effort.singles)]
                seconds[i] += [1e-3 * ns / (each * methods[i].calls) for ns in times]
                rounds[i] += 1
                spent[i] += sum(times)
            gc.collect()
    return seconds


def clocked(call: Callable[[], object], number: int) -> int:
    """Time so many calls [ns]."""
    times = repeat(None, number)
    start = perf_counter_ns()
    for _ in times:
        call()
    return perf_counter_ns() - start


@contextmanager
def collector_off() -> Iterator[None]:
    """Switch the garbage collector off: garbage of one method would be collected in another's time.

    What is there before is set aside, so that to collect between rounds is quick.
    """
    was = gc.isenabled()
    gc.collect()
    gc.disable()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
        if was:
            gc.enable()


def _repetitions(call: Callable[[], object], batch: int) -> int:
    """Count the calls that take at least `batch` [ns]; the first ones, which are slower, are not counted."""
    call()
    number = 1
    while (ns := clocked(call, number)) < batch:
        number = math.ceil(number * min(max(1.2 * batch / ns, 2.0), 10.0)) if ns else 10 * number
    return number


def _timed(row: Row, seconds: Sequence[float], singly: bool) -> Row:
    ordered = sorted(seconds)
    last = len(ordered) - 1
    spread = {name: ordered[math.ceil(share * last)] for name, share in QUANTILES.items()}
    return replace(row, time_us=ordered[0], median_us=median(ordered), quantiles=spread if singly else None)


def _row(case: Case, method: Method, error: float | None, state: str, note: str) -> Row:
    notes = "; ".join(text for text in (method.note, note) if text)
    shown_error = error if case.unit else None
    return Row(case.benchmark, case.name, method.name, None, shown_error, notes, case.unit, state=state)
