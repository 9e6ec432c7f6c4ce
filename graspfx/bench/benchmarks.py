"""Benchmarks of the package by name, and benchmarks in the folder of the tests."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import Protocol, cast

from graspfx.bench.timing import FULL, MISSING, QUICK, Case, Row, measure
from graspfx.errors import MissingPackageError

BENCHMARKS = {name: f"graspfx.bench.{name}" for name in ("startup", "ticks", "eq4")}
BESIDE_TESTS = ("runs", "batches", "maps", "projection", "contact", "bodies", "creep")
"""Comparisons with other programs, available in a checkout only: `make bench`."""

CHECKOUT = "in a checkout of GraspFX: make bench, or python -m tests.bench"


class Benchmark(Protocol):
    """A module of benchmarks.

    Attributes:
        TITLE: Title of the module's section in the report.
        LIMITS: Limitations of the module's numbers.
    """

    TITLE: str
    LIMITS: str

    def cases(self, quick: bool) -> Iterator[Case]:
        """Yield the cases one by one, so that a case's memory is freed before the next is built."""
        ...


def benchmark(name: str) -> Benchmark:
    """Import a benchmark of the package."""
    return cast(Benchmark, import_module(BENCHMARKS[name]))


def measured(name: str, module: Benchmark, *, quick: bool) -> Iterator[Sequence[Row]]:
    """Run a benchmark case by case; if the package of the benchmark's oracle is missing, one row states this."""
    try:
        for case in module.cases(quick):
            yield measure(case, QUICK if quick else FULL)
    except MissingPackageError as absent:
        note = f"not installed: pip install {absent.package}"
        yield [Row(name, "", absent.wanted_by, None, None, note, state=MISSING)]
