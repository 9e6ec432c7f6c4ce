"""`graspfx bench`: runs benchmarks, prints their tables or JSON, and writes the report, its page and its figures."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from graspfx.bench.calibration import calibrate
from graspfx.bench.measure import Row
from graspfx.bench.registry import benchmark, rows, select
from graspfx.bench.report import speeds
from graspfx.bench.report.page import NAME as PAGE
from graspfx.bench.report.page import PICTURES, error_text, page, ratio_text, time_text
from graspfx.bench.report.pareto import by_case, front
from graspfx.bench.report.report import NAME, Report, load, stamp
from graspfx.errors import InputError
from graspfx.progress import clear, waiting


def redraw(names: Sequence[str], out: Path, *, form: str = "png", width: str = "screen") -> None:
    """Draw the figures of a report anew, and write its page; nothing is measured.

    Raises:
        RecordingError: there is no report in the folder.
    """
    report = Report.load(out / NAME).ordered(select([]))
    drawn = [name for name in select(names) if name in report.stamps]
    write(report, out, drawn, form=form, width=width)
    print(f"wrote {out / PAGE} and the pictures in {out / PICTURES}", file=sys.stderr)


def bench(
    names: Sequence[str],
    *,
    quick: bool,
    as_json: bool,
    out: Path | None,
    readme: Path | None = None,
    form: str = "png",
    width: str = "screen",
) -> None:
    """Run the named benchmarks, all if none is named.

    With `out` the report goes there, its page and its figures; benchmarks that are not run keep what a report that is
    already there says of them. With `readme` the table of speeds goes into that file, from the report in `out` if
    there is one; without names and `out` only the benchmarks that it shows are run.
    """
    if readme is not None:
        if quick:
            raise InputError("--readme", str(readme), "a full measurement", "leave out --quick")
        speeds.require_place(readme)
    selection = select(names or (speeds.BENCHMARKS if readme is not None and out is None else ()))
    merged = Report.load(out / NAME) if out is not None and (out / NAME).is_file() else Report()
    if readme is not None and not set(speeds.BENCHMARKS) <= {*selection, *merged.stamps}:
        lacking = [name for name in speeds.BENCHMARKS if name not in {*selection, *merged.stamps}]
        raise InputError("--readme", str(readme), f"all benchmarks that it shows, also {', '.join(lacking)}")
    report = Report()
    for name in selection:
        run(name, report, quick, quiet=as_json)
        if out is not None:  # at once: nothing is lost where a later one is ended
            merged.add(name, [row for row in report.rows if row.benchmark == name], report.stamps[name])
            write(merged.ordered(select([])), out, [name], form=form, width=width)
    if as_json:
        print(json.dumps(report.to_json(), indent=1, allow_nan=False))
    if out is not None:
        report = merged.ordered(select([]))
        print(f"wrote {out / NAME}, {out / PAGE} and the pictures in {out / PICTURES}", file=sys.stderr)
    if readme is not None:
        speeds.write(report, readme)
        print(f"wrote the table of speeds in {readme}", file=sys.stderr)


def files(names: Sequence[str], out: Path, form: str = "png") -> list[Path]:
    """List the files that a report on benchmarks, on all if none is named, may write into a folder."""
    return [out / NAME, out / PAGE, *(_picture(out, name, form) for name in select(names))]


def run(name: str, report: Report, quick: bool, *, quiet: bool) -> None:
    """Run one benchmark into the report; each case is printed when it is done, unless `quiet`."""
    module = benchmark(name)
    before, load_before = calibrate(), load()
    lines: list[Row] = []
    with waiting(f"measuring {name}"):
        for row in rows(name, quick):
            if not quiet and lines and row.case != lines[-1].case:
                clear()
                show(name, [each for each in lines if each.case == lines[-1].case])
            lines.append(row)
    if not quiet and lines:
        show(name, [each for each in lines if each.case == lines[-1].case])
    command = f"graspfx bench {name}{' --quick' if quick else ''}"
    report.add(
        name, lines, stamp(module.TITLE, module.LIMITS, command, quick, (load_before, load()), before, calibrate())
    )


def show(name: str, rows: Sequence[Row]) -> None:
    """Show one case as text, the quickest first; an asterisk marks the Pareto front."""
    [(case, ordered)] = by_case(rows).items()
    best = front(ordered)
    unit = next((row.unit for row in ordered if row.unit), "")
    print(f"{name}: {case}{f', error [{unit}]' if unit else ''}")
    width = max(len(row.method) for row in ordered)
    for row in ordered:
        mark = "*" if row in best else " "
        spread = "  ".join(f"{key} {time_text(us)}" for key, us in (row.quantiles or {}).items())
        time = f"{time_text(row.time_us):>9}  {ratio_text(row.ratio):>8}  {error_text(row.error):>8}"
        print(f"  {mark} {row.method:<{width}}  {time}  {spread}{'  ' if spread else ''}{row.note}".rstrip())
    print(flush=True)


def write(report: Report, folder: Path, drawn: Sequence[str], *, form: str = "png", width: str = "screen") -> None:
    """Write the report as JSON, its page, and the figures of the benchmarks `drawn`."""
    from graspfx.bench.report.figures import figure
    from graspfx.loop.recording.places import make_folder

    make_folder(folder)
    report.save(folder / NAME)
    (folder / PAGE).write_text(page(report, form), encoding="utf-8")
    for name in drawn:
        lines = [row for row in report.rows if row.benchmark == name]
        if any(row.time_us is not None for row in lines):
            figure(lines, name, report.stamps[name].title, _picture(folder, name, form), width=width)


def _picture(folder: Path, name: str, form: str) -> Path:
    return folder / PICTURES / f"{name}.{form}"
