"""Benchmark of start-up: time of a whole process, with and without caches from an earlier process."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory

from graspfx.bench.timing import Case, Method, environment

TITLE = "Start-up"
LIMITS = """
Each time is that of a process from start to exit; a run takes at least the time of "import numpy". Files are in the
system's cache and Python's bytecode exists; the first start after installation takes longer. "Cold" starts with an
empty folder for compiled kernels and validated scenes, and compiles the kernels of all scenes; "cached" uses the
results of an earlier start. The time to start a process depends on the system.
"""

SCENES = ("paper-waving", "mug")  # two fingers on a cube; five on a mesh with friction
IMPORTS = "import numpy, h5py, pydantic, llvmlite.binding"
TICK = (
    "import graspfx as gx; scene = gx.load({scene!r}, {{'engine': {engine!r}}}); gx.run(scene, duration=scene.period)"
)


def cases(quick: bool) -> Iterator[Case]:
    """Yield a case of imports, then a case for each scene."""
    with TemporaryDirectory(prefix="graspfx-bench-") as folder:
        start = _Starter(Path(folder))
        reference = start.method("import numpy", "-c", "import numpy")
        methods = [
            reference,
            start.method("import graspfx", "-c", "import graspfx"),
            start.method("import numpy, h5py, pydantic, llvmlite", "-c", IMPORTS),
        ]
        yield Case("startup", "imports", "", methods, reference=reference.name)
        for scene in SCENES[: 1 if quick else 2]:
            run = ("-m", "graspfx", "run", scene, "--out", start.FOLDER)
            interpreted, compiled = (TICK.format(scene=scene, engine=name) for name in ("interpreted", "compiled"))
            methods = [
                reference,
                start.method("first tick, interpreted", "-c", interpreted),
                start.method("first tick, compiled, cached", "-c", compiled),
                start.method("graspfx run --no-figure, cached", *run, "--no-figure"),
                start.method("graspfx run with its figure, cached", *run),
            ]
            if not quick:
                methods.append(start.method("graspfx run --no-figure, cold", *run, "--no-figure", cold=True))
            yield Case("startup", scene, "", methods, reference=reference.name)


class _Starter:
    """Starts processes with the present Python interpreter and with folders for caches and output below `root`."""

    FOLDER = "{folder}"  # in arguments: a new folder

    def __init__(self, root: Path) -> None:
        self._root, self._numbers = root, count()
        self._kept = self._new("cache")

    def method(self, name: str, *arguments: str, cold: bool = False) -> Method:
        """Return a method that starts Python with these arguments and waits for its exit.

        Each argument `FOLDER` is replaced by a new folder. If `cold`, each process has a new, empty cache.
        """

        def call() -> None:
            cache = str(self._new("cache") if cold else self._kept)
            own = environment() | {"XDG_CACHE_HOME": cache, "GRASPFX_CACHE": cache}
            words = [str(self._new("out")) if word == self.FOLDER else word for word in arguments]
            process = subprocess.run(
                [sys.executable, *words], cwd=self._root, env=own, capture_output=True, text=True, check=False
            )
            if process.returncode:
                raise ValueError((process.stderr.strip().splitlines() or ["it failed"])[-1])

        return Method(name, call, _after(call))

    def _new(self, name: str) -> Path:
        return self._root / f"{name}-{next(self._numbers)}"


def _after(call: Callable[[], None]) -> Callable[[], float]:
    """Return an error function for `Method`: it makes one call, which fills caches, and returns an error of zero."""

    def error() -> float:
        call()
        return 0.0

    return error
