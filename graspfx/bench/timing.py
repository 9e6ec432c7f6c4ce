"""Timing of methods: checked against an oracle, then timed in turns in one process, many times."""

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
NUMERICAL = (ArithmeticError, ValueError, RuntimeError)  # exceptions of numerical libraries that find no solution
THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


@dataclass(frozen=True)
class Method:
    """One way to solve a case.

    Attributes:
        name: Name of the method, the same in every case.
        call: Function to be timed. It performs `calls` operations, on different inputs.
        error: Largest error over these inputs against the oracle, or a function that computes it. A function is called
            before timing, so that a missing package (MissingPackageError) is detected early.
        note: Note for readers of the row.
        calls: Number of operations of one `call`; times are per operation.
        singly: Whether to time every call separately and to report the quantiles of its time.
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
        benchmark: Name of the benchmark.
        name: Name of the case.
        unit: Unit of the error; empty without an error.
        methods: Methods, timed in turns in one process.
        bound: Bound on the error. A method that exceeds it is reported as wrong and not timed.
        reference: Method with ratio 1; the fastest method if empty.
    """

    benchmark: str
    name: str
    unit: str
    methods: Sequence[Method]
    bound: float | None = None
    reference: str = ""


@dataclass(frozen=True)
class Row:
    """A row of a table: one method in one case.

    Attributes:
        time_us: Time per operation in the fastest, least disturbed round or single call [us]; None if not timed.
        error: Largest error against the oracle, in `unit`; None without an oracle.
        ratio: Time relative to the case's reference, or to its fastest method.
        state: "timed", "wrong" (not timed: it fails, or its error exceeds the bound) or "missing" (not installed).
        quantiles: Quantiles of single operations by name [us], if every call is timed.
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
    """Effort spent on a method.

    Attributes:
        rounds: Number of rounds; in each, every method of a case is timed once, in turn.
        batch: Smallest time of one measurement [ns]; a method is called as often as needed.
        most: Time spent on a method after which the method takes part in no further round [ns].
        singles: Number of calls per round of a method whose calls are timed separately.
    """

    rounds: int
    batch: int
    most: int
    singles: int


FULL = Effort(rounds=30, batch=5_000_000, most=2_000_000_000, singles=500)
QUICK = Effort(rounds=7, batch=500_000, most=100_000_000, singles=200)


def each(function: Callable[..., object], inputs: Iterable[Any]) -> Callable[[], object]:
    """Return a function that performs function(input) for each input, for a method with calls = len(inputs)."""
    arguments = tuple(inputs)

    def call() -> object:
        result = None
        for x in arguments:
            result = function(x)
        return result

    return call


def missing(name: str, package: str) -> Method:
    """Return a placeholder for a method whose package is not installed; its row names the package to install."""

    def absent() -> NoReturn:
        raise MissingPackageError(package, name, f"pip install {package}")

    return Method(name, absent, absent)


def is_installed(module: str) -> bool:
    """Tell whether a package can be imported, without importing it."""
    return find_spec(module) is not None


def measure(case: Case, effort: Effort) -> list[Row]:
    """Return one row per method in the order of the case; wrong and missing methods are not timed."""
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
    """Return the row of a method before timing: its error, and whether it is within the bound."""
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
    """Time `number` calls [ns]."""
    times = repeat(None, number)
    start = perf_counter_ns()
    for _ in times:
        call()
    return perf_counter_ns() - start


def _repetitions(call: Callable[[], object], batch: int) -> int:
    """Return the number of calls that take at least `batch` [ns], ignoring the first, slower call."""
    call()
    number = 1
    while (ns := clocked(call, number)) < batch:
        number = math.ceil(number * min(max(1.2 * batch / ns, 2.0), 10.0)) if ns else 10 * number
    return number


@contextmanager
def collector_off() -> Iterator[None]:
    """Disable the garbage collector, which would collect garbage of one method in the time of another."""
    was = gc.isenabled()
    gc.collect()
    gc.disable()
    gc.freeze()  # makes collections between rounds fast
    try:
        yield
    finally:
        gc.unfreeze()
        if was:
            gc.enable()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit libraries loaded in the block to one BLAS thread, unless the user has set a limit.

    On a busy machine, two threads take thirty times as long for the eigenvalues of a 4 x 4 matrix. Another library
    would then appear slow only because of the way in which it is called.
    """
    mine = [name for name in THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(mine, "1"))
    try:
        yield
    finally:
        for name in mine:
            del os.environ[name]


def environment() -> dict[str, str]:
    """Return a copy of the environment without thread limits, for processes that start as a user would start them."""
    return {name: value for name, value in os.environ.items() if name not in THREADS}
