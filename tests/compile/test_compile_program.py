"""Programs that are kept are those of the kernels at hand, whatever these took their numbers from."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from graspfx.compile import program

DRIVER = """
from pathlib import Path

import {shared}

GAIN = float((Path(__file__).parent / "gain").read_text())


def kernel(S, o):
    S[o] = {factor} * GAIN + {shared}.OFFSET
    return 0
"""
ASK = """
import sys

sys.path[:0] = sys.argv[1:]
import driver

from graspfx.compile.program import program_source

text = "def run(k, count, r):\\n    kernel(a, 0)\\n    return 0"
print(program_source(text, {"kernel": driver.kernel}, ["a"]))
"""


@pytest.fixture
def folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two environments, each with a driver of the same name, and what both import."""
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", str(Path(program.__file__).parents[2]))
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    for name, factor in (("one", "2.0"), ("other", "7.0")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "driver.py").write_text(DRIVER.format(shared="offsets", factor=factor))
        (tmp_path / name / "gain").write_text("1.5")
    (tmp_path / "shared").mkdir()
    (tmp_path / "shared" / "offsets.py").write_text("OFFSET = 0.25\n")
    return tmp_path


def entry(folders: Path, name: str) -> float:
    """Give the text that the program writes in an environment."""
    places = [str(folders / name), str(folders / "shared")]
    out = subprocess.run([sys.executable, "-c", ASK, *places], capture_output=True, text=True, check=True).stdout
    found: float = eval(out.partition("S[o] = ")[2].splitlines()[0])
    return found


def programs(folders: Path) -> list[Path]:
    """List what is in the cache, the digest of the package's sources apart."""
    return [path for path in (folders / "cache").iterdir() if not path.name.startswith("sources-")]


def test_numbers_that_a_module_read_are_those_of_now(folders: Path) -> None:
    assert entry(folders, "one") == entry(folders, "one") == 3.25
    (folders / "one" / "gain").write_text("5.0")
    assert entry(folders, "one") == 10.25
    (folders / "shared" / "offsets.py").write_text("OFFSET = 0.5\n")
    assert entry(folders, "one") == 10.5
    assert len(programs(folders)) == 1


def test_a_driver_of_the_same_name_elsewhere_is_another(folders: Path) -> None:
    assert entry(folders, "one") == 3.25
    assert entry(folders, "other") == 10.75
    assert entry(folders, "one") == 3.25
    assert len(programs(folders)) == 2
