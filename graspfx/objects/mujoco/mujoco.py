"""A rigid body in a MuJoCo world: its joints, the exchange of wrench and motion, and a world without contacts."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any

import numpy as np

from graspfx.compile.calls import Call
from graspfx.compile.kernel import kernel
from graspfx.compile.memory import zeros
from graspfx.compile.records import numbers, start_of
from graspfx.errors import InputError, MissingPackageError
from graspfx.log import info
from graspfx.objects import guest
from graspfx.objects.body import BlockBody, FloatArray
from graspfx.objects.body_state import BodyState, Motion
from graspfx.objects.dynamics_table import DYNAMICS
from graspfx.objects.guest import CarriedBody, Carrier, GuestState, hand_over, numbers_of
from graspfx.objects.integrators import momentum, multiply, orient, spin_of, turn_exactly, vector_of
from graspfx.spatial import ZERO, Quaternion, Vector, cross, exponential, inner, rotate

OUT_OF_RANGE = 2
UNTOUCHED = 1e-16  # squared relative change of an angular velocity below which it is rounding
RANGE = 1e10  # largest number that MuJoCo does not treat as a failure


@kernel
def hand_to_joints(body: BodyState, guest: GuestState, T: float) -> None:
    """Write the force and the moment for MuJoCo's step to the buffer, in world axes; `hand_over` includes viscosity.

    If several rotations are free and the moments of inertia differ, the moment is computed by `drift`.
    """
    hand_over(body, guest, T)
    if guest.turns > 1:
        J = guest.moments
        if not (J.x == J.y == J.z):
            drift(body, guest, T)


@kernel
def drift(body: BodyState, guest: GuestState, T: float) -> None:
    """Compute the moment for which MuJoCo's step rotates the body as a push followed by free rotation would.

    The push changes the angular velocity by T J^-1 M, where J is the inertia and M is the moment with viscosity from
    `hand_over`. The body then rotates for T [s] by Euler's equations without a moment, computed to fourth order. This
    method is semi-implicit like the translation, and has no error of the gyroscopic term. MuJoCo rotates the body by
    its new angular velocity u+ = u + T J^-1 (N - u x J u), where N is the moment computed here. u+ has to equal the
    mean angular velocity of the free rotation.
    """
    motion = body.motion
    q, w, moment, b = motion.quaternion, motion.angular_velocity, body.moment, body.rotational_viscosity
    body.moment = ZERO
    body.rotational_viscosity = 0.0
    motion.angular_velocity = w + T * spin_of(body, q, 0.0, guest.twist)
    turn_exactly(body, T)
    aim = vector_of(motion.quaternion @ q.conjugate) / T
    guest.aim = aim
    guest.lead = motion.angular_velocity - aim
    body.moment = moment
    body.rotational_viscosity = b
    motion.quaternion = q
    motion.angular_velocity = w
    u = rotate(q, guest.spin)
    guest.twist = momentum(body, q, (aim - u) / T) + cross(u, momentum(body, q, u))


@kernel
def take_from_joints(body: BodyState, guest: GuestState, T: float) -> int:
    """Copy the motion after a step of T [s] to the block; return OUT_OF_RANGE if a number is too large, else 0.

    `guest.place` and `guest.velocity` are the values of slide joints or of a free joint. If one rotation is free,
    `guest.angle` is the angle, and `guest.spin` is in world axes. If several rotations are free, `guest.turn` is a
    quaternion (w, x, y, z) in MuJoCo's order, and `guest.spin` is in body axes.
    """
    if not guest.waiting:
        return 0
    guest.waiting = False
    motion, v, w, x = body.motion, guest.velocity, guest.spin, guest.place
    speed = abs(v.x) + abs(v.y) + abs(v.z) + abs(w.x) + abs(w.y) + abs(w.z)
    if not speed + abs(x.x) + abs(x.y) + abs(x.z) < RANGE:  # true for NaN
        return OUT_OF_RANGE
    for a in range(3):
        if guest.free_translation[a] != 0.0:
            motion.velocity[a] = guest.velocity[a]
            motion.position[a] = guest.place[a]
    if guest.turns == 0:
        return 0
    if guest.turns == 1:
        axis = guest.axis
        motion.angular_velocity[axis] = guest.spin[axis]
        if body.dimensions == 2:
            motion.angle = guest.start_angle + guest.angle
        else:
            tx = guest.angle if axis == 0 else 0.0
            ty = guest.angle if axis == 1 else 0.0
            tz = guest.angle if axis == 2 else 0.0
            motion.quaternion = exponential(Vector(tx, ty, tz)) @ guest.start
        orient(body)
        return 0
    t, old = guest.turn, motion.quaternion
    q = Quaternion(t.y, t.z, t.w, t.x)
    if q.x * old.x + q.y * old.y + q.z * old.z + q.w * old.w < 0.0:  # both signs mean the same rotation
        q = Quaternion(-q.x, -q.y, -q.z, -q.w)
    spin, aim, lead = rotate(q, w), guest.aim, guest.lead
    other = spin - aim
    if inner(other, other) <= UNTOUCHED * inner(aim, aim):  # no contact has changed it
        spin += lead
    motion.angular_velocity = multiply(guest.free_rotation, spin)
    motion.quaternion = q
    orient(body)
    return 0


WHOLE = slice(None)
SLACK = 1e-9  # tolerance of the triangle inequality of moments, which MuJoCo checks exactly
UNUSED = ("SENSOR", "ACTUATION", "EULERDAMP", "GRAVITY", "SPRING", "DAMPER", "AUTORESET", "LIMIT", "EQUALITY")


class MujocoMember(CarriedBody):
    """A body in a MuJoCo world, with a free joint if all six degrees of freedom are free.

    Otherwise the body has a slide joint for each free translation, and one joint for its rotations: a hinge joint about
    a world axis for one free rotation, and a ball joint for two or three. Contacts could rotate a body with two free
    rotations about the locked axis too; a body with contacts may therefore not have two free rotations.

    Args:
        state: Block filled by `fill_body`, (SIZE,). The motion is read from the block once, and then only written.
        part: Body's part of the buffer, (guest.SIZE,), for wrench and motion; all entries are overwritten.
        spec: MuJoCo's specification of the world, to which the body is added.
        number: Index of the body in the world.
    """

    handing = staticmethod(hand_to_joints)
    taking = staticmethod(take_from_joints)

    def __init__(self, state: FloatArray, part: FloatArray, spec: Any, number: int) -> None:
        super().__init__(state, part)
        kinds = mujoco().mjtJoint
        self._names = [f"{number}{letter}" for letter in "xyz"]
        self._turn = f"{number}turn"
        self._ball = len(self.turns) > 1
        whole = len(self.shifts) + len(self.turns) == 6
        x, y, z, w = self.start
        frame = (1.0, 0.0, 0.0, 0.0) if self._ball else (w, x, y, z)  # a ball's angle is its whole orientation
        self.shape_body = body = spec.worldbody.add_body(
            name=str(number), pos=self.place, quat=frame, mass=self._body.mass, inertia=_possible(self.moments),
            ipos=(0.0, 0.0, 0.0), iquat=(1.0, 0.0, 0.0, 0.0), explicitinertial=True,
        )  # fmt: skip
        self._whole = whole
        if whole:
            body.add_freejoint(name=self._turn)
            return
        back = Quaternion(0.0, 0.0, 0.0, 1.0) if self._ball else Quaternion(x, y, z, w).conjugate
        axes = [tuple(numbers(rotate(back, Vector(*row)))) for row in np.eye(3).tolist()]
        for a in self.shifts:
            body.add_joint(type=kinds.mjJNT_SLIDE, name=self._names[a], axis=axes[a], ref=self.place[a])
        if self._ball:
            body.add_joint(type=kinds.mjJNT_BALL, name=self._turn)
        elif self.turns:
            body.add_joint(type=kinds.mjJNT_HINGE, name=self._turn, axis=axes[self.turns[0]])

    def begin(self, model: Any, data: Any) -> None:
        """Write the body's state to the compiled world, and list the calls that apply wrenches and read motions."""
        self.pushes: list[Call] = []
        self.readings: list[Call] = []
        if self.fixed:
            return
        motion = BodyState(self.state).motion
        v = numbers_of(motion, Motion.velocity)
        w = numbers_of(motion, Motion.angular_velocity)
        x, y, z, r = self.start
        own = tuple(numbers(rotate(Quaternion(x, y, z, r).conjugate, Vector(*w))))
        self._pass(data.xfrc_applied[model.body(self.shape_body.name).id], "push", 6, into=True)
        for a in self.shifts if not self._whole else ():
            q, u = _places(model, self._names[a])
            data.qpos[q], data.qvel[u] = self.place[a], v[a]
            self._pass(data.qpos[q : q + 1], "place", 1, a)
            self._pass(data.qvel[u : u + 1], "velocity", 1, a)
        if not self.turns:
            return
        if len(self.turns) > 1:
            self.part.spin = Vector(*own)
        q, u = _places(model, self._turn)
        if self._whole:
            data.qpos[q : q + 7], data.qvel[u : u + 6] = (*self.place, r, x, y, z), (*v, *own)
            self._pass(data.qpos[q : q + 7], "place", 7)  # and `turn`
            self._pass(data.qvel[u : u + 3], "velocity", 3)
            self._pass(data.qvel[u + 3 : u + 6], "spin", 3)
        elif self._ball:
            data.qpos[q : q + 4], data.qvel[u : u + 3] = (r, x, y, z), own
            self._pass(data.qpos[q : q + 4], "turn", 4)
            self._pass(data.qvel[u : u + 3], "spin", 3)
        else:
            data.qvel[u] = w[self.turns[0]]
            self._pass(data.qpos[q : q + 1], "angle", 1)
            self._pass(data.qvel[u : u + 1], "spin", 1, self.turns[0])

    def _pass(self, theirs: FloatArray, name: str, count: int, first: int = 0, *, into: bool = False) -> None:
        """Add the call that copies `count` numbers: if `into`, from the buffer to MuJoCo, otherwise back.

        Args:
            theirs: MuJoCo's memory of the numbers.
            name: Field of the body's part of the buffer.
            count: Number of entries.
            first: Index of the first entry in the field.
            into: Whether to copy to MuJoCo.
        """
        start = self.part.offset + start_of(GuestState, name) + first
        ours, other = memoryview(self.part.buffer)[start : start + count], memoryview(theirs)
        if into:
            self.pushes.append(Call(other.__setitem__, (WHOLE, ours)))
        else:
            self.readings.append(Call(ours.__setitem__, (WHOLE, other)))


