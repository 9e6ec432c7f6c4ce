"""Names of the benchmarks, and their results as text and as JSON, with the Pareto front of run time and error."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, cast

from graspfx.bench.timing import FULL, MISSING, QUICK, TIMED, Case, Row, measure
from graspfx.environment import processors
from graspfx.errors import MissingPackageError
from graspfx.recording.header import machine, now, versions

BENCHMARKS = {name: f"graspfx.bench.{name}" for name in ("startup", "ticks", "eq4")}
BESIDE_TESTS = ("runs", "batches", "maps", "projection", "contact", "bodies", "creep")
"""Benchmarks that compare GraspFX with other programs. They are not installed; `make bench` in a checkout runs them."""

CHECKOUT = "in a checkout of GraspFX: make bench, or python -m tests.bench"


class Benchmark(Protocol):
    """A module of benchmarks.

    Attributes:
        TITLE: Title of the benchmark's section in the report.
        LIMITS: Text about how the times and errors were measured, and what they do not show.
    """

    TITLE: str
    LIMITS: str

    def cases(self, quick: bool) -> Iterator[Case]:
        """Yield the cases one at a time, so that the memory of each case can be freed before the next case is built.

        Args:
            quick: Whether fewer or smaller cases are sufficient.
        """
        ...


def benchmark(name: str) -> Benchmark:
    """Import and return the benchmark with this name, which must be a key of `BENCHMARKS`."""
    return cast(Benchmark, import_module(BENCHMARKS[name]))


def measured(name: str, module: Benchmark, *, quick: bool) -> Iterator[Sequence[Row]]:
    """Run a benchmark, and yield the rows of each case.

    If a package that the benchmark itself needs is not installed, the last item is one row that names the package.
    """
    try:
        for case in module.cases(quick):
            yield measure(case, QUICK if quick else FULL)
    except MissingPackageError as absent:
        note = f"not installed: pip install {absent.package}"
        yield [Row(name, "", absent.wanted_by, None, None, note, state=MISSING)]


PACKAGES = ("scipy", "llvmlite", "numba", "jax", "clarabel", "control", "trimesh", "coal", "mujoco", "pybullet")


def by_case(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Group rows by case. The rows of a case are sorted by time; methods that were not timed come last."""
    cases: dict[str, list[Row]] = {}
    for row in rows:
        cases.setdefault(row.case, []).append(row)
    return {case: sorted(own, key=_time) for case, own in cases.items()}


def front(rows: Sequence[Row]) -> list[Row]:
    """Return the rows of one case that lie on the Pareto front of time and error, fastest first.

    If the rows have no errors, the front is the fastest row.
    """
    best, least = list[Row](), float("inf")
    for row in sorted((row for row in rows if row.state == TIMED), key=_time):
        if (row.error or 0.0) < least:
            least = row.error or 0.0
            best.append(row)
    return best


def lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield a table of each case as lines of text, with the fastest method first.

    An asterisk marks the methods on the Pareto front.
    """
    for case, ordered in by_case(rows).items():
        best = front(ordered)
        unit = next((row.unit for row in ordered if row.unit), "")
        yield f"{ordered[0].benchmark}: {case}{f', error [{unit}]' if unit else ''}"
        width = max(len(row.method) for row in ordered)
        for row in ordered:
            spread = "".join(f"{key} {time_text(us)}  " for key, us in (row.quantiles or {}).items())
            time = f"{time_text(row.time_us):>9}  {ratio_text(row.ratio):>8}  {error_text(row.error):>8}"
            yield f"  {'*' if row in best else ' '} {row.method:<{width}}  {time}  {spread}{row.note}".rstrip()
        yield ""


def to_dict(rows: Sequence[Row], *, quick: bool) -> dict[str, Any]:
    """Convert rows to data for JSON, together with the data of `stamp`."""
    return {"rows": [asdict(row) for row in rows], **stamp(quick=quick)}


def stamp(*, quick: bool) -> dict[str, Any]:
    """Return the date, the machine, its load, the versions of `PACKAGES`, and whether the measurement was quick."""
    load = round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None
    return {
        "date": now(),
        "machine": machine(),
        "cpu": cpu(),
        "load": load,
        "versions": versions(*PACKAGES),
        "quick": quick,
    }


def cpu() -> str:
    """Return the name of the processor and the number of cores that this process may use, as text."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        text = []
    names = [line.partition(":")[2].strip() for line in text if line.startswith("model name")]
    return f"{names[0] if names else platform.processor() or platform.machine()}, {processors()} in use"


def time_text(us: float | None) -> str:
    """Format a time [us] with three digits and a suitable unit. The text is empty if the time is None."""
    if us is None:
        return ""
    for size, unit in ((1e6, "s"), (1e3, "ms"), (1.0, "µs")):
        if us >= size:
            return f"{us / size:#.3g}".rstrip(".") + f" {unit}"
    return f"{us * 1e3:#.3g}".rstrip(".") + " ns"


def error_text(error: float | None) -> str:
    """Format an error with two digits, or as "0" if it is zero. The text is empty if the error is None."""
    if error is None:
        return ""
    return f"{error:.1e}" if error else "0"


def ratio_text(ratio: float | None) -> str:
    """Format a ratio with three digits. The text is empty if the ratio is None."""
    if ratio is None:
        return ""
    return f"{ratio:.0f}" if ratio >= 1000.0 else f"{ratio:.3g}"


def _time(row: Row) -> float:
    return row.time_us if row.time_us is not None else float("inf")
