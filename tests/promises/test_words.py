"""Names are nouns or verbs, and docstrings are sentences: an imperative for a function, a noun for a value."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.rooms import ROOT

# Participles, pronouns and adverbs that have stood for nouns. A constant or a class is held to the list too.
BANNED = {
    "found", "given", "held", "made", "kept", "taken", "told", "chosen", "moved", "shown", "known", "named", "gone",
    "meant", "wanted", "said", "asked", "these", "those", "several", "either", "what", "which", "whose", "aside",
    "ahead", "later",
}  # fmt: skip
PUBLIC = {  # names that other people's code has
    "graspfx/errors.py": {"given", "known"},
    "graspfx/grasp/quality/internal.py": {"named"},
    "graspfx/loop/adapt.py": {"held"},
    "graspfx/testing/promise.py": {"found"},
}
OPENINGS = re.compile(r"(Of|What|At|By|As|The same)\b")
NO_VERBS = re.compile(r"(A|An|The|All|Each|Every|How|Whether|Which|Where|Who|Its|If|One|Two|Both|Those)\b")
SHELVES = ("graspfx", "devices", "scenes")
FILES = sorted(str(path.relative_to(ROOT)) for shelf in SHELVES for path in (ROOT / shelf).rglob("*.py"))


def names(tree: ast.AST) -> Iterator[str]:
    """List the names that a file gives to things of its own."""
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.arg(arg=name):
                yield name
            case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                yield name
            case ast.alias(asname=str(name)) | ast.ExceptHandler(name=str(name)) | ast.MatchAs(name=str(name)):
                yield name


def docstrings(tree: ast.AST) -> Iterator[str]:
    """List the first lines of a file's docstrings."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and (text := ast.get_docstring(node)):
            yield text.splitlines()[0]


def openings(tree: ast.AST) -> Iterator[str]:
    """List the docstrings of a file that begin as none should."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and (text := ast.get_docstring(node)):
            is_function = isinstance(node, ast.FunctionDef) and not any(
                ast.unparse(each).split(".")[-1] in ("property", "cached_property", "setter")
                for each in node.decorator_list
            )
            if OPENINGS.match(text) or (is_function and NO_VERBS.match(text)):
                yield text.splitlines()[0]


@pytest.mark.parametrize("file", FILES)
def test_words(file: str) -> None:
    tree = ast.parse(Path(ROOT / file).read_text("utf-8"))
    words = {name for name in names(tree) if name.strip("_").lower() in BANNED} - PUBLIC.get(file, set())
    assert words == set()
    assert list(openings(tree)) == []


@pytest.mark.parametrize("room", sorted(path.name for path in (ROOT / "tests").iterdir() if path.is_dir()))
def test_docstrings_of_tests_begin_as_sentences(room: str) -> None:
    texts = [
        text
        for path in (ROOT / "tests" / room).rglob("*.py")
        for text in docstrings(ast.parse(path.read_text("utf-8")))
    ]
    assert [text for text in texts if OPENINGS.match(text)] == []


def test_banned_words_and_openings_are_seen() -> None:
    tree = ast.parse("def f(given):\n    'The same.'\n    self._kept = found = [told for told in given]\n")
    assert {name for name in names(tree) if name.strip("_").lower() in BANNED} == {"given", "_kept", "found", "told"}
    assert list(openings(tree)) == ["The same."]