class MujocoCarrier(Carrier):
    """Bodies in one MuJoCo world, which contains no other moving bodies.

    Args:
        buffer: Flat buffer with a part of guest.SIZE entries for each body of `carried`.
        carried: Bodies of the world, which have been added to `spec`.
        spec: MuJoCo's specification of the world.
    """

    program = "MuJoCo"
    handing = staticmethod(hand_to_joints)
    taking = staticmethod(take_from_joints)

    def __init__(self, buffer: FloatArray, carried: Sequence[MujocoMember], spec: Any) -> None:
        self.model = spec.compile()
        self.data = mujoco().MjData(self.model)
        for one in carried:
            one.begin(self.model, self.data)
        pushes = [call for one in carried for call in one.pushes]
        readings = [call for one in carried for call in one.readings]
        super().__init__(buffer, carried, [*pushes, self._stepping(), *readings])

    def close(self) -> None:
        """Do nothing, because MuJoCo's memory is freed when this object is deleted."""

    def _stepping(self) -> Call:
        return Call(mujoco().mj_step, (self.model, self.data))

    def _set_step(self, T: float) -> None:
        self.model.opt.timestep = T

    def _fault(self, code: int) -> InputError:
        return InputError(
            "motion", "a number out of range", f"positions and velocities below {RANGE:g} m, m/s and rad/s",
            "the run is unstable: shorten the period, or lower the gains",
        )  # fmt: skip


