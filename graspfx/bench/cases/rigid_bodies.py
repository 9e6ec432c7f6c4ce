"""Rigid bodies over the time step, against closed forms: our integrators beside PyBullet and MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.bench.case import Case, Method, is_installed, missing
from graspfx.bench.oracles.closed_forms import turned_freely, turned_steadily, viscous_motion
from graspfx.bench.peers.rigid import InMuJoCo, InPyBullet, Rigid, RigidPeer
from graspfx.compile.kernel import kernel, source_function
from graspfx.compile.machine import compiled
from graspfx.compile.records import Floats
from graspfx.objects import integrators as at
from graspfx.objects.body import INTEGRATORS, VISCOUS_LIMIT, fill_body
from graspfx.objects.body_state import BodyState, Motion
from graspfx.objects.integrators import step

TITLE = "Rigid bodies over the time step"
LIMITS = (
    "Errors are those after 1 s of one motion of one body without contacts. The peers are stepped from Python, so "
    "that their times contain its calls; ours are those of a compiled loop, except where a row says otherwise. "
    "PyBullet is given viscosity as a force of the velocity before the step, MuJoCo as the damping of joints, which "
    "its integrators take implicitly except RK4; that is left out where viscosity is what is varied."
)

FloatArray = NDArray[np.float64]
STEPS = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02)  # [s]
MASS, VISCOSITY, VELOCITY = 0.1, 0.8, 0.3  # the paper's [kg], [N s/m]; [m/s]
CUBE = (4e-5,) * 3  # [kg m^2]
CUBE_SPUN = Rigid(MASS, CUBE, rotational_viscosity=3e-5, spin=(2.0, -3.0, 4.0))
BOX_SPUN = Rigid(MASS, (3e-5, 5e-5, 6e-5), spin=(4.0, 0.0, 6.0))
MUJOCO = ("MuJoCo Euler", "MuJoCo implicitfast", "MuJoCo RK4")
RATIOS = (0.04, 1.0, 10.0, 1000.0)  # b T/m
LOST = 1.0  # what is off by the whole way is not stable
ROUNDING = 1e-14  # of the exact integrator, relative
ROUNDED = 4.0 * 2.2e-16  # 4 rad, each step right to the last digit [rad s]

Error = Callable[[float, Sequence[float]], float]  # from the position along x and the quaternion


def cases(quick: bool) -> Iterator[Case]:
    """Yield a body on a line, a cube that spins, a box that tumbles, and ever more viscosity."""
    steps = (0.005, 0.02) if quick else STEPS
    for T in steps:
        yield on_a_line(T)
    for T in steps:
        yield turning("spinning cube", CUBE_SPUN, turned_steadily(CUBE_SPUN.spin, 0.75, 1.0), T, ROUNDED / T)
    tumbled = quaternion_of(turned_freely(BOX_SPUN.moments, BOX_SPUN.spin, 1.0))
    for T in steps:
        yield turning("tumbling box", BOX_SPUN, tumbled, T, 1e-7 * max(1.0, (T / 0.005) ** 4))
    for ratio in RATIOS:
        yield viscous(ratio)


def on_a_line(T: float) -> Case:
    """Apply a force that changes every step; the error is relative to the largest distance from the start."""
    forces = np.random.default_rng(1).normal(size=round(1.0 / T)).tolist()
    name = f"line, viscous, T = {1e3 * T:g} ms"
    return _travelled(name, T, VISCOSITY, forces, ("PyBullet", *MUJOCO), None)


def viscous(ratio: float) -> Case:
    """Hold a force at T = 5 ms and b T/m = ratio; an error larger than the way is instability."""
    T = 0.005
    peers = ("PyBullet", *MUJOCO[:2])  # the third, RK4, is explicit
    return _travelled(f"line, b T/m = {ratio:g}", T, ratio * MASS / T, [0.2] * round(1.0 / T), peers, LOST)


def _travelled(
    name: str, T: float, viscosity: float, forces: Sequence[float], peers: Sequence[str], bound: float | None
) -> Case:
    x, _, largest = viscous_motion(T, MASS, viscosity, VELOCITY, forces)

    def error(position: float, _: Sequence[float]) -> float:
        return abs(position - x) / largest

    rigid = Rigid(MASS, CUBE, viscosity=viscosity, velocity=VELOCITY)
    return Case("bodies", name, "of the way", methods(rigid, 1, T, forces, error, peers, ROUNDING), bound)


def turning(name: str, rigid: Rigid, turn: FloatArray, T: float, bound: float) -> Case:
    """Measure the angle [rad] from the quaternion that it should be turned to; `bound` is the exact integrator's."""

    def error(_: float, q: Sequence[float]) -> float:
        return angle_between(np.asarray(q), turn)

    still = [0.0] * round(1.0 / T)
    entries = methods(rigid, 3, T, still, error, ("PyBullet", *MUJOCO), bound)
    return Case("bodies", f"{name}, T = {1e3 * T:g} ms", "rad", entries)


