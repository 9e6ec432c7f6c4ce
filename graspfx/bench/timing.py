"""How methods are timed: checked against an oracle first, then in turns in one process, many times over."""

from __future__ import annotations

import gc
import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.util import find_spec
from itertools import repeat
from time import perf_counter_ns
from typing import Any, NoReturn

from graspfx.errors import MissingPackageError

TIMED, WRONG, MISSING = "timed", "wrong", "missing"
QUANTILES = {"p50": 0.5, "p99": 0.99, "p99.9": 0.999, "max": 1.0}
NUMERICAL = (ArithmeticError, ValueError, RuntimeError)  # what numerical libraries raise where they find no answer
THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


@dataclass(frozen=True)
class Method:
    """One way to solve a case.

    Attributes:
        name: the same in every case in which the method takes part.
        call: what is timed; it does `calls` operations, on inputs that vary from operation to operation.
        error: largest error over those inputs against the oracle, or a function that computes it. It is asked for
            before anything is timed, so that a missing package (MissingPackageError) is found out here.
        note: what a reader of the row has to know.
        calls: operations that one `call` does; times are per operation.
        singly: time every call by itself and report the quantiles of its time.
    """

    name: str
    call: Callable[[], object]
    error: Callable[[], float] | float
    note: str = ""
    calls: int = 1
    singly: bool = False


@dataclass(frozen=True)
class Case:
    """One problem and the methods that solve it.

    Attributes:
        benchmark: name of its benchmark.
        name: of the case.
        unit: of the error; empty where there is no error.
        methods: timed in turns, in one process.
        bound: of the error. A method that exceeds it is reported as wrong and not timed.
        reference: method to whose time the ratio is; the quickest if empty.
    """

    benchmark: str
    name: str
    unit: str
    methods: Sequence[Method]
    bound: float | None = None
    reference: str = ""


@dataclass(frozen=True)
class Row:
    """A line of a table: one method in one case.

    Attributes:
        time_us: of one operation, the best round's [us], which others on the machine disturb least; None if not timed.
        error: the largest against the oracle, in `unit`; None if there is none.
        ratio: time over that of the case's reference, or of its quickest method.
        state: "timed", "wrong" (not timed: its error is beyond the bound) or "missing" (not installed).
        quantiles: of single operations by name [us], where their spread is measured.
    """

    benchmark: str
    case: str
    method: str
    time_us: float | None
    error: float | None
    note: str
    unit: str = ""
    ratio: float | None = None
    state: str = TIMED
    quantiles: dict[str, float] | None = None


@dataclass(frozen=True)
class Effort:
    """How much is spent on a method.

    Attributes:
        rounds: in each of which every method of a case is timed once, one after another.
        batch: the least time that is taken at once [ns]: a method is called as often as it takes.
        most: time spent on a method, from which on it takes part in no further round [ns].
        singles: calls in a round of a method whose calls are timed one by one.
    """

    rounds: int
    batch: int
    most: int
    singles: int


FULL = Effort(rounds=30, batch=5_000_000, most=2_000_000_000, singles=500)
QUICK = Effort(rounds=7, batch=500_000, most=100_000_000, singles=200)


def each(function: Callable[..., object], inputs: Iterable[Any]) -> Callable[[], object]:
    """Make a call that does one operation per input, function(input), for a method with calls = len(inputs)."""
    arguments = tuple(inputs)

    def call() -> object:
        result = None
        for x in arguments:
            result = function(x)
        return result

    return call


def missing(name: str, package: str) -> Method:
    """Stand in for a method whose package is not installed: its row says what to install."""

    def absent() -> NoReturn:
        raise MissingPackageError(package, name, f"pip install {package}")

    return Method(name, absent, absent)


def is_installed(module: str) -> bool:
    """Tell whether a package can be imported, without importing it."""
    return find_spec(module) is not None


