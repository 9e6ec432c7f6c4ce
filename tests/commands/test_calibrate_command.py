"""graspfx calibrate: a table, a file that a scene takes over, and refusals before hardware is opened."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

import graspfx as gx
from graspfx.__main__ import main
from graspfx.assembly import device_calibration
from tests.support.hardware import VirtualClock
from tests.support.late_mass import late_driver, late_masses

SCENE = """
dimensions = 2
period = 0.001
duration = 1.0
safety = { force = 5.0 }

[object]
mass = 0.1
viscosity = 0.8
rotational_viscosity = 0.001
shape = { kind = "box", size = [0.04, 0.04] }

[coupling]
external = { stiffness = 30.0 }
internal = { stiffness = 30.0 }

[[finger]]
device = { name = "late.py", mass = 0.2 }
start = [-0.03, 0.0]
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(device_calibration, "WallClock", VirtualClock)
    late_driver(tmp_path)
    (tmp_path / "mine.toml").write_text(SCENE)
    return tmp_path


def test_measures_are_printed_and_written(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "mine.toml", "--yes", "--pulses", "20"]) == 0
    out = capsys.readouterr().out
    assert "finger0: 20 pulses of 0.1 N" in out and "axes        not checked: a person must push the finger" in out
    overrides = tomllib.loads((folder / "mine-measures.toml").read_text())
    assert overrides["finger.0.device.measures"]["mass"] == pytest.approx(0.2, rel=0.01)
    assert gx.load("mine.toml", overrides).linearise("start").mass == pytest.approx(0.2, rel=0.01)
    count = len(late_masses(folder / "late.py"))
    assert main(["calibrate", "mine.toml", "--yes"]) != 0
    assert "expected a new file" in capsys.readouterr().err
    assert len(late_masses(folder / "late.py")) == count


def test_nobody_at_the_terminal_and_simulations_are_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "mine.toml"]) != 0
    assert "add --yes, or start the command in a terminal" in capsys.readouterr().err
    assert main(["calibrate", "reference-1dof", "--yes"]) != 0
    assert "expected a scene with hardware" in capsys.readouterr().err
    assert not list(folder.glob("*-measures.toml"))
