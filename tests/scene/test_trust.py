"""A scene file runs Python when it names some: from its folder and below, from elsewhere only if the user says so."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from shutil import copy
from typing import Any

import pytest

import graspfx as gx
from graspfx import environment, plugins
from graspfx.__main__ import main
from graspfx.errors import Fault, GraspFXError, InputError, RecordingError, SceneError
from graspfx.recording.header import KeyChange
from tests.support import foreign_parts

BASE = (plugins.shelf("scenes") / "reference-1dof.toml").read_text(encoding="utf-8")
MARK = "open({!r}, 'a').close()\n"


@pytest.fixture(autouse=True)
def nobody_trusts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(environment.VARIABLE, raising=False)


@pytest.fixture
def places(tmp_path: Path) -> tuple[Path, Path]:
    """The folder of a scene, and another with parts that leave a mark when they run."""
    own, other = tmp_path / "own", tmp_path / "other"
    for place in (own / "below", other):
        place.mkdir(parents=True)
    for place in (own, own / "below", other):
        for name, file in foreign_parts.write(place).items():
            text = Path(file).read_text()
            Path(file).write_text(MARK.format(str(tmp_path / "ran")) + text)
            Path(file).rename(place / f"{name}.py")
        (place / "path.csv").write_text("t,x\n0,0\n1,0\n")
    return own, other


def scene(own: Path, key: str, path: str) -> Path:
    """The reference scene with a part from a path."""
    file, text = own / "scene.toml", BASE
    if key == "device":
        text = text.replace('device = { name = "simulated"', f'device = {{ name = "{path}"', 1)
    elif key == "dynamics":
        text = text.replace("[object]", f'[object]\ndynamics = "{path}"', 1)
    elif key == "motion":
        text = text.replace("hand = {", f'hand = {{ motion = {{ kind = "path", file = "{path}" }},', 1)
    elif key == "hand":
        head, _, rest = text.partition("hand = {")
        text = f'{head}hand = {{ kind = "{path}" }}{rest.partition("}")[2]}'
    assert text != BASE
    file.write_text(text)
    return file


def refused(file: Path, key: str) -> str:
    with pytest.raises(SceneError) as caught:
        gx.load(file)
    faults = [fault for fault in caught.value.faults if "outside of the scene's folder" in fault.message]
    assert len(faults) == 1 and faults[0].line and faults[0].key.split(".")[-1] == key
    assert "--trust" in faults[0].message and "GRASPFX_TRUST" in faults[0].message
    return faults[0].message


KEYS = {"device": ("devices.py", "name"), "dynamics": ("bodies.py", "dynamics"), "hand": ("hands.py", "kind"),
        "motion": ("path.csv", "file")}  # fmt: skip


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("way", ["absolute", "upwards", "link", "linked folder"])
def test_what_is_elsewhere_is_neither_run_nor_read(key: str, way: str, places: tuple[Path, Path]) -> None:
    own, other = places
    name, last = KEYS[key]
    path = {"absolute": str(other / name), "upwards": f"../other/{name}", "link": f"link-{name}"}.get(way, f"up/{name}")
    (own / f"link-{name}").symlink_to(other / name)
    (own / "up").symlink_to(other)
    refused(scene(own, key, path), last)
    assert not (own.parent / "ran").exists()


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("way", ["beside", "below", "absolute", "around"])
def test_what_is_in_the_folder_is_used(key: str, way: str, places: tuple[Path, Path]) -> None:
    own, _ = places
    name = KEYS[key][0]
    path = {"beside": name, "below": f"below/{name}", "absolute": str(own / name)}.get(way, f"../own/below/../{name}")
    load_or_other_faults(scene(own, key, path))
    assert (own.parent / "ran").exists() == (key != "motion")


def load_or_other_faults(file: Path, overrides: dict[str, Any] | None = None) -> None:
    """The parts do not all suit the scene; what matters here is that nobody asks where they come from."""
    faults: tuple[Fault, ...] = ()
    try:
        gx.load(file, overrides)
    except SceneError as error:
        faults = error.faults
    assert not [fault for fault in faults if "outside" in fault.message]


def test_a_user_may_trust(places: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    own, other = places
    file = scene(own, "motion", str(other / "path.csv"))
    assert main(["check", str(file)]) == 2
    assert main(["check", str(file), "--trust"]) == 0
    assert not environment.is_granted()  # it was said for that command
    for value, granted in (("", False), ("0", False), ("1", True)):
        monkeypatch.setenv(environment.VARIABLE, value)
        assert environment.is_granted() == granted
    assert gx.run(file, duration=0.05).finger_force.any()


def test_a_path_that_the_user_gives_is_the_users(places: tuple[Path, Path]) -> None:
    own, other = places
    (own / "scene.toml").write_text(BASE)
    changes = {"object.dynamics": str(other / "bodies.py")}
    load_or_other_faults(own / "scene.toml", changes)
    assert (own.parent / "ran").exists()


def test_what_python_makes_is_python(places: tuple[Path, Path]) -> None:
    own, other = places
    table = gx.load("reference-1dof").to_dict()
    changes = {"object.dynamics": str(other / "bodies.py")}
    (own / "made.py").write_text(
        f"import graspfx as gx\ndef scene(): return gx.Scene(**{table!r}).replace({changes!r})\n"
    )
    gx.load(own / "made.py")
    assert (own.parent / "ran").exists()


def test_meshes_are_of_the_folder_too(tmp_path: Path) -> None:
    own, other = tmp_path / "own", tmp_path / "other"
    own.mkdir()
    other.mkdir()
    text = (plugins.shelf("scenes") / "thin-plate.toml").read_text(encoding="utf-8")
    before = next(line for line in text.splitlines() if "mesh" in line and ".ply" in line)
    name = before.partition('mesh = "')[2].partition('"')[0]
    copy(plugins.shelf("scenes") / name, other / "plate.ply")
    (own / "scene.toml").write_text(text.replace(name, "../other/plate.ply"))
    refused(own / "scene.toml", "mesh")
    (own / "meshes").mkdir()
    (other / "plate.ply").rename(own / "meshes" / "plate.ply")
    (own / "scene.toml").write_text(text.replace(name, "meshes/plate.ply"))
    assert gx.load(own / "scene.toml").object[0].shape is not None


def test_other_faults_are_told_with_it(places: tuple[Path, Path]) -> None:
    own, other = places
    file = scene(own, "device", str(other / "devices.py"))
    file.write_text(file.read_text().replace("viscosity", "viscosty"))
    with pytest.raises(SceneError) as caught:
        gx.load(file)
    assert {"unknown key; did you mean 'viscosity'?"} < {fault.message for fault in caught.value.faults}
    assert not (own.parent / "ran").exists()


def test_the_shelf_and_links_to_a_scene_go_on(tmp_path: Path) -> None:
    for name, origin in plugins.names("scenes").items():
        if origin.startswith("GraspFX") and name in ("mug", "thin-plate", "prism", "paper-waving"):
            gx.load(name)
    (tmp_path / "link.toml").symlink_to(plugins.shelf("scenes") / "thin-plate.toml")
    gx.load(tmp_path / "link.toml")


@pytest.mark.parametrize("key", ["device", "dynamics", "hand"])
@pytest.mark.parametrize("way", ["command", "Python"])
def test_a_recording_runs_no_python_unless_its_user_says_so(
    key: str, way: str, places: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The recording says where its scene was, and so which files are beside it: nobody has chosen that folder."""
    own, _ = places
    rec = gx.run("reference-1dof", duration=0.05)
    table, mark = rec.header.scene_table, own.parent / "ran"
    name = str(own / KEYS[key][0])
    if key == "device":
        table["finger"][0]["device"] = {"name": name, "what": "device", "mass": 0.15, "dimensions": 1}
    elif key == "dynamics":
        table["object"][0]["dynamics"] = name
    else:
        table["finger"][0]["hand"] = {"kind": name, "called": False}
    header = replace(rec.header, scene_table=table, scene_folder=str(own))
    gx.Recording(rec.rows, rec.layout, header, rec.outcome).save(own / "recording.h5")
    assert main(["replay", str(own)]) == 2
    assert "Python files named in a recording" in (said := capsys.readouterr().err)
    assert "--trust" in said and "gx.replay(..., trust=True)" in said
    with pytest.raises(RecordingError, match=r"Python files named in a recording.*trust=True.*--trust"):
        gx.replay(own)
    with pytest.raises(InputError, match="True or False"):  # a word is no consent, whatever it says
        gx.replay(own, trust="no")  # type: ignore[arg-type]
    gx.Recording.load(own).summary()
    assert not mark.exists()
    if way == "command":
        assert main(["replay", str(own), "--trust"]) == (1 if key == "dynamics" else 0)  # another body, other bits
    else:
        assert len(gx.replay(own, trust=True)) == 10
    assert mark.exists()
    assert not environment.is_granted()  # it was said for that call


def test_a_key_that_a_recording_changes_runs_no_python(places: tuple[Path, Path]) -> None:
    own, _ = places
    rec = gx.run("reference-1dof", duration=0.05)
    changes = (KeyChange(3, "object.dynamics", str(own / "bodies.py")),)
    forged = gx.Recording(rec.rows, rec.layout, rec.header, replace(rec.outcome, changes=changes))
    with pytest.raises(GraspFXError):
        gx.replay(forged)
    assert not (own.parent / "ran").exists()
