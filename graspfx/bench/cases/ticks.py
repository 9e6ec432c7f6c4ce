"""Whole ticks of a scene: ours beside PyBullet's bare calls, MuJoCo with springs, and plain numpy from the paper."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from graspfx.bench.case import Case, Method, is_installed, missing
from graspfx.bench.cases import implicit_ticks
from graspfx.bench.cases.tick_engines import ENGINES as ENGINES
from graspfx.bench.cases.tick_engines import ON_BULLET as ON_BULLET
from graspfx.bench.cases.tick_engines import Engine as Engine
from graspfx.bench.peers.bare_bullet import BareBullet
from graspfx.bench.peers.paper import PaperProgram, Springs, coupling, rotation_matrix
from graspfx.bench.peers.springs import MuJoCoSprings
from graspfx.build.build import build
from graspfx.build.run import run
from graspfx.compile.records import numbers
from graspfx.loop.recording.record import Recording
from graspfx.objects import integrators as at
from graspfx.scene.model import Scene
from graspfx.spatial import Quaternion, quaternion_matrix

TITLE = "Whole ticks: devices, coupling, object, recording"
LIMITS = """
This is the steady tick, 200 to a call, its program compiled and loaded; for what a user waits see Whole runs and
Start-up. Fingers are attached: no contact is looked for. Ours records every tick, the others do not. The error is that
of where the fingers' contact points are after 1 s at T = 5 ms, against the same springs without sampling: what is left
of ours is that forces are held over a sample, as a device holds them. MuJoCo has springs instead of equation (4), so it
takes part where kep = kip, a case in which ours has less to do; its springs act within its step, so that it errs ten
times less, and its tendons are stepped without contacts or constraints. Numpy's program knows P and K, which in the
object's frame do not change, and makes all forces by one product. PyBullet's bare calls are given the wrenches of our
run on PyBullet: they are what would be left if our share cost nothing. The cases of integrators have n fingers that
touch a ball, with dampers; there the error is that of the ball's place after 0.1 s, against a sixteenth of the period.
"""

FloatArray = NDArray[np.float64]
T, SECONDS = 0.005, 1.0  # [s]
TICKS = round(SECONDS / T)
SIZE = 0.05  # of the cube [m]
START = {  # of the fingers [m]
    1: [[-0.0255], [0.0265]],
    2: [[-0.026, 0.004], [0.026, 0.01], [0.003, 0.0255]],
    3: [[-0.026, 0.0, 0.0], [0.026, 0.01, 0.002], [0.026, -0.01, -0.001], [0.0, 0.026, 0.005], [0.004, -0.002, -0.026]],
}
PULLED = {  # where the hands' springs pull the fingers to, from there [m]
    1: [[0.006], [0.002]],
    2: [[0.006, 0.003], [0.004, 0.002], [-0.001, 0.004]],
    3: [[0.006, 0.003, 0.0], [0.004, 0.002, 0.002], [0.004, 0.0, 0.001], [0.002, 0.004, -0.001], [-0.001, 0.0, -0.004]],
}
NAMES = {1: "line, 2 fingers", 2: "plane, 3 fingers", 3: "space, 5 fingers"}
EXTERNAL, INTERNAL = 30.0, 70.0  # the paper's kep, kip [N/m]
FINGER_MASS, FINGER_FRICTION, HAND = 0.15, 0.2, 33.0  # [kg], [N s/m], [N/m]


class Ticking(Protocol):
    """Another program that runs a scene from its start."""

    def reset(self) -> None: ...

    def tick(self) -> None: ...

    @property
    def position(self) -> FloatArray:
        """Position of the object, (d,) [m]."""
        ...

    def rotation(self) -> FloatArray:
        """Read the rotation of the object, (d, d)."""
        ...


def cases(quick: bool) -> Iterator[Case]:
    """Yield separate gains, then equal ones, in each dimension; then the implicit integrator beside the exact one."""
    for d in (1, 2, 3):
        for internal in (INTERNAL, EXTERNAL):
            yield whole_ticks(d, internal)
    for n in (2, 5, 10, 20):
        for friction in (0.8, 0.0):
            yield implicit_ticks.beside_exact(n, friction)


def whole_ticks(d: int, internal: float) -> Case:
    """Compare GraspFX and the peers on one scene; the error is that of the anchors' positions [m]."""
    native = make_scene(d, internal, "native")
    scene = springs(native, internal)
    truth = anchors_after(scene)
    methods = [ours(engine, native, truth, scene) for engine in ENGINES]
    if is_installed("pybullet"):
        methods += with_bullet(make_scene(d, internal, "bullet"), truth, scene)
    else:
        methods += [missing(engine.name, "pybullet") for engine in ON_BULLET]
    if internal == EXTERNAL:
        methods += with_mujoco(scene, truth)
    methods.append(_peer("numpy, K known", PaperProgram(scene), truth, scene, TICKS))
    gains = "kep = kip" if internal == EXTERNAL else "kep < kip"
    return Case("ticks", f"{NAMES[d]}, {gains}", "m", methods, bound=0.002)