def measure(case: Case, effort: Effort) -> list[Row]:
    """Measure a row per method, in the case's order; what is wrong or missing is not timed."""
    rows = [check(case, method) for method in case.methods]
    right = [i for i, row in enumerate(rows) if row.state == TIMED]
    times = interleaved([case.methods[i] for i in right], effort)
    for i, own in zip(right, times, strict=True):
        ordered = sorted(own)
        last = len(ordered) - 1
        spread = {name: ordered[math.ceil(share * last)] for name, share in QUANTILES.items()}
        rows[i] = replace(rows[i], time_us=ordered[0], quantiles=spread if case.methods[i].singly else None)
    known = {row.method: row.time_us for row in rows if row.time_us is not None}
    one = known.get(case.reference) if case.reference else min(known.values(), default=None)
    return [row if row.time_us is None or not one else replace(row, ratio=row.time_us / one) for row in rows]


def check(case: Case, method: Method) -> Row:
    """Write the row of a method before it is timed: its error, and whether that is within the bound."""
    row = Row(case.benchmark, case.name, method.name, None, None, method.note, case.unit)

    def refused(state: str, why: str, error: float | None = None) -> Row:
        note = "; ".join(text for text in (method.note, why) if text)
        return replace(row, state=state, note=note, error=error if case.unit else None)

    try:
        error = float(method.error() if callable(method.error) else method.error)
    except MissingPackageError as absent:
        return refused(MISSING, f"not installed: pip install {absent.package}")
    except NUMERICAL as failure:
        return refused(WRONG, f"fails: {' '.join(str(failure).split()) or type(failure).__name__}")
    if not math.isfinite(error):
        return refused(WRONG, "wrong: its result is not finite")
    if case.bound is not None and error > case.bound:
        return refused(WRONG, f"wrong: its error is beyond {case.bound:.1e}", error)
    return replace(row, error=error if case.unit else None)


def interleaved(methods: Sequence[Method], effort: Effort) -> list[list[float]]:
    """Time one operation [us] of each method, round by round; every round starts with another method."""
    seconds: list[list[float]] = [[] for _ in methods]
    spent = [0] * len(methods)
    with collector_off():
        numbers = [0 if m.singly else _repetitions(m.call, effort.batch) for m in methods]
        for turn in range(effort.rounds):
            for k in range(len(methods)):
                i = (turn + k) % len(methods)
                if spent[i] > effort.most and seconds[i]:
                    continue
                number = numbers[i] or 1
                times = [clocked(methods[i].call, number) for _ in range(1 if numbers[i] else effort.singles)]
                seconds[i] += [1e-3 * ns / (number * methods[i].calls) for ns in times]
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


def _repetitions(call: Callable[[], object], batch: int) -> int:
    """Count the calls that take at least `batch` [ns]; the first one, which is slower, is not counted."""
    call()
    number = 1
    while (ns := clocked(call, number)) < batch:
        number = math.ceil(number * min(max(1.2 * batch / ns, 2.0), 10.0)) if ns else 10 * number
    return number


@contextmanager
def collector_off() -> Iterator[None]:
    """Switch the garbage collector off: garbage of one method would be collected in another's time."""
    was = gc.isenabled()
    gc.collect()
    gc.disable()
    gc.freeze()  # so that to collect between rounds is quick
    try:
        yield
    finally:
        gc.unfreeze()
        if was:
            gc.enable()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit libraries that are loaded within to one BLAS thread; the user's own limits stay.

    On a machine whose processors are busy, two threads take thirty times as long for the eigenvalues of a 4 x 4 matrix:
    a peer would be slow by how it is called.
    """
    mine = [name for name in THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(mine, "1"))
    try:
        yield
    finally:
        for name in mine:
            del os.environ[name]


def environment() -> dict[str, str]:
    """Copy the environment without limits of threads, for processes that are to start as a user starts them."""
    return {name: value for name, value in os.environ.items() if name not in THREADS}
