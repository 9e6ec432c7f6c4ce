"""The benchmarks there are, by name; one is imported when it is run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import cast

from graspfx.bench.case import Benchmark
from graspfx.bench.measure import FULL, MISSING, QUICK, Row, measure
from graspfx.errors import MissingPackageError, UnknownNameError

BENCHMARKS = {  # whole calls, for which a user waits, before what they are made of
    "startup": "graspfx.bench.cases.startup",
    "runs": "graspfx.bench.cases.runs",
    "batches": "graspfx.bench.cases.batches",
    "maps": "graspfx.bench.cases.limit_maps",
    "ticks": "graspfx.bench.cases.ticks",
    "jitter": "graspfx.bench.cases.jitter",
    "eq4": "graspfx.bench.cases.eq4",
    "projection": "graspfx.bench.cases.cone_projection",
    "contact": "graspfx.bench.cases.mesh_fingers",
    "bodies": "graspfx.bench.cases.rigid_bodies",
}


def select(names: Sequence[str]) -> list[str]:
    """Select names, all there are if none is given, in the order of the report; an unknown one is an error."""
    for name in names:
        if name not in BENCHMARKS:
            raise UnknownNameError("benchmark", name, BENCHMARKS)
    return [name for name in BENCHMARKS if name in names or not names]


def benchmark(name: str) -> Benchmark:
    return cast(Benchmark, import_module(BENCHMARKS[name]))


def rows(name: str, quick: bool) -> Iterator[Row]:
    """Run a benchmark, case by case; without the package that its oracle needs, one row says so."""
    module = benchmark(name)
    try:
        for case in module.cases(quick):
            yield from measure(case, QUICK if quick else FULL)
    except MissingPackageError as absent:
        note = f"not installed: pip install {absent.package}"
        yield Row(name, "", absent.wanted_by, None, None, note, state=MISSING)
