"""Start-up: whole processes from their start to their end, what is compiled apart from what is kept."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from itertools import count
from pathlib import Path
from shutil import copytree
from tempfile import TemporaryDirectory

from graspfx.bench.case import Case, Method
from graspfx.bench.threads import environment

TITLE = "Start-up"
LIMITS = """
Each row is a process from its start to its end, of which "import numpy" is the least. Files are in the system's cache
and Python's bytecode is there: the first start after installing takes longer. "Cold" has an empty folder for compiled
kernels and checked scenes at every start, and compiles the kernels of all scenes; "new scene" has these kernels and
nothing of the scene; "cached" has what an earlier start has left. "Compiled" asks for a program specialised for the
scene from the first tick on (`engine = "compiled"`), and waits until it is there. Starting a process is the system's
work and differs from system to system.
"""

NUMPY = "import numpy"
IMPORTS = "import numpy, h5py, pydantic, llvmlite.binding"
TICK = (
    "import graspfx as gx; scene = gx.load({scene!r}).replace({{'engine': {engine!r}}}); "
    "gx.run(scene, duration=scene.period)"
)
DIRECT = "import graspfx as gx; gx.PointCoupling(gx.Impedance(30.0), gx.Impedance(70.0), 5).compute()"
MAP = """
import numpy as np
from graspfx.analysis.stability.one_gain import external_limit_map
mass, viscosity = np.linspace(0.05, 0.2, 200)[:, None], np.linspace(0.2, 2.0, 200)
external_limit_map(mass, 0.2, 0.005, 0.1, viscosity, spring=33.0)
"""
SCENES = ("paper-waving", "mug")  # two fingers on a cube; five on a mesh with friction


class Processes:
    """Methods that start this Python with folders of their own.

    Args:
        root: where the folders are.
    """

    def __init__(self, root: Path) -> None:
        self._root, self._numbers = root, count()
        self._full = self.folder("cache")

    def folder(self, name: str) -> Path:
        """Name a folder that nobody has used."""
        return self._root / f"{name}-{next(self._numbers)}"

    def empty(self) -> Path:
        return self.folder("cache")

    def full(self) -> Path:
        return self._full

    @cached_property
    def _kernels(self) -> Path:
        """Fill a folder with the kernels of all scenes and nothing else."""
        folder = self.folder("cache")
        caches = {"GRASPFX_CACHE": str(folder)}
        command = [sys.executable, "-m", "graspfx", "warmup", "--kernels"]
        subprocess.run(command, cwd=self._root, env=environment() | caches, capture_output=True, check=True)
        return folder

    def new(self) -> Path:
        """Name a folder that has the kernels of all scenes and nothing else."""
        folder = self.folder("cache")
        copytree(self._kernels, folder)
        return folder

    def code(self, name: str, text: str, cache: Callable[[], Path] | None = None) -> Method:
        """Start a process that executes a text."""
        return self._method(name, lambda: ["-c", text], cache or self.full)

    def run(self, name: str, scene: str, more: Sequence[str], cache: Callable[[], Path]) -> Method:
        """Start a process of `graspfx run`, into a folder that is new each time."""
        return self._method(
            name, lambda: ["-m", "graspfx", "run", scene, *more, "--out", str(self.folder("out"))], cache
        )  # fmt: skip

    def _method(self, name: str, arguments: Callable[[], list[str]], cache: Callable[[], Path]) -> Method:
        """Start a process of this Python; ValueError with what it wrote if it fails."""

        def call() -> None:
            caches = dict.fromkeys(("XDG_CACHE_HOME", "GRASPFX_CACHE"), str(cache()))
            process = subprocess.run(
                [sys.executable, *arguments()], cwd=self._root, env=environment() | caches, capture_output=True,
                text=True,
            )  # fmt: skip
            if process.returncode:
                raise ValueError(process.stderr.strip().splitlines()[-1] if process.stderr.strip() else "it failed")

        def error() -> float:
            call()
            return 0.0

        return Method(name, call, error)


def cases(quick: bool) -> Iterator[Case]:
    """Yield imports and the public calls by themselves, then scenes."""
    with TemporaryDirectory(prefix="graspfx-bench-") as folder:
        start = Processes(Path(folder))
        reference = start.code("import numpy", NUMPY)
        methods = [
            reference,
            start.code("import graspfx", "import graspfx"),
            start.code("import numpy, h5py, pydantic, llvmlite", IMPORTS),
            start.code("gx.PointCoupling, cold", DIRECT, start.empty),
            start.code("gx.PointCoupling, cached", DIRECT),
            start.code("a first map of 40 000 points", MAP),
        ]
        yield Case("startup", "whole processes", "", methods, reference=reference.name)
        for scene in SCENES[: 1 if quick else 2]:
            methods = [reference, *_of_scene(start, scene)]
            yield Case("startup", scene, "", methods, reference=reference.name)


def _of_scene(start: Processes, scene: str) -> Iterator[Method]:
    yield start.code("import numpy, h5py, pydantic, llvmlite", IMPORTS)
    yield start.code("first tick, interpreted", TICK.format(scene=scene, engine="interpreted"))
    for name, cache in (("new scene", start.new), ("cached", start.full)):
        yield start.code(f"first tick, generic, {name}", TICK.format(scene=scene, engine="generic"), cache)
    for name, cache in (("cold", start.empty), ("cached", start.full)):
        yield start.code(f"first tick, compiled, {name}", TICK.format(scene=scene, engine="compiled"), cache)
    for name, cache in (("cold", start.empty), ("new scene", start.new), ("cached", start.full)):
        yield start.run(f"graspfx run --no-figure, {name}", scene, ["--no-figure"], cache)
    yield start.run("graspfx run with its figure, cached", scene, [], start.full)
