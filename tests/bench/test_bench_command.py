"""`graspfx bench` without a scene: rows, JSON, what is missing, and the Pareto front; no time is asserted."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from graspfx.__main__ import main
from graspfx.bench import benchmarks
from graspfx.bench.benchmarks import by_case, front, lines, time_text
from graspfx.bench.timing import Case, Method, Row, check, missing
from graspfx.errors import MissingPackageError

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

    modules = {"toy": SimpleNamespace(cases=cases), "lost": SimpleNamespace(cases=without_oracle)}
    monkeypatch.setattr(benchmarks, "BENCHMARKS", dict.fromkeys(modules, ""))
    monkeypatch.setattr(benchmarks, "benchmark", modules.__getitem__)


@pytest.mark.usefixtures("toy")
def test_json_has_rows_and_where_they_were_measured(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "toy", "--json", "--quick"]) == 0
    table = json.loads(capsys.readouterr().out)
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
    assert table["quick"] is True and table["versions"]["python"] and {"date", "machine", "cpu", "load"} <= set(table)


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


@pytest.mark.parametrize("name", benchmarks.BENCHMARKS)
def test_a_benchmark_of_the_package_gives_right_answers(name: str) -> None:
    """Of every case of the quick form but start-up's, whose processes take seconds: each method within the bound."""
    module = benchmarks.benchmark(name)
    assert module.TITLE and len(module.LIMITS.split()) > 20
    for case in module.cases(quick=True) if name != "startup" else ():
        rows = {method.name: check(case, method) for method in case.methods}
        ours = [each for name, each in rows.items() if "numpy" not in name]
        assert ours and all(each.state in ("timed", "missing") for each in ours), case.name
        if case.unit == "relative":
            assert max(each.error or 0.0 for each in ours) < 4e-15


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
    marked = [line[4:18].strip() for line in lines(rows) if line.startswith("  * ")]
    assert marked == ["quick, rough", "between", "slow, exact"]


@pytest.mark.parametrize(
    ("us", "text"), [(None, ""), (0.0123, "12.3 ns"), (123.4, "123 µs"), (4567.0, "4.57 ms"), (2e6, "2.00 s")]
)
def test_times_have_three_digits(us: float | None, text: str) -> None:
    assert time_text(us) == text
