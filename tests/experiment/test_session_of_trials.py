"""Sessions: what is written after each trial, and that a session which was killed goes on as it would have."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import graspfx as gx
from graspfx.errors import InputError, RecordingError
from graspfx.experiment.design import Experiment
from graspfx.experiment.staircase import Stair, thresholds
from graspfx.experiment.trial import Presentation
from graspfx.experiment.trial_table import read_table
from tests.support.experiments import COMPARED, PLAIN, experiment, table_of

pytest.importorskip("questplus", reason="staircases: pip install 'graspfx[experiment]'")

STEADY = ("trial_number", "trial_type", "condition", "repetition", "increment", "larger", "response", "correct")


def steady(folder: Path) -> list[tuple[str, ...]]:
    """Read what of a table does not depend on the clock."""
    return [tuple(row[name] for name in STEADY) for row in read_table(table_of(folder))]


def breaking_off(experiment_: Experiment, folder: Path, after: int) -> None:
    """Run a session until some rows are there, and break off the next trial in its run."""
    done: Iterator[bool] = (
        folder.exists() and len(read_table(table_of(folder))) >= after for _ in iter(int, 1)
    )  # fmt: skip
    experiment_.run(folder, stop=lambda: next(done))


def test_a_session_is_files_as_bids_names_them(tmp_path: Path) -> None:
    plain = experiment(PLAIN)
    rows = plain.run(tmp_path, lambda shown: "soft", participant="03", session="02", run=4)
    home, stem = tmp_path / "sub-03" / "ses-02" / "beh", "sub-03_ses-02_task-plain_run-04"
    assert {path.name for path in home.iterdir()} == {
        f"{stem}_{name}" for name in ("beh.tsv", "beh.json", "events.tsv", "events.json", "recordings")
    }
    assert json.loads((tmp_path / "dataset_description.json").read_text("utf-8"))["BIDSVersion"]
    about, table = json.loads((home / f"{stem}_beh.json").read_text("utf-8")), read_table(home / f"{stem}_beh.tsv")
    assert set(table[0]) <= set(about) and about["response_time"]["Units"] == "s"
    assert about["GraspFX"]["ExperimentText"] == plain.source.text
    assert [row["condition"] for row in table] == [trial.condition for trial in plain.order("03", "02")]
    assert [row["correct"] for row in table] == [str(row["condition"] == "low").lower() for row in table]
    assert [row.is_correct for row in rows] == [row["correct"] == "true" for row in table]
    for row in table:
        recording = gx.Recording.load(home / row["path"])
        wanted = 40.0 if row["condition"] == "low" else 70.0
        assert recording.header.scene_table["coupling"]["internal"]["stiffness"] == wanted
        assert len(recording) == 10
        events = [line.split("\t")[2] for line in (home / row["path"] / "events.tsv").read_text().splitlines()]
        assert events == ["event", "trial", "stimulus", "end", "question", "response"]
    onsets = [float(row["onset"]) for row in table]
    assert onsets == sorted(onsets)


def test_nothing_is_written_over(tmp_path: Path) -> None:
    plain = experiment(PLAIN)
    with pytest.raises(RecordingError, match="there is no session to resume"):
        plain.run(tmp_path, lambda shown: "soft", resume=True)
    plain.run(tmp_path, lambda shown: "soft")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    with pytest.raises(RecordingError, match=r"exists already; --resume continues it"):
        plain.run(tmp_path, lambda shown: "soft")
    assert plain.run(tmp_path, lambda shown: "soft", resume=True) == []  # it is over
    after = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert {path: data for path, data in after.items() if "events.tsv" not in path.name} == {
        path: data for path, data in before.items() if "events.tsv" not in path.name
    }
    assert len(plain.run(tmp_path, lambda shown: "hard", run=2)) == 4


@pytest.mark.parametrize("way", ["resume", "remove", "run"])
def test_a_start_that_was_cut_short_says_what_to_do(tmp_path: Path, way: str) -> None:
    """A kill came between the description and the table: each way out of the error leads to a whole session."""
    plain = experiment(PLAIN)
    plain.run(tmp_path, lambda shown: "soft", stop=lambda: True)
    table = table_of(tmp_path)
    for path in (table, *table.parent.glob("*_events.*")):
        path.unlink()
    said = (
        r"_beh\.json: exists already, but its table does not.*--resume continues it, and --run N .*or remove this file"
    )
    with pytest.raises(RecordingError, match=said):
        plain.run(tmp_path, lambda shown: "soft")
    if way == "remove":
        table.with_suffix(".json").unlink()
    assert len(plain.run(tmp_path, lambda shown: "soft", resume=way == "resume", run=1 + (way == "run"))) == 4


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[str, ...]]:
    """Run a session in one piece."""
    folder = tmp_path_factory.mktemp("whole")
    compared = experiment(COMPARED)
    compared.run(folder)
    rows = read_table(table_of(folder))
    answers = thresholds(compared, rows)
    assert [(each.condition, each.trials) for each in answers] == [("internal", 4), ("external", 4)]
    assert compared.table.staircase is not None
    stair = Stair(compared.table.staircase)
    for row in rows:
        if row["condition"] == "external" and row["trial_type"] == "test":
            assert float(row["increment"]) == pytest.approx(stair.increment(), rel=1e-12)
            stair.update(float(row["increment"]), is_correct=row["correct"] == "true")
    assert answers[1].value == stair.threshold()[0]
    assert "external: " in str(answers[1])
    return steady(folder)


def test_what_was_broken_off_goes_on_as_it_would_have(tmp_path: Path, whole: list[tuple[str, ...]]) -> None:
    """The order, the staircases and the simulated observer's answers are those of a session in one piece."""
    compared = experiment(COMPARED)
    breaking_off(compared, tmp_path / "parts", 3)
    assert len(steady(tmp_path / "parts")) == 3
    compared.run(tmp_path / "parts", resume=True)
    assert steady(tmp_path / "parts") == whole
    assert len(whole) == 1 + 8


