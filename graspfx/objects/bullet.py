"""Rigid bodies moved by PyBullet: its one integrator, semi-implicit in position, with viscosity applied exactly."""

from __future__ import annotations

import ctypes
import math
import os
import sys
import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Any

from graspfx.errors import GraspFXError, InputError, MissingPackageError
from graspfx.objects import kernels as at
from graspfx.objects.body import BlockBody, FloatArray
from graspfx.objects.surroundings import Meeting, Member, Obstacle
from graspfx.spatial import exponential, product, rotate

if TYPE_CHECKING:
    from graspfx.objects.world import BulletWorld

TURN_LIMIT = 0.25 * math.pi  # PyBullet turns a body no further than this in one step, whatever its angular velocity
BANNER = b"pybullet build time"
NO_LIMIT = 1e12  # PyBullet clamps speeds at 100 m/s unless told otherwise


class Carried(BlockBody):
    """A block's body in a PyBullet world, without PyBullet's damping: pushed before the world's step, read after it.

    Viscosity b is the force (f + m g - b v) (1 - E)/(b T/m), E = exp(-b T/m), held over the sample: the velocity is
    that of the viscous body, the position x+ = x + T v+. Rotation likewise, about the principal axes.

    A locked freedom gets no force and its entries in the block are never written. A body that turns about one axis
    only is given the moment about that axis all around, which is the same motion; with two free rotations the
    inertia has to be isotropic.

    Args:
        state: (SIZE,) the block, filled by `fill_body`. The motion is read from it once, then written only.
        client: PyBullet's number of the world.
        collision: its number of the body's shape; -1 for a body that meets nothing.

    Raises:
        InputError: two free rotations of a body whose moments differ.
    """

    def __init__(self, state: FloatArray, client: int, collision: int = -1) -> None:
        super().__init__(state)
        d = self.dimensions
        free = state[at.FREE : at.FREE + 6] != 0.0
        self._shifts = tuple(int(a) for a in range(d) if free[a])
        self._turns = tuple(int(a) for a in range(3) if free[3 + a])
        self._start = (0.0, 0.0, 0.0, 1.0) if d == 2 else _four(state, at.QUATERNION)
        self._first_angle = float(state[at.ANGLE])
        self._angle = 0.0
        self._moments = self._seen_moments()
        self._T = 0.0
        self._mass = float(state[at.MASS])
        self._share = 1.0  # (1 - E)/(b T/m)
        self._shares = (1.0, 1.0, 1.0)
        self._bullet = bullet = pybullet()
        self._client = client
        self._where = _three(state, at.POSITION)
        self._shaped = shaped = collision >= 0
        moving = not shaped or bool(free.any())
        self.body: int = bullet.createMultiBody(
            baseMass=self._mass if moving else 0.0,
            baseCollisionShapeIndex=collision,
            basePosition=self._where,
            baseOrientation=self._start if shaped or len(self._turns) > 1 else (0.0, 0.0, 0.0, 1.0),
            # of PyBullet's two kinds of bodies this one's contacts settle: the other creeps, or slips below mu m g
            useMaximalCoordinates=int(shaped),
            physicsClientId=client,
        )
        bullet.changeDynamics(
            self.body,
            -1,
            linearDamping=0.0,
            angularDamping=0.0,
            maxJointVelocity=NO_LIMIT,
            mass=self._mass if moving else 0.0,  # without it PyBullet takes the mass away when it is given moments
            localInertiaDiagonal=self._moments,
            physicsClientId=client,
        )
        bullet.resetBaseVelocity(
            self.body, _three(state, at.VELOCITY), _three(state, at.ANGULAR_VELOCITY), physicsClientId=client
        )

    def push(self, T: float) -> None:
        """Hand the wrench in the block, with gravity and viscosity, to PyBullet for its next step of T [s]."""
        if T != self._T:
            self._prepare(T)
        S, bullet, client, body = self._S, self._bullet, self._client, self.body
        force = [0.0, 0.0, 0.0]
        b = S[at.VISCOSITY]
        for a in self._shifts:
            pull = S[at.FORCE + a] + self._mass * S[at.GRAVITY + a] - b * S[at.VELOCITY + a]
            force[a] = self._share * pull
        bullet.applyExternalForce(body, -1, force, self._where, bullet.WORLD_FRAME, physicsClientId=client)
        if self._turns and self._shaped:  # the friction of PyBullet's contacts does not see a torque, but a velocity
            bullet.resetBaseVelocity(body, angularVelocity=self._spin_after(T), physicsClientId=client)
        elif self._turns:
            bullet.applyExternalTorque(body, -1, self._torque(), bullet.WORLD_FRAME, physicsClientId=client)

    def read(self, T: float) -> None:
        """Write the motion after a step of T [s] into the block.

        Raises:
            InputError: the body turns faster than PyBullet follows, 45 degrees a step.
        """
        S, bullet, client, body = self._S, self._bullet, self._client, self.body
        self._where, quaternion = bullet.getBasePositionAndOrientation(body, physicsClientId=client)
        velocity, spin = bullet.getBaseVelocity(body, physicsClientId=client)
        for a in self._shifts:
            S[at.POSITION + a] = self._where[a]
            S[at.VELOCITY + a] = velocity[a]
        if self._turns:
            self._turned(T, quaternion, spin)

    def _seen_moments(self) -> tuple[float, float, float]:
        """The moments that PyBullet is given, so that the free rotations move as they should."""
        moments = _three(self.state, at.INERTIA)
        if len(self._turns) == 3 or moments[0] == moments[1] == moments[2] > 0.0:
            return moments
        if not self._turns:
            return 1.0, 1.0, 1.0
        if len(self._turns) == 2:
            raise InputError(
                "free",
                "two of three rotations",
                "one, three, or equal moments of inertia with PyBullet",
                "use native dynamics",
            )
        axis = [1.0 if a in self._turns else 0.0 for a in range(3)]
        if self.dimensions == 3:
            x, y, z, w = self._start
            axis = list(rotate(-x, -y, -z, w, *axis))
        J = sum(moment * e * e for moment, e in zip(moments, axis, strict=True))
        return J, J, J

    def _prepare(self, T: float) -> None:
        if not 0.0 < T < math.inf:
            raise InputError("T", T, "a finite time above zero [s]")
        S = self._S
        self._T = T
        self._share = at.held(S[at.VISCOSITY] * T / self._mass)[1]
        x, y, z = (at.held(S[at.ROTATIONAL_VISCOSITY] * T / J)[1] for J in self._moments)
        self._shares = x, y, z

    def _torque(self) -> tuple[float, float, float]:
        """The moment with exact viscosity, world axes."""
        S, b = self._S, self._S[at.ROTATIONAL_VISCOSITY]
        m, v, f = at.MOMENT, at.ANGULAR_VELOCITY, at.FREE + 3
        mx = S[f] * (S[m] - b * S[v])
        my = S[f + 1] * (S[m + 1] - b * S[v + 1])
        mz = S[f + 2] * (S[m + 2] - b * S[v + 2])
        p, q, r = self._shares
        if p == q == r:
            return p * mx, p * my, p * mz
        x, y, z, w = _four(S, at.QUATERNION)
        mx, my, mz = rotate(-x, -y, -z, w, mx, my, mz)
        return rotate(x, y, z, w, p * mx, q * my, r * mz)

    def _spin_after(self, T: float) -> tuple[float, float, float]:
        """w + T J^-1 M, world axes [rad/s]."""
        S, v = self._S, at.ANGULAR_VELOCITY
        x, y, z, w = _four(S, at.QUATERNION)
        own = rotate(-x, -y, -z, w, *self._torque())
        p, q, r = (T * m / J for m, J in zip(own, self._moments, strict=True))
        p, q, r = rotate(x, y, z, w, p, q, r)
        return float(S[v] + p), float(S[v + 1] + q), float(S[v + 2] + r)

    def _turned(self, T: float, quaternion: tuple[float, ...], spin: tuple[float, ...]) -> None:
        """Writes orientation and angular velocity of the free rotations into the block."""
        S = self._S
        speed = math.sqrt(spin[0] ** 2 + spin[1] ** 2 + spin[2] ** 2)
        if speed * T > TURN_LIMIT:
            raise InputError(
                "angular_velocity", f"{speed:.4g} rad/s", f"at most {TURN_LIMIT / T:.4g} rad/s, 45 degrees a step",
                "PyBullet turns a body no further; shorten the period or use native dynamics",
            )  # fmt: skip
        for a in self._turns:
            S[at.ANGULAR_VELOCITY + a] = spin[a]
        x, y, z, w = quaternion
        if len(self._turns) == 1:
            a = self._turns[0]
            angle = 2.0 * math.atan2(quaternion[a], w)
            ahead = self._angle + T * spin[a]
            self._angle = angle + 2.0 * math.pi * round((ahead - angle) / (2.0 * math.pi))
            if self.dimensions == 2:
                S[at.ANGLE] = self._first_angle + self._angle
                at.orient(S, 0)
                return
            turn = [self._angle if k == a else 0.0 for k in range(3)]
            x, y, z, w = product(*exponential(*turn), *self._start)
        o = at.QUATERNION
        if x * S[o] + y * S[o + 1] + z * S[o + 2] + w * S[o + 3] < 0.0:  # PyBullet changes its sign at will
            x, y, z, w = -x, -y, -z, -w
        S[o], S[o + 1], S[o + 2], S[o + 3] = x, y, z, w
        at.orient(S, 0)