def make_scene(d: int, internal: float, dynamics: str, period: float = T) -> Scene:
    """Make a cube of the paper's mass and viscosity, its fingers attached, each with a hand of 33 N/m."""
    start = np.array(START[d])
    thing: dict[str, Any] = {
        "mass": 0.1, "viscosity": 0.8, "dynamics": dynamics, "shape": {"kind": "box", "size": [SIZE] * d},
    }  # fmt: skip
    if d > 1:
        thing["rotational_viscosity"] = 3e-4
    if dynamics == "native":
        thing["integrator"] = "exact"
    return Scene(
        dimensions=d,
        period=period,
        duration=SECONDS,
        object=thing,
        coupling={
            "contact": "attached", "external": {"stiffness": EXTERNAL}, "internal": {"stiffness": internal},
        },
        finger=[
            {
                "device": {"name": "simulated", "mass": FINGER_MASS, "damping": FINGER_FRICTION},
                "hand": {"stiffness": HAND, "rest": rest},
                "start": begin,
            }
            for begin, rest in zip(start.tolist(), (start + PULLED[d]).tolist(), strict=True)
        ],
    )  # fmt: skip


def springs(scene: Scene, internal: float) -> Springs:
    """Describe the scene for the other programs; anchors and inertia are those of the built scene."""
    d = scene.dimensions
    with build(scene) as servo:
        body = servo.objects[0].grasped.body_state.copy()
    start = np.array(START[d])
    return Springs(
        T=scene.period,
        anchors=np.clip(start, -0.5 * SIZE, 0.5 * SIZE),
        start=start,
        rest=start + PULLED[d],
        finger_mass=FINGER_MASS,
        finger_friction=FINGER_FRICTION,
        hand=HAND,
        mass=float(body[at.MASS]),
        inertia=float(body[at.INERTIA + 2]) or 1.0,  # nothing turns on a line
        viscosity=float(body[at.VISCOSITY]),
        rotational_viscosity=float(body[at.ROTATIONAL_VISCOSITY]),
        external=EXTERNAL,
        internal=internal,
    )


