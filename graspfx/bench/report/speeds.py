"""The table of speeds in docs/accuracy.md: each figure a row of the report, rounded, with its error beside it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from graspfx.bench.measure import TIMED, Row
from graspfx.bench.report.report import Report, Stamp
from graspfx.errors import InputError

BEGIN, END = "<!-- speeds: written by `graspfx bench --readme docs/accuracy.md` -->", "<!-- end of speeds -->"
HEAD = "| what you call | GraspFX: time, error | beside it: time, error | report |\n|---|---|---|---|"
SIZES = ((1e6, "s"), (1e3, "ms"), (1.0, "us"), (1e-3, "ns"))  # in microseconds
FIVE, FIXED, LINE = "5 fingers", "5 fingers, contacts fixed", "5 fingers, condition 1e9"
APART, EQUAL = (f"space, 5 fingers, {gains}" for gains in ("kep < kip", "kep = kip"))
RUN_APART, RUN_EQUAL = (f"{case}, 10000 ticks" for case in (APART, EQUAL))
COULOMB = "coulomb, 5 fingers, gains' ratio 3"
ONE_KEY, TWO_KEYS = "10000 values of one key, 1000 ticks", "1000 random points of two keys, 1000 ticks"
MAP = "device that moves an object, 200 by 200"


@dataclass(frozen=True)
class Figure:
    """One time with its error.

    Attributes:
        label: stands before it; empty for nothing.
        case: of the line's benchmark.
        method: of the case.
        times: operations that the figure is of, where the report's is of one.
    """

    label: str
    case: str
    method: str
    times: int = 1


@dataclass(frozen=True)
class Line:
    """One row of the table: what is called, ours and what stands beside it, all of one benchmark."""

    call: str
    benchmark: str
    ours: Sequence[Figure]
    beside: Sequence[Figure]


POINT = "GraspFX PointCoupling, compiled, written and read"
EVERY_LINE = (
    Line(
        "`law.force(gx.Grasp(points).split(), e)`: eq. (4), five fingers in space, contacts anew at each call",
        "eq4",
        [Figure("", FIVE, "GraspFX Grasp.split, Coupling.force")],
        [Figure("numpy's pinv", FIVE, "numpy pinv"), Figure("numpy's solve", FIVE, "numpy solve")],
    ),
    Line(
        "the same by a `gx.PointCoupling`, made once: points and displacements written, forces read",
        "eq4",
        [Figure("", FIVE, POINT)],
        [Figure("LAPACK's Cholesky", FIVE, "scipy posv"), Figure("closed form in numpy", FIVE, "numpy, closed form")],
    ),
    Line(
        "the same, contacts nearly on a line (condition 1e9)",
        "eq4",
        [Figure("", LINE, POINT)],
        [Figure("numpy's pinv", LINE, "numpy pinv"), Figure("numpy's QR", LINE, "numpy QR")],
    ),
    Line(
        "`law.force(split, e)`: contacts that stay, the split known",
        "eq4",
        [
            Figure("", FIXED, "GraspFX Coupling.force, split known"),
            Figure("PointCoupling", FIXED, "GraspFX PointCoupling, compiled"),
        ],
        [Figure("numpy, one product with K", FIXED, "numpy, K known")],
    ),
    Line(
        "`gx.run`, five fingers in space, 10 000 ticks, per tick",
        "runs",
        [Figure("", RUN_APART, "GraspFX gx.run"), Figure("to disk", RUN_APART, "GraspFX gx.run to disk")],
        [Figure("a numpy program that knows K", RUN_APART, "numpy, K known")],
    ),
    Line(
        "the same with equal gains, as springs can do it too",
        "runs",
        [Figure("", RUN_EQUAL, "GraspFX gx.run")],
        [Figure("MuJoCo's rollout", RUN_EQUAL, "MuJoCo with springs, rollout")],
    ),
    Line(
        "the steady tick alone of five fingers in space: gains apart; equal gains",
        "ticks",
        [Figure("", APART, "GraspFX, compiled"), Figure("", EQUAL, "GraspFX, compiled")],
        [Figure("numpy", APART, "numpy, K known"), Figure("MuJoCo", EQUAL, "MuJoCo with springs")],
    ),
    Line(
        "a steady tick on PyBullet, on a line; in space",
        "ticks",
        [Figure("", case, "GraspFX on PyBullet") for case in ("line, 2 fingers, kep < kip", APART)],
        [Figure("its calls alone", case, "PyBullet, bare calls") for case in ("line, 2 fingers, kep < kip", APART)],
    ),
    Line(
        "contacts of five fingers on 20 480 triangles, inside a tick",
        "contact",
        [Figure("", "sphere, 20480 triangles", "GraspFX, compiled")],
        [Figure(name, "sphere, 20480 triangles", name) for name in ("coal", "trimesh")],
    ),
    Line(
        "`gx.unilateral_force` of five fingers with Coulomb friction",
        "projection",
        [
            Figure("", COULOMB, "GraspFX unilateral_force"),
            Figure("inside a tick", COULOMB, "GraspFX Newton in modes, compiled"),
        ],
        [
            Figure("Gauss-Seidel, compiled", COULOMB, "Gauss-Seidel to 1e-03"),
            Figure("to 1e-12", COULOMB, "Gauss-Seidel to 1e-12"),
        ],
    ),
    Line(
        "`gx.run_batch`, 10 000 values of one key, 1000 ticks of the 1-DOF scene each, whole",
        "batches",
        [Figure("", ONE_KEY, "GraspFX run_batch", 10_000)],
        [Figure("arrays of numpy", ONE_KEY, "numpy, arrays of variants", 10_000)],
    ),
    Line(
        "`gx.run_batch`, random points of two keys, each",
        "batches",
        [
            Figure("", TWO_KEYS, "GraspFX run_batch"),
            Figure("`gx.run` one by one", TWO_KEYS, "GraspFX gx.run one by one, compiled"),
        ],
        [Figure("arrays of numpy", TWO_KEYS, "numpy, arrays of variants")],
    ),
    Line(
        "`external_limit_map`, a stability limit of 40 000: by default; compiled",
        "maps",
        [Figure("", MAP, "GraspFX, numpy"), Figure("", MAP, "GraspFX, compiled")],
        [
            Figure("eigenvalues and Brent's method", MAP, "numpy eigenvalues, Brent"),
            Figure("python-control", MAP, "python-control, margins"),
        ],
    ),
    Line(
        "`graspfx run paper-waving --no-figure`, from start to end: the first time; from then on; with its figure",
        "startup",
        [
            Figure("", "paper-waving", f"graspfx run {name}")
            for name in ("--no-figure, cold", "--no-figure, cached", "with its figure, cached")
        ],
        [Figure("`import numpy`", "paper-waving", "import numpy")],
    ),
    Line(
        "until the first compiled tick of `mug`: to be compiled; compiled before",
        "startup",
        [Figure("", "mug", f"first tick, compiled, {name}") for name in ("cold", "cached")],
        [Figure("`import numpy`", "mug", "import numpy")],
    ),
)
FIRST = ("startup", "runs", "batches", "maps", "ticks")  # whole calls before their parts, as in the report
LINES = tuple(
    sorted(EVERY_LINE, key=lambda line: FIRST.index(line.benchmark) if line.benchmark in FIRST else len(FIRST))
)
BENCHMARKS = tuple(dict.fromkeys(line.benchmark for line in LINES))


def table(report: Report) -> str:
    """Write the table in Markdown, and on what machine it was measured; lines that were not measured are left out."""
    rows = {(row.benchmark, row.case, row.method): row for row in report.rows if row.state == TIMED}
    lines = [text for line in LINES if (text := _text(line, rows)) is not None]
    stamps = [report.stamps[name] for name in BENCHMARKS if name in report.stamps]
    if not lines:
        return ""
    return "\n".join([HEAD, *lines, "", _where(stamps)])


def _where(stamps: Sequence[Stamp]) -> str:
    loads = [load for each in stamps for load in each.load]
    dates = sorted({each.date[:10] for each in stamps})
    days = dates[0] if len(dates) == 1 else f"{dates[0]} to {dates[-1]}"
    cpus = "; ".join(sorted({each.cpu for each in stamps}))
    return f"Measured on {cpus}; load of the machine {min(loads):.1f} to {max(loads):.1f}; {days}."


def lacking(report: Report) -> list[str]:
    """List the table's figures that a report does not have."""
    rows = {(row.benchmark, row.case, row.method) for row in report.rows if row.state == TIMED}
    results = [(line.benchmark, each.case, each.method) for line in LINES for each in (*line.ours, *line.beside)]
    return [": ".join(each) for each in results if each not in rows]


