"""docs/benchmarks.md and its picture: a line for each problem, ours beside the others, also where others win."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspfx.bench.benchmarks import Benchmark, by_case
from graspfx.bench.timing import MISSING, TIMED, Row
from graspfx.show import style
from graspfx.show.style import FINGERS, INK, MARKERS, NEUTRAL, panel

if TYPE_CHECKING:
    from graspfx.show.sheet import Sheet

PAGE, PICTURE = "benchmarks.md", "pictures/benchmarks.png"
OWN = ("GraspFX", "gx.", "session.", "graspfx ", "first tick", "import graspfx")
SIZES = ((1e6, "s"), (1e3, "ms"), (1.0, "us"), (1e-3, "ns"))  # in microseconds
LINE, FRAME = 0.3, 0.5  # of the picture [inches]

HEAD = """# Benchmarks

This page lists run time and error of calls that users make, and of other programs that solve the same problem. `make bench` measures everything in about ten minutes and writes this page; do not edit it. `python -m tests.bench NAME` prints one benchmark with all of its rows. `graspfx bench SCENE` measures the choices of your own scene, and `graspfx bench` the benchmarks that need no other package.

All methods of a benchmark, except Start-up, are called in the same process on the same inputs. Each result is first checked against an oracle; then the methods are timed in turns. A time is that of one operation, the best of all rounds. It is followed by the largest error over the inputs and, for other programs, in brackets by the ratio of their time to that of the fastest GraspFX method in the row: **below 1 they are faster**. The other programs are set up once and written for speed, as their own users would do, with one BLAS thread for all. Their authors may know a faster way. Some of them solve more general problems, some only this one. Compare times within a row: times from two machines differ because of caches, vector units and libraries.

![Ratios of run times: the programs that are faster than GraspFX, and those that are slower](pictures/benchmarks.png)
"""  # noqa: E501


def page(rows: Sequence[Row], modules: Mapping[str, Benchmark], stamp: Mapping[str, Any]) -> str:
    """Write the page from rows."""
    sections = [HEAD]
    for name, module in modules.items():
        own = [row for row in rows if row.benchmark == name]
        table = ["| problem | GraspFX: time, error | beside it: time, error |", "|---|---|---|"]
        table += [line for case, each in by_case(own).items() for line in _line(case, each)]
        table = table if own else ["Not measured this time."]
        sections.append("\n".join([f"## {module.TITLE}\n", f"`{command(name)}`\n", *table, ""]))
        sections.append(f"{' '.join(module.LIMITS.split())}\n")
    versions = ", ".join(f"{name} {version}" for name, version in stamp["versions"].items())
    load = "load of the machine not noted" if stamp["load"] is None else f"load of the machine {stamp['load']}"
    rough = ", with --quick: few rounds and small problems" if stamp["quick"] else ""
    sections.append(f"Measured on {stamp['date'][:10]}, {stamp['cpu']}, {load}{rough}; {versions}.\n")
    return "\n".join(sections)


def command(name: str) -> str:
    """Give the command that measures one benchmark."""
    return f"python -m tests.bench {name}"


def _line(case: str, rows: Sequence[Row]) -> Iterator[str]:
    ours = [row for row in rows if is_own(row)]
    best = quickest(rows)
    cells = ["; ".join(_text(row, None if own else best) for row in each)
             for own, each in ((True, ours), (False, [row for row in rows if not is_own(row)]))]  # fmt: skip
    yield f"| {case or 'not measured'} | {cells[0]} | {cells[1]} |"


def is_own(row: Row) -> bool:
    """Tell whether a method is GraspFX's."""
    return row.method.startswith(OWN)


def quickest(rows: Sequence[Row]) -> float | None:
    """Find the least time of ours [us]; None where nothing of ours was timed."""
    return min((row.time_us for row in rows if is_own(row) and row.time_us is not None), default=None)


def _text(row: Row, best: float | None) -> str:
    name = row.method.removeprefix("GraspFX").lstrip(", ") or "GraspFX"
    if row.time_us is None:
        return f"{name}: {row.note.rpartition('; ')[2]}"
    text = f"{name} **{short_time(row.time_us)}**"
    if row.error is not None:
        text += f", {short_error(row.error)}{'' if row.unit == 'relative' else ' ' + row.unit}"
    if row.quantiles:
        text += f", p99.9 {short_time(row.quantiles['p99.9'])}"
    return text if best is None else f"{text} ({row.time_us / best:.2g})"


def short_time(us: float) -> str:
    """Write a time [us] with two digits and a unit."""
    rounded = float(f"{us:.1e}")
    size, unit = next((pair for pair in SIZES if rounded >= pair[0]), SIZES[-1])
    value = rounded / size
    return f"{value:.1f} {unit}" if value < 9.95 else f"{value:.0f} {unit}"


def short_error(error: float) -> str:
    """Write an error with one digit, 0 for the same bits."""
    return f"{error:.0e}" if error else "0"


def ratios(rows: Sequence[Row]) -> dict[str, dict[str, list[float]]]:
    """List, by benchmark and kind of program, their times over the quickest of ours in the same case."""
    found: dict[str, dict[str, list[float]]] = {}
    for name in dict.fromkeys(row.benchmark for row in rows):
        for own in by_case([row for row in rows if row.benchmark == name]).values():
            best = quickest(own)
            for row in own:
                if best and row.state == TIMED and row.time_us is not None and not is_own(row):
                    kind = row.method.partition(",")[0].split()[0]
                    found.setdefault(name, {}).setdefault(kind, []).append(row.time_us / best)
    return found


def sheet(rows: Sequence[Row]) -> Sheet:
    """Draw times of others over ours, a line for each benchmark and a colour for each program."""
    found = {name: own for name, own in ratios(rows).items() if name != "startup"}
    kinds = list(dict.fromkeys(kind for own in found.values() for kind in own))
    colours = (INK, *FINGERS, NEUTRAL)
    with style.look("screen"):
        drawing = style.figure([FRAME + LINE * len(found)], width="screen")
        [axes] = drawing.panels[0]
        axes.set_xscale("log")
        axes.axvline(1.0, color=NEUTRAL, lw=1.0)
        for k, kind in enumerate(kinds):
            places = [(ratio, -i) for i, own in enumerate(found.values()) for ratio in own.get(kind, [])]
            x, y = zip(*places, strict=True)
            marker, colour = MARKERS[k % len(MARKERS)], colours[k % len(colours)]
            axes.plot(
                x, y, marker, color=colour, markersize=5.0, label=kind, markerfacecolor="none" if k > 6 else colour
            )
        low, high = axes.get_xlim()
        axes.set_xlim(0.5 * low, 2.0 * high)
        axes.set_yticks([-i for i in range(len(found))], list(found))
        axes.set_ylim(0.6 - len(found), 0.6)
        panel(axes, x="time over that of GraspFX: on the left others are quicker")
        drawing.legend(0)
        drawing.title("Which programs are quicker than GraspFX, and by how much?")
    return drawing


def write(rows: Sequence[Row], modules: Mapping[str, Benchmark], stamp: Mapping[str, Any], folder: Path) -> None:
    """Write the page and its picture into a folder."""
    picture = folder / PICTURE
    picture.parent.mkdir(parents=True, exist_ok=True)
    (folder / PAGE).write_text(page(rows, modules, stamp), encoding="utf-8")
    if ratios(rows):
        style.save(sheet(rows), picture)


def absent(rows: Sequence[Row]) -> list[str]:
    """Say which methods were not measured, as their packages are missing."""
    return [f"{row.benchmark}, {row.method}: {row.note}" for row in rows if row.state == MISSING]
