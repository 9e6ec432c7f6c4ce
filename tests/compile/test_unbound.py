"""Names that may be unbound where they are used, and ends without a value, as the flow through a kernel has them."""

from __future__ import annotations

import ast
import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from textwrap import dedent
from typing import Any

import pytest

from graspfx.compile.kernel import kernel
from graspfx.compile.kernel_checks import check
from graspfx.compile.machine import compiled
from graspfx.compile.own_sources import NO_KERNELS, source_folders
from graspfx.compile.unbound import lost_end, unbound_names
from graspfx.errors import KernelError

FLAWED = {
    "one branch": ("if a > 0:\n    x = 1\nreturn x", [("x", 4)]),
    "the other": ("if a > 0:\n    pass\nelse:\n    x = 1\nreturn x", [("x", 6)]),
    "a test tested before": ("if a > 0:\n    x = 1\nif a > 0:\n    a = x\nreturn a", [("x", 5)]),
    "a loop without turns": ("for i in range(a):\n    x = i\nreturn x", [("x", 4)]),
    "the loop's own variable": ("for i in range(a):\n    pass\nreturn i", [("i", 4)]),
    "a while": ("while a > 0:\n    x = a\n    a -= 1\nreturn x", [("x", 5)]),
    "a turn that is cut short": (
        "for i in range(3):\n    if a > i:\n        continue\n    x = i\nreturn x",
        [("x", 6)],
    ),
    "a loop that is left": ("for i in range(3):\n    if a > i:\n        break\n    x = i\nreturn x", [("x", 6)]),
    "an addition": ("if a > 0:\n    x = 1\nx += a\nreturn x", [("x", 4)]),
    "an entry's index": ("if a > 0:\n    j = 1\nS[j] = 0.0\nreturn a", [("j", 4)]),
    "before its assignment": ("y = x\nx = 1\nreturn x + y", [("x", 2)]),
    "an empty range": ("for i in range(2, 2):\n    x = i\nreturn x", [("x", 4)]),
}
SOUND = {
    "both branches": "if a > 0:\n    x = 1\nelse:\n    x = 2\nreturn x",
    "before the branch": "x = 0\nif a > 0:\n    x = 1\nreturn x",
    "the other way returns": "if a > 0:\n    x = 1\nelse:\n    return 0\nreturn x",
    "turns as written": "for i in range(3):\n    x = i\nreturn x + i",
    "a tuple": "for i in (1, a):\n    x = i\nreturn x",
    "within a turn": "for i in range(a):\n    x = i\n    a += x\nreturn a",
    "an endless loop that is left": "while True:\n    x = a\n    if x > 0:\n        break\nreturn x",
    "an early way out of a loop": "while a > 0:\n    x = a\n    if x > 3:\n        return x\n    a -= 1\nreturn a",
    "a tuple's parts": "x, (S[0]) = a, a\nreturn x",
    "a name of the module": "return a + other",
}


LOST = {  # line at which a way out has no value
    "one branch": ("if a > 0:\n    return 1", 3),
    "no else": ("if a > 0:\n    return 1\nelif a < 0:\n    return 2", 5),
    "a loop that may have no turn": ("for i in range(a):\n    return i", 3),
    "a loop that is left": ("while True:\n    if a > 0:\n        break\n    return a", 5),
    "a bare return": ("if a > 0:\n    return\nreturn a", 3),
}
KEPT = {
    "nothing to give": "S[0] = a",
    "a bare return and nothing to give": "if a > 0:\n    return\nS[0] = a",
    "both branches": "if a > 0:\n    return 1\nelse:\n    return 2",
    "an endless loop": "while True:\n    a -= 1\n    if a < 0:\n        return a",
}


def tree_of(body: str) -> ast.FunctionDef:
    text = "def f(S, a):\n" + "\n".join("    " + line for line in dedent(body).splitlines())
    [tree] = ast.parse(text).body
    assert isinstance(tree, ast.FunctionDef)
    return tree


@pytest.mark.parametrize(("body", "expected"), FLAWED.values(), ids=FLAWED)
def test_ways_on_which_a_name_has_no_value(body: str, expected: list[tuple[str, int]]) -> None:
    assert [(name.id, name.lineno) for name in unbound_names(tree_of(body))] == expected


@pytest.mark.parametrize("body", SOUND.values(), ids=SOUND)
def test_ways_on_which_each_name_has_a_value(body: str) -> None:
    assert unbound_names(tree_of(body)) == []


@pytest.mark.parametrize(("body", "line"), LOST.values(), ids=LOST)
def test_ends_without_a_value(body: str, line: int) -> None:
    assert lost_end(tree_of(body)) == line


@pytest.mark.parametrize("body", [*SOUND.values(), *KEPT.values()], ids=[*SOUND, *KEPT])
def test_ends_with_a_value_or_with_nothing_to_give(body: str) -> None:
    assert lost_end(tree_of(body)) == 0


WAYS: dict[str, Callable[[Any], object]] = {
    "called": lambda function: kernel(function)(-1.0),
    "compiled": lambda function: compiled(function)(-1.0),
    "checked before a run": lambda function: check([function]),
}


@pytest.mark.parametrize("way", WAYS)
def test_a_kernel_that_falls_off_its_end(way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An error with file and line, where Python gave None and machine code 0.0."""
    (tmp_path / "falling.py").write_text("def shared(a: float) -> float:\n    if a > 0.0:\n        return a\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "falling", raising=False)
    with pytest.raises(KernelError, match=r"falling\.py:3: given .*the end of 'shared'.*a value on every path"):
        WAYS[way](importlib.import_module("falling").shared)


def test_no_kernel_of_ours_has_such_a_name() -> None:
    files = [file for folder in source_folders() for file in Path(folder).rglob("*.py")]
    ours = [each for file in files for each in kernels(file)]
    assert len(ours) > 300
    assert [name for each in ours for name in unbound_names(each)] == []
    assert [each.name for each in ours if lost_end(each)] == []


def test_rooms_that_caches_leave_out_have_no_kernel() -> None:
    """Edits of these rooms leave compiled programs valid, so no program may be made from what stands there."""
    package = Path(source_folders()[0])
    for room in NO_KERNELS:
        assert (package / room / "__init__.py").is_file()
        assert [node.name for file in (package / room).rglob("*.py") for node in kernels(file)] == [], room


def kernels(file: Path) -> list[ast.FunctionDef]:
    """List the kernels that a file defines."""
    return [
        node
        for node in ast.walk(ast.parse(file.read_text("utf-8")))
        if isinstance(node, ast.FunctionDef)
        and {d.id for d in node.decorator_list if isinstance(d, ast.Name)} & {"kernel", "inline"}
    ]
