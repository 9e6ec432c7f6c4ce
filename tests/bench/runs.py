"""Whole runs of five attached fingers in space, beside other programs that keep a row of every tick."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import count
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import graspfx as gx
from graspfx.bench.timing import Case, Method, is_installed, missing
from tests.bench.peers import (
    START,
    BareBullet,
    InJax,
    InMuJoCo,
    InNumba,
    InNumpy,
    Program,
    Springs,
    once,
    rotation_matrix,
)

FloatArray = NDArray[np.float64]

TITLE = "Whole runs: devices, coupling, object, recording"
LIMITS = """
Times are per tick, of whole calls: building and checking the scene, loading its program, the ticks with a complete
row for each, and the recording. Programs are compiled beforehand (Start-up shows the time for that). The peers store
positions and forces, or the state, and assume that the fingers stay attached, so that K never changes in the object's
frame; GraspFX checks contacts, limits and faults in every tick. MuJoCo has springs instead of eq. (4), so it takes
part only where kep = kip. PyBullet's bare calls receive the wrenches of a run of GraspFX. Errors are those of the
contact points after 1 s at T = 5 ms, against the same springs without sampling; GraspFX, unlike these springs, holds
forces over a sample, as a device does.
"""

T, SECONDS = 0.005, 1.0  # [s]
TICKS = round(SECONDS / T)
SIZE = 0.05  # of the cube [m]
PLACES = [
    [-0.026, 0.0, 0.0],
    [0.026, 0.01, 0.002],
    [0.026, -0.01, -0.001],
    [0.0, 0.026, 0.005],
    [0.004, -0.002, -0.026],
]
PULLED = [
    [0.006, 0.003, 0.0],
    [0.004, 0.002, 0.002],
    [0.004, 0.0, 0.001],
    [0.002, 0.004, -0.001],
    [-0.001, 0.0, -0.004],
]
EXTERNAL, INTERNAL = 30.0, 70.0  # the paper's kep, kip [N/m]
FINGER_MASS, FINGER_FRICTION, HAND = 0.15, 0.2, 33.0  # [kg], [N s/m], [N/m]
MASS, VISCOSITY, TURNING = 0.1, 0.8, 3e-4  # [kg], [N s/m], [N m s/rad]
BOUND = 0.002  # [m]


def cases(quick: bool) -> Iterator[Case]:
    """Yield separate gains, then equal ones, and runs on PyBullet."""
    number = 1000 if quick else 10_000
    for internal, gains in ((INTERNAL, "kep < kip"), (EXTERNAL, "kep = kip")):
        g = springs(internal)
        truth = anchors_after(g)
        makes: dict[str, Any] = {"numpy": InNumpy, "numba, hand-written loops": InNumba, "JAX, scan": InJax}
        if internal == EXTERNAL:
            makes["MuJoCo, springs, rollout"] = InMuJoCo
        with TemporaryDirectory(prefix="graspfx-bench-") as folder:
            methods = [*ours(scene(internal), number, truth, g, Path(folder))]
            methods += [peer(name, once(make, g), truth, g, number) for name, make in makes.items()]
            yield Case("runs", f"5 fingers, {gains}, {number} ticks", "m", methods, BOUND)
    yield on_bullet(number)


def scene(internal: float, dynamics: str = "native", period: float = T) -> gx.Scene:
    """Make a cube of the paper's mass and viscosity, its fingers attached, each with a hand of 33 N/m."""
    start = np.array(PLACES)
    thing: dict[str, Any] = {
        "mass": MASS, "viscosity": VISCOSITY, "rotational_viscosity": TURNING, "dynamics": dynamics,
        "shape": {"kind": "box", "size": [SIZE] * 3},
    }  # fmt: skip
    return gx.Scene(
        dimensions=3,
        period=period,
        duration=SECONDS,
        engine="compiled" if is_installed("llvmlite") else "interpreted",
        object=thing | ({"integrator": "exact"} if dynamics == "native" else {}),
        coupling={"contact": "attached", "external": {"stiffness": EXTERNAL}, "internal": {"stiffness": internal}},
        finger=[
            {
                "device": {"name": "simulated", "mass": FINGER_MASS, "damping": FINGER_FRICTION},
                "hand": {"stiffness": HAND, "rest": rest},
                "start": begin,
            }
            for begin, rest in zip(start.tolist(), (start + PULLED).tolist(), strict=True)
        ],
    )


def springs(internal: float, period: float = T) -> Springs:
    """Describe the scene for the other programs; a cube's moment of inertia is m a^2/6."""
    start = np.array(PLACES)
    return Springs(
        T=period, anchors=np.clip(start, -0.5 * SIZE, 0.5 * SIZE), start=start, rest=start + PULLED,
        finger_mass=FINGER_MASS, finger_friction=FINGER_FRICTION, hand=HAND, mass=MASS, inertia=MASS * SIZE**2 / 6.0,
        viscosity=VISCOSITY, rotational_viscosity=TURNING, external=EXTERNAL, internal=internal,
    )  # fmt: skip


