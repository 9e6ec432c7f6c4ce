"""Benchmark of ticks of built-in scenes: mean time per tick of whole runs, and quantiles of single ticks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial

import numpy as np

import graspfx as gx
from graspfx.bench.timing import Case, Method, is_installed, missing

TITLE = "Ticks of built-in scenes"
LIMITS = """
The time of `gx.run` is the time of the whole call divided by the number of ticks; it does not include compilation.
Each call of `session.step(1)` is timed separately. The highest quantiles of these times depend on the scheduler of the
system, because the process has ordinary priority. Devices are simulated; a real device also takes time for its bus. The
error is the largest difference between the finger positions of the first 100 ticks and those of the interpreted engine;
it is zero if both engines give identical bits.
"""

SCENES = ("reference-1dof", "paper-waving", "sphere-three-fingers", "mug")
TICKS = {"compiled": 10_000, "interpreted": 400}
CHECKED = 100  # ticks that are compared before timing


def cases(quick: bool) -> Iterator[Case]:
    """Yield one case per scene."""
    for name in SCENES[: 2 if quick else None]:
        scene = gx.load(name)
        with ExitStack() as stack:
            methods = []
            for engine, count in TICKS.items():
                variant = scene.replace({"engine": engine})
                if engine == "compiled" and not is_installed("llvmlite"):
                    methods.append(missing(f"gx.run, {engine}", "llvmlite"))
                    continue
                error = partial(_difference, scene, variant)
                whole = partial(gx.run, variant, duration=count * scene.period)
                session = stack.enter_context(gx.open(variant))
                methods.append(Method(f"gx.run, {engine}", whole, error, f"{count} ticks", calls=count))
                methods.append(Method(f"session.step(1), {engine}", partial(session.step, 1), error, singly=True))
            yield Case("ticks", name, "m", methods, bound=0.0)


def _difference(scene: gx.Scene, variant: gx.Scene) -> float:
    """Return the largest difference between finger positions of a variant and those of the interpreted engine [m]."""
    seconds = CHECKED * scene.period
    own, other = (gx.run(each, duration=seconds) for each in (variant, scene.replace({"engine": "interpreted"})))
    return float(np.abs(own.finger_position - other.finger_position).max())
