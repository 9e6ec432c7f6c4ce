"""Plug-ins are found by path, on the shelf and in other distributions, and listing imports none of them."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from graspfx import plugins
from graspfx.errors import InputError, UnknownNameError

ROOT = Path(__file__).parents[2]
DRIVER = "MARK = {mark!r}\ndef connect(**settings): return settings\n"


@pytest.fixture
def shelf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A shelf of our own, so that these tests do not depend on what ships."""
    folder = tmp_path / "shelf"
    folder.mkdir()
    monkeypatch.setattr(plugins, "shelf", lambda group: folder)
    return folder


@pytest.fixture
def acme(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Another distribution, as installed: a driver that would explode if imported, one that works, and two scenes."""
    site = tmp_path / "site"
    package = site / "acme_haptics"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / "thumb.py").write_text(DRIVER.format(mark="acme"))
    (package / "bomb.py").write_text("raise RuntimeError('imported')\n")
    (package / "stack.toml").write_text("period = 0.001\n")
    (package / "tower.py").write_text("def scene(): ...\n")
    info = site / "acme_haptics-1.2.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme-haptics\nVersion: 1.2\n")
    (info / "entry_points.txt").write_text(
        "[graspfx.devices]\nthumb = acme_haptics.thumb\nbomb = acme_haptics.bomb\n"
        "[graspfx.scenes]\nstack = acme_haptics.stack\ntower = acme_haptics.tower\nlost = acme_haptics.lost\n"
        "[graspfx.dynamics]\nsoft = acme_haptics.thumb\n[graspfx.hands]\nglove = acme_haptics.thumb\n"
    )
    monkeypatch.syspath_prepend(str(site))
    yield package
    for name in [name for name in sys.modules if name.startswith("acme_haptics")]:
        del sys.modules[name]


def test_the_shelf_names_files_with_hyphens_and_hides_those_with_an_underscore(shelf: Path) -> None:
    for name in ("two_link.py", "_board.py", "__init__.py", ".hidden.py", "notes.txt", "table.toml"):
        (shelf / name).touch()
    assert plugins.names("devices").keys() == {"two-link"}
    assert plugins.names("devices")["two-link"] == "GraspFX (devices/two_link.py)"
    assert plugins.names("scenes").keys() == {"two-link", "table"}


def test_a_name_on_the_shelf_leads_to_its_file(shelf: Path) -> None:
    (shelf / "paper-waving.toml").touch()
    assert plugins.find("scenes", "paper-waving") == shelf / "paper-waving.toml"


def test_drivers_that_ship_load_as_submodules_of_the_package() -> None:
    loaded = [plugins.load("devices", name) for name, origin in plugins.names("devices").items() if "GraspFX" in origin]
    assert loaded
    assert all(module.__name__.startswith("graspfx.devices.") and callable(module.connect) for module in loaded)
    assert "devices.two_link" not in sys.modules  # the file has one name


def test_a_path_needs_no_shelf_and_loads_once(tmp_path: Path) -> None:
    driver = tmp_path / "my-driver.py"
    driver.write_text("from dataclasses import dataclass\n@dataclass\nclass Arm:\n    mass: 'float' = 0.1\n")
    module = plugins.load("devices", driver)
    assert plugins.find("devices", str(driver)) == driver
    assert plugins.load("devices", str(driver)) is module  # one class for two devices of the same driver
    assert module.__name__ != "my-driver"
    assert module.Arm().mass == 0.1


def test_a_file_that_changed_is_loaded_anew(tmp_path: Path) -> None:
    driver = tmp_path / "driver.py"
    driver.write_text(DRIVER.format(mark="old"))
    assert plugins.load("devices", driver).MARK == "old"
    driver.write_text(DRIVER.format(mark="newer"))
    assert plugins.load("devices", driver).MARK == "newer"


def test_two_files_of_one_name_are_two_modules(tmp_path: Path) -> None:
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        (tmp_path / side / "arm.py").write_text(DRIVER.format(mark=side))
    assert [plugins.load("devices", tmp_path / side / "arm.py").MARK for side in ("left", "right")] == ["left", "right"]


def test_a_file_that_fails_leaves_no_half_loaded_module(tmp_path: Path) -> None:
    driver = tmp_path / "half_loaded.py"
    driver.write_text("raise OSError('no such port')\n")
    for _ in range(2):
        with pytest.raises(OSError, match="no such port"):
            plugins.load("devices", driver)
    assert not [name for name in sys.modules if "half_loaded" in name]


def test_a_relative_path_starts_where_it_is_told(tmp_path: Path) -> None:
    (tmp_path / "arm.py").write_text(DRIVER.format(mark="here"))
    assert plugins.load("devices", "arm.py", folder=tmp_path).MARK == "here"


def test_an_entry_point_of_another_distribution(acme: Path) -> None:
    assert plugins.names("devices")["thumb"] == "acme-haptics 1.2 (acme_haptics.thumb)"
    assert plugins.load("devices", "thumb").MARK == "acme"
    assert plugins.load("dynamics", "soft").MARK == "acme"
    assert plugins.names("hands") == {"glove": "acme-haptics 1.2 (acme_haptics.thumb)"}
    assert plugins.load("hands", "glove").MARK == "acme"


def test_an_entry_point_may_be_a_scene_in_toml_or_python(acme: Path) -> None:
    assert plugins.find("scenes", "stack") == acme / "stack.toml"
    assert plugins.find("scenes", "tower") == acme / "tower.py"
    with pytest.raises(InputError, match="lost"):
        plugins.find("scenes", "lost")


def test_listing_imports_no_plugin(acme: Path) -> None:
    code = (
        f"import sys; sys.path[:0] = [{str(ROOT)!r}, {str(acme.parent)!r}]\n"
        "from graspfx import plugins\n"
        "listed = {group: plugins.names(group) for group in ('devices', 'hands', 'scenes', 'dynamics')}\n"
        "assert 'bomb' in listed['devices'] and {'native', 'bullet'} <= listed['dynamics'].keys()\n"
        "print(*sorted(n for n in sys.modules if n.startswith(('graspfx', 'acme', 'numpy', 'pybullet'))))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == [
        "graspfx",
        "graspfx.environment",
        "graspfx.errors",
        "graspfx.installed",
        "graspfx.plugins",
        "graspfx.system",
        "graspfx.system.c_library",
        "graspfx.system.scheduling",
    ]


def test_an_unknown_name_gets_the_closest_one(shelf: Path) -> None:
    (shelf / "two_link.py").touch()
    with pytest.raises(UnknownNameError, match="unknown device 'two_link'; did you mean 'two-link'"):
        plugins.load("devices", "two_link")


def test_an_unknown_name_gets_the_closest_file_too(tmp_path: Path) -> None:
    (tmp_path / "cone.toml").touch()
    with pytest.raises(UnknownNameError, match=r"unknown scene 'cnoe' .*; there is a file cone\.toml"):
        plugins.find("scenes", "cnoe", tmp_path)


def test_two_plugins_of_one_name_are_refused_by_both_names(shelf: Path, acme: Path) -> None:
    (shelf / "thumb.py").touch()
    with pytest.raises(InputError, match=r"devices/thumb\.py.* and acme-haptics 1\.2"):
        plugins.find("devices", "thumb")
    assert " and " in plugins.names("devices")["thumb"]


def test_a_path_without_a_file_says_where_it_looked(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=str(tmp_path / "none.toml")):
        plugins.find("scenes", "none.toml", folder=tmp_path)


def test_a_table_is_no_driver_and_cannot_be_imported(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").touch()
    with pytest.raises(InputError, match=r"ends in \.py"):
        plugins.find("devices", tmp_path / "scene.toml")
    with pytest.raises(InputError, match="a TOML file cannot be imported"):
        plugins.load("scenes", tmp_path / "scene.toml")
