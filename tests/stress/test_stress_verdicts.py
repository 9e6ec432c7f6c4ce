"""Varied scenes through check, certify and run: errors are GraspFX's, and no run contradicts its scene's verdict."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.certificate.certificate import Certificate
from graspfx.errors import GraspFXError, SceneError
from tests.support.families import efforts, family
from tests.support.scatter import decades, rotation

ANSWERED = family("verdicts: check, certify and run", "an error of GraspFX, or a verdict and a recording")
TOLD = family("verdicts: those that a run can tell", "the run itself")

CALM = 1e-7  # [m]: what is still at the end of a run
LOUD = 40.0  # of log amplitude: rounding that has grown past every other motion
SLIDE = 2  # of `status`
SURE = 1e-4  # of a spectral radius about 1: nearer, a run of some seconds tells nothing


KINDS = {
    1: ["box", "sphere"],
    2: ["box", "sphere", "capsule", "ellipsoid"],
    3: ["box", "sphere", "capsule", "cylinder", "ellipsoid", "mesh", "ring"],
}
DYNAMICS = ["native", "native", "native", "bullet", "mujoco"]
SECONDS = 3.0  # of a run
RAMP = 0.3  # [s]: in which hands close
NUDGE = 1e-5  # [m/s]: with which objects begin, and their surfaces turn


def varied_table(seed: int) -> dict[str, Any]:
    """1 to 3 objects in 1 to 3 dimensions, some that no finger names, and 1 to 5 fingers from 2 mm inside to 50 mm off.

    Hands are still and close by up to 8 mm. Gains go from well below a wall's limit 2 b/T to several times above it.
    """
    rng = np.random.default_rng([26, seed])
    d, n, count = int(rng.integers(1, 4)), int(rng.integers(1, 6)), int(rng.choice([1, 1, 1, 2, 3]))
    T = float(rng.choice([0.001, 0.002, 0.004]))
    dynamics = str(rng.choice(DYNAMICS))
    names = [f"object{i}" for i in range(count)]
    attached = bool(rng.random() < 0.15)
    objects = [_object(rng, d, name, dynamics, 0.3 * i) for i, name in enumerate(names)]
    mass, friction = decades(rng, 0.03, 0.3), decades(rng, 0.1, 2.0)
    device: dict[str, Any] = {"name": "simulated", "mass": mass, "damping": friction}
    if rng.random() < 0.2:
        device["delay"] = int(rng.integers(1, 3))
    held = rng.integers(0, count, n) if rng.random() < 0.7 else np.zeros(n, dtype=int)
    stiffness = 2.0 * friction / T * np.exp(rng.uniform(np.log(0.05), np.log(1.5), 2))
    damping = friction * rng.uniform(0.0, 0.3, 2) * (rng.random(2) < 0.4)
    coupling: dict[str, Any] = {
        "contact": "attached" if attached else "unilateral",
        "friction": "stick" if attached else rng.choice(["stick", "slip", "coulomb"]),
        "reaction": str(rng.choice(["fingertip", "contact"])),
        "absent": str(rng.choice(["fade", "follow"])),
        "metric": str(rng.choice(["equal", "equal", "mass"])),
        "external": {"stiffness": stiffness[0], "damping": damping[0]},
        "internal": {"stiffness": stiffness[1], "damping": damping[1]},
    }
    coupling["friction"] = {"slip": 0.0, "coulomb": float(rng.uniform(0.2, 1.2))}.get(coupling["friction"], "stick")
    table: dict[str, Any] = {
        "dimensions": d,
        "period": T,
        "duration": SECONDS,
        "object": objects,
        "coupling": coupling,
        "finger": [_finger(rng, d, objects[k], device, i, attached) for i, k in enumerate(held)],
    }
    for thing in objects:  # else a grasp that is exactly even stands on its edge for ever
        thing["velocity"] = (NUDGE * rng.normal(size=d)).tolist()
        if d > 1:
            thing["angular_velocity"] = float(rng.normal()) if d == 2 else rng.normal(size=3).tolist()
            thing["angular_velocity"] = (NUDGE / 0.03 * np.array(thing["angular_velocity"])).tolist()
    if rng.random() < 0.3:
        up = np.eye(d)[-1]
        table["gravity"] = (-9.81 * up).tolist()
        if rng.random() < 0.6:
            below = float(rng.choice([0.05, 0.08]))
            floor = {"name": "floor", "shape": {"kind": "half-space", "normal": up.tolist()}}
            table["obstacle"] = [{**floor, "position": (-below * up).tolist()}]
    return table


def _object(rng: np.random.Generator, d: int, name: str, dynamics: str, away: float) -> dict[str, Any]:
    size = float(rng.uniform(0.02, 0.05))
    thing: dict[str, Any] = {
        "name": name,
        "mass": decades(rng, 0.03, 0.5),
        "viscosity": decades(rng, 0.05, 2.0),
        "shape": _shape(rng, d, size),
        "position": (away * np.eye(d)[0]).tolist(),
        "dynamics": dynamics,
    }
    if dynamics == "native":
        thing["integrator"] = str(rng.choice(["explicit", "semi-implicit", "exact", "implicit"]))
    if d > 1:
        thing["rotational_viscosity"] = thing["viscosity"] * size**2
    if d == 3 and rng.random() < 0.3:
        q = rng.normal(size=4)
        thing["orientation"] = (q / np.linalg.norm(q)).tolist()
    if d == 2 and rng.random() < 0.3:
        thing["orientation"] = float(rng.uniform(-3.0, 3.0))
    return thing


def _shape(rng: np.random.Generator, d: int, size: float) -> dict[str, Any]:
    kind = str(rng.choice(KINDS[d]))
    if kind == "box":
        return {"kind": kind, "size": (2.0 * size * rng.uniform(0.5, 1.0, d)).tolist()}
    if kind == "sphere":
        return {"kind": kind, "radius": size}
    if kind == "ellipsoid":
        return {"kind": kind, "semi_axes": (size * rng.uniform(0.5, 1.0, d)).tolist()}
    if kind in ("capsule", "cylinder"):
        return {"kind": kind, "radius": 0.4 * size, "length": 1.2 * size}
    vertices, faces = _octahedron(size) if kind == "mesh" else _ring(size)
    return {"kind": "mesh", "vertices": vertices, "faces": faces}


def _octahedron(size: float) -> tuple[list[list[float]], list[list[int]]]:
    vertices = [*(size * np.eye(3)).tolist(), *(-size * np.eye(3)).tolist()]
    faces = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    return vertices, faces


def _ring(size: float, count: int = 16, around: int = 8) -> tuple[list[list[float]], list[list[int]]]:
    a, b = np.meshgrid(np.arange(count) * 2 * np.pi / count, np.arange(around) * 2 * np.pi / around, indexing="ij")
    out = size * (0.75 + 0.25 * np.cos(b))
    vertices = np.stack([out * np.cos(a), out * np.sin(a), 0.25 * size * np.sin(b)], axis=-1).reshape(-1, 3)
    i, j = (each.ravel() for each in np.meshgrid(np.arange(count), np.arange(around), indexing="ij"))
    p, q = i * around + j, (i + 1) % count * around + j
    r, s = (i + 1) % count * around + (j + 1) % around, i * around + (j + 1) % around
    return vertices.tolist(), np.concatenate([np.stack([p, q, r], 1), np.stack([p, r, s], 1)]).tolist()


def _finger(
    rng: np.random.Generator, d: int, thing: dict[str, Any], device: dict[str, Any], i: int, attached: bool
) -> dict[str, Any]:
    """Every second finger faces the one before it, so that squeezes hold."""
    angle = 2.1 * (i // 2)
    toward = np.array([1.0, 0.0, 0.0])[:d] if d == 1 else np.array([np.cos(angle), np.sin(angle), 0.0])[:d]
    toward = toward * (-1.0) ** i
    if d == 3 and rng.random() < 0.2:
        toward = rotation(rng)[0]
    gap = 0.0 if attached or rng.random() < 0.2 else decades(rng, 1e-5, 0.05)
    closing = float(rng.uniform(0.001, 0.008)) if rng.random() < 0.8 else 0.0
    hand = {
        "stiffness": decades(rng, 30.0, 1000.0),
        "damping": float(rng.uniform(0.0, 1.0)),
        "squeeze": closing + (gap if rng.random() < 0.6 else 0.0),
        "squeeze_ramp": RAMP,
    }
    finger: dict[str, Any] = {
        "device": device,
        "object": thing["name"],
        "start": {"toward": toward.tolist(), "gap": gap},
        "hand": hand,
    }
    if rng.random() < 0.2:
        finger["radius"] = 0.006
    if not attached and rng.random() < 0.1:
        finger["pad"] = {"kind": "hertz", "stiffness": decades(rng, 1e4, 1e6)}
    return finger


def contradiction(scene: gx.Scene, one: Certificate, run: gx.Recording) -> str | None:
    """Say how a run contradicts a verdict; nothing where it agrees, None where it cannot tell.

    It cannot tell where fingers that a stable grasp has let go or slide in its second half, and of a loop so near to
    its limit, or so short a run, that nothing grows or fades in time.
    """
    index = [thing.name for thing in scene.object].index(one.object)
    fingers = np.flatnonzero(np.array(scene.finger_objects) == index)
    touching = run.touching[:, fingers]
    if run.faults or (not one.grasps and scene.gravity is not None):
        return None
    half = len(touching) // 2
    if not one.grasps:  # a finger may tap the object as it overshoots
        return "a finger touches" if touching[half:].all(axis=0).any() else ""
    held = bool(touching[half:].all()) and (run.status is None or not (run.status[half:, fingers] == SLIDE).any())
    if one.stable and one.spectral_radius < 1.0 - SURE and held:
        grown = [each for each in run.summary()["growth"] if each["object"] == one.object]
        return f"it grows: {grown[0]}" if grown and not grown[0]["mode"].startswith("pushing") else ""
    ticks = len(touching) - round(RAMP / scene.period)
    if one.spectral_radius > 1.0 + SURE and math.log(one.spectral_radius) * ticks > LOUD:
        motion = float(np.ptp(run.finger_position[-len(touching) // 10 :, fingers], axis=0).max())
        return f"it is calm at its end, within {motion:.1e} m" if held and motion < CALM else ""
    return None


@efforts(short=4, full=5000)
def test_varied_scenes_have_verdicts_that_runs_do_not_contradict(cases: int) -> None:
    pytest.importorskip("mujoco")
    pytest.importorskip("pybullet")
    wrong: list[tuple[int, str]] = []
    for seed in range(cases):
        outcome = judged(seed)
        if outcome:
            wrong.append((seed, outcome))
    assert not wrong, "\n".join(f"scene {seed}: {text}" for seed, text in wrong)


def judged(seed: int) -> str:
    """Check, certify and run a scene; say what is wrong, or nothing."""
    try:
        scene = gx.Scene(**varied_table(seed))
    except SceneError:
        ANSWERED.tried()
        return ""
    report = gx.check(scene)
    ANSWERED.tried()
    try:
        run = gx.run(scene)
    except GraspFXError as error:
        return "" if not report.ok else f"{report.verdict}, but its run is refused: {error}"
    if report.faults:
        return f"{report.verdict}, but it runs"
    if not report.certificates:
        return ""
    certificates = {one.object: one for one in gx.certify(scene)}
    for one in report.certificates:
        if certificates[one.object].verdict != one.verdict:
            return f"check: {one.verdict}; certify: {certificates[one.object].verdict}"
        said = contradiction(scene, one, run)
        if said is not None:
            TOLD.tried()
        if said:
            return f"{one.verdict}, but {said}"
    return ""
