"""The programs of scenes compiled before they are needed, several scenes at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from time import perf_counter
from typing import Any

from graspfx.build.build import build
from graspfx.compile.generic import library
from graspfx.compile.machine import compiled
from graspfx.coupling.division import divide_rows
from graspfx.environment import processors
from graspfx.errors import GraspFXError
from graspfx.grasp import point_sets
from graspfx.loop.recording.growth.rough_program import rough
from graspfx.loop.recording.tally_program import measure
from graspfx.loop.tick.library import LIBRARY
from graspfx.loop.tick.programs import Compiled
from graspfx.scene.load import load

KERNELS = "kernels of all scenes"
OF_RECORDINGS = divide_rows, measure, rough
COMPILED, CACHED, CANNOT = "compiled", "was there", "cannot"


@dataclass(frozen=True)
class Warmed:
    """The outcome of warming up a scene's program.

    Attributes:
        scene: its name or path.
        state: "compiled" (it is in the cache now), "was there" or "cannot".
        seconds: to load and build the scene, and to make or load its program.
        size: of its machine code [bytes].
        why: it cannot.
    """

    scene: str
    state: str
    seconds: float = 0.0
    size: int = 0
    why: str = ""


def warm(name: str, overrides: Mapping[str, Any], preset: str | None = None) -> Warmed:
    """Compile a scene's program unless it is in the cache; devices that are no simulations are not opened."""
    began = perf_counter()
    try:
        for kernel in OF_RECORDINGS:
            compiled(kernel)
        with build(load(name, overrides, preset=preset), hardware=False) as servo:
            programs = Compiled(servo.script).programs.values()
    except GraspFXError as error:
        return Warmed(name, CANNOT, perf_counter() - began, why=" ".join(str(error).split()))
    seconds, size = perf_counter() - began, sum(program.size for program in programs)
    notes = [program.note for program in programs if program.note]
    if notes:
        return Warmed(name, CANNOT, seconds, size, notes[0])
    return Warmed(name, CACHED if all(program.cached for program in programs) else COMPILED, seconds, size)


def warm_kernels() -> Warmed:
    """Compile the kernels that all scenes start with, and those of `gx.Split`, unless they are in the cache."""
    began = perf_counter()
    point_sets.warm()
    kernels = library(LIBRARY)
    state = CANNOT if kernels.note else CACHED if kernels.cached else COMPILED
    return Warmed(KERNELS, state, perf_counter() - began, kernels.size, kernels.note)


def warm_all(names: Sequence[str], overrides: Mapping[str, Any], preset: str | None = None) -> Iterator[Warmed]:
    """Warm up several scenes, in their order, by as many processes as there are processors to use.

    Threads would wait for one another: LLVM is called by one at a time.
    """
    each = partial(warm, overrides=overrides, preset=preset)
    count = min(len(names), processors())
    if count < 2:
        yield from map(each, names)
        return
    with ProcessPoolExecutor(count, mp_context=get_context("spawn")) as pool:
        yield from pool.map(each, names)