def methods(
    rigid: Rigid, dimensions: int, T: float, forces: Sequence[float], error: Error, peers: Sequence[str], bound: float
) -> list[Method]:
    """List every integrator and the peers named; an operation is a step; `bound` is that of the exact integrator."""
    entries: list[Method] = []
    for integrator in INTEGRATORS:
        entries += _ours(integrator, rigid, dimensions, T, forces, error, bound if integrator == "exact" else None)
    for name in peers:
        package, _, integrator = name.partition(" ")
        if not is_installed(package.lower()):
            entries.append(missing(name, package.lower()))
            continue
        body = InMuJoCo(rigid, T, integrator=integrator) if integrator else InPyBullet(rigid, T)
        entries.append(_peer(name, body, forces, error))
    return entries


def _ours(
    integrator: str, rigid: Rigid, d: int, T: float, forces: Sequence[float], error: Error, bound: float | None
) -> Iterator[Method]:
    state = np.zeros(at.SIZE)
    fill_body(
        state, dimensions=d, mass=rigid.mass, viscosity=rigid.viscosity, inertia=rigid.moments,
        rotational_viscosity=rigid.rotational_viscosity, velocity=[rigid.velocity, 0.0, 0.0][:d],
        angular_velocity=rigid.spin if d == 3 else None, integrator=integrator,
    )  # fmt: skip
    ratio = rigid.viscosity * T / rigid.mass
    refused = integrator in ("explicit", "semi-implicit") and ratio >= VISCOUS_LIMIT
    note = f"b T/m is {ratio:g}: `graspfx check` refuses it" if refused else ""
    name = f"GraspFX {integrator}"
    has_llvm = is_installed("llvmlite")
    if has_llvm:
        yield _native(name, compiled(advance), np.asarray, state, T, forces, error, bound, note)
    else:
        yield missing(name, "llvmlite")
    if integrator == "exact" or not has_llvm:
        yield _native(
            f"{name}, interpreted", source_function(advance), memoryview, state, T, forces, error, bound, note
        )


def _native(
    name: str, move: Callable[..., None], view: Callable[[FloatArray], Any], start: FloatArray, T: float,
    forces: Sequence[float], error: Error, bound: float | None, note: str,
) -> Method:  # fmt: skip
    state, pushes = start.copy(), np.array(forces)
    S, F = view(state), view(pushes)

    def call() -> None:
        state[:] = start
        move(S, 0, T, F, 0, len(pushes))

    def error_of_run() -> float:
        call()
        motion = BodyState(state).motion
        return error(motion.position.x, motion.array(Motion.quaternion).tolist())

    return Method(name, call, error_of_run, note, len(pushes), bound)


def _peer(name: str, body: RigidPeer, forces: Sequence[float], error: Error) -> Method:
    def call() -> None:
        body.reset()
        body.run(forces)

    def error_of_run() -> float:
        call()
        return error(body.position, body.quaternion)

    return Method(name, call, error_of_run, calls=len(forces))


@kernel
def advance(body: BodyState, T: float, force: Floats, steps: int) -> None:
    """Move the body by steps of T [s], each under its force along x."""
    for k in range(steps):
        body.force[0] = force[k]
        step(body, T)


def angle_between(p: FloatArray, q: FloatArray) -> float:
    """Compute the angle [rad] of the rotation from one quaternion to another, accurate where it is small."""
    v = p[3] * q[:3] - q[3] * p[:3] - np.cross(q[:3], p[:3])
    return 2.0 * math.atan2(float(np.linalg.norm(v)), abs(float(p @ q)))


def quaternion_of(R: FloatArray) -> FloatArray:
    """Give x y z w of a rotation matrix."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(R).as_quat(), dtype=np.float64)
