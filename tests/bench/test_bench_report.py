"""Benchmarks' rows, JSON, page, figures and command; no time is asserted."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from matplotlib.image import imread

from graspfx.__main__ import main
from graspfx.bench import registry
from graspfx.bench.calibration import STEPS, calibrate, chain
from graspfx.bench.case import Case, Method, missing
from graspfx.bench.measure import Row
from graspfx.bench.report import page as pages
from graspfx.bench.report.figures import figure, sheet
from graspfx.bench.report.pareto import by_case, front
from graspfx.bench.report.questions import QUESTIONS, question
from graspfx.bench.report.report import SCHEMA, Report
from graspfx.errors import MissingPackageError, RecordingError
from graspfx.show.style import arranged
from tests.support.writing import faults

DOCS = Path(__file__).parents[2] / "docs"
ROW = {"benchmark", "method", "time_us", "error", "note"}


def row(method: str, time_us: float | None, error: float | None, state: str = "timed") -> Row:
    return Row("b", "c", method, time_us, error, "", "m", state=state)


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two benchmarks in place of the real ones."""

    def cases(quick: bool) -> Iterator[Case]:
        methods = [Method("good", int, 1e-9, "a note"), Method("wrong", int, 1.0), missing("peer", "some-package")]
        yield Case("toy", "first", "m", methods, bound=1e-3)
        yield Case("toy", "second", "m", [Method("good", int, 0.0), Method("rough", lambda: sum(range(99)), 0.5)])

    def without_oracle(quick: bool) -> Iterator[Case]:
        yield from ()
        raise MissingPackageError("oracle-package", "the oracle", "pip install oracle-package")

    modules = {
        "toy": SimpleNamespace(TITLE="A toy", LIMITS="It is\na toy.", cases=cases),
        "lost": SimpleNamespace(TITLE="Lost", LIMITS="All.", cases=without_oracle),
    }
    monkeypatch.setattr(registry, "BENCHMARKS", dict.fromkeys(modules, ""))
    monkeypatch.setattr("graspfx.bench.registry.import_module", lambda name: modules[name])
    monkeypatch.setattr(registry, "benchmark", modules.__getitem__)
    monkeypatch.setattr("graspfx.bench.suite.benchmark", modules.__getitem__)


@pytest.mark.usefixtures("toy")
def test_json_has_rows_and_a_stamp_for_each_benchmark(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "toy", "--json", "--quick"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert table["schema"] == SCHEMA
    assert all(set(each) >= ROW and each["benchmark"] == "toy" for each in table["rows"])
    states = {(each["case"], each["method"]): each["state"] for each in table["rows"]}
    assert states == {
        ("first", "good"): "timed",
        ("first", "wrong"): "wrong",
        ("first", "peer"): "missing",
        ("second", "good"): "timed",
        ("second", "rough"): "timed",
    }
    first = {each["method"]: each for each in table["rows"] if each["case"] == "first"}
    assert first["wrong"]["time_us"] is None and first["wrong"]["error"] == 1.0
    assert first["peer"]["note"] == "not installed: pip install some-package"
    assert first["good"]["ratio"] == 1.0 and first["good"]["note"] == "a note"
    stamp = table["benchmarks"]["toy"]
    assert stamp["command"] == "graspfx bench toy --quick" and stamp["quick"] is True
    assert {"date", "machine", "cpu", "load", "versions", "step_ns", "calibration", "limits"} <= set(stamp)
    assert stamp["versions"]["python"] and stamp["limits"] == "It is a toy."


@pytest.mark.usefixtures("toy")
def test_missing_oracle_is_a_row_too(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "lost", "--json"]) == 0
    [only] = json.loads(capsys.readouterr().out)["rows"]
    assert only["state"] == "missing" and only["note"] == "not installed: pip install oracle-package"


@pytest.mark.usefixtures("toy")
def test_all_are_run_if_none_is_named_and_their_tables_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--quick"]) == 0
    out = capsys.readouterr().out
    assert re.search(r"^toy: first, error \[m\]\n  \* good ", out, re.MULTILINE)
    assert "toy: second" in out and "wrong: its error is beyond 1.0e-03" in out and "lost: " in out


def test_unknown_name_has_a_close_match(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "eq5"]) == 2
    assert "did you mean 'eq4'?" in capsys.readouterr().err


@pytest.mark.usefixtures("toy")
def test_report_page_and_figures_are_written_and_others_kept(tmp_path: Path) -> None:
    assert main(["bench", "lost", "--quick", "--out", str(tmp_path)]) == 0
    assert (
        main(["bench", "toy", "--quick", "--out", str(tmp_path), "--overwrite"]) == 0
    )  # first on the page, whenever it was run
    report = Report.load(tmp_path / "benchmarks.json")
    assert list(report.stamps) == ["toy", "lost"]
    assert (tmp_path / "benchmarks.md").read_text(encoding="utf-8") == pages.page(report)
    assert (tmp_path / "pictures/bench/toy.png").stat().st_size > 5000
    assert not (tmp_path / "pictures/bench/lost.png").exists()


