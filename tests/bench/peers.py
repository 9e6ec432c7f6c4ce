"""Five attached fingers in space by other programs: numpy, numba, JAX, MuJoCo, and PyBullet's bare calls."""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from math import sqrt
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

import graspfx as gx
from graspfx.errors import MissingPackageError
from graspfx.objects.bullet.bullet import pybullet

FloatArray = NDArray[np.float64]
UNUSED = '<flag contact="disable" constraint="disable" sensor="disable" actuation="disable"/>'  # of MuJoCo's steps
START = (0.0, 0.0, 0.0, 1.0)  # an orientation, x y z w


@dataclass(frozen=True)
class Springs:
    """Fingers on a cube: what every program is made from.

    Attributes:
        T: [s].
        anchors: where the fingers are attached, in the cube's frame, which is the world's at time zero (n, 3) [m].
        start: of the fingers (n, 3) [m].
        rest: where their hands' springs pull them to (n, 3) [m].
        finger_mass: [kg]; finger_friction: [N s/m]; hand: stiffness [N/m].
        mass: of the cube [kg]; inertia: about any axis [kg m^2]; viscosity, rotational_viscosity.
        external, internal: kep, kip [N/m].
    """

    T: float
    anchors: FloatArray
    start: FloatArray
    rest: FloatArray
    finger_mass: float
    finger_friction: float
    hand: float
    mass: float
    inertia: float
    viscosity: float
    rotational_viscosity: float
    external: float
    internal: float

    @property
    def K(self) -> FloatArray:
        """k_ep P + k_ip (I - P) in the cube's frame (3 n, 3 n)."""
        G = gx.grasp_matrix(self.anchors)
        P = np.linalg.pinv(G) @ G
        return self.external * P + self.internal * (np.eye(len(P)) - P)


class Program(Protocol):
    """A program that runs the scene from its start, and keeps positions and forces of every tick."""

    def run(self, ticks: int) -> tuple[FloatArray, FloatArray]:
        """Run so many ticks; position (3,) [m] and rotation (3, 3) of the cube after them."""
        ...


def rotation_matrix(quaternion: Any) -> FloatArray:
    """Give the rotation matrix of x y z w."""
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def imported(name: str, wanted_by: str) -> Any:
    """Import an optional package; MissingPackageError without it."""
    try:
        return import_module(name)
    except ImportError as error:
        raise MissingPackageError(name, wanted_by, f"pip install {name}") from error


def jax_in_double() -> Any:
    """Import JAX, with numbers of 64 bits."""
    jax = imported("jax", "the peer of JAX")
    jax.config.update("jax_enable_x64", True)
    return jax


class InNumpy:
    """Semi-implicit Euler as a user of numpy would write it who cares for speed.

    The fingers are attached, so that K never changes in the cube's frame: one product gives all forces and the wrench
    there, another turns them into the world. Arrays are updated in place; the few numbers of the cube are Python's.
    """

    def __init__(self, g: Springs) -> None:
        self.springs, n = g, len(g.anchors)
        self._law = np.vstack([g.K, gx.grasp_matrix(g.anchors) @ g.K])  # forces (3 n), then the wrench (6)
        self._local, self._world = np.empty((n + 2, 3)), np.empty((n + 2, 3))
        self._e, self._step = np.empty((n, 3)), np.empty((n, 3))
        self._decay = 1.0 - g.T * g.finger_friction / g.finger_mass
        self._pull, self._push = g.T * g.hand / g.finger_mass, g.T / g.finger_mass

    def run(self, ticks: int) -> tuple[FloatArray, FloatArray]:
        g, n, step, e, local, world = self.springs, len(self.springs.anchors), *self._arrays()
        x, v = g.start.copy(), np.zeros((n, 3))
        position, back = np.zeros(3), np.eye(3)
        velocity, place, spin = [0.0] * 3, [0.0] * 3, (0.0, 0.0, 0.0)
        turn: tuple[float, ...] = START
        self.positions, self.forces = np.empty((ticks, n, 3)), np.empty((ticks, n, 3))
        rest, flat_e, flat_local, T = self._pull * g.rest, e.reshape(-1), local.reshape(-1), g.T
        glide, push = 1.0 - T * g.viscosity / g.mass, T / g.mass
        slow, twist = 1.0 - T * g.rotational_viscosity / g.inertia, T / g.inertia
        for k in range(ticks):
            np.subtract(x, position, out=step)
            np.matmul(step, back.T, out=e)  # in the cube's frame: (x - p) R - a
            e -= g.anchors
            self._law.dot(flat_e, out=flat_local)
            np.matmul(local, back, out=world)
            v *= self._decay
            v += rest
            v -= np.multiply(x, self._pull, out=step)
            v -= np.multiply(world[:n], self._push, out=step)
            x += np.multiply(v, T, out=step)
            velocity = [glide * u + push * f for u, f in zip(velocity, world[n].tolist(), strict=True)]
            position[:] = place = [p + T * u for p, u in zip(place, velocity, strict=True)]
            p, q, r = (slow * u + twist * m for u, m in zip(spin, world[n + 1].tolist(), strict=True))
            spin = p, q, r
            turn = _turned(turn, p, q, r, 0.5 * T)
            back[:] = rotation_matrix(turn).T
            self.positions[k], self.forces[k] = x, world[:n]
        return position, back.T

    def _arrays(self) -> tuple[FloatArray, ...]:
        return self._step, self._e, self._local, self._world