class BulletBody(Carried):
    """A rigid body in a PyBullet world of its own, without shape or contacts.

    Args:
        state: (SIZE,) the block, filled by `fill_body`. The motion is read from it once, then written only.

    Raises:
        MissingPackageError: PyBullet is not installed.
        InputError: two free rotations of a body whose moments differ.
    """

    def __init__(self, state: FloatArray) -> None:
        client = new_client()
        self._disconnect = weakref.finalize(self, pybullet().disconnect, client)
        super().__init__(state, client)

    def step(self, T: float) -> None:
        """Advance by T [s] under the wrench in the block, held.

        Raises:
            InputError: the body turns faster than PyBullet follows, 45 degrees a step.
        """
        if T != self._T:
            self._bullet.setTimeStep(T, physicsClientId=self._client)
        self.push(T)
        self._bullet.stepSimulation(physicsClientId=self._client)
        self.read(T)

    def free_motion(self, T: float) -> None:
        """Raises InputError: PyBullet cannot solve for the body's new state."""
        raise InputError("integrator", "implicit", "another one: PyBullet has one integrator", "use native dynamics")

    def close(self) -> None:
        """Give the PyBullet world back; the block keeps the last state."""
        self._disconnect()


def create(state: FloatArray) -> BulletBody:
    """The body that `dynamics = "bullet"` names."""
    return BulletBody(state)


