"""The wheel is the tree, with the shelves inside the package, and nothing has a second copy."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
from hatchling import build

import graspfx
from graspfx import plugins

ROOT = Path(__file__).parents[2]
SHELVES = ("devices", "scenes")


def tree(*folders: str) -> dict[str, bytes]:
    """List the source tree, without what Python, an operating system or an editor leaves there."""
    files = (path for folder in folders for path in (ROOT / folder).rglob("*") if path.is_file())
    kept = (path for path in files if path.suffix != ".pyc" and not path.name.startswith("."))
    return {path.relative_to(ROOT).as_posix(): path.read_bytes() for path in kept}


def contents(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist() if ".dist-info/" not in name}


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A wheel, a source distribution and an editable wheel of the tree, without programs: `make wheel` tries those."""
    folder = tmp_path_factory.mktemp("built")
    (folder / "editable").mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        patch.setenv("GRASPFX_AHEAD", "off")
        return {
            "wheel": folder / build.build_wheel(str(folder)),
            "sdist": folder / build.build_sdist(str(folder)),
            "editable": folder / "editable" / build.build_editable(str(folder / "editable")),
        }


def test_the_wheel_equals_the_tree(built: dict[str, Path]) -> None:
    source = tree("graspfx", *SHELVES)
    expected = {name if name.startswith("graspfx/") else f"graspfx/{name}": data for name, data in source.items()}
    assert contents(built["wheel"]) == expected
    assert "graspfx/py.typed" in expected


def test_the_source_distribution_holds_the_shelves_and_gives_the_same_wheel(
    built: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with tarfile.open(built["sdist"]) as archive:
        archive.extraction_filter = getattr(tarfile, "data_filter", None)  # no argument: 3.11.3 and older know none
        archive.extractall(tmp_path)
    unpacked = tmp_path / f"graspfx-{graspfx.__version__}"
    held = {path.relative_to(unpacked).as_posix() for path in unpacked.rglob("*") if path.is_file()}
    assert tree("graspfx", "tests", "docs", *SHELVES).keys() <= held
    assert {
        "LICENSE",
        "README.md",
        "CHANGELOG.md",
        "CITATION.cff",
        "CONTRIBUTING.md",
        "Makefile",
        "pyproject.toml",
    } <= held
    monkeypatch.chdir(unpacked)
    monkeypatch.setenv("GRASPFX_AHEAD", "off")
    again = tmp_path / build.build_wheel(str(tmp_path))
    assert contents(again) == contents(built["wheel"])


def test_an_editable_installation_copies_nothing(built: dict[str, Path]) -> None:
    assert contents(built["editable"]) == {"_graspfx.pth": str(ROOT).encode()}


def test_an_installed_wheel_finds_its_shelves_inside_the_package(built: dict[str, Path], tmp_path: Path) -> None:
    with zipfile.ZipFile(built["wheel"]) as archive:
        archive.extractall(tmp_path / "site")
    code = (
        "import graspfx, json\n"
        "from graspfx import plugins\n"
        "print(json.dumps([list(graspfx.__path__), str(plugins.shelf('devices')), sorted(plugins.names('scenes'))]))"
    )
    environment = os.environ | {"PYTHONPATH": str(tmp_path / "site")}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path, env=environment
    )
    package = str(tmp_path / "site" / "graspfx")
    scenes = [name for name, origin in plugins.names("scenes").items() if origin.startswith("GraspFX")]
    assert json.loads(done.stdout) == [[package], f"{package}/devices", sorted(scenes)]


def test_this_environment_has_no_second_copy() -> None:
    installed = Path(sysconfig.get_path("purelib"))
    if Path(graspfx.__file__).is_relative_to(installed):
        pytest.skip("GraspFX itself is installed here: its shelves belong in site-packages")
    for stale in (*SHELVES, *(f"graspfx/{shelf}" for shelf in SHELVES)):
        assert not (installed / stale).exists()


def test_readme_installs_without_make() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    section = text.partition("## Install\n")[2].partition("\n## ")[0]
    assert re.search(r"^    pip install \.( |$)", section, re.MULTILINE)
    [extra] = re.findall(r"^    pip install -e '\.\[(\w+)\]'", section, re.MULTILINE)
    assert extra in project["optional-dependencies"]
    assert all(url.startswith("https://") for url in project.get("urls", {}).values())


def test_citation_is_of_this_version_and_of_the_paper_that_the_readme_names() -> None:
    """A year or a DOI, once it is known, has the form of one."""
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    software, _, paper = text.partition("references:")
    assert f"\nversion: {graspfx.__version__}\n" in software and "title: GraspFX" in software
    assert f"## {graspfx.__version__}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    title = re.search(r"title: (.+)", paper)
    assert title is not None and title[1] in (ROOT / "README.md").read_text(encoding="utf-8")
    assert re.findall(r"family-names: (\w+)", paper) == ["Kawai", "Yoshikawa"]
    for key, form in (("year", r"(19|20)\d\d"), ("doi", r"10\.\d{4,}/\S+")):
        for value in re.findall(rf"^\s+{key}: (.+)$", text, re.MULTILINE):
            assert re.fullmatch(form, value)
