"""A scene that is run again is the same scene and the same run; whatever could change it makes it be checked anew."""

from __future__ import annotations

import os
import pickle
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from graspfx import plugins
from graspfx.__main__ import main
from graspfx.assembly import meshes
from graspfx.assembly.resolve import resolve
from graspfx.assembly.scene_cache import KeptTable, _kept, cached, place
from graspfx.compile import cache
from graspfx.recording.record import Recording
from graspfx.scene.load import load

TABLES = sorted(path.stem for path in plugins.shelf("scenes").glob("*.toml"))


@pytest.fixture(autouse=True)
def folder(new_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of each test's own, and a current folder."""
    monkeypatch.chdir(tmp_path)
    return new_cache


def is_kept(name: str, **overrides: object) -> bool:
    where = place(name, overrides)
    return where is not None and cached(where) is not None


def scene_files(folder: Path) -> list[Path]:
    """List the cache's files of scenes; programs and their sources are kept there too."""
    return sorted(path for path in folder.glob(f"*{cache.SUFFIX}") if b"KeptTable" in path.read_bytes())


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
    found = pickle.loads(pickle.dumps(_kept(scene)))
    assert {*type(scene).model_fields} <= {*vars(found)}
    assert alike(found, scene)


@pytest.mark.parametrize("name", TABLES)
def test_the_second_run_is_the_first(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = []
    for folder in ("run-1", "run-2"):
        assert run(name, "--out", folder) == 0
        texts = capsys.readouterr()
        table = re.sub(r"(wall time|ticks per second|cost per tick|tick engine).*", "", texts.out.replace(folder, ""))
        said.append((re.sub("[ ━]+", " ", table), texts.err))  # columns are as wide as those times need
    assert said[0] == said[1]
    first, second = (Recording.load(folder) for folder in ("run-1", "run-2"))
    assert np.array_equal(first.rows, second.rows, equal_nan=True)
    assert first.layout == second.layout
    for key in set(vars(first.header)) - {"created"}:
        assert getattr(first.header, key) == getattr(second.header, key), key
    assert is_kept(name)


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
    assert "mass: expected more than 0" in capsys.readouterr().err
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


@pytest.mark.parametrize("override", ["finger.0.hand={ kind = 'mine.py' }", "finger.0.device.name='mine.py'"])
def test_scenes_that_name_code_are_not_kept(override: str, folder: Path) -> None:
    Path("mine.py").write_text(
        "from graspfx.devices.simulated import connect\n"
        "from graspfx.loop.hand import Hand\n"
        "def hold(rest): return Hand(rest, 10.0)\n"
    )
    written("own.toml")
    assert run("own.toml", "--set", override) == 0
    assert scene_files(folder) == []
    assert run("own.toml") == 0
    assert len(scene_files(folder)) == 1 and is_kept("own.toml")  # without the code it is


def test_a_mesh_that_changed_is_seen_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    """The file's time and size stay: its content alone tells."""
    shelf = plugins.shelf("scenes")
    text = (shelf / "thin-plate.toml").read_text(encoding="utf-8")
    Path("own.toml").write_text(text.replace("meshes/plate.ply", "plate.ply"), encoding="utf-8")
    mesh = Path("plate.ply")
    mesh.write_bytes((shelf / "meshes/plate.ply").read_bytes())
    assert run("own.toml", "--out", "first") == 0 and is_kept("own.toml")
    stamp, content = mesh.stat(), mesh.read_bytes()
    start = content.index(b"end_header\n") + len(b"end_header\n")
    corners = np.frombuffer(content, "<f4", 24, start).reshape(8, 3) * np.array([1.0, 1.0, 1.01], "<f4")
    mesh.write_bytes(content[:start] + corners.tobytes() + content[start + corners.nbytes :])
    os.utime(mesh, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    assert mesh.stat().st_size == stamp.st_size and not is_kept("own.toml")
    meshes._read.cache_clear()  # as in another process
    assert run("own.toml", "--out", "second") == 0 and is_kept("own.toml")
    first, second = (Recording.load(folder) for folder in ("first", "second"))
    assert not np.array_equal(first.rows, second.rows, equal_nan=True)
    mesh.write_bytes(content)
    meshes._read.cache_clear()
    assert run("own.toml", "--out", "third") == 0
    assert np.array_equal(first.rows, Recording.load("third").rows, equal_nan=True)
    mesh.write_bytes(content[:-5])
    capsys.readouterr()
    assert run("own.toml", "--out", "fourth") == 2
    assert "object.shape.mesh" in capsys.readouterr().err


def test_a_path_that_changed_is_seen_at_once() -> None:
    written("own.toml")
    override = "finger.0.hand.motion={ kind = 'path', file = 'path.csv' }"
    path = Path("path.csv")
    rows = []
    for way in ("0.001", "0.002"):
        path.write_text(f"t,x\n0,0\n0.05,{way}\n")
        os.utime(path, ns=(0, 0))
        assert run("own.toml", "--set", override, "--out", way) == 0
        rows.append(Recording.load(way).rows)
        assert is_kept("own.toml", **{"finger.0.hand.motion": {"kind": "path", "file": "path.csv"}})
    assert not np.array_equal(rows[0], rows[1], equal_nan=True)


def test_a_scene_that_was_trusted_is_not_from_then_on(capsys: pytest.CaptureFixture[str]) -> None:
    Path("inside").mkdir()
    text = (plugins.shelf("scenes") / "reference-1dof.toml").read_text(encoding="utf-8")
    hand = "hand = { stiffness = 33.0, rest = [0.0], motion = { kind = 'path', file = '../path.csv' } }"
    assert "hand = { stiffness = 33.0, rest = [0.0] }" in text
    Path("inside/own.toml").write_text(text.replace("hand = { stiffness = 33.0, rest = [0.0] }", hand), "utf-8")
    Path("path.csv").write_text("t,x\n0,0\n1,0\n")
    assert run("inside/own.toml", "--trust") == 0
    capsys.readouterr()
    assert run("inside/own.toml") == 2
    assert "outside of the scene's folder" in capsys.readouterr().err


def forget() -> None:
    """Forget the meshes that this process has read."""
    meshes._read.cache_clear()
    meshes._scene_mesh.cache_clear()


@pytest.mark.parametrize("name", ["mug", "thin-plate", "prism"])
def test_a_mesh_from_the_cache_is_the_mesh(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every array has the same bits, and nothing loads trimesh again."""
    forget()  # what another test has read
    [first] = [part.solid.mesh for part in resolve(load(name)).objects]
    assert first is not None
    forget()
    monkeypatch.setattr("graspfx.surfaces.triangles.mesh_file.import_module", lambda name: pytest.fail(name))
    [second] = [part.solid.mesh for part in resolve(load(name)).objects]
    assert second is not None and second is not first
    assert second.mesh.notes == first.mesh.notes and second.unit.mass == first.unit.mass
    for table in ("mesh", "unit"):
        one, other = getattr(first, table), getattr(second, table)
        for key in {*vars(one), *(("data",) if table == "mesh" else ())} - {"notes", "shell", "mass"}:
            assert getattr(one, key).tobytes() == getattr(other, key).tobytes(), key
            assert getattr(other, key).flags.writeable == getattr(one, key).flags.writeable


def test_python_scenes_are_not_kept_as_files() -> None:
    assert place("prism", {}) is None


def test_a_python_scene_runs_every_time_and_a_change_is_seen_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    """The mass comes from another file, of which nobody can know."""
    path = Path("own.py")
    path.write_text(
        "import graspfx as gx\nfrom pathlib import Path\n"
        "def scene():\n"
        "    mass = float(Path('mass.txt').read_text())\n"
        "    return gx.load('reference-1dof').replace({'object.mass': mass})\n"
    )
    masses = ["0.1", "0.2", "0.1", "-1"]
    for k, mass in enumerate(masses):
        Path("mass.txt").write_text(mass)
        code = run("own.py", "--out", f"run-{k}")
        assert code == (2 if mass == "-1" else 0)
    assert "mass: expected more than 0" in capsys.readouterr().err
    rows = [Recording.load(f"run-{k}").rows for k in range(3)]
    assert np.array_equal(rows[0], rows[2], equal_nan=True) and not np.array_equal(rows[0], rows[1], equal_nan=True)


def test_what_was_damaged_is_checked_anew(folder: Path) -> None:
    assert run("reference-1dof") == 0
    where = place("reference-1dof", {})
    assert where is not None
    (file,) = scene_files(folder)
    assert file.stem == where.key
    file.write_bytes(file.read_bytes()[:-7])
    assert cached(where) is None
    assert run("reference-1dof") == 0
    assert cached(where) is not None


def test_a_folder_that_cannot_be_written_stops_no_run(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("taken").touch()
    monkeypatch.setenv("GRASPFX_CACHE", str(Path("taken").resolve()))
    assert "cannot write to the cache" in cache.store("key", b"")
    assert run("reference-1dof", "--set", "engine=interpreted") == 0  # to compile anew without a cache takes a minute
    assert not is_kept("reference-1dof")
