"""Cases of a comparison: a case is one problem, a method one way to solve it, with its error against an oracle."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, NoReturn, Protocol

from graspfx.errors import MissingPackageError


@dataclass(frozen=True)
class Method:
    """One way to solve a case.

    Attributes:
        name: the same in every case in which the method takes part: tables and figures join rows by it.
        call: what is timed; it does `calls` operations, on inputs that vary from operation to operation.
        error: the largest error over those inputs against the oracle, or what computes it. It is asked for before
            anything is timed, and so is the place to find out that a package is missing (MissingPackageError).
        note: what a reader of the row has to know.
        calls: operations that one `call` does; times are per operation.
        bound: of the error, instead of the case's.
        singly: every call is timed by itself, and the quantiles of its time are reported too: for how times spread.
        once: a call takes so long that there is one: it is timed first, and `error` is of what it has left behind.
    """

    name: str
    call: Callable[[], object]
    error: Callable[[], float] | float
    note: str = ""
    calls: int = 1
    bound: float | None = None
    singly: bool = False
    once: bool = False


@dataclass(frozen=True)
class Case:
    """One problem and the methods that solve it.

    Attributes:
        benchmark: the name under which `graspfx bench` knows it.
        name: of the case, one of a benchmark's.
        unit: of the error; empty where there is nothing to be wrong by.
        methods: timed in turns, in one process.
        bound: of the error: a method that exceeds it is wrong, and is reported so instead of timed; None for cases in
            which the error is what is to be shown.
        reference: the method whose time others are shown as a ratio to; the quickest if empty.
    """

    benchmark: str
    name: str
    unit: str
    methods: Sequence[Method]
    bound: float | None = None
    reference: str = ""


class Benchmark(Protocol):
    """A module of benchmarks.

    Attributes:
        TITLE: of its section in the report.
        LIMITS: what its numbers do not say.
    """

    TITLE: str
    LIMITS: str

    def cases(self, quick: bool) -> Generator[Case]:
        """Yield the cases one after another, so that memory of one is free before the next is built."""
        ...


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
    """Make the method of a peer that is not installed, to stand in its place: its row says what to install."""

    def absent() -> NoReturn:
        raise MissingPackageError(package, name, f"pip install {package}")

    return Method(name, absent, absent)


def is_installed(module: str) -> bool:
    """Tell whether a peer can be imported, without importing it."""
    return find_spec(module) is not None