def anchors_after(g: Springs) -> FloatArray:
    """Compute where the anchors are after a second with forces that are never held, (n, 3), by DOP853."""
    n = len(g.anchors)
    cuts = np.cumsum([3 * n, 3 * n, 3, 3, 3])

    def rate(_: float, y: FloatArray) -> FloatArray:
        x, v, p, u, w, q = np.split(y, cuts)
        R = rotation_matrix(q / np.linalg.norm(q))
        f, wrench = coupling(g, x.reshape(n, 3), p, R)
        pull = (g.hand * (g.rest.ravel() - x) - g.finger_friction * v - f.ravel()) / g.finger_mass
        push, twist = (wrench[:3] - g.viscosity * u) / g.mass, (wrench[3:] - g.rotational_viscosity * w) / g.inertia
        return np.concatenate([v, pull, u, push, twist, 0.5 * np.append(w * q[3] + np.cross(w, q[:3]), -w @ q[:3])])

    first = np.concatenate([g.start.ravel(), np.zeros(3 * n + 9), START])
    y = solve_ivp(rate, (0.0, SECONDS), first, method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    _, _, p, _, _, q = np.split(y, cuts)
    return np.asarray(p + g.anchors @ rotation_matrix(q / np.linalg.norm(q)).T)


def coupling(g: Springs, fingers: FloatArray, position: FloatArray, R: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute forces (n, 3) on the cube by eq. (4) in world axes, P anew, and their wrench (6,)."""
    arms = g.anchors @ R.T
    G = np.vstack([np.tile(np.eye(3), len(arms)), np.hstack([np.cross(arm, np.eye(3)).T for arm in arms])])
    P = np.linalg.pinv(G) @ G
    f = (g.external * P + g.internal * (np.eye(len(P)) - P)) @ (fingers - position - arms).ravel()
    return f.reshape(-1, 3), G @ f


def anchor_error(pose: tuple[FloatArray, FloatArray], truth: FloatArray, g: Springs) -> float:
    """Find the largest distance [m] of an anchor from where it should be."""
    position, R = pose
    return float(np.linalg.norm(position + g.anchors @ R.T - truth, axis=1).max())


def pose_of(recording: gx.Recording) -> tuple[FloatArray, FloatArray]:
    """Read position and rotation of the cube in the last row, which is read at its time."""
    [motion] = recording.objects.values()
    return motion.position[-1], rotation_matrix(np.asarray(motion.orientation)[-1])


def run_error(scene_: gx.Scene, truth: FloatArray, g: Springs) -> float:
    """Run a second of the scene and one tick more; the error [m]."""
    return anchor_error(pose_of(gx.run(scene_, duration=SECONDS + scene_.period)), truth, g)


def ours(scene_: gx.Scene, number: int, truth: FloatArray, g: Springs, folder: Path) -> Iterator[Method]:
    """List the public calls."""
    seconds, folders, error = number * scene_.period, count(), partial(run_error, scene_, truth, g)

    def to_disk() -> None:
        place = folder / f"run-{next(folders)}"
        gx.run(scene_, duration=seconds, out=place)
        rmtree(place)

    long = 20 * number
    calls: dict[str, tuple[Callable[[], object], int]] = {
        "GraspFX gx.run": (partial(gx.run, scene_, duration=seconds), number),
        f"GraspFX gx.run, {long} ticks": (partial(gx.run, scene_, duration=long * scene_.period), long),
        "GraspFX gx.run and its summary": (lambda: gx.run(scene_, duration=seconds).summary(), number),
        "GraspFX gx.run to disk": (to_disk, number),
    }
    for name, (call, ticks) in calls.items():
        yield Method(name, call, error, calls=ticks)


def peer(name: str, program: Callable[[], Program], truth: FloatArray, g: Springs, number: int) -> Method:
    """Run another program as often."""
    return Method(
        name, lambda: program().run(number), lambda: anchor_error(program().run(TICKS), truth, g), calls=number
    )


def on_bullet(number: int) -> Case:
    """Step a session on PyBullet beside the calls that it makes."""
    name = "5 fingers, kep < kip, on PyBullet"
    names = "GraspFX session.step", "PyBullet, bare calls"
    if not is_installed("pybullet"):
        return Case("runs", name, "m", [missing(each, "pybullet") for each in names], BOUND)
    g, own = springs(INTERNAL), scene(INTERNAL, "bullet")
    truth, session = anchors_after(g), gx.open(own)
    bare = once(lambda springs: BareBullet(springs, gx.run(own)), g)
    step = Method(names[0], partial(session.step, TICKS), partial(run_error, own, truth, g), "recorded", TICKS)
    return Case("runs", name, "m", [step, peer(names[1], bare, truth, g, TICKS)], BOUND)