@pytest.mark.usefixtures("toy")
def test_what_was_measured_stays_where_a_later_benchmark_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(quick: bool) -> Iterator[Case]:
        yield from ()
        raise KeyboardInterrupt

    monkeypatch.setattr(registry.benchmark("lost"), "cases", interrupted)
    assert main(["bench", "--quick", "--out", str(tmp_path)]) == 130
    report = Report.load(tmp_path / "benchmarks.json")
    assert list(report.stamps) == ["toy"] and len(report.rows) == 5
    assert (tmp_path / "benchmarks.md").read_text(encoding="utf-8") == pages.page(report)


def test_what_is_no_report_is_an_error(tmp_path: Path) -> None:
    file = tmp_path / "benchmarks.json"
    for text in ("", "[]", '{"schema": 0}', f'{{"schema": {SCHEMA}, "rows": [{{}}], "benchmarks": {{}}}}'):
        file.write_text(text)
        with pytest.raises(RecordingError, match="no report of benchmarks"):
            Report.load(file)


def test_pareto_front() -> None:
    rows = [
        row("slow, exact", 9.0, 1e-15),
        row("quick, rough", 1.0, 1e-3),
        row("beaten", 10.0, 1e-9),
        row("wrong", None, 9.0, "wrong"),
        row("between", 2.0, 1e-6),
        row("as exact, slower", 9.5, 1e-15),
    ]
    assert [each.method for each in front(rows)] == ["quick, rough", "between", "slow, exact"]
    [ordered] = by_case(rows).values()
    assert [each.method for each in ordered][-1] == "wrong"


def test_table_is_sorted_by_time_and_marks_the_front() -> None:
    lines = list(pages.table(by_case([row("b", 2.0, 1e-9), row("a", 1.0, 1e-3), row("c", 1500.0, 1e-3)])["c"]))
    assert lines[0] == "| | method | time | ratio | error [m] | note |"
    assert [line.split("|")[1].strip() for line in lines[2:]] == ["●", "●", ""]
    assert [line.split("|")[3].strip() for line in lines[2:]] == ["1.00 µs", "2.00 µs", "1.50 ms"]


@pytest.mark.parametrize(
    ("us", "text"), [(None, ""), (0.0123, "12.3 ns"), (123.4, "123 µs"), (4567.0, "4.57 ms"), (2e6, "2.00 s")]
)
def test_times_have_three_digits(us: float | None, text: str) -> None:
    assert pages.time_text(us) == text


def test_figures_with_and_without_errors(tmp_path: Path) -> None:
    figure(
        [row("a", 1.0, 0.0), row("b", 2.0, 1e-9), row("c", None, None, "missing")], "toy", "errors", tmp_path / "a.png"
    )
    spread = Row("b", "c", "a", 1.0, None, "", median_us=1.5, quantiles={"p50": 1.5, "max": 40.0})
    figure([spread], "toy", "no errors", tmp_path / "b.png")
    for name, dots in (("a.png", 2), ("b.png", 1)):
        ink = (imread(tmp_path / name)[..., :3] < 0.2).all(axis=2)
        assert ink.sum() > 1200 + 20 * dots  # frame, words and marks


@pytest.mark.parametrize("width", ["screen", "column"])
@pytest.mark.parametrize("name", registry.BENCHMARKS)
def test_a_figure_answers_one_question_in_three_panels_at_most(name: str, width: str) -> None:
    """From the committed report: each panel shows what was measured, and nothing is written over anything else."""
    report = Report.load(DOCS / "benchmarks.json")
    rows = [each for each in report.rows if each.benchmark == name]
    assert QUESTIONS[name].text.endswith("?") and 1 <= len(QUESTIONS[name].panels) <= 3
    drawn = sheet(rows, question(name, "", rows), width=width)
    assert all(axes.lines for axes in drawn.panels.ravel())
    assert faults(arranged(drawn)) == []


def test_figures_are_drawn_anew_from_the_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing is measured: only a report that is there is read."""
    assert main(["bench", "--redraw", "--out", str(tmp_path)]) == 2
    (tmp_path / "benchmarks.json").write_bytes((DOCS / "benchmarks.json").read_bytes())
    assert main(["bench", "maps", "--redraw", "--out", str(tmp_path), "--overwrite", "--format", "svg"]) == 0
    assert "<svg" in (tmp_path / "pictures/bench/maps.svg").read_text("utf-8")
    assert "pictures/bench/maps.svg" in (tmp_path / "benchmarks.md").read_text("utf-8")
    assert main(["bench", "--redraw"]) == 2
    assert "--out" in capsys.readouterr().err


def test_calibration_is_the_chain() -> None:
    assert chain(200, 1.0) == pytest.approx(0.5 * (0.75**2 * 4 + 8) ** 0.5 - 0.75, rel=1e-15)  # x^2/2 + 3x/4 = 1
    found = calibrate()
    assert found.step_ns > 0.0 and STEPS > 0


def test_committed_page_is_that_of_the_committed_report() -> None:
    report = Report.load(DOCS / "benchmarks.json")
    assert (DOCS / "benchmarks.md").read_text(encoding="utf-8") == pages.page(report)
    assert set(report.stamps) == set(registry.BENCHMARKS)
    for name in report.stamps:
        assert (DOCS / "pictures/bench" / f"{name}.png").is_file()
    assert not any(each.state == "missing" for each in report.rows)


@pytest.mark.parametrize("name", registry.BENCHMARKS)
def test_every_benchmark_says_what_it_does_not_say(name: str) -> None:
    module = registry.benchmark(name)
    assert module.TITLE and len(module.LIMITS.split()) > 20
