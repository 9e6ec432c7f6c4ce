"""Ticks of built-in scenes: whole runs by each engine, and how the time of a single tick spreads."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial

import numpy as np

import graspfx as gx
from graspfx.bench.timing import Case, Method, is_installed, missing

TITLE = "Ticks of built-in scenes"
LIMITS = """
Times of `gx.run` are whole calls, from the scene to the recording, divided by the ticks; the scene's program was
compiled before. `session.step(1)` is timed call by call: the last quantiles are those of the system's scheduler, as the
process has ordinary priority and the machine does other things too (see its load). Devices are simulated; a real one
waits for its bus. Errors are the difference of the last positions from those of the interpreted engine: both have the
same bits.
"""

SCENES = ("reference-1dof", "paper-waving", "sphere-three-fingers", "mug")
TICKS = {"compiled": 10_000, "interpreted": 400}
CHECKED = 100  # ticks that are compared before any is timed


def cases(quick: bool) -> Iterator[Case]:
    """Yield a case for each scene."""
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
    """Find the largest difference of the fingers' positions from those of the interpreted engine [m]."""
    seconds = CHECKED * scene.period
    own, other = (gx.run(each, duration=seconds) for each in (variant, scene.replace({"engine": "interpreted"})))
    return float(np.abs(own.finger_position - other.finger_position).max())
