"""The library of programs that a wheel brings: the bits of what is compiled here, and what is damaged is not loaded."""

from __future__ import annotations

import ast
import json
import math
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType
from typing import Any, cast

import numpy as np
import pytest

from graspfx.compile import library, own_sources
from graspfx.compile.llvm.llvm import llvm_program
from graspfx.compile.machine import Machine, request_of
from graspfx.compile.native import compiled
from graspfx.compile.own_sources import footprint, was_compiled
from graspfx.grasp import direct
from graspfx.testing.wire import compiler
from tests.support.optional import require

require("llvmlite")
pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux") or compiler() is None, reason="a library of Linux, and cc to link it"
)

WAVES = """
def waves(x, y, n):
    for i in range(n):
        y[i] = math.sin(x[i]) + math.exp(x[i]) * math.pow(2.0, x[i]) - math.floor(x[i]) + math.atan2(x[i], 0.3)
    return n
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Put another library in place of the package's."""
    monkeypatch.setattr(library, "FOLDER", tmp_path / "programs")
    library._table.cache_clear()
    library.imports.cache_clear()
    yield tmp_path / "programs"
    library._table.cache_clear()
    library.imports.cache_clear()


def test_a_program_of_the_library_has_the_bits_of_one_compiled_here_and_of_python(folder: Path) -> None:
    tag = library.build({"waves": ("waves", llvm_program(WAVES))}, folder)
    assert re.fullmatch(r"manylinux_2_\d+_x86_64", tag)
    assert sorted(each.name for each in folder.iterdir()) == ["imports.json", "programs.json", "waves.so"]
    shipped, here = library.find("waves"), compiled(WAVES)
    assert shipped is not None and shipped.cached and shipped.place == str(folder)
    x = np.random.default_rng(1).normal(0.0, 3.0, 1000)
    answers = [np.zeros(1000), np.zeros(1000)]
    for native, y in zip((shipped, here), answers, strict=True):
        by_name = {"x": x, "y": y}
        assert native.bind(*(by_name[name] for name in native.arrays)).brief(1000) == 1000
    expected = [math.sin(a) + math.exp(a) * math.pow(2.0, a) - math.floor(a) + math.atan2(a, 0.3) for a in x.tolist()]
    assert answers[0].tolist() == answers[1].tolist() == expected


def test_a_kernel_is_taken_from_the_library_while_its_sources_are_the_same(
    folder: Path, monkeypatch: pytest.MonkeyPatch, new_cache: Path
) -> None:
    source, floats = request_of(direct.couple)
    key = footprint(direct.couple)
    assert not was_compiled(direct.couple)
    library.build({key: ("couple", llvm_program(source, floats, apart=False))}, folder)
    library._table.cache_clear()
    assert was_compiled(direct.couple)
    monkeypatch.setitem(sys.modules, "llvmlite", None)  # needed for what is not in the library
    assert Machine(cast("FunctionType", direct.couple))._native.place == str(folder)
    table = json.loads((folder / library.TABLE).read_text())
    (folder / library.TABLE).write_text(json.dumps({f"{key}0": table[key]}))  # as of other sources
    library._table.cache_clear()
    assert library.find(key) is None and not was_compiled(direct.couple)


def test_sources_of_a_wheel_are_not_parsed_and_edited_ones_are(
    folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """What they import stands in the library by the digest of their content."""
    library.build({}, folder, sources=own_sources.all_imports())
    library.imports.cache_clear()
    own = Path(library.__file__)
    with monkeypatch.context() as patch:
        patch.setattr(ast, "parse", None)
        known = own_sources._digest_and_imports(str(own))
    (edited := tmp_path / "edited.py").write_bytes(own.read_bytes() + b"import graspfx.spatial\n")
    assert known[1] == own_sources._imports(own.read_bytes()) and "graspfx.log" in known[1]
    assert set(own_sources._digest_and_imports(str(edited))[1]) == {*known[1], "graspfx.spatial"}


@pytest.mark.parametrize("harm", ["cut", "changed", "gone", "no table", "no JSON"])
def test_a_damaged_library_is_not_loaded(folder: Path, harm: str) -> None:
    library.build({"waves": ("waves", llvm_program(WAVES))}, folder)
    file, table = folder / "waves.so", folder / library.TABLE
    content = file.read_bytes()
    match harm:
        case "cut":
            file.write_bytes(content[:5000])
        case "changed":
            file.write_bytes(content[:3000] + bytes([content[3000] ^ 1]) + content[3001:])
        case "gone":
            file.unlink()
        case "no table":
            table.unlink()
        case "no JSON":
            table.write_text("{")
    if harm == "no table":  # as in a checkout
        assert library.find("waves") is None
        return
    with pytest.warns(UserWarning, match=r"is not used, and programs are compiled instead: .*; install GraspFX again"):
        assert library.find("waves") is None


def test_a_linker_that_fails_says_why(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def run(words: list[str], **options: Any) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(words, 1, "", "no room")

    monkeypatch.setattr(subprocess, "run", run)
    with pytest.raises(OSError, match=r"cc -shared .*: no room"):
        library.build({"waves": ("waves", llvm_program(WAVES))}, folder)
