"""Documents, and `tests/slow.txt`, that name tests: each such test exists."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.support import slow
from tests.support.hardware import EVIL
from tests.support.rooms import ROOT

NAMED = re.compile(r"((?:[\w/]+/)?test_\w+\.py)::(test_\w+)")
BARE = re.compile(r"(?<![\w/:.])(test_\w+)(?![\w.])")
FILE = re.compile(r"(?<![\w/])((?:[\w/]+/)?test_\w+\.py)(?!::)")
EVIL_NAME = re.compile(r"\[\.\.\.-([^\]]+)\]")
DOCUMENTS = ("docs/faults.md", "docs/safety.md")


def defined() -> dict[str, set[str]]:
    """List the functions of each file of tests, by its path from the root."""
    files = ROOT.glob("tests/**/test_*.py")
    return {
        str(file.relative_to(ROOT)): set(re.findall(r"^def (test_\w+)", file.read_text(), re.MULTILINE))
        for file in files
    }


def unknown_tests(text: str, tests: dict[str, set[str]]) -> list[str]:
    """List what a document names that no file of tests has."""
    missing = []
    for path, name in NAMED.findall(text):
        if not any(name in names for file, names in tests.items() if f"/{file}".endswith(f"/{path}")):
            missing.append(f"{path}::{name}")
    every = set().union(*tests.values())
    missing += [name for name in BARE.findall(NAMED.sub("", text)) if name not in every]
    missing += [path for path in FILE.findall(text) if not any(f"/{file}".endswith(f"/{path}") for file in tests)]
    for kind in EVIL_NAME.findall(text):
        if "..." not in kind and kind not in EVIL:
            missing.append(kind)
    return missing


@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_test_that_a_document_names_exists(document: str) -> None:
    text = (ROOT / document).read_text()
    assert len(NAMED.findall(text)) > 10
    assert unknown_tests(text, defined()) == []


def test_a_name_that_no_test_has_is_seen() -> None:
    tests = {"tests/a/test_x.py": {"test_one"}, "tests/b/test_x.py": {"test_two"}}
    assert unknown_tests("`tests/a/test_x.py::test_one`, `test_x.py::test_two`, `test_one`, `[...-NaN]`", tests) == []
    assert unknown_tests("`tests/a/test_x.py::test_two`", tests) == ["tests/a/test_x.py::test_two"]
    assert unknown_tests("`test_three` and `tests/c/test_y.py`, `[...-no such deed]`", tests) == [
        "test_three", "tests/c/test_y.py", "no such deed",
    ]  # fmt: skip
    assert Path(ROOT / DOCUMENTS[0]).exists()


def test_what_make_fast_leaves_out_is_there() -> None:
    for name in slow.means():
        path, _, test = name.partition("::")
        text = (slow.ROOT / path).read_text(encoding="utf-8")
        assert path.endswith(".md") or f"def {test}(" in text, f"{name}: measure anew with `make durations`"