def test_a_session_of_another_experiment_does_not_go_on(tmp_path: Path) -> None:
    breaking_off(experiment(PLAIN), tmp_path, 2)
    with pytest.raises(RecordingError, match="this session has another experiment, scene or mode"):
        experiment(PLAIN, ("seed = 3", "seed = 4")).run(tmp_path, resume=True)
    table = table_of(tmp_path)
    text = table.read_text("utf-8")
    table.write_text(text.replace("\tlow\t", "\thigh\t", 1), encoding="utf-8")
    with pytest.raises(RecordingError, match="does not match the order of this session"):
        experiment(PLAIN).run(tmp_path, resume=True)


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="signals of POSIX")
def test_a_kill_loses_no_trial_that_was_answered(tmp_path: Path, whole: list[tuple[str, ...]]) -> None:
    """The process is killed after a row is seen; every row is there, the session goes on with the same answers."""
    path = tmp_path / "compared.toml"
    path.write_text(COMPARED, encoding="utf-8")
    words = [sys.executable, "-m", "graspfx", "experiment", str(path), "--simulate", "--out", str(tmp_path / "killed")]
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=dict(os.environ))
    while process.poll() is None:
        tables = list((tmp_path / "killed").glob("sub-*/ses-*/beh/*_beh.tsv"))
        if tables and tables[0].read_bytes().count(b"\n") >= 4:
            process.kill()
            break
        time.sleep(0.001)
    process.communicate()
    before = table_of(tmp_path / "killed").read_bytes()
    assert before.count(b"\n") >= 4
    with table_of(tmp_path / "killed").open("ab") as file:
        file.write(b"99\ttest\tinter")  # a row that was cut short
    compared = experiment(COMPARED)
    compared.run(tmp_path / "killed", resume=True)
    assert table_of(tmp_path / "killed").read_bytes().startswith(before[: before.rfind(b"\n") + 1])
    assert steady(tmp_path / "killed") == whole


def test_an_answer_is_one_of_the_questions(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="one of the answers soft, hard"):
        experiment(PLAIN).run(tmp_path, lambda shown: "fluffy")
    with pytest.raises(InputError, match="letters and digits only"):
        experiment(PLAIN).run(tmp_path, lambda shown: "soft", participant="../3")


def test_a_fault_is_in_the_row_and_nobody_is_asked(tmp_path: Path) -> None:
    """A finger whose device cannot follow has a fault, from which on forces are zero: no answer counts."""
    shown: list[Presentation] = []

    def respond(each: Presentation) -> str:
        shown.append(each)
        return "soft"

    wide = '"finger.*.hand.motion" = { kind = "sine", amplitude = 3.0, frequency = 2.0, axis = "x" }'
    broken = experiment(
        PLAIN, ('"reference-1dof"', '"paper-waving"'), ("duration = 0.05", "duration = 0.3"),
        ('set = { "coupling.internal.stiffness" = 70.0 }', f"set = {{ {wide} }}"),
    )  # fmt: skip
    rows = broken.run(tmp_path, respond)
    faults = [row.fault for row in rows]
    assert [bool(fault) for fault in faults] == [row.trial.condition == "high" for row in rows]
    assert [row.response for row in rows] == ["" if row.fault else "soft" for row in rows]
    assert len(shown) == 2
    assert [row["fault"] != "n/a" for row in read_table(table_of(tmp_path))] == [bool(fault) for fault in faults]
