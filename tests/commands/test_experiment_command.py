"""`graspfx experiment`: a plan, simulated sessions, sessions answered by keys, and what is refused."""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from graspfx.__main__ import main
from graspfx.experiment.presenters import Showing, Simulated
from graspfx.experiment.trial_table import read_table
from tests.support.experiments import COMPARED, PLAIN, table_of

pytest.importorskip("questplus", reason="staircases: pip install 'graspfx[experiment]'")


def written(folder: Path, text: str) -> str:
    """Write an experiment's file, and give its path."""
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_the_plan_is_printed_and_nothing_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["experiment", written(tmp_path, COMPARED), "--plan", "--participant", "7"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 1 + 8 and lines[0].startswith("1  practice  ")
    assert sum("  internal  " in line for line in lines[1:]) == 4
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]


def test_a_simulated_session_sums_up(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["experiment", written(tmp_path, COMPARED), "--simulate", "--out", str(tmp_path / "study")]
    assert main(words) == 0
    text = capsys.readouterr().out
    assert "internal: threshold " in text and " of 4 answers correct" in text and "_beh.tsv" in text
    assert main(words) == 2
    assert "--resume continues it" in capsys.readouterr().err


def test_lines_of_input_answer_and_its_end_is_the_end(tmp_path: Path) -> None:
    """Answers come too late for the first question where input has ended: the session ends, and can go on."""
    words = [sys.executable, "-m", "graspfx", "experiment", written(tmp_path, PLAIN), "--out", str(tmp_path / "study")]
    done = subprocess.run(words, input="", capture_output=True, text=True, env=dict(os.environ), check=False)
    assert done.returncode == 130, done.stderr
    said = "ended before the first of 4 trials: the input of answers has ended; the same command"
    assert f"{said} with --resume continues with trial 1" in done.stdout and "has no trial yet" in done.stdout
    assert read_table(table_of(tmp_path / "study")) == []


@pytest.mark.parametrize("done", [0, 2])
def test_ctrl_c_says_what_is_done_and_how_to_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, done: int
) -> None:
    """The signal comes while a trial is computed: it is told as an interruption, and the trial comes again."""
    show, intervals = Simulated.show, []

    def interrupted(self: Simulated, *given: Any) -> Showing:
        intervals.append(given)
        if len(intervals) == 2 * done + 1:
            signal.raise_signal(signal.SIGINT)
        return show(self, *given)

    monkeypatch.setattr(Simulated, "show", interrupted)
    words = ["experiment", written(tmp_path, COMPARED), "--simulate", "--out", str(tmp_path / "study")]
    assert main(words) == 130
    out = capsys.readouterr().out
    where = "after trial 2 of 9" if done else "before the first of 9 trials"
    assert f"ended {where}: it was interrupted; the same command with --resume continues with trial {done + 1}\n" in out
    assert len(read_table(table_of(tmp_path / "study"))) == done
    assert main([*words, "--resume"]) == 0
    assert len(read_table(table_of(tmp_path / "study"))) == 9


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["stifness-jnd"], "did you mean 'stiffness-jnd'"),
        (["stiffness-jnd", "--participant", "a b", "--simulate"], "letters and digits only"),
        (["stiffness-jnd", "--resume", "--simulate"], "there is no session to resume"),
        (["stiffness-jnd", "--run", "0", "--simulate"], "from 1 to 99"),
        (["stiffness-jnd", "--simulate", "--lsl"], "--simulate without these options"),
    ],
)
def test_what_is_refused(
    words: list[str], text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    assert main(["experiment", *words]) == 2
    assert text in capsys.readouterr().err
    assert not list(tmp_path.rglob("*.tsv"))
