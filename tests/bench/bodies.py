"""Free rigid bodies over the time step, against closed forms: our integrators beside PyBullet and MuJoCo."""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import graspfx as gx
from graspfx.bench.timing import Case, Method, is_installed
from graspfx.objects.bullet.bullet import pybullet
from tests.bench.peers import START, UNUSED, bullet_body, imported
from tests.support.closed_forms import turned_freely, turned_steadily, viscous_motion

FloatArray = NDArray[np.float64]

TITLE = "Rigid bodies over the time step"
LIMITS = """
Errors are those of the motion of one body without contacts, after 1 s. Times are per step: for GraspFX a step of
`session.step`, with a finger far away, its device and a recorded row; for the peers a bare step, called from Python.
PyBullet receives viscosity as a force computed from the velocity before the step, MuJoCo as the damping of joints,
which its integrators except RK4 treat implicitly.
"""

MASS = 0.1  # [kg]
SECONDS = 1.0  # [s]
INTEGRATORS = ("exact", "implicit", "semi-implicit")
MUJOCO = ("MuJoCo Euler", "MuJoCo implicitfast", "MuJoCo RK4")


@dataclass(frozen=True)
class Rigid:
    """A body at the origin: principal moments [kg m^2], velocity along x [m/s], spin [rad/s], viscosities."""

    moments: tuple[float, ...] = (4e-5,) * 3
    viscosity: float = 0.0
    rotational_viscosity: float = 0.0
    velocity: float = 0.0
    spin: tuple[float, ...] = (0.0,) * 3


Pose = tuple[float, Sequence[float]]  # place along x [m], and quaternion x y z w
Error = Callable[[Pose], float]

GLIDING = Rigid(viscosity=0.8, velocity=0.3)
SPUN = Rigid(rotational_viscosity=3e-5, spin=(2.0, -3.0, 4.0))
TUMBLING = Rigid(moments=(3e-5, 5e-5, 6e-5), spin=(4.0, 0.0, 6.0))


def cases(quick: bool) -> Iterator[Case]:
    """Yield a body that glides to a halt, a cube that spins and a box that tumbles."""
    steady = turned_steadily(SPUN.spin, SPUN.rotational_viscosity / SPUN.moments[0], SECONDS)
    free = Rotation.from_matrix(turned_freely(TUMBLING.moments, TUMBLING.spin, SECONDS)).as_quat()
    for T in (0.005,) if quick else (0.001, 0.005, 0.02):
        x, _, way = viscous_motion(T, MASS, GLIDING.viscosity, GLIDING.velocity, [0.0] * round(SECONDS / T))
        ms = f"T = {1e3 * T:g} ms"
        slid: Error = partial(_slid, x, way)
        yield Case("bodies", f"line, viscous, {ms}", "of the way", list(methods(GLIDING, T, slid)))
        yield Case("bodies", f"spinning cube, {ms}", "rad", list(methods(SPUN, T, partial(_turned, steady))))
        yield Case("bodies", f"tumbling box, {ms}", "rad", list(methods(TUMBLING, T, partial(_turned, free))))


def _slid(x: float, way: float, pose: Pose) -> float:
    return abs(pose[0] - x) / way


def _turned(q: FloatArray, pose: Pose) -> float:
    return angle_between(np.asarray(pose[1]), q)


def angle_between(p: FloatArray, q: FloatArray) -> float:
    """Compute the angle [rad] of the rotation from one quaternion to another, accurate where it is small."""
    v = p[3] * q[:3] - q[3] * p[:3] - np.cross(q[:3], p[:3])
    return 2.0 * math.atan2(float(np.linalg.norm(v)), abs(float(p @ q)))


def methods(rigid: Rigid, T: float, error: Error) -> Iterator[Method]:
    """List integrators and peers; an operation is a step."""
    steps = round(SECONDS / T)
    for integrator in INTEGRATORS:
        own = scene(rigid, T, integrator)
        step = partial(gx.open(own).step, steps)
        yield Method(f"GraspFX {integrator}", step, partial(_error, own, error), calls=steps)
    makes: dict[str, Callable[[], Any]] = {"PyBullet": partial(InPyBullet, rigid, T)}
    makes |= {name: partial(InMuJoCo, rigid, T, name.partition(" ")[2]) for name in MUJOCO}
    for name, make in makes.items():
        yield _peer(name, make, error, steps)


def _error(own: gx.Scene, error: Error) -> float:
    return error(pose_of(gx.run(own, duration=SECONDS + own.period)))


