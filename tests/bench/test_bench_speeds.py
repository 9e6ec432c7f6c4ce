"""The table of speeds in docs/accuracy.md: every figure is the report's, with its error; nothing is left out."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from graspfx.__main__ import main
from graspfx.bench.measure import Row
from graspfx.bench.registry import BENCHMARKS, benchmark
from graspfx.bench.report import speeds
from graspfx.bench.report.report import Report
from graspfx.errors import InputError

ROOT = Path(__file__).parents[2]
PAGE, REPORT = ROOT / "docs" / "accuracy.md", ROOT / "docs" / "benchmarks.json"
SIZES = {"s": 1e6, "ms": 1e3, "us": 1.0, "ns": 1e-3}
FIGURE = re.compile(r"(?P<time>[0-9.]+) (?P<unit>s|ms|us|ns)(?:, (?P<error>0|[0-9]e-[0-9]{2})(?P<metres> m)?)?$")


def cells(text: str) -> list[list[str]]:
    """Split the rows of a page's speed section into their cells."""
    section = text.partition("## How fast it is\n")[2].partition("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows[1:]]


def test_figures_of_the_table_are_those_of_the_report() -> None:
    """Time to two digits and error to one, from the JSON as it stands; a figure without its error is none."""
    rows = {(row["benchmark"], row["case"], row["method"]): row for row in json.loads(REPORT.read_text())["rows"]}
    table = cells(PAGE.read_text(encoding="utf-8"))
    assert len(table) == len(speeds.LINES) > 10
    for line, (what, ours, beside, command) in zip(speeds.LINES, table, strict=True):
        assert (what, command) == (line.call, f"`graspfx bench {line.benchmark}`")
        for cell, figures in ((ours, line.ours), (beside, line.beside)):
            for text, figure in zip(cell.split("; "), figures, strict=True):
                row = rows[line.benchmark, figure.case, figure.method]
                shown = FIGURE.search(text)
                assert shown is not None and text == f"{figure.label} {shown[0]}".lstrip(), text
                time = float(shown["time"]) * SIZES[shown["unit"]]
                assert math.isclose(time, float(f"{row['time_us'] * figure.times:.1e}"), rel_tol=1e-9), (text, row)
                if row["error"] is None:
                    assert shown["error"] is None
                else:
                    assert shown["error"] is not None and float(shown["error"]) == float(f"{row['error']:.0e}"), text
                    assert bool(shown["metres"]) == (row["unit"] == "m")


def test_table_of_the_page_is_the_one_that_the_report_gives() -> None:
    text = PAGE.read_text(encoding="utf-8")
    table = text.partition(speeds.BEGIN)[2].partition(speeds.END)[0]
    assert table.strip() == speeds.table(Report.load(REPORT))
    assert table.strip() in (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8")


def test_no_other_figure_of_speed_stands_in_its_section() -> None:
    """Speeds stand in the table, where they are measured; the text before and after it has none of its own."""
    section = PAGE.read_text(encoding="utf-8").partition("## How fast it is\n")[2].partition("\n## ")[0]
    before, _, rest = section.partition(speeds.BEGIN)
    assert not re.search(r"[0-9.]+ (s|ms|us|ns)\b", before + rest.partition(speeds.END)[2])


@pytest.mark.parametrize(
    ("us", "text"),
    [(0.0123, "12 ns"), (0.85, "850 ns"), (0.996, "1.0 us"), (9.96, "10 us"), (357.0, "360 us"), (999.6, "1.0 ms"),
     (38.2e6, "38 s"), (3.04e6, "3.0 s")],
)  # fmt: skip
def test_times_have_two_digits(us: float, text: str) -> None:
    assert speeds.short_time(us) == text


def full_report() -> Report:
    """Every figure of the table, at times that tell one from another."""
    figures = [(line.benchmark, each) for line in speeds.LINES for each in (*line.ours, *line.beside)]
    names = dict.fromkeys((benchmark, each.case, each.method) for benchmark, each in figures)
    report = Report.load(REPORT)
    rows = [Row(*name, 1.0 + k, 1e-9, "", "m") for k, name in enumerate(names)]
    return Report(rows, report.stamps)


@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_line_stands_in_the_table_whoever_wins(factor: float) -> None:
    report = full_report()
    report.rows = [
        replace(row, time_us=(row.time_us or 0.0) * (factor if row.method.startswith("GraspFX") else 1.0))
        for row in report.rows
    ]
    assert speeds.table(report).count("`graspfx bench ") == len(speeds.LINES)


def test_table_is_written_between_its_lines(tmp_path: Path) -> None:
    file = tmp_path / "page.md"
    file.write_text(f"before\n{speeds.BEGIN}\nold\n{speeds.END}\nafter\n")
    report = full_report()
    speeds.write(report, file)
    assert file.read_text() == f"before\n{speeds.BEGIN}\n{speeds.table(report)}\n{speeds.END}\nafter\n"
    speeds.write(report, file)  # once more gives the same
    assert file.read_text().count("| what you call |") == 1


def test_report_that_lacks_a_figure_writes_nothing(tmp_path: Path) -> None:
    file = tmp_path / "page.md"
    file.write_text(f"{speeds.BEGIN}\nold\n{speeds.END}\n")
    report = full_report()
    lost = report.rows[0]
    report.rows[0] = replace(lost, state="wrong", time_us=None)
    with pytest.raises(InputError, match=re.escape(lost.method)):
        speeds.write(report, file)
    assert "old" in file.read_text()


def test_table_leaves_out_a_line_that_was_not_measured() -> None:
    report = full_report()
    report.rows = [row for row in report.rows if row.benchmark != "maps"]
    assert "graspfx bench maps" not in speeds.table(report) and "graspfx bench eq4" in speeds.table(report)
    assert speeds.table(Report()) == ""


def test_file_without_a_place_is_refused_before_anything_is_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "page.md"
    file.write_text("no table here\n")
    for arguments, expected in (
        (["bench", "--readme", str(file)], "a file with the lines"),
        (["bench", "--quick", "--readme", str(PAGE)], "leave out --quick"),
        (["bench", "eq4", "--readme", str(PAGE)], "all benchmarks that it shows, also "),
    ):
        assert main(arguments) == 2
        assert expected in capsys.readouterr().err


def test_figures_are_of_benchmarks_that_there_are() -> None:
    assert set(speeds.BENCHMARKS) <= set(BENCHMARKS)
    assert all(benchmark(name).TITLE for name in speeds.BENCHMARKS)
