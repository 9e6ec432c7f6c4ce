"""A rigid body in a PyBullet world: pushed before the world's step, read after it; PyBullet without its banner."""

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
from typing import Any

import numpy as np

from graspfx.compile.calls import Call, in_turn
from graspfx.compile.kernel import source_function
from graspfx.compile.records import Record, start_of
from graspfx.errors import GraspFXError, InputError, MissingPackageError
from graspfx.objects import guest
from graspfx.objects.body import BlockBody, FloatArray
from graspfx.objects.body_state import BodyState, Motion
from graspfx.objects.decay import decay_integrals
from graspfx.objects.guest import GuestState
from graspfx.spatial import Quaternion, Vector, rotate

BANNER = b"pybullet build time"
NO_LIMIT = 1e12  # PyBullet clamps speeds at 100 m/s unless told otherwise
NONE = math.inf  # speed that no body has: before the first reading PyBullet is handed any


class CarriedBody(BlockBody):
    """A block's body in a PyBullet world, without PyBullet's damping: pushed before the world's step, read after it.

    Viscosity b is the force (f + m g - b v) (1 - E)/(b T/m), E = exp(-b T/m), held over the sample: the velocity is
    that of the viscous body, the position x+ = x + T v+. Rotation likewise, about the principal axes.

    A locked freedom gets no force and its entries in the block are never written. A body that turns about one axis
    only is given the moment about that axis all around, which is the same motion; with two free rotations the
    inertia has to be isotropic.

    The calls `pushes` give PyBullet the wrench that `guest.hand_over` left in the body's part, for its next step;
    `readings` write the motion after that step there, for `guest.take_over`.

    Args:
        state: (SIZE,) the block, filled by `fill_body`. The motion is read from it once, then written only.
        part: (guest.SIZE,) of the buffer, for the wrench and the motion; overwritten whole.
        client: PyBullet's number of the world.
        collision: its number of the body's shape; -1 for a body that meets nothing.

    Raises:
        InputError: two free rotations of a body whose moments differ.
    """

    def __init__(self, state: FloatArray, part: FloatArray, client: int, collision: int = -1) -> None:
        super().__init__(state)
        d = self.dimensions
        own = BodyState(state)
        free = np.append(own.array(BodyState.free_translation), own.array(BodyState.free_rotation)) != 0.0
        self.fixed = not free.any()
        self._turns = tuple(int(a) for a in range(3) if free[3 + a])
        self._start = (0.0, 0.0, 0.0, 1.0) if d == 2 else _numbers(own.motion, Motion.quaternion)
        moments = self._seen_moments()
        mass = own.mass
        bullet = pybullet()
        where = _numbers(own.motion, Motion.position)
        shaped = collision >= 0
        moving = not (shaped and self.fixed)
        self.body: int = bullet.createMultiBody(
            baseMass=mass if moving else 0.0,
            baseCollisionShapeIndex=collision,
            basePosition=where,
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
            mass=mass if moving else 0.0,  # without it PyBullet takes the mass away when it is given moments
            localInertiaDiagonal=moments,
            physicsClientId=client,
        )
        bullet.resetBaseVelocity(
            self.body,
            _numbers(own.motion, Motion.velocity),
            _numbers(own.motion, Motion.angular_velocity),
            physicsClientId=client,
        )
        part[:] = 0.0
        guest_state = self._guest = GuestState(memoryview(part))
        guest_state.by_spin = shaped  # the friction of PyBullet's contacts does not see a torque, but a velocity
        guest_state.array(GuestState.free_translation)[:d] = free[:d]
        guest_state.free_rotation = Vector(*free[3:])
        guest_state.turns, guest_state.axis = len(self._turns), self._turns[0] if self._turns else 0
        guest_state.moments, guest_state.start = Vector(*moments), Quaternion(*self._start)
        guest_state.start_angle = self._body.motion.angle
        guest_state.place = Vector(*where)
        if shaped:
            guest_state.spin = Vector(NONE, NONE, NONE)
        self.pushes = _pushes(guest_state, client, self.body)
        self.readings = _readings(guest_state, client, self.body)

    def hold(self, T: float) -> None:
        """Compute the shares of viscosity over samples of T [s]."""
        body, guest_state = self._body, self._guest
        guest_state.share = decay_integrals(body.viscosity * T / body.mass)[1]
        b, J = body.rotational_viscosity, guest_state.moments
        guest_state.shares = Vector(*(decay_integrals(b * T / moment)[1] for moment in (J.x, J.y, J.z)))

    def hand_over(self, T: float) -> None:
        """Hand over the wrench in the block, with gravity and viscosity, for a push over T [s]."""
        guest.hand_over(self._body, self._guest, T)

    def take_over(self, T: float) -> int:
        """Write the motion after a step of T [s] to the block; give 0, or a code if the body cannot go on."""
        body, part = self._body, self._guest  # as numbers, since every call of a run ends here
        return int(source_function(guest.take_over)(body.buffer, body.offset, part.buffer, part.offset, T))

    @property
    def speed(self) -> float:
        """Speed of rotation at the last reading [rad/s]."""
        return float(np.linalg.norm(self._guest.array(GuestState.spin)))

    def _seen_moments(self) -> tuple[float, ...]:
        """Compute the moments of inertia for PyBullet with which the free rotations move as they should."""
        moments = _numbers(self._body, BodyState.inertia)
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
            own = rotate(Quaternion(*self._start).conjugate, Vector(*axis))
            axis = [own.x, own.y, own.z]
        J = sum(moment * e * e for moment, e in zip(moments, axis, strict=True))
        return J, J, J