def _peer(name: str, make: Callable[[], Any], error: Error, steps: int) -> Method:
    made: list[Any] = []

    def run() -> Pose:
        if not made:
            made.append(make())
        pose: Pose = made[0].run(steps)
        return pose

    return Method(name, run, lambda: error(run()), calls=steps)


def scene(rigid: Rigid, T: float, integrator: str) -> gx.Scene:
    """Put the body into a scene with a finger that never meets it."""
    return gx.Scene(
        dimensions=3,
        period=T,
        duration=SECONDS,
        engine="compiled" if is_installed("llvmlite") else "interpreted",
        object={
            "mass": MASS, "inertia": list(rigid.moments), "viscosity": rigid.viscosity, "integrator": integrator,
            "rotational_viscosity": rigid.rotational_viscosity, "shape": {"kind": "sphere", "radius": 0.01},
            "velocity": [rigid.velocity, 0.0, 0.0], "angular_velocity": list(rigid.spin),
        },
        coupling={"external": {"stiffness": 30.0}, "internal": {"stiffness": 30.0}},
        finger=[{"device": {"name": "simulated", "mass": 0.1, "damping": 0.1}, "start": [0.0, 10.0, 0.0]}],
    )  # fmt: skip


def pose_of(recording: gx.Recording) -> Pose:
    """Read the last row."""
    [motion] = recording.objects.values()
    return float(motion.position[-1, 0]), np.asarray(motion.orientation)[-1].tolist()


class InPyBullet:
    """Its damping off; viscosity as a force and a moment, -b v of the velocities before the step."""

    def __init__(self, rigid: Rigid, T: float) -> None:
        self._bullet = bullet = pybullet()
        self._client, self._rigid = bullet.connect(bullet.DIRECT), rigid
        weakref.finalize(self, bullet.disconnect, self._client)
        self._body = bullet_body(bullet, self._client, MASS, rigid.moments, T)

    def run(self, steps: int) -> Pose:
        bullet, client, body, rigid = self._bullet, self._client, self._body, self._rigid
        bullet.resetBasePositionAndOrientation(body, (0.0, 0.0, 0.0), START, physicsClientId=client)
        bullet.resetBaseVelocity(body, (rigid.velocity, 0.0, 0.0), rigid.spin, physicsClientId=client)
        push, twist, step = bullet.applyExternalForce, bullet.applyExternalTorque, bullet.stepSimulation
        place, motion, frame = bullet.getBasePositionAndOrientation, bullet.getBaseVelocity, bullet.WORLD_FRAME
        b, c = rigid.viscosity, rigid.rotational_viscosity
        where, turn = place(body, client)
        velocity, spin = motion(body, client)
        for _ in range(steps):  # by position, the fastest way to call them
            push(body, -1, (-b * velocity[0], 0.0, 0.0), where, frame, client)
            if c:
                twist(body, -1, (-c * spin[0], -c * spin[1], -c * spin[2]), frame, client)
            step(client)
            where, turn = place(body, client)
            velocity, spin = motion(body, client)
        return float(where[0]), turn


class InMuJoCo:
    """Viscosity as the damping of three slides and a ball joint; "Euler", "implicitfast" or "RK4"."""

    def __init__(self, rigid: Rigid, T: float, integrator: str) -> None:
        self._mujoco = imported("mujoco", "the peer of MuJoCo")
        slides = "".join(
            f'<joint type="slide" axis="{axis}" damping="{rigid.viscosity!r}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1")
        )
        moments = " ".join(repr(float(moment)) for moment in rigid.moments)
        self._model = self._mujoco.MjModel.from_xml_string(f"""
            <mujoco><option timestep="{T!r}" gravity="0 0 0" integrator="{integrator}">{UNUSED}</option>
              <worldbody><body>{slides}
                <joint type="ball" damping="{rigid.rotational_viscosity!r}"/>
                <inertial pos="0 0 0" mass="{MASS!r}" diaginertia="{moments}"/></body></worldbody>
            </mujoco>""")
        self._data = self._mujoco.MjData(self._model)
        self._start = [rigid.velocity, 0.0, 0.0, *rigid.spin]

    def run(self, steps: int) -> Pose:
        step, model, data = self._mujoco.mj_step, self._model, self._data
        self._mujoco.mj_resetData(model, data)
        data.qvel[:] = self._start
        for _ in range(steps):
            step(model, data)
        w, x, y, z = data.qpos[3:7].tolist()
        return float(data.qpos[0]), (x, y, z, w)
