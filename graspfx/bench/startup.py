"""Start-up: whole processes from their start to their end, beside one that imports numpy."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory

from graspfx.bench.case import Case, Method

TITLE = "Start-up"
LIMITS = """
Files are in the system's cache and Python's bytecode is there: the first start after installing takes longer.
"Cold" has an empty folder for compiled kernels at every start, "cached" one that an earlier start has filled; while a
run compiles nothing the two are the same. Starting a process is the system's work and differs from system to system.
"""

NUMPY = "import numpy"
FIRST_TICK = "import graspfx as gx; scene = gx.load('reference-1dof'); gx.run(scene, duration=scene.period)"


def cases(quick: bool) -> Iterator[Case]:
    with TemporaryDirectory(prefix="graspfx-bench-") as folder:
        root = Path(folder)
        numbers = count()

        def fresh() -> Path:
            return root / f"cache-{next(numbers)}"

        kept = fresh()
        run = ["-m", "graspfx", "run", "reference-1dof", "--no-figure", "--overwrite", "--out", str(root / "out")]
        methods = [
            _process("import numpy", ["-c", NUMPY], root, lambda: kept),
            _process("import graspfx", ["-c", "import graspfx"], root, lambda: kept),
            _process("first tick, cold", ["-c", FIRST_TICK], root, fresh),
            _process("first tick, cached", ["-c", FIRST_TICK], root, lambda: kept),
            _process("graspfx run reference-1dof --no-figure, cold", run, root, fresh),
            _process("graspfx run reference-1dof --no-figure, cached", run, root, lambda: kept),
        ]
        yield Case("startup", "whole processes", "", methods, reference="import numpy")


def _process(name: str, arguments: list[str], folder: Path, cache: Callable[[], Path]) -> Method:
    """A process of this Python; ValueError with what it wrote if it fails."""

    def call() -> None:
        caches = dict.fromkeys(("XDG_CACHE_HOME", "NUMBA_CACHE_DIR"), str(cache()))
        done = subprocess.run(
            [sys.executable, *arguments], cwd=folder, env=os.environ | caches, capture_output=True, text=True
        )
        if done.returncode:
            raise ValueError(done.stderr.strip().splitlines()[-1] if done.stderr.strip() else "it failed")

    def error() -> float:
        call()
        return 0.0

    return Method(name, call, error)
