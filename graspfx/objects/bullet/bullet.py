"""A rigid body in a PyBullet world: the wrench is applied before each step, and the motion is read after the step."""

from __future__ import annotations

import math
import os
import sys
import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from tempfile import TemporaryFile
from typing import Any

from graspfx.compile.calls import Call
from graspfx.compile.memory import zeros
from graspfx.compile.records import start_of
from graspfx.errors import GraspFXError, InputError, MissingPackageError
from graspfx.objects import guest
from graspfx.objects.body import BlockBody, FloatArray
from graspfx.objects.body_state import BodyState, Motion
from graspfx.objects.dynamics_table import DYNAMICS
from graspfx.objects.guest import CarriedBody, Carrier, GuestState, numbers_of
from graspfx.spatial import Vector
from graspfx.system.c_library import flush_output

BANNER = b"pybullet build time"
NO_LIMIT = 1e12  # PyBullet clamps speeds at 100 m/s unless told otherwise
NONE = math.inf  # impossible last angular velocity, so that the first one is always sent to PyBullet


class BulletMember(CarriedBody):
    """A body in a PyBullet world, with the parameters in its block, and without the damping that PyBullet adds.

    A body with one free rotation gets the moment of inertia of this rotation about all axes, which does not change the
    motion. If two rotations are free, the three moments of inertia must be equal.

    The calls in `pushes` apply the wrench that `guest.hand_over` has written to the body's part of the buffer. The
    calls in `readings` write the motion after PyBullet's step to that part, where `guest.take_over` reads it.

    Args:
        state: Block filled by `fill_body`, (SIZE,). The motion is read from the block once, and then only written.
        part: Body's part of the buffer, (guest.SIZE,), for wrench and motion; all entries are overwritten.
        client: PyBullet's index of the world.
        collision: PyBullet's index of the collision shape; -1 for a body without contacts.

    Raises:
        InputError: If two rotations are free and the moments of inertia differ.
    """

    def __init__(self, state: FloatArray, part: FloatArray, client: int, collision: int = -1) -> None:
        super().__init__(state, part)
        own, moments, where = BodyState(state), self.moments, self.place
        if len(self.turns) == 2 and not moments[0] == moments[1] == moments[2]:
            raise InputError(
                "free",
                "two of three rotations",
                "one or three free rotations, or equal moments of inertia, with PyBullet",
                "use native dynamics, or MuJoCo's",
            )
        mass = own.mass
        bullet = pybullet()
        shaped = collision >= 0
        moving = not (shaped and self.fixed)
        self.body: int = bullet.createMultiBody(
            baseMass=mass if moving else 0.0,
            baseCollisionShapeIndex=collision,
            basePosition=where,
            baseOrientation=self.start if shaped or len(self.turns) > 1 else (0.0, 0.0, 0.0, 1.0),
            # contacts of this kind of PyBullet body converge; bodies of the other kind creep, or slip below mu m g
            useMaximalCoordinates=int(shaped),
            physicsClientId=client,
        )
        bullet.changeDynamics(
            self.body,
            -1,
            linearDamping=0.0,
            angularDamping=0.0,
            maxJointVelocity=NO_LIMIT,
            mass=mass if moving else 0.0,  # otherwise PyBullet drops the mass when it is given moments
            localInertiaDiagonal=moments,
            physicsClientId=client,
        )
        bullet.resetBaseVelocity(
            self.body,
            numbers_of(own.motion, Motion.velocity),
            numbers_of(own.motion, Motion.angular_velocity),
            physicsClientId=client,
        )
        own_part = self.part
        own_part.by_spin = shaped  # friction of PyBullet's contacts ignores a torque, but not a velocity
        if shaped:
            own_part.spin = Vector(NONE, NONE, NONE)
        self.pushes = _pushes(own_part, client, self.body)
        self.readings = _readings(own_part, client, self.body)


def _pushes(guest_state: GuestState, client: int, body: int) -> list[Call]:
    """List the calls that apply the body's wrench in PyBullet; a call without effect in a sample is skipped.

    Arguments are positional where possible, because this saves 0.2 us per call.
    """
    bullet = pybullet()
    force = bullet.applyExternalForce
    push, twist, spin = (_entries(guest_state, name) for name in ("push", "twist", "spin"))
    pushed, turned, where = [0.0] * 3, [0.0] * 3, [0.0] * 3
    if guest_state.turns == 0:  # no rotation, and PyBullet's x+ is x + T v+ to the last bit
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
    """List the calls that copy a body's motion from PyBullet to the body's part of the buffer."""
    bullet, world = pybullet(), (body, client)
    place, turn, velocity, spin = (_entries(guest_state, name) for name in ("place", "turn", "velocity", "spin"))
    if guest_state.turns == 0:
        return [Call(bullet.getBaseVelocity, world, receipts=[(0, velocity)])]
    return [
        Call(bullet.getBasePositionAndOrientation, world, receipts=[(0, place), (1, turn)]),
        Call(bullet.getBaseVelocity, world, receipts=[(0, velocity), (1, spin)]),
    ]