def _pushes(guest_state: GuestState, client: int, body: int) -> list[Call]:
    """List the calls that push a body in PyBullet by the wrench handed over; what would change nothing is left out.

    Arguments are positional where they can be, which saves 0.2 us a call.
    """
    bullet = pybullet()
    force = bullet.applyExternalForce
    push, twist, spin = (_entries(guest_state, name) for name in ("push", "twist", "spin"))
    pushed, turned, where = [0.0] * 3, [0.0] * 3, [0.0] * 3
    if guest_state.turns == 0:  # its frame is never turned, and PyBullet's x+ = x + T v+ is ours to the last bit
        own = (body, -1, pushed, (0.0, 0.0, 0.0), bullet.LINK_FRAME, client)
        return [Call(force, own, sends=[(pushed, push)], nonzero=push)]
    frame = bullet.WORLD_FRAME
    at_centre = [(pushed, push), (where, _entries(guest_state, "place"))]
    first = Call(force, (body, -1, pushed, where, frame, client), sends=at_centre, nonzero=push)
    twisting = [(turned, twist)]
    if not guest_state.by_spin:
        second = Call(bullet.applyExternalTorque, (body, -1, turned, frame, client), sends=twisting, nonzero=twist)
        return [first, second]
    keywords = {"angularVelocity": turned, "physicsClientId": client}
    return [first, Call(bullet.resetBaseVelocity, (body,), keywords, sends=twisting, changed=(twist, spin))]


def _readings(guest_state: GuestState, client: int, body: int) -> list[Call]:
    """List the calls that read a body's motion from PyBullet."""
    bullet, world = pybullet(), (body, client)
    place, turn, velocity, spin = (_entries(guest_state, name) for name in ("place", "turn", "velocity", "spin"))
    if guest_state.turns == 0:
        return [Call(bullet.getBaseVelocity, world, receipts=[(0, velocity)])]
    return [
        Call(bullet.getBasePositionAndOrientation, world, receipts=[(0, place), (1, turn)]),
        Call(bullet.getBaseVelocity, world, receipts=[(0, velocity), (1, spin)]),
    ]


def _entries(guest_state: GuestState, name: str) -> memoryview:
    """Give the memory of a field: three floats, four of a quaternion."""
    size, start = 4 if name == "turn" else 3, guest_state.offset + start_of(GuestState, name)
    return memoryview(guest_state.buffer)[start : start + size]


