"""The page of the benchmarks: generated, with what others win, what is missing and what was wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from graspfx.bench.benchmarks import BENCHMARKS, BESIDE_TESTS, stamp
from graspfx.bench.timing import Row
from graspfx.show.style import arranged
from tests.bench import report
from tests.bench.__main__ import HERE, NAMES, main, module
from tests.support.writing import faults

DOCS = Path(__file__).parents[2] / "docs"
MODULES: Any = {"toy": SimpleNamespace(TITLE="A toy", LIMITS="It is\na toy.")}
ROWS = [
    Row("toy", "first", "GraspFX gx.run", 20.0, 1e-9, "", "m"),
    Row("toy", "first", "GraspFX gx.run to disk", 50.0, 1e-9, "", "m"),
    Row("toy", "first", "numba, loops", 5.0, 3e-5, "", "m"),
    Row("toy", "first", "numpy", None, 0.5, "a note; wrong: its error is beyond 1.0e-03", "m", state="wrong"),
    Row("toy", "first", "JAX, scan", None, None, "not installed: pip install jax", "m", state="missing"),
]


def test_a_line_has_ours_and_the_others_whoever_wins() -> None:
    [line] = [each for each in report.page(ROWS, MODULES, stamp(quick=True)).splitlines() if each.startswith("| first")]
    ours, others = line.strip("| ").split(" | ")[1:]
    assert ours == "gx.run **20 us**, 1e-09 m; gx.run to disk **50 us**, 1e-09 m"
    assert others.startswith("numba, loops **5.0 us**, 3e-05 m (0.25); numpy: wrong: its error is beyond")
    assert others.endswith("JAX, scan: not installed: pip install jax")
    assert [report.is_own(row) for row in ROWS] == [True, True, False, False, False]
    assert report.is_own(replace(ROWS[0], method="GraspFX, whole tick")) and report.is_own(
        replace(ROWS[0], method="GraspFX")
    )
    slower = [replace(row, time_us=1e6) if row.method == "numba, loops" else row for row in ROWS]
    assert "numba, loops **1.0 s**, 3e-05 m (5e+04)" in report.page(slower, MODULES, stamp(quick=True))


def test_the_picture_has_a_mark_for_every_time_beside_ours(tmp_path: Path) -> None:
    more = [replace(row, case="second", time_us=row.time_us and 3.0 * row.time_us) for row in ROWS]
    assert report.ratios([*ROWS, *more]) == {"toy": {"numba": [0.25, 0.25]}}
    drawing = report.sheet([*ROWS, *more])
    [axes] = drawing.panels[0]
    [marks] = [line for line in axes.lines if line.get_label() == "numba"]
    assert list(marks.get_xdata()) == [0.25, 0.25] and faults(arranged(drawing)) == []
    report.write(ROWS, MODULES, stamp(quick=True), tmp_path)
    assert (tmp_path / report.PAGE).read_text("utf-8").startswith("# Benchmarks")
    assert (tmp_path / report.PICTURE).stat().st_size > 5000
    assert report.absent(ROWS) == ["toy, JAX, scan: not installed: pip install jax"]


def test_the_committed_page_has_every_benchmark_and_is_short() -> None:
    text = (DOCS / report.PAGE).read_text(encoding="utf-8")
    assert text.startswith(report.HEAD)
    assert (DOCS / report.PICTURE).is_file()
    for name in NAMES:
        each = module(name)
        assert f"## {each.TITLE}\n\n`{report.command(name)}`" in text and " ".join(each.LIMITS.split()) in text
    assert "not installed" not in text and "Measured on 20" in text
    assert len(text.splitlines()) < 200
    losses = [line for line in text.splitlines() if line.startswith("| ") and " (0." in line]
    assert losses  # what others do in less time stays in


def test_the_package_says_which_benchmarks_stand_here() -> None:
    assert set(NAMES) == {*BENCHMARKS, *BESIDE_TESTS} and set(HERE) >= set(BESIDE_TESTS)


def test_a_page_is_of_all_benchmarks(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    for words in (["eq4", "--out", str(tmp_path)], ["eq5"]):
        with pytest.raises(SystemExit):
            main(words)
    assert "leave out names" in capsys.readouterr().err and not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("us", "text"),
    [(0.0123, "12 ns"), (0.85, "850 ns"), (0.996, "1.0 us"), (9.96, "10 us"), (357.0, "360 us"), (999.6, "1.0 ms"),
     (38.2e6, "38 s"), (3.04e6, "3.0 s")],
)  # fmt: skip
def test_times_have_two_digits(us: float, text: str) -> None:
    assert report.short_time(us) == text