class MujocoBody(BlockBody, MujocoCarrier):
    """A rigid body in a separate MuJoCo world, without shape or contacts.

    Args:
        state: Block filled by `fill_body`, (SIZE,). The motion is read from the block once, and then only written.

    Raises:
        MissingPackageError: If MuJoCo is not installed.
    """

    def __init__(self, state: FloatArray) -> None:
        BlockBody.__init__(self, state)
        buffer = zeros(guest.SIZE)
        spec = new_spec("CONTACT", "CONSTRAINT")
        MujocoCarrier.__init__(self, buffer, [MujocoMember(state, buffer, spec, 0)], spec)


def create(state: FloatArray) -> MujocoBody:
    """Return the body for `dynamics = "mujoco"`."""
    return MujocoBody(state)


def new_spec(*disabled: str) -> Any:
    """Return the specification of a world without gravity, with the semi-implicit integrator.

    Args:
        disabled: Names of MuJoCo's features to disable, in addition to those that GraspFX never uses.

    Raises:
        MissingPackageError: If MuJoCo is not installed.
    """
    library = mujoco()
    spec = library.MjSpec()
    spec.option.gravity = (0.0, 0.0, 0.0)
    spec.option.integrator = library.mjtIntegrator.mjINT_EULER
    flags = library.mjtDisableBit
    spec.option.disableflags = sum(int(getattr(flags, f"mjDSBL_{name}")) for name in (*UNUSED, *disabled))
    return spec


def mujoco() -> Any:
    """Import MuJoCo, and send its warnings to GraspFX's log, unless a handler for the warnings is already set.

    Raises:
        MissingPackageError: If MuJoCo is not installed.
    """
    try:
        library = sys.modules.get("mujoco") or import_module("mujoco")
    except ModuleNotFoundError as error:
        raise MissingPackageError("mujoco", "dynamics = 'mujoco'", DYNAMICS["mujoco"].remedy) from error
    if library.get_mju_user_warning() is None:
        library.set_mju_user_warning(_log_warning)
    return library


def _log_warning(text: object) -> None:
    info("MuJoCo: %s", text)


def _places(model: Any, joint: str) -> tuple[int, int]:
    """Return the index of a joint's first value in MuJoCo's positions, and in its velocities."""
    number = model.joint(joint).id
    return int(model.jnt_qposadr[number]), int(model.jnt_dofadr[number])


def _possible(moments: Sequence[float]) -> tuple[float, ...]:
    """Return the moments, with the largest one lowered if rounding has made it exceed the sum of the two others.

    MuJoCo rejects such moments.
    """
    largest, total = max(moments), sum(moments)
    if largest <= total - largest or largest > (total - largest) * (1.0 + 1e3 * SLACK):
        return tuple(moments)
    return tuple(min(moment, (total - largest) * (1.0 - 1e-15)) for moment in moments)