def create_world(members: Sequence[Member], obstacles: Sequence[Obstacle], meeting: Meeting) -> BulletWorld:
    """The world of objects that meet obstacles or one another."""
    from graspfx.objects.world import BulletWorld

    return BulletWorld(members, obstacles, meeting)


def new_client() -> int:
    """PyBullet's number of a new, empty world without gravity.

    Raises:
        MissingPackageError: PyBullet is not installed.
        GraspFXError: PyBullet has no room for a further one.
    """
    bullet = pybullet()
    client: int = bullet.connect(bullet.DIRECT)
    if client < 0:
        raise GraspFXError("PyBullet gives no further world; close bodies that are no longer needed")
    bullet.setGravity(0.0, 0.0, 0.0, physicsClientId=client)
    return client


def _three(S: Any, o: int) -> tuple[float, float, float]:
    return float(S[o]), float(S[o + 1]), float(S[o + 2])


def _four(S: Any, o: int) -> tuple[float, float, float, float]:
    return float(S[o]), float(S[o + 1]), float(S[o + 2]), float(S[o + 3])


def pybullet() -> Any:
    """The package, imported without its banner."""
    if "pybullet" in sys.modules:
        return sys.modules["pybullet"]
    with _without_banner(1), _without_banner(2):
        try:
            return import_module("pybullet")
        except ModuleNotFoundError as error:
            raise MissingPackageError(
                "pybullet", "dynamics = 'bullet'", "install graspfx[bullet], or use native dynamics"
            ) from error


@contextmanager
def _without_banner(descriptor: int) -> Iterator[None]:
    """Holds back what is written to a descriptor, then passes on all but the banner, which C code prints."""
    try:
        saved = os.dup(descriptor)
    except OSError:  # closed: nothing to hold back
        yield
        return
    flush = ctypes.CDLL(None).fflush if os.name == "posix" else ctypes.cdll.msvcrt.fflush
    sys.stdout.flush()
    flush(None)
    with TemporaryFile() as held:
        os.dup2(held.fileno(), descriptor)
        try:
            yield
        finally:
            flush(None)
            os.dup2(saved, descriptor)
            os.close(saved)
            held.seek(0)
            for line in held:
                if not line.startswith(BANNER):
                    os.write(descriptor, line)
