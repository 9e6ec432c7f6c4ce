"""Other Pythons: where they are looked for, which tests they are tried with, and the versions that are pinned."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from packaging.markers import default_environment
from packaging.requirements import Requirement

from tests.support import interpreters

ROOT = Path(__file__).parents[2]
LOCK = ROOT / ".ci" / "requirements.txt"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
THIS = f"{sys.version_info.major}.{sys.version_info.minor}"
PLACES = {
    "Linux, x86-64": {"sys_platform": "linux", "platform_machine": "x86_64"},
    "macOS": {"sys_platform": "darwin", "platform_machine": "arm64"},
    "Windows": {"sys_platform": "win32", "platform_machine": "AMD64", "os_name": "nt"},
}


def test_the_part_has_a_file_of_every_folder_of_tests() -> None:
    files, tests = interpreters.part(), ROOT / "tests"
    assert [file for file in files if not (ROOT / file).is_file()] == []
    assert len({*files}) == len(files)
    folders = {path.relative_to(tests).parts[0] for path in tests.rglob("test_*.py") if path.parent != tests}
    assert {Path(file).parts[1] for file in files} == folders


def test_a_python_that_is_here_is_found_and_none_is_made_up(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A name on the PATH that runs nothing, as pyenv leaves them, is passed over."""
    bin = tmp_path / "bin"
    bin.mkdir()
    for name, text in (("python3.97", "#!/bin/sh\nexit 127\n"), ("python3.98", "#!/bin/sh\necho 3.11\n")):
        (bin / name).write_text(text, encoding="utf-8")
        (bin / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(bin))
    monkeypatch.setenv("PYENV_ROOT", str(tmp_path))
    assert [interpreters.interpreter(version) for version in ("3.97", "3.98", "3.99")] == [None, None, None]
    versions = tmp_path / "versions" / f"{THIS}.0" / "bin"
    versions.mkdir(parents=True)
    (versions / f"python{THIS}").write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n', encoding="utf-8")
    (versions / f"python{THIS}").chmod(0o755)
    assert interpreters.interpreter(THIS) == str(versions / f"python{THIS}")


def pinned() -> list[Requirement]:
    lines = LOCK.read_text(encoding="utf-8").splitlines()
    return [Requirement(line) for line in lines if line and not line.lstrip().startswith("#")]


def test_the_lock_pins_each_package_once_and_names_no_host() -> None:
    assert re.search(r"https?:|--index|--find-links|@", LOCK.read_text(encoding="utf-8")) is None
    assert all(re.fullmatch(r"==[^*,]+", str(each.specifier)) and not each.url for each in pinned())


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("version", ["3.11", "3.12", "3.13"])
def test_the_lock_covers_what_pyproject_asks_for(version: str, place: str) -> None:
    environment: dict[str, Any] = {
        **default_environment(),
        "python_version": version,
        "python_full_version": f"{version}.4",
    }
    environment |= PLACES[place]
    here: dict[str, str] = {}
    for each in pinned():
        if each.marker is None or each.marker.evaluate(environment):
            assert each.name not in here, f"{each.name} is pinned twice"
            here[each.name] = str(each.specifier).removeprefix("==")
    extras = PROJECT["optional-dependencies"].values()
    for text in (*PROJECT["dependencies"], *(each for extra in extras for each in extra)):
        wish = Requirement(text)
        if wish.marker is None or wish.marker.evaluate(environment):
            name = re.sub(r"[-_.]+", "-", wish.name).lower()
            assert wish.specifier.contains(here[name], prereleases=True), f"{wish}: {here[name]}; make lock"
