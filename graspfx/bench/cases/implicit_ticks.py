"""Ticks under the implicit integrator beside the exact one's: n fingers that touch a ball, with friction or without."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from graspfx.bench.case import Case, Method, is_installed, missing
from graspfx.bench.cases.tick_engines import ENGINES
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

T, SECONDS = 0.001, 0.1  # [s]
RADIUS = 0.03  # of the ball [m]
TICKS = 200
FINER = 16  # times as many samples in the run that errors are against
GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))  # [rad]
INTEGRATORS = ("exact", "implicit")


def beside_exact(n: int, friction: float) -> Case:
    """Compare both integrators on n fingers; the error is that of the ball's place [m]."""
    name = f"{'friction' if friction else 'no friction'}, {n} fingers, integrators"
    names = [f"GraspFX {integrator}" for integrator in INTEGRATORS]
    if not is_installed("llvmlite"):
        return Case("ticks", name, "m", [missing(each, "llvmlite") for each in names])
    truth = place_after(n, friction, "exact", T / FINER)
    methods = []
    for each, integrator in zip(names, INTEGRATORS, strict=True):
        run = partial(ENGINES[0].start(ball(n, friction, integrator, T)), TICKS)
        methods.append(Method(each, run, partial(error_of, n, friction, integrator, truth), calls=TICKS))
    return Case("ticks", name, "m", methods, bound=0.001)


def ball(n: int, friction: float, integrator: str, period: float) -> Scene:
    """Make a ball between n fingers on a Fibonacci spiral, each with a hand that pulls it inwards."""
    k = np.arange(n)
    z = 1.0 - (2.0 * k + 1.0) / n
    around = np.sqrt(1.0 - z * z)
    out = np.stack([around * np.cos(GOLDEN_ANGLE * k), around * np.sin(GOLDEN_ANGLE * k), z], axis=1)
    return Scene(
        dimensions=3,
        period=period,
        duration=SECONDS,
        object={
            "mass": 0.1, "viscosity": 0.8, "rotational_viscosity": 3e-4, "integrator": integrator,
            "shape": {"kind": "sphere", "radius": RADIUS},
        },
        coupling={
            "external": {"stiffness": 60.0, "damping": 0.5}, "internal": {"stiffness": 140.0, "damping": 1.0},
            "friction": friction,
        },
        finger=[
            {
                "device": {"name": "simulated", "mass": 0.15, "damping": 0.2},
                "hand": {"stiffness": 33.0 + i, "rest": (0.5 * RADIUS * u).tolist()},
                "start": (RADIUS * u).tolist(),
            }
            for i, u in enumerate(out)
        ],
    )  # fmt: skip


def place_after(n: int, friction: float, integrator: str, period: float) -> FloatArray:
    """Run the scene and read where the ball is at its end, (3,) [m]."""
    recording = ENGINES[0].record(ball(n, friction, integrator, period), SECONDS + period)
    return np.asarray(recording.object_position[-1])


def error_of(n: int, friction: float, integrator: str, truth: FloatArray) -> float:
    """Measure how far from the truth the ball is [m]."""
    return float(np.linalg.norm(place_after(n, friction, integrator, T) - truth))
