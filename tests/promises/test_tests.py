"""Tests import helpers from `tests.support` only, never one another, and no name of a file stands twice."""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

import pytest

from tests.support import slow

TESTS = Path(__file__).parents[1]
FILES = sorted(TESTS.rglob("*.py"))
SUPPORT = "tests.support"


def modules(file: Path) -> set[str]:
    """Return the modules that a file imports, wherever in it the statement stands."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {each.name for each in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f"{node.module}.{each.name}" for each in node.names}
    return names


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.relative_to(TESTS).as_posix())
def test_helpers_stand_in_support(file: Path) -> None:
    foreign = [name for name in modules(file) if name.split(".")[0] == "tests" and not name.startswith(f"{SUPPORT}.")]
    bare = {name.split(".")[0] for name in modules(file)} & {each.stem for each in FILES}
    assert not foreign and not bare


def test_a_file_is_a_test_or_helps_several() -> None:
    """`conftest.py` and the report of the stress tests are the only others."""
    others = [file.relative_to(TESTS).as_posix() for file in FILES if not file.name.startswith("test_")]
    assert [name for name in others if not name.startswith("support/")] == ["conftest.py", "stress/report.py"]


def test_no_name_of_a_file_stands_twice() -> None:
    assert [name for name, count in Counter(file.name for file in FILES).items() if count > 1] == []


def test_folders_are_the_rooms() -> None:
    """Beside them stand laws, oracles, the paper's claims, promises, sweeps and faults, which belong to no room."""
    root = TESTS.parent
    own = {"laws", "oracles", "paper", "promises", "stress", "faults", "support"}
    folders = {file.parent.relative_to(TESTS) for file in FILES} - {Path()}
    rooms = {folder for folder in folders if (root / "graspfx" / folder).is_dir() or (root / folder).is_dir()}
    assert {folder.as_posix() for folder in folders - rooms} == own


def test_what_make_fast_leaves_out_is_there() -> None:
    for name in slow.means():
        path, _, test = name.partition("::")
        text = (slow.ROOT / path).read_text(encoding="utf-8")
        assert path.endswith(".md") or f"def {test}(" in text, f"{name}: measure anew with `make durations`"
