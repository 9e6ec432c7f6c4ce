"""The program of `steps` for this machine with musl's mathematics: what a page computes with, natively."""

from __future__ import annotations

import ctypes
import subprocess
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.build import build
from graspfx.compile import webassembly
from graspfx.compile.emission import portable
from graspfx.compile.library import TRIPLE
from graspfx.compile.llvm.llvm import llvm_program
from graspfx.compile.native import text_of
from graspfx.live.guides import guided_scene
from graspfx.live.sliders import live_keys, sliders
from graspfx.loop import program
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]


@cache
def entry() -> Any:
    """Compile and load `graspfx_entry(arena, rows, world, k, count, r)`, without FMA."""
    folder, source = Path(mkdtemp()), llvm_program(program.source())
    (folder / "steps.o").write_bytes(portable(text_of(source), TRIPLE, "x86-64-v2"))
    maths = webassembly.mathematics(source.libm, "x86_64-linux-musl", folder)
    words = ["cc", "-shared", "-Wl,-Bsymbolic", "-o", "steps.so", "steps.o", *map(str, maths)]
    subprocess.run(words, cwd=folder, check=True)
    function = ctypes.CDLL(str(folder / "steps.so")).graspfx_entry
    function.argtypes = [ctypes.c_void_p] * 2 + [ctypes.c_int64] * 4
    function.restype = ctypes.c_int64
    return function


def rows_of(scene: Scene, ticks: int) -> FloatArray:
    """Run a scene as its page does, without anybody's hands on it."""
    own = guided_scene(scene.replace({"record.every": 1, "record.columns": []}))
    with build(own, live=live_keys(sliders(own))) as servo:
        arena = servo.arena
        memory, rows = arena.memory.floats, np.zeros((ticks, servo.layout.width))
        done = entry()(memory.ctypes.data, rows.ctypes.data, arena.offset, 0, ticks, 0)
    assert done == ticks
    return rows
