"""A scene that is run again is the same scene and the same run; whatever could change it makes it be checked anew."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from graspfx import plugins
from graspfx.__main__ import main
from graspfx.build.scene_cache import KeptTable, _read, _written, cached, place
from graspfx.compile import cache
from graspfx.loop.recording.record import Recording
from graspfx.scene.load import load

TABLES = sorted(path.stem for path in plugins.shelf("scenes").glob("*.toml"))


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of each test's own, and a current folder."""
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    return tmp_path / "cache"


def is_kept(name: str, **overrides: object) -> bool:
    where = place(name, overrides)
    return where is not None and cached(where) is not None


def run(name: str, *more: str) -> int:
    return main(["run", name, "--no-figure", "--duration", "0.05", *more])


def written(name: str) -> Path:
    """The reference scene as a file of one's own."""
    path = Path(name)
    path.write_text((plugins.shelf("scenes") / "reference-1dof.toml").read_text(encoding="utf-8"), encoding="utf-8")
    return path


def alike(table: object, other: object) -> bool:
    if isinstance(table, KeptTable):
        fields = {name: value for name, value in vars(table).items() if name != "_settings"}
        same = all(alike(value, getattr(other, name)) for name, value in fields.items())
        return same and table.settings == getattr(other, "settings", {})
    if isinstance(table, dict) and isinstance(other, dict):
        return table.keys() == other.keys() and all(alike(value, other[key]) for key, value in table.items())
    if isinstance(table, tuple | list):
        return type(table) is type(other) and all(map(alike, table, other)) and len(table) == len(other)
    return type(table) is type(other) and table == other


@pytest.mark.parametrize("name", TABLES)
def test_every_field_comes_back(name: str) -> None:
    scene = load(name)
    found = _read(_written(scene))
    assert {*type(scene).model_fields} <= {*vars(found)}
    assert alike(found, scene)


@pytest.mark.parametrize("name", TABLES)
def test_the_second_run_is_the_first(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = []
    for folder in ("run-1", "run-2"):
        assert run(name, "--out", folder) == 0
        texts = capsys.readouterr()
        table = re.sub(r"(wall time|ticks per second|cost per tick).*", "", texts.out.replace(folder, ""))
        said.append((table, texts.err))
    assert said[0] == said[1]
    first, second = (Recording.load(folder) for folder in ("run-1", "run-2"))
    assert np.array_equal(first.rows, second.rows, equal_nan=True)
    assert first.layout == second.layout
    for key in set(vars(first.header)) - {"created"}:
        assert getattr(first.header, key) == getattr(second.header, key), key
    assert is_kept(name) == all(
        thing.dynamics == "native" and getattr(thing.shape, "kind", None) != "mesh" for thing in load(name).object
    )


def test_a_scene_with_overrides_is_another() -> None:
    assert run("reference-1dof", "--set", "object.mass=0.2") == 0
    assert is_kept("reference-1dof", **{"object.mass": 0.2})
    assert not is_kept("reference-1dof")
    assert not is_kept("reference-1dof", **{"object.mass": 0.3})
    assert not is_kept("reference-1dof", **{"object.mass": "0.2"})


def test_a_file_that_changed_is_checked_anew(capsys: pytest.CaptureFixture[str]) -> None:
    path = written("own.toml")
    assert run("own.toml") == 0
    assert is_kept("own.toml")
    stamp = path.stat()
    path.write_text(path.read_text().replace("mass = 0.1 ", "mass = 0.0 "))
    os.utime(path, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))  # as fast as a clock's tick
    assert run("own.toml") == 2
    assert "object.mass: expected more than 0" in capsys.readouterr().err
    assert run("own.toml") == 2  # what is wrong is never kept


def test_a_driver_that_changed_is_asked_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shelf = tmp_path / "devices"
    shelf.mkdir()
    (shelf / "simulated.py").write_text("from graspfx.devices.simulated import connect\n")
    real = plugins.shelf
    monkeypatch.setattr(plugins, "shelf", lambda group: shelf if group == "devices" else real(group))
    assert run("reference-1dof") == 0
    assert is_kept("reference-1dof")
    (shelf / "simulated.py").write_text("from graspfx.devices.simulated import connect\n\n")
    assert not is_kept("reference-1dof")


def test_what_is_installed_later_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run("reference-1dof") == 0
    assert is_kept("reference-1dof")
    info = tmp_path / "site" / "acme-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme\nVersion: 1.0\n")
    monkeypatch.setattr(sys, "path", [*sys.path, str(info.parent)])
    assert not is_kept("reference-1dof")


@pytest.mark.parametrize(
    "override",
    [
        "object.shape={ mesh = 'ball.stl' }",
        "finger.0.hand={ kind = 'mine.py' }",
        "finger.0.hand.motion={ kind = 'path', file = 'path.csv' }",
        "finger.0.device.name='mine.py'",
    ],
)
def test_scenes_that_name_other_files_are_not_kept(override: str) -> None:
    Path("mine.py").write_text(
        "from graspfx.devices.simulated import connect\n"
        "from graspfx.loop.hand import Hand\n"
        "def hold(rest): return Hand(rest, 10.0)\n"
    )
    Path("path.csv").write_text("t,x\n0,0\n1,0\n")
    written("own.toml")
    code = run("own.toml", "--set", override)
    assert code == 2 if "mesh" in override else code == 0
    files = [path for path in Path("cache").glob("*") if not path.name.startswith("lowered-")]  # lowered kernels may be
    assert files == []


def test_python_scenes_are_not_kept() -> None:
    assert place("prism", {}) is None


def test_what_was_damaged_is_checked_anew(folder: Path) -> None:
    assert run("reference-1dof") == 0
    where = place("reference-1dof", {})
    assert where is not None
    (file,) = folder.iterdir()
    file.write_bytes(file.read_bytes()[:-7])
    assert cached(where) is None
    assert run("reference-1dof") == 0
    assert cached(where) is not None


def test_a_folder_that_cannot_be_written_stops_no_run(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("taken").touch()
    monkeypatch.setenv("GRASPFX_CACHE", str(Path("taken").resolve()))
    assert "nothing can be kept in" in cache.store("key", b"")
    assert run("reference-1dof") == 0
    assert not is_kept("reference-1dof")
