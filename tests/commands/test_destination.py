"""Commands write over nothing that they did not write: folders of their own, refusals at the start, --overwrite."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import graspfx as gx
from graspfx.__main__ import main
from graspfx.commands.destination import OUT
from graspfx.errors import RecordingError
from graspfx.recording.files import LATEST

ROOT = Path(__file__).parents[2]
RUN = ["run", "reference-1dof", "--duration", "0.05"]
QUICK = [*RUN, "--no-figure"]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def files() -> dict[str, bytes]:
    return {path.as_posix(): path.read_bytes() for path in Path().rglob("*") if path.is_file()}


def test_each_run_has_a_folder_of_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("reference-1dof", "reference-1dof-2", "reference-1dof-3"):
        assert main(QUICK) == 0
        assert f"wrote out/{name}/recording.h5" in capsys.readouterr().out
        assert str(Path("out/latest").readlink()) == name
    assert main([*QUICK[:-1], "--no-figure", "--overwrite"]) == 0
    assert "wrote out/reference-1dof/recording.h5" in capsys.readouterr().out
    assert str(Path("out/latest").readlink()) == "reference-1dof"
    assert sorted(path.name for path in Path("out").iterdir()) == [
        "latest",
        "reference-1dof",
        "reference-1dof-2",
        "reference-1dof-3",
    ]
    assert len(gx.Recording.load("out/latest")) == 10
    before = files()
    assert main(["run", "reference-1dof", "--duration", "1e30"]) == 2
    assert "the disk of out/reference-1dof-4 has room for" in capsys.readouterr().err
    assert files() == before and len(list(Path("out").iterdir())) == 4


def test_a_folder_that_is_named_is_not_the_latest_and_may_exist() -> None:
    Path("mine").mkdir()
    Path("mine/notes.txt").write_text("kept")
    assert main([*QUICK, "--out", "mine"]) == 0
    assert not Path("out").exists()
    assert Path("mine/notes.txt").read_text() == "kept"


def test_where_there_are_no_links_a_file_names_the_latest(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError("A required privilege is not held by the client")

    monkeypatch.setattr(Path, "symlink_to", refuse)
    for _ in range(2):
        assert main(QUICK) == 0
    assert Path("out/latest").read_text() == "reference-1dof-2\n"
    assert gx.Recording.load("out/latest").rows.tobytes() == gx.Recording.load("out/reference-1dof-2").rows.tobytes()
    assert main(["plot", "out/latest"]) == 0
    assert main(["picture", "out/latest"]) == 0
    assert Path("out/reference-1dof-2/picture.png").is_file()
    assert main(["view", "out/latest", "--html", "latest.html"]) == 0
    assert "wrote out/reference-1dof-2/figure.png" in capsys.readouterr().out


def test_a_folder_of_ones_own_called_latest_stays(capsys: pytest.CaptureFixture[str]) -> None:
    (OUT / LATEST).mkdir(parents=True)
    assert main(QUICK) == 0
    said = "note: out/latest cannot point to reference-1dof: it is a folder\n"
    assert capsys.readouterr().err == said
    assert (OUT / LATEST).is_dir() and not (OUT / LATEST).is_symlink()


@pytest.mark.parametrize("there", ["recording.h5", "recording.h5.part", "figure.png"])
def test_a_run_refuses_before_it_starts(
    there: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("a").mkdir()
    Path("a", there).write_bytes(b"mine")
    before = files()
    with monkeypatch.context() as nothing:
        nothing.setattr("graspfx.assembly.run_scene.run", None)
        nothing.setattr("graspfx.scene.load.load", None)
        assert main([*RUN, "--out", "a"]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"a/{there}: exists already") and said.count("\n") == 1
    assert "choose another --out, or overwrite it with --overwrite" in said
    assert files() == before
    if there == "figure.png":
        assert main([*QUICK, "--out", "a"]) == 0  # which draws none
    assert main([*RUN, "--out", "a", "--overwrite"]) == 0
    assert sorted(path.name for path in Path("a").iterdir()) == ["figure.png", "recording.h5"]


def test_plot_picture_stability_and_bench_refuse_too(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    gx.run(gx.load("reference-1dof"), duration=0.05, out="a")
    sweep = ["stability", "reference-1dof", "--sweep", "coupling.internal.stiffness=50:70:2", "--out", "a"]
    cases = {
        "a/figure.png": ["plot", "a"],
        "a/comparison.png": ["plot", "a", "a/recording.h5"],
        "a/picture.png": ["picture", "a"],
        "b.png": ["picture", "reference-1dof", "--out", "b.png"],
        "a/stability.png": sweep,
        "a/bench.png": ["bench", "reference-1dof", "--quick", "--out", "a"],
    }
    drawing = ["show.run_figures.sheet", "show.picture.portrait.portrait"]
    for work in (*drawing, "certificate.limit_sweep.swept_limits", "bench.scene_choices.trade_off"):
        monkeypatch.setattr(f"graspfx.{work}", None)
    for there, command in cases.items():
        Path(there).parent.mkdir(parents=True, exist_ok=True)
        Path(there).write_bytes(b"mine")
        assert main(command) == 2
        said = capsys.readouterr().err
        assert said == f"{there}: exists already; choose another --out, or overwrite it with --overwrite\n"
        assert Path(there).read_bytes() == b"mine"
        Path(there).unlink()


def test_the_same_commands_write_over_a_file_when_they_are_told_to(capsys: pytest.CaptureFixture[str]) -> None:
    gx.run(gx.load("reference-1dof"), duration=0.05, out="a")
    sweep = ["stability", "reference-1dof", "--sweep", "coupling.internal.stiffness=50:70:2", "--out", "a"]
    for there, command in (
        ("a/figure.png", ["plot", "a"]),
        ("a/picture.png", ["picture", "a"]),
        ("a/stability.png", sweep),
    ):
        Path(there).write_bytes(b"old")
        assert main([*command, "--overwrite"]) == 0
        assert Path(there).read_bytes().startswith(b"\x89PNG")
    assert not [name for name in files() if Path(name).name.startswith(".")]


@pytest.mark.parametrize("out", ["here/", "here", "here/r.csv"])
def test_a_folder_in_a_files_place_gets_the_file(out: str, capsys: pytest.CaptureFixture[str]) -> None:
    gx.run("reference-1dof", duration=0.02, out="a")
    if out == "here":
        Path(out).mkdir()
    path = "here/r.csv" if out.endswith(".csv") else "here/recording.csv"
    assert main(["export", "a", "--out", out]) == 0
    assert capsys.readouterr().out == f"wrote {path}\n" and Path(path).is_file()
    if path != out:
        assert main(["picture", "a", "--out", out]) == 0
        assert capsys.readouterr().out == "wrote here/picture.png\n"


@pytest.mark.parametrize("subject", ["a", "reference-1dof"])
def test_a_pictures_ending_is_refused_by_the_path_that_was_typed(
    subject: str, capsys: pytest.CaptureFixture[str]
) -> None:
    gx.run("reference-1dof", duration=0.02, out="a")
    assert main(["picture", subject, "--out", "x.xyz"]) == 2
    assert capsys.readouterr().err.startswith("path: given 'x.xyz', expected a file that ends in ")


@pytest.mark.parametrize("time", ["100", "-1"])
def test_a_picture_of_a_scene_is_of_a_time_that_it_takes(time: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["picture", "mug", "--time", time]) == 2
    error = capsys.readouterr().err
    assert "a time from 0 to 2.5 s, the duration of the scene; to extend the run, add --set duration" in error
    assert not Path("out").exists()


def test_pictures_of_scenes_have_folders_of_their_own(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["picture", "reference-1dof", "--time", "0.1"]) == 0
    assert main(["picture", "reference-1dof", "--time", "0.2"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "wrote out/reference-1dof/picture.png",
        "wrote out/reference-1dof-2/picture.png",
    ]
    assert not Path("out/latest").exists()  # of runs


def test_run_and_save_from_python_take_overwrite() -> None:
    scene = gx.load("reference-1dof")
    rec = gx.run(scene, duration=0.05, out="a")
    before = files()
    with pytest.raises(RecordingError, match=r"a/recording\.h5: exists already; .* overwrite=True"):
        gx.run(scene, duration=0.1, out="a")
    with pytest.raises(RecordingError, match="exists already"):
        rec.save("a/recording.h5")
    assert files() == before
    assert len(gx.run(scene, duration=0.1, out="a", overwrite=True)) == 20
    rec.save("a/recording.h5", overwrite=True)
    assert len(gx.Recording.load("a")) == 10


@pytest.fixture
def make(tmp_path: Path) -> list[str]:
    """A command `make` in a copy of what it reads, with an environment whose programs are these, and quick ones."""
    if shutil.which("make") is None or os.name != "posix":
        pytest.skip("make and a shell are what is tested here")
    venv = tmp_path / "environment"
    (venv / "bin").mkdir(parents=True)
    (tmp_path / "docs" / "pictures" / "scenes").mkdir(parents=True)
    for name in ("Makefile", "pyproject.toml", "docs/scenes.md"):
        shutil.copy(ROOT / name, tmp_path / name)
    python = f"#!/bin/sh\nexport PYTHONPATH={ROOT}\n"
    quick = f'{python}case "$1" in run) shift; set -- run "$@" --duration 0.1 --no-figure;; esac\n'
    (venv / "bin" / "graspfx").write_text(f'{quick}exec {sys.executable} -m graspfx "$@"\n')
    (venv / "bin" / "python").write_text("#!/bin/sh\necho reference-1dof\n")  # which asks for the shelf
    for program in (venv / "bin").iterdir():
        program.chmod(0o755)
    (venv / ".ready-to-run").touch()
    return ["make", "-C", str(tmp_path), f"VENV={venv}", "OUT=results"]


def again(make: list[str], target: str, names: list[str]) -> str:
    """Rewrite a target's output to that of its second run, when its files are there."""
    for name in names:
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_bytes(b"of the first time")
    done = subprocess.run([*make, target], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert all(Path(name).stat().st_size > 1000 for name in names)
    return done.stdout


def test_the_demo_works_a_second_time(make: list[str]) -> None:
    runs = [f"results/{run}/recording.h5" for run in ("conventional", "proposed")]
    assert "wrote results/comparison.png" in again(make, "demo", [*runs, "results/comparison.png"])
    assert len(gx.Recording.load("results/proposed")) == 20


def test_pictures_of_the_shelf_are_drawn_a_second_time(make: list[str]) -> None:
    assert "wrote docs/" in again(make, "pictures", ["docs/pictures/scenes/reference-1dof.png"])