class Carrier:
    """Bodies in one PyBullet world that is their own: a guest of the tick.

    Args:
        buffer: (bodies guest.SIZE,), flat; each body of `carried` has its part of it.
        client: PyBullet's number of the world.
    """

    _disconnect: Any  # of the class that has made the world

    handing = staticmethod(guest.hand_over)
    taking = staticmethod(guest.take_over)

    def __init__(self, buffer: FloatArray, carried: Sequence[CarriedBody], client: int) -> None:
        self.buffer, self.carried = buffer, carried
        moves = [not one.fixed for one in carried]
        self.places = tuple(i * guest.SIZE if m else -1 for i, m in enumerate(moves))
        self.structure = tuple(o + k for o in self.places if o >= 0 for k in range(guest.STRUCTURE))
        self._moving = [one for one, m in zip(carried, moves, strict=True) if m]
        self.client, self._T = client, 0.0
        pushes = [call for one in self._moving for call in one.pushes]
        readings = [call for one in self._moving for call in one.readings]
        self._calls = [*pushes, Call(pybullet().stepSimulation, (client,)), *readings]
        self._exchange = in_turn(self._calls)

    @property
    def calls(self) -> Sequence[Call]:
        """Calls of an exchange; none if a subclass exchanges in a way of its own."""
        return self._calls if type(self).exchange is Carrier.exchange else ()

    def hold(self, T: float) -> None:
        """Set the period of every sample from here on to T [s].

        Raises:
            InputError: T is no finite time above zero.
        """
        if T != self._T:
            if not 0.0 < T < math.inf:
                raise InputError("T", T, "a finite time above zero [s]")
            for one in self._moving:
                one.hold(T)
            pybullet().setTimeStep(T, physicsClientId=self.client)
            self._T = T

    def exchange(self) -> None:
        """Push every body, let PyBullet step, read every body: all that a tick needs of PyBullet."""
        self._exchange()

    def take(self) -> int:
        """Write the last reading to the blocks; give 0, or the code of the first body that cannot go on."""
        return next((code for one in self._moving if (code := one.take_over(self._T))), 0)

    def fault_text(self, code: int) -> str:
        """Explain why a body cannot go on."""
        return str(self._too_fast())

    def step(self, T: float) -> None:
        """Advance every body by T [s] under the wrench in its block, held, and its contacts.

        Raises:
            InputError: T is no finite time above zero; a body turns faster than PyBullet follows, 45 degrees a step.
        """
        self.hold(T)
        for one in self._moving:
            one.hand_over(T)
        self.exchange()
        if self.take():
            raise self._too_fast()

    def free_motion(self, T: float) -> None:
        """Raise InputError: PyBullet cannot solve for a new state."""
        raise InputError("integrator", "implicit", "another one: PyBullet has one integrator", "use native dynamics")

    def close(self) -> None:
        """Give the PyBullet world back; the blocks keep the last states."""
        self._disconnect()

    def _too_fast(self) -> InputError:
        speed = next(one.speed for one in self._moving if not one.speed * self._T <= guest.TURN_LIMIT)
        return InputError(
            "angular_velocity", f"{speed:.4g} rad/s",
            f"at most {guest.TURN_LIMIT / self._T:.4g} rad/s, 45 degrees a step",
            "PyBullet turns a body no further; shorten the period or use native dynamics",
        )  # fmt: skip


class BulletBody(BlockBody, Carrier):
    """A rigid body in a PyBullet world of its own, without shape or contacts.

    Args:
        state: (SIZE,) the block, filled by `fill_body`. The motion is read from it once, then written only.

    Raises:
        MissingPackageError: PyBullet is not installed.
        InputError: two free rotations of a body whose moments differ.
    """

    def __init__(self, state: FloatArray) -> None:
        BlockBody.__init__(self, state)
        client = new_client()
        self._disconnect = weakref.finalize(self, pybullet().disconnect, client)
        buffer = np.zeros(guest.SIZE)
        Carrier.__init__(self, buffer, [CarriedBody(state, buffer, client)], client)


def create(state: FloatArray) -> BulletBody:
    """Make the body for `dynamics = "bullet"`."""
    return BulletBody(state)


def new_client() -> int:
    """Open a new, empty world without gravity and give PyBullet's number of it.

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


def _numbers(record: Record, field: Any) -> tuple[float, ...]:
    """Give the numbers of a field as PyBullet takes them."""
    return tuple(record.array(field).tolist())


def pybullet() -> Any:
    """Import the package without its banner."""
    if "pybullet" in sys.modules:
        return sys.modules["pybullet"]
    with _without_banner(1), _without_banner(2):
        try:
            return import_module("pybullet")
        except ModuleNotFoundError as error:
            raise MissingPackageError(
                "pybullet",
                "dynamics = 'bullet'",
                "install graspfx[bullet] ('.[bullet]' in a checkout), or use native dynamics",
            ) from error


@contextmanager
def _without_banner(descriptor: int) -> Iterator[None]:
    """Capture the output to a descriptor, then pass on all but the banner, which C code prints."""
    try:
        saved = os.dup(descriptor)
    except OSError:  # closed: nothing to hold back
        yield
        return
    flush = ctypes.CDLL(None).fflush if os.name == "posix" else ctypes.cdll.msvcrt.fflush
    sys.stdout.flush()
    flush(None)
    with TemporaryFile() as capture:
        os.dup2(capture.fileno(), descriptor)
        try:
            yield
        finally:
            flush(None)
            os.dup2(saved, descriptor)
            os.close(saved)
            capture.seek(0)
            for line in capture:
                if not line.startswith(BANNER):
                    os.write(descriptor, line)
