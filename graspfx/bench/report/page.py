"""The page of the documentation that shows a report: a section for each benchmark, a table for each case."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from graspfx.bench.measure import Row
from graspfx.bench.report.pareto import by_case, front
from graspfx.bench.report.questions import question
from graspfx.bench.report.report import Report, Stamp
from graspfx.bench.report.speeds import table as table_of_speeds

NAME = "benchmarks.md"
PICTURES = "pictures/bench"

HEAD = """# Benchmarks

Run time *against* error. Every method stands beside its peers: same process, same inputs, timed in turns, its result checked against an oracle before anything is timed. This page is written by `graspfx bench --out docs --overwrite` from [benchmarks.json](benchmarks.json); do not edit it.

**Times** are per operation, the best of all rounds, which others on the machine disturb least; the median stands in the JSON. Inputs change from operation to operation; Python collects no garbage meanwhile. **Ratio** is to the quickest method of the table, or to the one whose ratio is 1. **Error** is the largest over the inputs.
A figure answers one question about its benchmark; `graspfx bench --redraw --out docs --overwrite` draws all of them from the JSON.
● marks the Pareto front: no other method of the table is both as quick and as exact. A method whose error is beyond its bound is not timed.
"""  # noqa: E501

SHORT = (
    "A time is that of the whole call in the first column; its error stands behind it. Calls that are slower than what "
    "is beside them stand here too."
)
LIMITATIONS = """
- Compare ratios within one table. Times of two machines compare only after division by the calibration's step, and not well then: caches, vector units and libraries differ.
- The best round leaves out what the scheduler and other processes do; the section on jitter is about those.
- Times are of calls from Python in a warm process: code and data are in the caches, as in a servo loop that does nothing else, and branches are predicted as well as a few different inputs allow.
- Peers are called by us as their users would call them who care for speed: set up once, arrays in place, one BLAS thread for all, which small matrices are quickest with. Their authors may know a quicker way. They solve more general problems than the one here.
- "interpreted" and "compiled" are the same source, run by Python and compiled.
- Errors are over the inputs listed and bound nothing else.
"""  # noqa: E501


def page(report: Report, form: str = "png") -> str:
    """Write the report in Markdown, with figures of a format."""
    measured = _measured(report.stamps)
    return "\n".join([HEAD, *_short(report), *measured, *_sections(report, form), "## Limitations", LIMITATIONS])


def _short(report: Report) -> Iterator[str]:
    if text := table_of_speeds(report):
        yield f"## In short\n\n{SHORT}\n\n{text}\n"


def _measured(stamps: dict[str, Stamp]) -> Iterator[str]:
    yield "## Machine\n"
    yield "| benchmark | date | processor | step of the calibration [ns] | load | effort |"
    yield "|---|---|---|---|---|---|"
    for name, s in stamps.items():
        steps, load = (f"{pair[0]:.2f}, {pair[1]:.2f}" for pair in (s.step_ns, s.load))
        yield f"| {name} | {s.date} | {s.cpu} | {steps} | {load} | {'quick' if s.quick else 'full'} |"
    for kind in sorted({s.calibration for s in stamps.values()}):
        yield f"\nThe calibration is {kind}, before and after; the load is that of the whole machine, before and after."
    for text in sorted({_versions(s) for s in stamps.values()}):
        yield f"\n{text}."
    yield ""


def _versions(s: Stamp) -> str:
    return ", ".join([s.machine["platform"], *(f"{name} {version}" for name, version in s.versions.items())])


def _sections(report: Report, form: str) -> Iterator[str]:
    for name, s in report.stamps.items():
        rows = [row for row in report.rows if row.benchmark == name]
        yield f"## {s.title}\n"
        yield f"`{s.command}`\n"
        if any(row.time_us is not None for row in rows):
            yield f"![{question(name, s.title, rows).text}]({PICTURES}/{name}.{form})\n"
        for case, each in by_case(rows).items():
            yield f"### {case or 'Not run'}\n"
            yield from table(each)
            yield ""
        yield f"*What this does not say.* {s.limits}\n"


def table(rows: Sequence[Row]) -> Iterator[str]:
    """Write one case as a table."""
    best = front(rows)
    unit = next((row.unit for row in rows if row.unit), "")
    names = list(dict.fromkeys(name for row in rows for name in row.quantiles or {}))
    quantiles = "".join(f" {name} |" for name in names)
    heading = f" error [{unit}] |" if unit else ""
    yield f"| | method | time | ratio |{quantiles}{heading} note |"
    yield "|---" * (5 + len(names) + bool(unit)) + "|"
    for row in rows:
        spread = "".join(f" {time_text((row.quantiles or {}).get(name))} |" for name in names)
        error = f" {error_text(row.error)} |" if unit else ""
        mark = "●" if row in best else ""
        time = f"{time_text(row.time_us)} | {ratio_text(row.ratio)}"
        yield f"| {mark} | {row.method} | {time} |{spread}{error} {row.note} |"


def time_text(us: float | None) -> str:
    """Write a time with three digits and a unit; empty for a method that was not timed."""
    if us is None:
        return ""
    for size, unit in ((1e6, "s"), (1e3, "ms"), (1.0, "µs")):
        if us >= size:
            return f"{us / size:#.3g}".rstrip(".") + f" {unit}"
    return f"{us * 1e3:#.3g}".rstrip(".") + " ns"


def error_text(error: float | None) -> str:
    if error is None:
        return ""
    return f"{error:.1e}" if error else "0"


def ratio_text(ratio: float | None) -> str:
    if ratio is None:
        return ""
    return f"{ratio:.0f}" if ratio >= 1000.0 else f"{ratio:.3g}"
