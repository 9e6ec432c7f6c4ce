"""Timing of the methods that solve a problem, after the error of each method was checked."""

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
    """One method that solves a case.

    Attributes:
        name: Name of the method.
        call: Function to be timed. It performs `calls` operations, each on another input.
        error: Largest error of the results of `call`, or a function that computes this error. The function is called
            before timing; if it raises MissingPackageError, the method is not timed.
        note: Remark that is shown in the row of the method.
        calls: Number of operations in one call; the reported times are per operation.
        singly: Whether to time every call separately and to report quantiles of these times.
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
        unit: Unit of the error, or "relative"; empty if errors are not reported.
        methods: Methods to compare.
        bound: Largest permitted error. A method with a larger error is reported as wrong and is not timed. None for no
            bound.
        reference: Name of the method to which times are compared; if empty, times are compared to the fastest method.
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
        time_us: Smallest measured time per operation [us]; None if the method was not timed.
        error: Largest error of the method, in `unit`; None if errors are not reported.
        ratio: Time divided by the time of the case's reference; None if one of these times is missing.
        state: "timed"; "wrong" if the method fails or its error exceeds the bound; "missing" if its package is not
            installed.
        quantiles: Quantiles of the time per operation by name [us], if every call was timed separately; otherwise None.
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
    """Number and duration of the measurements of each method.

    Attributes:
        rounds: Number of rounds. In each round, the methods of a case are timed one after another.
        batch: Smallest duration of one measurement [ns]. The method is called repeatedly to reach it.
        most: Total time of a method's measurements after which the method is not timed in further rounds [ns].
        singles: Number of calls per round, for a method whose calls are timed separately.
    """

    rounds: int
    batch: int
    most: int
    singles: int


FULL = Effort(rounds=30, batch=5_000_000, most=2_000_000_000, singles=500)
QUICK = Effort(rounds=7, batch=500_000, most=100_000_000, singles=200)


def each(function: Callable[..., object], inputs: Iterable[Any]) -> Callable[[], object]:
    """Return a function that calls `function` with each input, and that returns the last result."""
    arguments = tuple(inputs)

    def call() -> object:
        result = None
        for x in arguments:
            result = function(x)
        return result

    return call


def missing(name: str, package: str) -> Method:
    """Return a method that is reported as missing, because the package with this name is not installed."""

    def absent() -> NoReturn:
        raise MissingPackageError(package, name, f"pip install {package}")

    return Method(name, absent, absent)


def is_installed(module: str) -> bool:
    """Return whether a module can be found, without importing it."""
    return find_spec(module) is not None


def measure(case: Case, effort: Effort) -> list[Row]:
    """Check and time the methods of a case, and return one row per method in the order of the methods.

    Methods that are wrong or missing are not timed.
    """
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
    """Return the row of a method before it is timed; the state is "timed" if the error is within the bound."""
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
    """Return the measured times per operation [us] of each method.

    The methods are timed in rounds, so that a disturbance affects all methods. Each round starts with another method.
    """
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
    """Return the time of `number` calls together [ns]."""
    times = repeat(None, number)
    start = perf_counter_ns()
    for _ in times:
        call()
    return perf_counter_ns() - start


def _repetitions(call: Callable[[], object], batch: int) -> int:
    """Return a number of calls that together take at least `batch` [ns]. The first call is slower and not counted."""
    call()
    number = 1
    while (ns := clocked(call, number)) < batch:
        number = math.ceil(number * min(max(1.2 * batch / ns, 2.0), 10.0)) if ns else 10 * number
    return number


@contextmanager
def collector_off() -> Iterator[None]:
    """Disable the garbage collector in a block, so that no method is timed while garbage of another is collected."""
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
    """Limit libraries that are loaded in the block to one BLAS thread, unless the user has set a limit.

    On a busy machine, the eigenvalues of a 4 x 4 matrix take thirty times as long with two threads, so that the library
    of a compared method would appear slow.
    """
    mine = [name for name in THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(mine, "1"))
    try:
        yield
    finally:
        for name in mine:
            del os.environ[name]


def environment() -> dict[str, str]:
    """Return a copy of the environment variables without the limits of BLAS threads that `one_blas_thread` sets."""
    return {name: value for name, value in os.environ.items() if name not in THREADS}
