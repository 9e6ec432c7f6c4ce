"""Thousands of variants of the 1-DOF system at once, beside arrays of numpy and one run after another."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import graspfx as gx
from graspfx.bench.case import Case, Method, is_installed, missing
from graspfx.loop.servo import Servo
from graspfx.processors import processors
from graspfx.scene.batch import Runs
from graspfx.scene.making.build import build
from graspfx.scene.model import Scene
from graspfx.scene.variants import Variants

FloatArray = NDArray[np.float64]

TITLE = "Batches"
LIMITS = """
Time is that of the runs, per tick of one variant: to build 10 000 variants takes seconds besides, most of it for the
few hundred whole scenes that the others are put together from. The program side by side keeps of each run its growth
only. The scene is attached and on a line; fingers that let go are run one by one. The error is that of the last
positions of both fingers and of the object against single runs, of the largest position in them, over the variants
that are stable.
"""

STIFFNESS, VISCOSITY = "coupling.external.stiffness", "object.viscosity"
BOUND = 1e-12
CHECKED = 12
ALONE = 20  # runs that are timed one after another


def cases(quick: bool) -> Iterator[Case]:
    side, ticks = (30, 200) if quick else (100, 1000)
    scene = gx.load("reference-1dof")
    stiffness, viscosity = np.linspace(5.0, 60.0, side), np.linspace(0.6, 1.5, side)
    values = np.stack(np.meshgrid(stiffness, viscosity, indexing="ij"), axis=-1).reshape(-1, 2)
    chosen = np.random.default_rng(3).integers(0, len(values), CHECKED)
    known = np.stack([_alone(scene, values[k], ticks) for k in chosen])

    def error(last: FloatArray) -> float:
        return float((np.abs(last[chosen] - known).max(axis=1) / np.abs(known).max(axis=1)).max())

    name = f"{len(values)} variants, {ticks} ticks"
    yield Case("batches", name, "relative", list(_methods(scene, values, ticks, error)), BOUND)


def _methods(scene: Scene, values: FloatArray, ticks: int, error: Callable[[FloatArray], float]) -> Iterator[Method]:
    calls = len(values) * ticks
    if not is_installed("llvmlite"):
        yield missing("GraspFX run_batch", "llvmlite")
    else:
        seconds = ticks * scene.period
        lists = {STIFFNESS: list(values[:, 0]), VISCOSITY: list(values[:, 1])}
        unique = {key: sorted(set(each)) for key, each in lists.items()}
        numbers = np.array([[unique[key].index(each[k]) for key, each in lists.items()] for k in range(len(values))])
        variants = Variants(scene, unique, numbers)
        groups = variants.groups()

        def last() -> float:
            batch = gx.run_batch(scene, lists, seconds, zip=True, measure=["finger_position", "object_position"],
                                 statistics=["last"])  # fmt: skip
            fingers, thing = batch["finger_position"]["last"][:, :, 0], batch["object_position"]["last"]
            return error(np.concatenate([fingers, thing], axis=1))

        for threads, note in ((None, "every processor"), (1, "one processor")):
            runs = Runs(scene, variants, len(values), seconds, threads or processors())
            yield Method(
                f"GraspFX run_batch, {note}", partial(runs.measured, groups, ["finger_position"], ["growth"]), last,
                calls=calls,
            )  # fmt: skip
        servos = [_built(scene, each) for each in values[:ALONE]]

        def one_by_one() -> None:
            for servo in servos:
                servo.run(ticks, None)

        yield Method(
            "GraspFX, compiled, one by one", one_by_one, 0.0,
            "each goes on from where it was", calls=ALONE * ticks,
        )  # fmt: skip
    yield Method(
        "numpy, arrays of variants", lambda: side_by_side(scene, values, ticks),
        lambda: error(side_by_side(scene, values, ticks)), calls=calls,
    )  # fmt: skip


def _alone(scene: Scene, value: FloatArray, ticks: int) -> FloatArray:
    changed = scene.replace({STIFFNESS: float(value[0]), VISCOSITY: float(value[1])})
    run = gx.run(changed, ticks * scene.period)
    return np.concatenate([run.finger_position[-1, :, 0], run.object_position[-1]])


def _built(scene: Scene, value: FloatArray) -> Servo:
    changed = scene.replace({STIFFNESS: float(value[0]), VISCOSITY: float(value[1]), "engine": "compiled"})
    with build(changed, record=False) as servo:
        return servo


def side_by_side(scene: Scene, values: FloatArray, ticks: int) -> FloatArray:
    """Eqs. (4)-(12) for all variants at once, as numpy has them: the last positions of the fingers and the object."""
    T, kip, mass = scene.period, _number(scene.coupling.internal.stiffness), _number(scene.object[0].mass)
    A, B = _device_step(scene)
    viscosity = values[:, 1]
    E = np.exp(-viscosity / mass * T)
    travel = (1.0 - E) * mass / viscosity
    drift = (T - travel) / viscosity
    q = np.array([each.start[0] for each in scene.finger])[:, None] * np.ones(len(values))  # the hands rest at 0
    v, x, speed = np.zeros_like(q), np.zeros(len(values)), np.zeros(len(values))
    last = np.empty((len(values), 3))
    for _ in range(ticks):
        last[:, :2], last[:, 2] = q.T, x
        e = q - x
        mean = e.mean(axis=0)
        f = values[:, 0] * mean + kip * (e - mean)
        total = f.sum(axis=0)
        x, speed = x + travel * speed + drift * total, E * speed + travel / mass * total
        q, v = A[0, 0] * q + A[0, 1] * v - B[0] * f, A[1, 0] * q + A[1, 1] * v - B[1] * f
    return last


def _device_step(scene: Scene) -> tuple[FloatArray, FloatArray]:
    """A and B of m q'' + b q' + k q = u over a period, u held."""
    from scipy.linalg import expm

    finger = scene.finger[0]
    device: Any = finger.device
    hand: Any = finger.hand
    m, b, k = device.settings["mass"], device.settings["friction"], _number(hand.stiffness)
    system = np.array([[0.0, 1.0, 0.0], [-k / m, -b / m, 1.0 / m], [0.0, 0.0, 0.0]])
    E = np.asarray(expm(system * scene.period))
    return E[:2, :2], E[:2, 2]


def _number(value: Any) -> float:
    return float(np.asarray(value))