def _turned(turn: tuple[float, ...], p: float, q: float, r: float, h: float) -> tuple[float, ...]:
    """Turn a quaternion by half a step h of an angular velocity."""
    x, y, z, w = turn
    x, y, z, w = (
        x + h * (p * w + q * z - r * y),
        y + h * (q * w + r * x - p * z),
        z + h * (r * w + p * y - q * x),
        w - h * (p * x + q * y + r * z),
    )
    size = 1.0 / sqrt(x * x + y * y + z * z + w * w)
    return x * size, y * size, z * size, w * size


class InNumba:
    """The same as loops of plain numbers, which numba compiles."""

    def __init__(self, g: Springs) -> None:
        self._ticks = imported("numba", "the peer of numba").njit(loops)
        self._numbers = np.array([g.T, g.finger_mass, g.finger_friction, g.hand, g.mass, g.inertia, g.viscosity,
                                  g.rotational_viscosity])  # fmt: skip
        self._arrays = g.K, g.anchors, g.start, g.rest

    def run(self, ticks: int) -> tuple[FloatArray, FloatArray]:
        self.positions, self.forces = (np.empty((ticks, len(self._arrays[1]), 3)) for _ in range(2))
        position, R = self._ticks(self._numbers, *self._arrays, self.positions, self.forces)
        return position, R


