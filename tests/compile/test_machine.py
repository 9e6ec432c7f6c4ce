"""Kernels by themselves as machine code: the bits of Python whatever memory they are given, known by their text."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx
from graspfx.compile.machine import compiled
from graspfx.compile.symbol import symbol_of


def shift(A: Any, B: Any, n: int) -> float:
    """Copy entries on by one, each as it stands by then; return their sum."""
    total = 0.0
    for i in range(n):
        A[i + 1] = B[i] + 1.0
        total += A[i + 1] * B[i + 1]
    return total


def grade(A: Any, k: int, x: float, high: bool) -> bool:
    """Tell whether an entry is beyond a number."""
    return A[k] > x if high else A[k] < x


def ends(A: Any, n: int) -> tuple[float, int]:
    """Give the last entry and its number."""
    return A[n - 1], n - 1


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_two_buffers_may_be_the_same_memory() -> None:
    for same in (False, True):
        one, other = np.arange(9.0), np.arange(9.0)
        a, b = (one, one if same else one.copy()), (other, other if same else other.copy())
        assert compiled(shift)(*a, 8) == shift(*b, 8)
        assert one.tobytes() == other.tobytes()


def test_a_truth_value_and_a_tuple_come_back_as_floats() -> None:
    A = np.arange(5.0)
    for k, x, high in ((0, 0.5, False), (2, 1.0, True), (3, 9.0, True)):
        assert compiled(grade)(A, k, x, high) == float(grade(A, k, x, high))
    assert compiled(ends)(A, 3) == ends(A, 3)


def test_a_kernel_is_a_symbol_for_other_machine_code() -> None:
    import ctypes

    import llvmlite.binding as llvm

    symbol = symbol_of(shift, ("ptr", "ptr", "i64"))
    call = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)(
        llvm.address_of_symbol(symbol)
    )
    one, other = np.arange(9.0), np.arange(9.0)
    assert call(one.ctypes.data, one.ctypes.data, 8) == shift(other, other, 8)
    assert one.tobytes() == other.tobytes()


ASK = """
from graspfx.compile import native
from graspfx.compile.llvm import llvm
from graspfx.compile.machine import compiled
from graspfx.compile.program import Program
from graspfx.coupling.law import combine

done, lower, emit = [], Program.source, llvm.llvm_program
Program.source = lambda *given: done.append("lowered") or lower(*given)
llvm.llvm_program = lambda *given, **more: done.append("compiled") or emit(*given, **more)
compiled(combine)
print(*done)
"""
EDITS = [  # a file, what stands in it and what comes in its place, and what the next process does
    ("coupling/law.py", "", "", "lowered compiled"),
    ("coupling/law.py", "", "", ""),
    ("assembly/run_scene.py", "", "# a comment in a module without kernels\n", ""),
    ("loop/step.py", "", "# one beside kernels that are not asked for\n", ""),
    ("coupling/law.py", "", "# one beside the kernel\n", "lowered"),
    ("compile/lower/lowering.py", "", "# one in the compiler\n", "lowered"),
    ("coupling/law.py", "kip * ", "-kip * ", "lowered compiled"),
    ("coupling/law.py", "-kip * ", "kip * ", ""),
    (
        "coupling/grasp_state.py",
        "class FingerState(FramedContact):",
        "class FingerState(FramedContact):\n    new: float",
        "lowered compiled",
    ),
    ("spatial.py", "self.x + other.x", "other.x + self.x", "lowered compiled"),
]


def test_programs_are_known_by_what_they_are(tmp_path: Path) -> None:
    """An edit outside of a kernel's imports lowers nothing, and one that leaves the lowered text compiles nothing."""
    package = tmp_path / "graspfx"
    shutil.copytree(Path(graspfx.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    environment = {**os.environ, "GRASPFX_CACHE": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}
    for file, old, new, expected in EDITS:
        text = (package / file).read_text("utf-8")
        assert old in text
        (package / file).write_text(text.replace(old, new) if old else text + new, "utf-8")
        words = [sys.executable, "-P", "-c", ASK]
        out = subprocess.run(words, env=environment, cwd=tmp_path, capture_output=True, text=True, check=True)
        assert out.stdout.strip() == expected, (file, new)


TWO = """
from graspfx.loop import engine

TEXT = "def run(arena, rows, world, k, count, r):\\n    arena[world] = rows[k]\\n    return count + r"
engine.source = lambda make=True: TEXT
print(engine.program().cached)
"""


def test_two_processes_that_start_at_once_compile_the_program_once(folder: Path) -> None:
    root = str(Path(graspfx.__file__).parents[1])
    both = [
        subprocess.Popen(
            [sys.executable, "-c", TWO], stdout=subprocess.PIPE, text=True,
            env={"PYTHONPATH": root, "GRASPFX_CACHE": str(folder)},
        )
        for _ in range(2)
    ]  # fmt: skip
    assert sorted(process.communicate()[0].strip() for process in both) == ["False", "True"]


def test_a_kernel_that_is_not_compiled_yet_is_not_compiled_unasked(folder: Path) -> None:
    def alone(A: Any, k: int) -> float:
        return 2.0 * A[k]

    with pytest.raises(LookupError):
        compiled(alone, make=False)
    assert compiled(alone)(np.array([1.0, 4.0]), 1) == 8.0