def write(report: Report, file: Path) -> None:
    """Put the table into a file, between its two lines of comment.

    Raises:
        InputError: the file has no such lines, or the report lacks figures of the table.
    """
    require_place(file)
    names = lacking(report)
    if names:
        raise InputError("--readme", str(file), f"a report with all of its figures; not there: {'; '.join(names)}")
    text = file.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    file.write_text(f"{before}{BEGIN}\n{table(report)}\n{END}{after}", encoding="utf-8")


def require_place(file: Path) -> None:
    """Raise InputError where a file has no place for the table, so that nobody measures for nothing."""
    text = file.read_text(encoding="utf-8") if file.is_file() else ""
    if not 0 <= text.find(BEGIN) < text.find(END):
        raise InputError("--readme", str(file), f"a file with the lines {BEGIN} and {END}")


def _text(line: Line, rows: dict[tuple[str, str, str], Row]) -> str | None:
    cells = []
    for figures in (line.ours, line.beside):
        measurements = [rows.get((line.benchmark, each.case, each.method)) for each in figures]
        if None in measurements:
            return None
        cells.append("; ".join(_figures(figures, [row for row in measurements if row is not None])))
    return f"| {line.call} | {cells[0]} | {cells[1]} | `graspfx bench {line.benchmark}` |"


def _figures(figures: Sequence[Figure], rows: Sequence[Row]) -> Iterator[str]:
    for figure, row in zip(figures, rows, strict=True):
        text = short_time((row.time_us or 0.0) * figure.times)
        if row.error is not None:
            text += f", {short_error(row.error)}{'' if row.unit == 'relative' else ' ' + row.unit}"
        yield f"{figure.label} {text}".lstrip()


def short_time(us: float) -> str:
    """Write a time [us] with two digits and a unit."""
    rounded = float(f"{us:.1e}")
    size, unit = next((pair for pair in SIZES if rounded >= pair[0]), SIZES[-1])
    value = rounded / size
    return f"{value:.1f} {unit}" if value < 9.95 else f"{value:.0f} {unit}"


def short_error(error: float) -> str:
    """Write an error with one digit, 0 for the same bits."""
    return f"{error:.0e}" if error else "0"
