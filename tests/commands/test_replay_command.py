"""graspfx replay: the comparison in words and as JSON, its exit code, and the recording that it writes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import graspfx as gx
from graspfx.__main__ import main
from graspfx.recording.record import Difference, Recording


@pytest.fixture(name="run")
def recorded(tmp_path: Path) -> Path:
    gx.run("reference-1dof", {"engine": "interpreted"}, duration=0.1, out=tmp_path / "run")
    return tmp_path / "run"


def test_a_replay_to_the_bit(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(run)]) == 0
    said = capsys.readouterr().out
    what = "reference-1dof: 20 ticks, 10 columns replayed"
    assert said == f"{what}; all are equal to the recording, bit for bit: largest difference 0\n"
    assert main(["replay", str(run), "--json"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert table["identical"]
    assert not table["open_loop"]
    assert (table["ticks"], table["columns"], table["differences"]) == (20, 10, [])


def test_one_bit_is_a_difference(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A force that is one unit in the last place off, and a zero with another sign, end in exit code 1."""
    rec = Recording.load(run)
    rows = rec.rows.copy()
    place = rec.layout.columns["finger_force"].where.start
    rows[7, place] = np.nextafter(rows[7, place], 1.0)
    Recording(rows, rec.layout, rec.header, rec.outcome).save(tmp_path / "other.h5")
    assert main(["replay", str(tmp_path / "other.h5")]) == 1
    said = capsys.readouterr().out
    assert "1 of them differ from the recording" in said
    assert "finger_force: up to " in said
    assert "from tick 7 on" in said


def test_a_difference_names_its_unit_if_it_has_one() -> None:
    assert str(Difference("gap", 0.003, 5, "m")) == "gap: up to 0.003 m, from tick 5 on"
    assert str(Difference("touching", 1.0, 5, "1")) == "touching: up to 1, from tick 5 on"


def test_overrides_are_said_to_be_an_open_loop(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "stiffer"
    words = ["replay", str(run), "--set", "coupling.internal.stiffness=120", "--out", str(out)]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "open loop: the fingers follow the recorded motion" in said
    assert "finger_force: up to " in said
    assert f"wrote {out / 'recording.h5'}" in said
    stored = Recording.load(out)
    assert stored.header.overrides["coupling.internal.stiffness"] == 120
    assert np.array_equal(stored.finger_position, Recording.load(run).finger_position)
    assert main(words) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert main([*words, "--overwrite"]) == 0


def test_a_recording_without_what_it_takes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gx.run("reference-1dof", {"engine": "interpreted", "record.every": 2}, duration=0.1, out=tmp_path / "run")
    assert main(["replay", str(tmp_path / "run")]) == 2
    assert "a replay needs every tick" in capsys.readouterr().err
