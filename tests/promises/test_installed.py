"""Installed distributions, against importlib.metadata."""

from __future__ import annotations

import sys
import zipfile
from importlib import metadata
from pathlib import Path

import pytest

from graspfx import installed


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A place where packages are installed, the only one."""
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    return tmp_path


def install(site: Path, name: str, version: str, announced: str = "") -> Path:
    info = site / f"{name}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n", encoding="utf-8")
    if announced:
        (info / "entry_points.txt").write_text(announced, encoding="utf-8")
    return info


def test_versions_are_those_of_importlib() -> None:
    for each in metadata.distributions():
        assert installed.version(each.name) == metadata.version(each.name), each.name
    assert installed.version("no-such-package") is None


def test_a_name_is_found_however_it_is_spelt(site: Path) -> None:
    install(site, "Acme_Haptics", "2.0rc1")
    install(site, "acme_haptics_more", "9.9")
    assert installed.version("acme-haptics") == "2.0rc1"
    assert installed.version("acme.haptics") == "2.0rc1"
    assert installed.version("acme") is None


def test_entry_points_are_seen_from_when_they_are_there_until_they_are_gone(site: Path) -> None:
    install(site, "other", "1.0", "[console_scripts]\nother = other:main\n")
    assert installed.entry_points("graspfx.devices") == ()
    info = install(site, "acme", "1.2", "[graspfx.devices]\nthumb = acme.thumb\n")
    assert installed.entry_points("graspfx.devices") == (("thumb", "acme.thumb", "acme 1.2"),)
    assert installed.entry_points("graspfx.hands") == ()
    (info / "entry_points.txt").unlink()
    (info / "METADATA").unlink()
    info.rmdir()
    assert installed.entry_points("graspfx.devices") == ()


def test_what_folders_do_not_tell_importlib_does(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with zipfile.ZipFile(site / "acme.zip", "w") as archive:
        archive.writestr("acme-3.0.dist-info/METADATA", "Metadata-Version: 2.1\nName: acme\nVersion: 3.0\n")
        archive.writestr("acme-3.0.dist-info/entry_points.txt", "[graspfx.hands]\nglove = acme.glove\n")
    monkeypatch.setattr(sys, "path", [str(site / "acme.zip")])
    assert installed.distributions() is None
    assert installed.entry_points("graspfx.hands") == (("glove", "acme.glove", "acme 3.0"),)
    assert installed.version("acme") == "3.0"


def test_another_finder_is_asked_too(monkeypatch: pytest.MonkeyPatch) -> None:
    class Finder:
        @staticmethod
        def find_spec(name: str, path: object = None, target: object = None) -> None:
            return None

        @staticmethod
        def find_distributions(context: object) -> list[metadata.Distribution]:
            return []

    monkeypatch.setattr(sys, "meta_path", [Finder, *sys.meta_path])
    assert installed.distributions() is None
    assert installed.version("numpy") == metadata.version("numpy")