def anchors_after(g: Springs) -> FloatArray:
    """Compute where the anchors are after a second with forces that are never held, (n, d), by DOP853."""
    n, d = g.anchors.shape
    turns = {1: 0, 2: 1, 3: 3}[d]
    N = n * d

    def parts(y: FloatArray) -> tuple[FloatArray, ...]:
        return tuple(np.split(y, np.cumsum([N, N, d, d, turns])))

    def rate(_: float, y: FloatArray) -> FloatArray:
        x, v, position, velocity, spin, turn = parts(y)
        R = rotation_matrix(d, turn[0] if d == 2 else 0.0, turn / np.linalg.norm(turn) if d == 3 else ())
        forces, wrench = coupling(g, x.reshape(n, d), position, R)
        pull = (g.hand * (g.rest.ravel() - x) - g.finger_friction * v - forces.ravel()) / g.finger_mass
        push = (wrench[:d] - g.viscosity * velocity) / g.mass
        twist = (wrench[d:] - g.rotational_viscosity * spin) / g.inertia
        turning = spin
        if d == 3:
            turning = 0.5 * np.append(spin * turn[3] + np.cross(spin, turn[:3]), -spin @ turn[:3])
        return np.concatenate([v, pull, velocity, push, twist, turning])

    first = [g.start.ravel(), np.zeros(N + 2 * d + turns), [0.0, 0.0, 0.0, 1.0] if d == 3 else np.zeros(turns)]
    y = solve_ivp(rate, (0.0, SECONDS), np.concatenate(first), method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    *_, position, _, _, turn = parts(y)
    R = rotation_matrix(d, turn[0] if d == 2 else 0.0, turn / np.linalg.norm(turn) if d == 3 else ())
    return np.asarray(position + g.anchors @ R.T)


def ours(engine: Engine, scene: Scene, truth: FloatArray, g: Springs) -> Method:
    """Time an engine on a scene."""
    for package in engine.packages:
        if not is_installed(package):
            return missing(engine.name, package)
    ticks = engine.start(scene)

    def call() -> None:
        ticks(TICKS)

    def error() -> float:
        return recorded_error(engine.record(scene, SECONDS + scene.period), truth, g)

    return Method(engine.name, call, error, calls=TICKS)


def recorded_error(recording: Recording, truth: FloatArray, g: Springs) -> float:
    """Measure the error of the last row of a recording, which is read at its time."""
    [motion] = recording.objects.values()
    R = np.eye(3)
    turn = motion.orientation
    if g.dimensions == 3 and turn is not None:
        R = np.array(list(numbers(quaternion_matrix(Quaternion(*turn[-1].tolist()))))).reshape(3, 3)
    elif turn is not None:
        R = rotation_matrix(2, float(turn[-1]), ())
    return anchor_error((motion.position[-1], R[: g.dimensions, : g.dimensions]), truth, g)


def anchor_error(pose: tuple[FloatArray, FloatArray], truth: FloatArray, g: Springs) -> float:
    """Find the largest distance [m] of an anchor from where it should be."""
    position, R = pose
    return float(np.linalg.norm(position + g.anchors @ R.T - truth, axis=1).max())


def with_bullet(scene: Scene, truth: FloatArray, g: Springs) -> Iterator[Method]:
    """Time a run on PyBullet, and the calls that it makes alone."""
    yield from (ours(engine, scene, truth, g) for engine in ON_BULLET)
    [motion] = run(scene).objects.values()
    bare = BareBullet(g, motion.wrench, motion.velocity, motion.angular_velocity)

    def call() -> None:
        bare.reset()
        bare.run()

    def error() -> float:
        call()
        return anchor_error((bare.position, bare.rotation()), truth, g)

    yield Method("PyBullet, bare calls", call, error, "one body, its wrenches known beforehand", TICKS)


def with_mujoco(g: Springs, truth: FloatArray) -> Iterator[Method]:
    """Time a call for each step, and one for all of them."""
    for name, each in (("MuJoCo with springs", 1), ("MuJoCo with springs, one call", TICKS)):
        yield (
            _peer(name, MuJoCoSprings(g, steps=each), truth, g, TICKS // each)
            if is_installed("mujoco")
            else missing(name, "mujoco")
        )


def _peer(name: str, peer: Ticking, truth: FloatArray, g: Springs, ticks: int) -> Method:
    def call() -> None:
        peer.reset()
        for _ in range(ticks):
            peer.tick()

    def error() -> float:
        call()
        return anchor_error((peer.position, peer.rotation()), truth, g)

    return Method(name, call, error, calls=TICKS)
