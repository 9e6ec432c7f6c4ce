"""A free rigid body in PyBullet and in MuJoCo, stepped under a force that its user gives."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Protocol

from graspfx.objects.bullet.bullet import NO_LIMIT, new_client, pybullet

Three = Sequence[float]
UNUSED = '<flag contact="disable" constraint="disable" sensor="disable" actuation="disable"/>'  # of MuJoCo's steps


class RigidPeer(Protocol):
    """A body in another program."""

    def reset(self) -> None:
        """Reset to time zero."""

    def run(self, forces: Sequence[float]) -> None:
        """Run a step for each force along x [N]."""

    @property
    def position(self) -> float: ...

    @property
    def quaternion(self) -> Sequence[float]:
        """x y z w."""
        ...


@dataclass(frozen=True)
class Rigid:
    """A body with principal moments along the world's axes at time zero, when it moves along x.

    Attributes:
        mass: [kg]; moments: [kg m^2]; viscosity: [N s/m]; rotational_viscosity: [N m s/rad]; of a body with that, all
            moments are equal.
        velocity: [m/s]; spin: [rad/s].
    """

    mass: float
    moments: Three
    viscosity: float = 0.0
    rotational_viscosity: float = 0.0
    velocity: float = 0.0
    spin: Three = (0.0, 0.0, 0.0)


def free_body(bullet: Any, client: int, mass: float, moments: Sequence[float], T: float) -> int:
    """Make a body that meets nothing in a PyBullet world of steps of T, PyBullet's damping and limit of speed off."""
    bullet.setTimeStep(T, physicsClientId=client)
    body: int = bullet.createMultiBody(mass, physicsClientId=client)
    bullet.changeDynamics(
        body, -1, mass=mass, localInertiaDiagonal=moments, linearDamping=0.0, angularDamping=0.0,
        maxJointVelocity=NO_LIMIT, physicsClientId=client,
    )  # fmt: skip
    return body


class InPyBullet:
    """Its damping off; viscosity as a force and a moment, -b v of the velocities before the step."""

    _place: Any
    _turn: Any
    _velocity: Any
    _spin: Any

    def __init__(self, rigid: Rigid, T: float) -> None:
        self._bullet = bullet = pybullet()
        self._client = client = new_client()
        weakref.finalize(self, bullet.disconnect, client)
        self._body = free_body(bullet, client, rigid.mass, rigid.moments, T)
        self._viscosity, self._rotational_viscosity = rigid.viscosity, rigid.rotational_viscosity
        self._start = (rigid.velocity, 0.0, 0.0), tuple(rigid.spin)
        self.reset()

    def reset(self) -> None:
        bullet, client = self._bullet, self._client
        bullet.resetBasePositionAndOrientation(
            self._body, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), physicsClientId=client
        )
        bullet.resetBaseVelocity(self._body, *self._start, physicsClientId=client)
        self._read()

    def run(self, forces: Sequence[float]) -> None:
        bullet, client, body, b = self._bullet, self._client, self._body, self._rotational_viscosity
        push, twist, step = bullet.applyExternalForce, bullet.applyExternalTorque, bullet.stepSimulation
        place, motion, frame = bullet.getBasePositionAndOrientation, bullet.getBaseVelocity, bullet.WORLD_FRAME
        viscosity, where, turn = self._viscosity, self._place, self._turn
        velocity, spin = self._velocity, self._spin
        for force in forces:  # by position, the fastest way to call them
            push(body, -1, (force - viscosity * velocity[0], 0.0, 0.0), where, frame, client)
            if b:
                twist(body, -1, (-b * spin[0], -b * spin[1], -b * spin[2]), frame, client)
            step(client)
            where, turn = place(body, client)
            velocity, spin = motion(body, client)
        self._place, self._turn, self._velocity, self._spin = where, turn, velocity, spin

    def _read(self) -> None:
        bullet, client = self._bullet, self._client
        self._place, self._turn = bullet.getBasePositionAndOrientation(self._body, physicsClientId=client)
        self._velocity, self._spin = bullet.getBaseVelocity(self._body, physicsClientId=client)

    @property
    def position(self) -> float:
        return float(self._place[0])

    @property
    def quaternion(self) -> Sequence[float]:
        return tuple(self._turn)


class InMuJoCo:
    """Viscosity as the damping of three slides and a ball joint; "Euler", "implicitfast" or "RK4"."""

    def __init__(self, rigid: Rigid, T: float, *, integrator: str) -> None:
        self._mujoco: Any = import_module("mujoco")
        slides = "".join(
            f'<joint type="slide" axis="{axis}" damping="{rigid.viscosity!r}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1")
        )
        text = " ".join(repr(float(moment)) for moment in rigid.moments)
        self._model = self._mujoco.MjModel.from_xml_string(f"""
            <mujoco><option timestep="{T!r}" gravity="0 0 0" integrator="{integrator}">{UNUSED}</option>
              <worldbody><body>{slides}
                <joint type="ball" damping="{rigid.rotational_viscosity!r}"/>
                <inertial pos="0 0 0" mass="{rigid.mass!r}" diaginertia="{text}"/></body></worldbody>
            </mujoco>""")
        self._data = self._mujoco.MjData(self._model)
        self._start = [rigid.velocity, 0.0, 0.0, *rigid.spin]
        self.reset()

    def reset(self) -> None:
        self._mujoco.mj_resetData(self._model, self._data)
        self._data.qvel[:] = self._start

    def run(self, forces: Sequence[float]) -> None:
        step, model, data = self._mujoco.mj_step, self._model, self._data
        applied = data.qfrc_applied
        for force in forces:
            applied[0] = force
            step(model, data)

    @property
    def position(self) -> float:
        return float(self._data.qpos[0])

    @property
    def quaternion(self) -> Sequence[float]:
        w, x, y, z = self._data.qpos[3:7].tolist()
        return x, y, z, w
