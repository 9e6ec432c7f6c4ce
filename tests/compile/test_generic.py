"""Generic kernels: the bits of Python whatever memory they are given, compiled once by whoever comes first."""

from __future__ import annotations

import gc
import os
import shutil
import subprocess
import sys
import weakref
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx
from graspfx.compile import emitters, generic
from graspfx.compile.generic import library, single
from graspfx.compile.joined import joined
from graspfx.compile.machine import compiled

SMALL = ("graspfx.loop.world.latch", "graspfx.coupling.sample.let_go")


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


SOURCE = """
def run(A, B, out, k, x):
    out[0] = shift(A, A, 3)
    out[1] = shift(A, B, 3)
    if grade(A, k, x, k > 1):
        out[2] = 1.0
    out[3], out[4] = ends(A, k + 1)
    return int(grade(B, 0, x, False))
"""


def test_a_program_calls_kernels_for_the_types_of_its_arguments() -> None:
    """A truth value and a tuple go over to the other machine code and back."""
    kernels: dict[str, Any] = {"shift": shift, "grade": grade, "ends": ends}
    names = dict(kernels)
    exec(SOURCE, names)
    native = joined(SOURCE, kernels, ["A", "B", "out"], floats=["x"])
    for k, x in ((0, 0.5), (2, 1.0), (3, 9.0)):
        ours, theirs = ([np.arange(5.0), np.arange(5.0) - 2.0, np.zeros(5)] for _ in range(2))
        assert native.bind(*ours).brief(k, x) == names["run"](*theirs, k, x)
        assert all(a.tobytes() == b.tobytes() for a, b in zip(ours, theirs, strict=True))


def test_a_library_is_compiled_once_with_a_line_of_progress(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    library.cache_clear()
    monkeypatch.setattr(emitters, "_is_watched", lambda: True)
    assert not library(SMALL).cached
    told = capsys.readouterr().err
    assert "compiling kernels, once per version and machine: 2 of 2" in told and told.endswith("\n")
    library.cache_clear()
    assert library(SMALL).cached and not capsys.readouterr().err
    library.cache_clear()


ASK = """
from graspfx.compile import generic
from graspfx.compile.llvm import library_text
from graspfx.compile.specialise.specialise import Program

done, lower, emit = [], Program.source, library_text.library_text
Program.source = lambda *given: done.append("lowered") or lower(*given)
library_text.library_text = lambda *given: done.append("compiled") or emit(*given)
generic.library(("graspfx.coupling.law.combine",))
print(*done)
"""
EDITS = [  # a file, what stands in it and what comes in its place, and what the next process does
    ("coupling/law.py", "", "", "lowered compiled"),
    ("coupling/law.py", "", "", ""),
    ("build/run.py", "", "# a comment in a module without kernels\n", ""),
    ("loop/tick/tick.py", "", "# one beside kernels that are not asked for\n", ""),
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


def test_machine_code_that_others_may_call_outlives_its_library(folder: Path) -> None:
    """Programs are bound to it by address: were it freed, they would run on in whatever stands there by then."""
    library.cache_clear()
    home = library(SMALL)
    symbol = home.find("graspfx.loop.world.latch", ("ptr", *["i64"] * 5))
    assert symbol is not None
    home.load([symbol.name])
    engine = weakref.ref(home._engines[0])
    del home
    library.cache_clear()
    gc.collect()
    assert engine() is not None


def test_without_further_processes_this_one_compiles(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(module: str) -> Any:
        raise OSError("no more processes")

    library.cache_clear()
    monkeypatch.setattr(emitters, "start", refused)
    home = library(SMALL)
    symbol = home.find("graspfx.loop.world.latch", ("ptr", *["i64"] * 5))
    assert not home.cached and symbol is not None and symbol.result is None
    library.cache_clear()


def test_a_process_that_dies_leaves_its_work_to_this_one(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def killed(module: str) -> Any:
        process = subprocess.Popen(
            [sys.executable, "-c", ""], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        process.wait()
        return process

    library.cache_clear()
    monkeypatch.setattr(emitters, "start", killed)
    assert library(SMALL).size > 0
    library.cache_clear()


def test_two_processes_that_start_at_once_compile_a_library_once(folder: Path) -> None:
    script = f"from graspfx.compile.generic import library; print(library({SMALL!r}).cached)"
    root = str(Path(graspfx.__file__).parents[1])
    both = [
        subprocess.Popen(
            [sys.executable, "-c", script], stdout=subprocess.PIPE, text=True,
            env={"PYTHONPATH": root, "GRASPFX_CACHE": str(folder)},
        )
        for _ in range(2)
    ]  # fmt: skip
    assert sorted(process.communicate()[0].strip() for process in both) == ["False", "True"]


def test_a_kernel_that_is_not_compiled_yet_is_not_compiled_unasked(folder: Path) -> None:
    def alone(A: Any, k: int) -> float:
        return 2.0 * A[k]

    with pytest.raises(LookupError):
        single(alone, ("ptr", "i64"), make=False)
    assert generic.kernel_name(alone).endswith("alone")
    assert compiled(alone)(np.array([1.0, 4.0]), 1) == 8.0