def loops(
    numbers: FloatArray, K: FloatArray, anchors: FloatArray, start: FloatArray, rest: FloatArray,
    positions: FloatArray, forces: FloatArray,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Run as many ticks as `positions` (N, n, 3) has room for; written for numba."""
    T, finger_mass, finger_friction, hand, mass, inertia, viscosity, rotational = numbers
    n = len(anchors)
    x, v = start.copy(), np.zeros((n, 3))
    p, u, w = np.zeros(3), np.zeros(3), np.zeros(3)
    q, R = np.array([0.0, 0.0, 0.0, 1.0]), np.eye(3)
    e, f, total, moment = np.zeros(3 * n), np.zeros(3), np.zeros(3), np.zeros(3)
    for k in range(len(positions)):
        for i in range(n):
            for a in range(3):
                e[3 * i + a] = -anchors[i, a]
                for b in range(3):
                    e[3 * i + a] += R[b, a] * (x[i, b] - p[b])
        total[:], moment[:] = 0.0, 0.0
        for i in range(n):
            for a in range(3):
                f[a] = 0.0
                for j in range(3 * n):
                    f[a] += K[3 * i + a, j] * e[j]
            for a in range(3):
                world = R[a, 0] * f[0] + R[a, 1] * f[1] + R[a, 2] * f[2]
                b, c = (a + 1) % 3, (a + 2) % 3
                total[a] += world
                moment[a] += anchors[i, b] * f[c] - anchors[i, c] * f[b]
                v[i, a] += T * (hand * (rest[i, a] - x[i, a]) - finger_friction * v[i, a] - world) / finger_mass
                forces[k, i, a] = world
        for i in range(n):
            for a in range(3):
                x[i, a] += T * v[i, a]
                positions[k, i, a] = x[i, a]
        for a in range(3):
            u[a] += T * (total[a] - viscosity * u[a]) / mass
            p[a] += T * u[a]
            w[a] += T * (R[a, 0] * moment[0] + R[a, 1] * moment[1] + R[a, 2] * moment[2] - rotational * w[a]) / inertia
        h = 0.5 * T
        q0, q1, q2, q3 = q[0], q[1], q[2], q[3]
        q[0] += h * (w[0] * q3 + w[1] * q2 - w[2] * q1)
        q[1] += h * (w[1] * q3 + w[2] * q0 - w[0] * q2)
        q[2] += h * (w[2] * q3 + w[0] * q1 - w[1] * q0)
        q[3] -= h * (w[0] * q0 + w[1] * q1 + w[2] * q2)
        q /= math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            R[a, a] = 1.0 - 2.0 * (q[b] * q[b] + q[c] * q[c])
            R[a, b] = 2.0 * (q[a] * q[b] - q[c] * q[3])
            R[b, a] = 2.0 * (q[a] * q[b] + q[c] * q[3])
    return p, R


class InJax:
    """The same as a scan that JAX compiles for a number of ticks."""

    def __init__(self, g: Springs) -> None:
        jax = jax_in_double()
        self._springs, np_ = g, jax.numpy
        K, anchors, rest = np_.array(g.K), np_.array(g.anchors), np_.array(g.rest)
        G = np_.array(gx.grasp_matrix(g.anchors))

        def rotation(q: Any) -> Any:
            x, y, z, w = q
            cross = np_.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            return np_.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross

        def tick(state: Any, _: Any) -> Any:
            x, v, p, u, w, q = state
            R = rotation(q)
            local = K @ ((x - p) @ R - anchors).ravel()
            wrench = G @ local
            f = local.reshape(-1, 3) @ R.T
            v = v + g.T * (g.hand * (rest - x) - g.finger_friction * v - f) / g.finger_mass
            x = x + g.T * v
            u = u + g.T * (R @ wrench[:3] - g.viscosity * u) / g.mass
            p = p + g.T * u
            w = w + g.T * (R @ wrench[3:] - g.rotational_viscosity * w) / g.inertia
            q = q + 0.5 * g.T * np_.append(w * q[3] + np_.cross(w, q[:3]), -w @ q[:3])
            q = q / np_.linalg.norm(q)
            return (x, v, p, u, w, q), (x, f)

        def ticks(start: Any, count: int) -> Any:
            return jax.lax.scan(tick, start, None, length=count)

        self._ticks = jax.jit(ticks, static_argnums=1)

    def run(self, ticks: int) -> tuple[FloatArray, FloatArray]:
        g, zero = self._springs, np.zeros(3)
        start = g.start, np.zeros_like(g.start), zero, zero, zero, np.array(START)
        (_, _, position, _, _, q), rows = self._ticks(start, ticks)
        self.positions, self.forces = (np.asarray(each) for each in rows)
        return np.asarray(position), rotation_matrix(np.asarray(q))


class InMuJoCo:
    """Every coupling spring as a tendon of length zero: equal gains, kep = kip. Its rollout keeps every state."""

    def __init__(self, g: Springs) -> None:
        self._mujoco = imported("mujoco", "the peer of MuJoCo")
        imported("mujoco.rollout", "the peer of MuJoCo")
        anchors = "".join(f'<site name="a{i}" pos="{_text(place)}"/>' for i, place in enumerate(g.anchors))
        moments = " ".join([repr(g.inertia)] * 3)
        fingers = "".join(
            f'<body pos="{_text(at)}">{_slides(g.finger_friction, g.hand, rest - at)}'
            f'<inertial pos="0 0 0" mass="{g.finger_mass!r}" diaginertia="1 1 1"/><site name="f{i}"/></body>'
            for i, (at, rest) in enumerate(zip(g.start, g.rest, strict=True))
        )
        springs = "".join(
            f'<spatial stiffness="{g.external!r}" springlength="0 0"><site site="a{i}"/><site site="f{i}"/></spatial>'
            for i in range(len(g.anchors))
        )
        self._model = self._mujoco.MjModel.from_xml_string(f"""
            <mujoco><option timestep="{g.T!r}" gravity="0 0 0">{UNUSED}</option><worldbody>
              <body>{_slides(g.viscosity, 0.0, np.zeros(3))}
                <joint type="ball" damping="{g.rotational_viscosity!r}"/>
                <inertial pos="0 0 0" mass="{g.mass!r}" diaginertia="{moments}"/>{anchors}</body>{fingers}
              </worldbody><tendon>{springs}</tendon></mujoco>""")
        self._data = self._mujoco.MjData(self._model)

    def run(self, ticks: int) -> tuple[FloatArray, FloatArray]:
        kind = self._mujoco.mjtState.mjSTATE_FULLPHYSICS
        first = np.empty(self._mujoco.mj_stateSize(self._model, kind))
        self._mujoco.mj_resetData(self._model, self._data)
        self._mujoco.mj_getState(self._model, self._data, first, kind)
        states, _ = self._mujoco.rollout.rollout(self._model, self._data, first, nstep=ticks)
        x, y, z, qw, qx, qy, qz = states[0][-1][1:8].tolist()
        return np.array([x, y, z]), rotation_matrix((qx, qy, qz, qw))


def _slides(damping: float, stiffness: float, rest: FloatArray) -> str:
    return "".join(
        f'<joint type="slide" axis="{axis}" damping="{damping!r}" stiffness="{stiffness!r}" springref="{float(x)!r}"/>'
        for axis, x in zip(("1 0 0", "0 1 0", "0 0 1"), rest, strict=True)
    )


def _text(point: FloatArray) -> str:
    return " ".join(repr(float(x)) for x in point)


class BareBullet:
    """A body in PyBullet that is given known pushes and twists: the calls that a tick cannot do without."""

    def __init__(self, g: Springs, recording: gx.Recording) -> None:
        self._bullet = bullet = pybullet()
        self._client = client = bullet.connect(bullet.DIRECT)
        weakref.finalize(self, bullet.disconnect, client)
        self._body = bullet_body(bullet, client, g.mass, [g.inertia] * 3, g.T)
        [motion] = recording.objects.values()
        wrench, spin = motion.wrench, motion.angular_velocity
        self._pushes = _held(wrench[:, :3], motion.velocity, g.viscosity, g.mass, g.T)
        self._twists = _held(wrench[:, 3:], spin, g.rotational_viscosity, g.inertia, g.T)

    def run(self, ticks: int) -> tuple[FloatArray, FloatArray]:
        """Apply the first pushes and twists, as many as there are ticks."""
        bullet, client, body = self._bullet, self._client, self._body
        bullet.resetBasePositionAndOrientation(body, (0.0, 0.0, 0.0), START, physicsClientId=client)
        bullet.resetBaseVelocity(body, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), physicsClientId=client)
        force, torque, step = bullet.applyExternalForce, bullet.applyExternalTorque, bullet.stepSimulation
        place, motion, frame = bullet.getBasePositionAndOrientation, bullet.getBaseVelocity, bullet.WORLD_FRAME
        where, turn = (0.0, 0.0, 0.0), START
        for push, twist in zip(self._pushes[:ticks], self._twists[:ticks], strict=True):  # by position: the fastest way
            force(body, -1, push, where, frame, client)
            torque(body, -1, twist, frame, client)
            step(client)
            where, turn = place(body, client)
            motion(body, client)
        return np.array(where), rotation_matrix(turn)


def bullet_body(bullet: Any, client: int, mass: float, moments: Any, T: float) -> int:
    """Make a body that meets nothing, PyBullet's damping and limit of speed off."""
    bullet.setTimeStep(T, physicsClientId=client)
    body: int = bullet.createMultiBody(mass, physicsClientId=client)
    bullet.changeDynamics(
        body, -1, mass=mass, localInertiaDiagonal=moments, linearDamping=0.0, angularDamping=0.0, maxJointVelocity=1e30,
        physicsClientId=client,
    )  # fmt: skip
    return body


def _held(load: Any, velocity: Any, b: float, m: float, T: float) -> list[tuple[float, ...]]:
    """Give the loads that have exact viscosity in a step of semi-implicit Euler: g F - b_eff v."""
    share = -math.expm1(-b * T / m) / (b * T / m)
    return [tuple(row) for row in (share * (load - b * velocity)).tolist()]


def once(make: Callable[[Springs], Program], g: Springs) -> Callable[[], Program]:
    """Make a program when it is first asked for, so that a missing package is found out then."""
    made: list[Program] = []

    def program() -> Program:
        if not made:
            made.append(make(g))
        return made[0]

    return program
