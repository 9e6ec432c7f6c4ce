"""Whole runs: `gx.run` from the scene to the recording, beside other programs that keep a row of every tick."""

from __future__ import annotations

from collections.abc import Callable, Generator
from functools import partial
from itertools import count
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

import graspfx as gx
from graspfx.bench.case import Case, Method, is_installed, missing
from graspfx.bench.cases import ticks
from graspfx.bench.peers.paper import PaperProgram, Springs
from graspfx.bench.peers.springs import MuJoCoSprings
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

TITLE = "Whole runs: from the scene to the recording"
LIMITS = """
Time is per tick, of whole calls of 10 000 ticks: the scene built and checked, its program loaded, the ticks, a row of
all that is recorded for each, and the recording's object or file; "ticks alone" is the share of the ticks. The program
was compiled beforehand (what that takes: Start-up). Numpy and MuJoCo keep positions and forces, or the state, in an
array made beforehand; MuJoCo's run is one call of its `rollout`. The scene and the errors are those of the whole ticks
in space, after 1 s. `gx.run` is asked to go as far as 10 000 ticks by its default engine, which runs the first 16
interpreted. Of the long run, a million ticks, building and loading is a small part; its files are removed again.
"""

TICKS = 10_000
QUICK = 1000
LONG, LONG_QUICK = 1_000_000, 200_000  # ticks of which building a scene is a small part


def cases(quick: bool) -> Generator[Case]:
    """Yield five fingers in space: separate gains, then equal ones, which MuJoCo's springs can be too; a long run."""
    number = QUICK if quick else TICKS
    for internal, gains in ((ticks.INTERNAL, "kep < kip"), (ticks.EXTERNAL, "kep = kip")):
        scene = ticks.make_scene(3, internal, "native")
        system = ticks.springs(scene, internal)
        truth = ticks.anchors_after(system)
        with TemporaryDirectory(prefix="graspfx-bench-") as folder:
            methods = [*_ours(scene, number, truth, system, Path(folder)), _by_numpy(system, truth, number)]
            if internal == ticks.EXTERNAL:
                methods.append(_by_mujoco(system, truth, number))
            yield Case("runs", f"space, 5 fingers, {gains}, {number} ticks", "m", methods, bound=0.002)
    with TemporaryDirectory(prefix="graspfx-bench-") as folder:
        scene = ticks.make_scene(3, ticks.INTERNAL, "native")
        system = ticks.springs(scene, ticks.INTERNAL)
        methods = _ours(scene, LONG_QUICK if quick else LONG, ticks.anchors_after(system), system, Path(folder))
        yield Case("runs", "space, 5 fingers, a long run", "m", methods, bound=0.002)


def _ours(scene: Scene, number: int, truth: FloatArray, system: Springs, folder: Path) -> list[Method]:
    seconds, folders = number * scene.period, count()

    def to_disk() -> None:
        place = folder / f"run-{next(folders)}"
        gx.run(scene, duration=seconds, out=place)
        rmtree(place)

    def error(engine: str) -> float:
        run = gx.run(scene.model_copy(update={"engine": engine}), duration=ticks.SECONDS + scene.period)
        return ticks.recorded_error(run, truth, system)

    calls: dict[str, Callable[[], object]] = {
        "GraspFX gx.run": lambda: gx.run(scene, duration=seconds),
        "GraspFX gx.run and its summary": lambda: gx.run(scene, duration=seconds).summary(),
        "GraspFX gx.run to disk": to_disk,
    }
    methods = [Method(name, call, partial(error, "auto"), calls=number) for name, call in calls.items()]
    if not is_installed("llvmlite"):
        return [*methods, missing("GraspFX, ticks alone", "llvmlite")]
    alone = partial(ticks.ENGINES[0].start(scene), number)
    return [*methods, Method("GraspFX, ticks alone", alone, partial(error, "compiled"), calls=number)]


def _by_numpy(system: Springs, truth: FloatArray, number: int) -> Method:
    program = PaperProgram(system)
    n, d = system.anchors.shape
    positions, forces, place = np.empty((number, n, d)), np.empty((number, n, d)), np.empty((number, d))

    def run(rows: int) -> None:
        program.reset()
        for k in range(rows):
            program.tick()
            positions[k], forces[k], place[k] = program.fingers, program.forces, program.position

    def error() -> float:
        run(ticks.TICKS)
        return ticks.anchor_error((program.position, program.rotation()), truth, system)

    return Method("numpy, K known", partial(run, number), error, calls=number)


def _by_mujoco(system: Springs, truth: FloatArray, number: int) -> Method:
    name = "MuJoCo with springs, rollout"
    if not is_installed("mujoco"):
        return missing(name, "mujoco")
    peer = MuJoCoSprings(system)

    def error() -> float:
        return ticks.anchor_error(peer.pose(peer.rollout(ticks.TICKS)[-1]), truth, system)

    return Method(name, partial(peer.rollout, number), error, calls=number)
