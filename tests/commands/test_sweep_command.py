"""`graspfx sweep`: a table, a file and figures; existing files, and refusals."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from graspfx.__main__ import main
from graspfx.sweeps.crew import ChunkLoop

OVER = ["--over", "coupling.external.stiffness=20:60:3", "--duration", "0.1"]
SCENE = ["sweep", "reference-1dof", *OVER]


@pytest.mark.filterwarnings("default:.*was removed to start again")
def test_it_writes_a_file_a_figure_and_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = ["--out", str(tmp_path)]
    assert main([*SCENE, *out, "--measure", "finger_force.peak"]) == 0
    text = capsys.readouterr().out
    assert "3 variants" in text and "finger_force.peak [N]" in text and "external.stiffness" in text
    assert "faults: 0; failures: 0" in text and f"wrote {tmp_path}/sweep.nc" in text
    assert (tmp_path / "sweep.png").stat().st_size > 5000
    assert main([*SCENE, *out, "--measure", "finger_force.peak"]) == 2
    assert "--resume" in capsys.readouterr().err
    assert main([*SCENE, *out, "--measure", "finger_force.peak", "--resume", "--json"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert table["values"]["coupling.external.stiffness"] == [20.0, 40.0, 60.0]
    assert len(table["measures"]["finger_force"]["peak"]) == 3 and table["failure"] == ["", "", ""]
    assert main([*SCENE, *out, "--resume"]) == 2  # of other statistics
    assert "another sweep" in capsys.readouterr().err
    assert main([*SCENE, *out, "--overwrite", "--executor", "threads:2", "--chunk", "2"]) == 0
    said = capsys.readouterr().err
    assert said.startswith(f"warning: {tmp_path}: the sweep of ")
    assert "was removed to start again, with 1 chunk and sweep.nc\n" in said


def test_a_folder_of_its_own_and_the_last_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    words = [*SCENE, "--over", "object.mass=0.1,-1", "--set", "object.viscosity=0.9"]
    assert main(words) == 0
    assert "failures: 3" in capsys.readouterr().out
    assert main([*words, "--sample", "lhs:4"]) == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "reference-1dof-sweep",
        "reference-1dof-sweep-2",
    ]
    assert main([*words, "--sample", "lhs:4", "--resume"]) == 0
    assert len(list((tmp_path / "out").iterdir())) == 2


def test_ctrl_c_says_how_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(ChunkLoop, "run", interrupt)
    assert main([*SCENE, "--out", str(tmp_path)]) == 130
    assert f"0 of 3 variants are done in {tmp_path}" in (text := capsys.readouterr().err)
    assert f"--out {tmp_path} --resume" in text


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["sweep", "reference-1dof"], "--over"),
        ([*SCENE, "--cluster", "here", "--executor", "threads:2"], "--cluster without --executor"),
        ([*SCENE, "--cluster", "here"], "tcp://HOST:PORT"),
        ([*SCENE, "--executor", "fibres"], "threads:N"),
        ([*SCENE, *OVER], "each key once"),
        ([*SCENE, "--measure", "finger_forces"], "did you mean 'finger_force'"),
        (["sweep", "reference-1dof", "--over", "object.mas=1:2:3"], "did you mean"),
        ([*SCENE, "--out", "nowhere", "--sample", "lhs:x"], "lhs:N"),
    ],
)
def test_others_are_refused(
    words: list[str], text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    assert text in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
