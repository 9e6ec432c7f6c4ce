"""Ticks of built-in scenes: whole runs with each engine, and the distribution of the time per tick."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial

import numpy as np

import graspfx as gx
from graspfx.bench.timing import Case, Method, is_installed, missing

TITLE = "Ticks of built-in scenes"
LIMITS = """
Times of `gx.run` are whole calls, from the scene to the recording, divided by the number of ticks; the program of all
scenes was compiled before. `session.step(1)` is timed call by call. Its highest quantiles are due to the system's
scheduler, because the process has ordinary priority and other processes run (see the machine's load). Devices are
simulated; a real device waits for its bus. Errors are the largest difference of finger positions in the first 100 ticks
from those of the interpreted engine; both engines give identical bits.
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
    """Return the largest difference of finger positions from those of the interpreted engine [m]."""
    seconds = CHECKED * scene.period
    own, other = (gx.run(each, duration=seconds) for each in (variant, scene.replace({"engine": "interpreted"})))
    return float(np.abs(own.finger_position - other.finger_position).max())
