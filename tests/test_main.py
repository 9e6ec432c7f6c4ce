"""The graspfx command: what each command prints and writes, and what it exits with."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import graspfx
from graspfx.__main__ import main, override

ROOT = Path(__file__).parents[1]

WORN = """
from math import nan
import numpy as np
from graspfx.loop.device import Features

class Worn:
    features = Features(fingers=1, dimensions=1)
    reads = 0
    def open(self, period): self.period = period
    def read(self):
        self.reads += 1
        position = 0.001 if self.reads <= 10 else nan
        return np.array([[position]]), np.zeros((1, 1)), self.reads * self.period
    def write(self, forces): pass
    def stop(self): pass
    def close(self): pass
    def __enter__(self): return self
    def __exit__(self, *exc): self.close()

def connect(): return Worn()
"""


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands write into the current folder: here one of their own."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("object.mass=0.2", ("object.mass", 0.2)),
        ("object.free=[true, false]", ("object.free", [True, False])),
        ("object.dynamics=bullet", ("object.dynamics", "bullet")),
        ('object.dynamics="bullet"', ("object.dynamics", "bullet")),
        ("object.shape={ kind = 'box', size = [1.0] }", ("object.shape", {"kind": "box", "size": [1.0]})),
        ("finger.0.device.port=a=b", ("finger.0.device.port", "a=b")),
        ("title=", ("title", "")),
    ],
)
def test_a_value_is_toml_else_a_string(text: str, expected: tuple[str, object]) -> None:
    assert override(text) == expected


@pytest.mark.parametrize("text", ["object.mass", "=3"])
def test_an_override_needs_a_key_and_a_value(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["run", "reference-1dof", "--set", text])
    assert "is not of the form KEY=VALUE" in capsys.readouterr().err


def test_a_run_writes_what_it_names(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "reference-1dof", "--duration", "0.1", "--out", "here"]) == 0
    printed = capsys.readouterr().out
    for name in ("here/recording.h5", "here/figure.png"):
        assert name in printed
        assert Path(name).stat().st_size > 1000
    assert graspfx.Recording.load(Path("here/recording.h5")).time.shape == (20,)


def test_a_run_goes_to_a_folder_named_after_its_scene() -> None:
    assert main(["run", "reference-1dof", "--duration", "0.05", "--no-figure"]) == 0
    assert [path.as_posix() for path in sorted(Path().rglob("*.*"))] == ["out/reference-1dof/recording.h5"]


def test_json_is_all_that_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "reference-1dof", "--duration", "0.1", "--no-figure", "--json"]) == 0
    assert isinstance(json.loads(capsys.readouterr().out), dict)


def test_set_may_be_repeated_and_takes_several() -> None:
    changes = ["object.mass=0.2", "object.viscosity=1.0", "--set", "coupling.internal.stiffness=50.0"]
    assert main(["run", "reference-1dof", "--duration", "0.05", "--no-figure", "--out", "here", "--set", *changes]) == 0
    scene = graspfx.load("reference-1dof", {"object.mass": 0.2})
    assert scene.object[0].mass == 0.2


def test_an_unknown_scene_is_one_line_on_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "reference-1dfo"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "did you mean 'reference-1dof'" in printed.err
    assert "Traceback" not in printed.err


def test_check_shows_a_plan_with_reasons(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "reference-1dof"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert {line.split()[0] for line in lines} == {"runs", "skipped"}


def test_check_shows_every_fault_with_its_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (ROOT / "scenes" / "reference-1dof.toml").read_text()
    broken = text.replace("viscosity", "viscosty").replace("period = 0.005", "period = -1")
    Path("broken.toml").write_text(broken)
    assert main(["check", "broken.toml"]) == 2
    faults = capsys.readouterr().err.splitlines()
    at = 1 + next(row for row, line in enumerate(broken.splitlines()) if "viscosty" in line)
    assert any(f"broken.toml:{at}: object.viscosty" in fault and "'viscosity'" in fault for fault in faults)
    assert any("period" in fault for fault in faults)


def test_list_names_scenes_devices_and_dynamics(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in ("paper-waving", "two-link", "native", "bullet"))


def test_schema_is_a_json_schema(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema"]) == 0
    assert {"period", "object", "coupling", "finger"} <= json.loads(capsys.readouterr().out)["properties"].keys()


def test_a_reader_that_leaves_early_is_no_error() -> None:
    command = [sys.executable, "-m", "graspfx", "schema"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""


def test_plot_draws_one_recording_or_two_compared(capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("a", "b"):
        assert main(["run", "reference-1dof", "--duration", "0.1", "--no-figure", "--out", name]) == 0
    assert main(["plot", "a/recording.h5"]) == 0
    assert main(["plot", "a/recording.h5", "b/recording.h5", "--out", "both"]) == 0
    assert Path("a/figure.png").is_file()
    assert Path("both/comparison.png").is_file()
    assert "both/comparison.png" in capsys.readouterr().out
    assert main(["plot", "a/recording.h5", "b/recording.h5", "a/recording.h5"]) == 2


def test_a_recording_that_is_none_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    Path("notes.h5").write_text("not HDF5")
    assert main(["plot", "notes.h5"]) == 2
    assert main(["plot", "missing.h5"]) == 2
    assert "notes.h5" in capsys.readouterr().err


def test_a_run_with_a_fault_writes_its_files_and_exits_with_3(capsys: pytest.CaptureFixture[str]) -> None:
    """A device whose reading becomes NaN after 10 samples: zero force from there on, and a fault that is said."""
    Path("worn.py").write_text(WORN)
    lines = (ROOT / "scenes" / "reference-1dof.toml").read_text().splitlines()
    without_hands = (line for line in lines if not line.startswith("hand"))
    scene = ['device = { name = "worn.py" }' if line.startswith("device") else line for line in without_hands]
    Path("worn.toml").write_text("\n".join(scene))
    assert main(["run", "worn.toml", "--duration", "0.1", "--no-figure"]) == 3
    assert "tick 10" in capsys.readouterr().err
    recording = graspfx.Recording.load(Path("out/worn/recording.h5"))
    assert recording.time.size == 20
    assert (recording.finger_force[:10] != 0.0).any()
    assert (recording.finger_force[10:] == 0.0).all()


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
def test_an_interrupted_run_leaves_a_readable_recording() -> None:
    command = ["run", "reference-1dof", "--duration", "100000", "--no-figure", "--out", "cut"]
    process = subprocess.Popen(
        [sys.executable, "-m", "graspfx", *command],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    recording = Path("cut/recording.h5")
    while process.poll() is None and not (recording.is_file() and recording.stat().st_size > 200_000):
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert (process.returncode, said.strip()) == (130, "interrupted")
    read = graspfx.Recording.load(recording)
    assert read.time.size > 100
    assert read.finger_force.shape == (read.time.size, 2, 1)