def _entries(guest_state: GuestState, name: str) -> memoryview:
    """Return the memory of a field of the record: three floats, or four for the quaternion `turn`."""
    size, start = 4 if name == "turn" else 3, guest_state.offset + start_of(GuestState, name)
    return memoryview(guest_state.buffer)[start : start + size]


class BulletCarrier(Carrier):
    """Bodies in one PyBullet world, which is closed when this object is deleted.

    Args:
        buffer: Flat buffer with a part of guest.SIZE entries for each body of `carried`.
        carried: Bodies of the world.
        client: PyBullet's index of the world.
    """

    program = "PyBullet"
    carried: Sequence[BulletMember]
    _disconnect: Any  # set by the class that has created the world

    def __init__(self, buffer: FloatArray, carried: Sequence[BulletMember], client: int) -> None:
        moving = [one for one in carried if not one.fixed]
        pushes = [call for one in moving for call in one.pushes]
        readings = [call for one in moving for call in one.readings]
        self.client = client
        super().__init__(buffer, carried, [*pushes, Call(pybullet().stepSimulation, (client,)), *readings])

    def close(self) -> None:
        """Close the PyBullet world; the bodies' blocks keep the last states."""
        self._disconnect()

    def _set_step(self, T: float) -> None:
        pybullet().setTimeStep(T, physicsClientId=self.client)

    def _fault(self, code: int) -> InputError:
        speed = next(one.speed for one in self._moving if not one.speed * self._T <= guest.TURN_LIMIT)
        return InputError(
            "angular_velocity", f"{speed:.4g} rad/s",
            f"at most {guest.TURN_LIMIT / self._T:.4g} rad/s, 45 degrees a step",
            "PyBullet cannot rotate a body further in one step; shorten the period or use native dynamics",
        )  # fmt: skip


class BulletBody(BlockBody, BulletCarrier):
    """A rigid body in a separate PyBullet world, without collision shape or contacts.

    Args:
        state: Block filled by `fill_body`, (SIZE,). The motion is read from the block once, and then only written.

    Raises:
        MissingPackageError: If PyBullet is not installed.
        InputError: If two rotations are free and the moments of inertia differ.
    """

    def __init__(self, state: FloatArray) -> None:
        BlockBody.__init__(self, state)
        client = new_client()
        self._disconnect = weakref.finalize(self, pybullet().disconnect, client)
        buffer = zeros(guest.SIZE)
        BulletCarrier.__init__(self, buffer, [BulletMember(state, buffer, client)], client)


def create(state: FloatArray) -> BulletBody:
    """Return the body for `dynamics = "bullet"`."""
    return BulletBody(state)


def new_client() -> int:
    """Open an empty PyBullet world without gravity, and return PyBullet's index of the world.

    Raises:
        MissingPackageError: If PyBullet is not installed.
        GraspFXError: If PyBullet cannot open another world.
    """
    bullet = pybullet()
    client: int = bullet.connect(bullet.DIRECT)
    if client < 0:
        raise GraspFXError("PyBullet cannot open another world: close bodies that are no longer needed")
    bullet.setGravity(0.0, 0.0, 0.0, physicsClientId=client)
    return client


def pybullet() -> Any:
    """Import PyBullet without the banner that it prints."""
    if "pybullet" in sys.modules:
        return sys.modules["pybullet"]
    with _without_banner(1), _without_banner(2):
        try:
            return import_module("pybullet")
        except ModuleNotFoundError as error:
            raise MissingPackageError("pybullet", "dynamics = 'bullet'", DYNAMICS["bullet"].remedy) from error


@contextmanager
def _without_banner(descriptor: int) -> Iterator[None]:
    """Capture the output to a file descriptor within a `with` block, and then write all of it except the banner."""
    try:
        saved = os.dup(descriptor)
    except OSError:  # closed: nothing to capture
        yield
        return
    sys.stdout.flush()
    flush_output()
    with TemporaryFile() as capture:
        os.dup2(capture.fileno(), descriptor)
        try:
            yield
        finally:
            flush_output()
            os.dup2(saved, descriptor)
            os.close(saved)
            capture.seek(0)
            for line in capture:
                if not line.startswith(BANNER):
                    os.write(descriptor, line)
