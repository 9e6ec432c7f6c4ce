"""Bodies simulated by other software: protocol, base classes, and conversion of wrenches and motions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np

from graspfx import elementary
from graspfx.compile.calls import Call, in_turn
from graspfx.compile.kernel import kernel, source_function
from graspfx.compile.records import Record, size_of
from graspfx.errors import InputError
from graspfx.objects.body import BlockBody, FloatArray
from graspfx.objects.body_state import BodyState, Motion
from graspfx.objects.integrators import decay_integrals, multiply, orient
from graspfx.spatial import Quaternion, Vector, exponential, rotate


class GuestState(Record):
    """A body's part of the exchange buffer: properties, wrench to send and motion received, in world axes."""

    by_spin: bool  # whether the angular velocity after the step is sent instead of a moment
    free_translation: Vector  # 1.0 or 0.0 per axis
    free_rotation: Vector
    turns: int  # number of free rotations
    axis: int  # axis of the first free rotation
    share: float  # factor on a constant force that models viscosity: (1 - E)/(b T/m), E = exp(-b T/m)
    shares: Vector  # factors on moments about the principal axes, with inertia and rotational viscosity
    moments: Vector  # moments of inertia in the software [kg m^2]
    start: Quaternion  # orientation from which the angle of a single free rotation is measured
    start_angle: float  # initial angle in the plane [rad]
    angle: float  # angle of a single free rotation since `start`, unwrapped [rad]
    push: Vector  # force sent [N]
    twist: Vector  # moment sent [N m], or angular velocity [rad/s]
    waiting: bool  # whether a wrench was sent and the resulting motion has not been taken yet
    velocity: Vector  # velocity received [m/s]
    place: Vector  # position received [m], used if a rotation is free; otherwise the position is x + T v
    turn: Quaternion  # rotation since `start`; the whole orientation if several rotations are free
    spin: Vector  # angular velocity received [rad/s]
    aim: Vector  # angular velocity intended as the mean of the step, world axes [rad/s]
    lead: Vector  # angular velocity at the step's end minus that mean [rad/s]


SIZE = size_of(GuestState)

TURN_LIMIT = 0.25 * math.pi  # largest rotation of a PyBullet body in one step, at any angular velocity
TOO_FAST = 1


@runtime_checkable
class Guest(Protocol):
    """Protocol of a body, or a world of bodies, that other software moves between two ticks.

    At the end of a tick, a run calls the kernel `handing(S, o, F, f, T)` for each body, and then `exchange`. The kernel
    writes the wrench for the software. At the beginning of the next tick, the run calls the kernel
    `taking(S, o, F, f, T)` for each body. This kernel reads the motion and returns 0, or a fault code if the body
    cannot continue. The body's block starts at S[o], its part of the buffer at F[f].
    """

    @property
    def buffer(self) -> FloatArray:
        """Buffer for the wrenches sent and the motions received; always the same array."""
        ...

    @property
    def places(self) -> Sequence[int]:
        """Index in the buffer at which each body's part starts; -1 for a body that never moves."""
        ...

    @property
    def handing(self) -> Any:
        """Kernel that writes to the buffer the wrench that the other software applies to a body."""

    @property
    def taking(self) -> Any:
        """Kernel that copies a body's motion from the buffer to its block."""

    def hold(self, T: float) -> None:
        """Set the period of all following samples to T [s]."""

    def exchange(self) -> None:
        """Send the wrenches, step the software once, and receive the motions."""

    def take(self) -> int:
        """Copy the last motions to the blocks; return 0, or the fault code of the first body that cannot continue."""
        ...

    def fault_text(self, code: int) -> str:
        """Return the message for the fault code of a body."""
        ...


@runtime_checkable
class CallingGuest(Guest, Protocol):
    """A guest whose `exchange` only calls functions of the software, so that a run can call these functions itself."""

    @property
    def calls(self) -> Sequence[Call]:
        """Calls that an exchange makes, in order; empty if `exchange` must be called."""
        ...


@kernel
def hand_over(body: BodyState, guest: GuestState, T: float) -> None:
    """Write the force to send, (f + m g - b v) times `share`, and the moment or the angular velocity to send.

    Here f is the force in the block, m the mass, g gravity, b the viscosity and v the velocity.
    """
    b = body.viscosity
    for a in range(3):
        push = 0.0
        if guest.free_translation[a] != 0.0:
            pull = body.force[a] + body.mass * body.gravity[a] - b * body.motion.velocity[a]
            push = guest.share * pull
        guest.push[a] = push
    if guest.turns > 0:
        twist = viscous_moment(body, guest)
        guest.twist = spin_after(body, guest, T, twist) if guest.by_spin else twist
    guest.waiting = True


@kernel
def viscous_moment(body: BodyState, guest: GuestState) -> Vector:
    """Compute the moment to send, in world axes [N m], such that rotational viscosity is exact."""
    motion, shares = body.motion, guest.shares
    moment = multiply(body.free_rotation, body.moment - body.rotational_viscosity * motion.angular_velocity)
    if shares.x == shares.y == shares.z:
        return shares.x * moment
    q = motion.quaternion
    return rotate(q, multiply(shares, rotate(q.conjugate, moment)))


@kernel
def spin_after(body: BodyState, guest: GuestState, T: float, moment: Vector) -> Vector:
    """Compute the angular velocity that a moment M gives in T [s], w + T J^-1 M, in world axes [rad/s].

    Here w is the present angular velocity and J the inertia in the software.
    """
    q, J = body.motion.quaternion, guest.moments
    m = rotate(q.conjugate, moment)
    return body.motion.angular_velocity + rotate(q, Vector(T * m.x / J.x, T * m.y / J.y, T * m.z / J.z))


@kernel
def take_over(body: BodyState, guest: GuestState, T: float) -> int:
    """Copy the motion after a step of T [s] to the block; return TOO_FAST if it turned by over TURN_LIMIT, else 0."""
    if not guest.waiting:
        return 0
    guest.waiting = False
    motion = body.motion
    for a in range(3):
        if guest.free_translation[a] != 0.0:
            v = guest.velocity[a]
            motion.velocity[a] = v
            motion.position[a] = motion.position[a] + T * v if guest.turns == 0 else guest.place[a]
    if guest.turns == 0:
        return 0
    w = guest.spin
    speed = math.sqrt(w.x * w.x + w.y * w.y + w.z * w.z)
    if not speed * T <= TURN_LIMIT:  # true for NaN
        return TOO_FAST
    for a in range(3):
        if guest.free_rotation[a] != 0.0:
            motion.angular_velocity[a] = guest.spin[a]
    q = guest.turn
    if guest.turns == 1:
        angle = unwrapped_angle(guest, T)
        if body.dimensions == 2:
            motion.angle = guest.start_angle + angle
            orient(body)
            return 0
        axis = guest.axis
        tx = angle if axis == 0 else 0.0
        ty = angle if axis == 1 else 0.0
        tz = angle if axis == 2 else 0.0
        q = exponential(Vector(tx, ty, tz)) @ guest.start
    old = motion.quaternion
    if q.x * old.x + q.y * old.y + q.z * old.z + q.w * old.w < 0.0:  # both signs mean the same rotation
        q = Quaternion(-q.x, -q.y, -q.z, -q.w)
    motion.quaternion = q
    orient(body)
    return 0


@kernel
def unwrapped_angle(guest: GuestState, T: float) -> float:
    """Compute the unwrapped angle of the single free rotation [rad], which is the nearest to last angle + T w."""
    axis, q = guest.axis, guest.turn
    sine = q.x if axis == 0 else (q.y if axis == 1 else q.z)
    angle = 2.0 * elementary.atan2(sine, q.w)
    expected = guest.angle + T * guest.spin[axis]
    angle += 2.0 * math.pi * math.floor((expected - angle) / (2.0 * math.pi) + 0.5)
    guest.angle = angle
    return angle


# Base classes ---------------------------------------------------------------------------------------------------------


class CarriedBody(BlockBody):
    """A body in another program's world, which receives the wrench in the block before the world's step.

    The program receives the force (f + m g - b v) (1 - E)/(b T/m), which is constant over the sample of T [s]. Here f
    is the force in the block, m the mass, g gravity, b the viscosity, v the velocity, and E = exp(-b T/m). The velocity
    v+ after the sample is then exactly that of a viscous body, and the position after the sample is x+ = x + T v+.
    Moments about the principal axes are computed in the same way. No force acts along a locked degree of freedom, and
    the entries of locked degrees of freedom in the block are never written.

    Args:
        state: Block filled by `fill_body`, (SIZE,). The motion is read from the block once, and then only written.
        part: Body's part of the buffer, (SIZE,), for wrench and motion; all entries are overwritten.
    """

    handing: Callable[..., None] = staticmethod(hand_over)
    taking: Callable[..., int] = staticmethod(take_over)

    def __init__(self, state: FloatArray, part: FloatArray) -> None:
        super().__init__(state)
        d = self.dimensions
        own = BodyState(state)
        free = np.append(own.array(BodyState.free_translation), own.array(BodyState.free_rotation)) != 0.0
        self.fixed = not free.any()
        self.shifts = tuple(int(a) for a in range(3) if free[a])
        self.turns = tuple(int(a) for a in range(3) if free[3 + a])
        self.start = (0.0, 0.0, 0.0, 1.0) if d == 2 else numbers_of(own.motion, Motion.quaternion)
        self.place = numbers_of(own.motion, Motion.position)
        self.moments = self._seen_moments()
        part[:] = 0.0
        own_part = self.part = GuestState(memoryview(part))
        own_part.array(GuestState.free_translation)[:d] = free[:d]
        own_part.free_rotation = Vector(*free[3:])
        own_part.turns, own_part.axis = len(self.turns), self.turns[0] if self.turns else 0
        own_part.moments, own_part.start = Vector(*self.moments), Quaternion(*self.start)
        own_part.start_angle = self._body.motion.angle
        own_part.place = Vector(*self.place)

    def hold(self, T: float) -> None:
        """Compute the factors on force and moment that model viscosity, for samples of T [s]."""
        body, own_part = self._body, self.part
        own_part.share = decay_integrals(body.viscosity * T / body.mass)[1]
        b, J = body.rotational_viscosity, own_part.moments
        own_part.shares = Vector(*(decay_integrals(b * T / moment)[1] for moment in (J.x, J.y, J.z)))

    def hand_over(self, T: float) -> None:
        """Write the wrench for a step of T [s] to the buffer, with gravity and viscosity."""
        self.handing(self._body, self.part, T)

    def take_over(self, T: float) -> int:
        """Copy the motion after a step of T [s] to the block; return 0, or a fault code if the body cannot continue."""
        body, part = self._body, self.part  # local names, because a run executes this in every tick
        return int(source_function(self.taking)(body.buffer, body.offset, part.buffer, part.offset, T))

    @property
    def speed(self) -> float:
        """Angular speed that was received last [rad/s]."""
        return float(np.linalg.norm(self.part.array(GuestState.spin)))

    def _seen_moments(self) -> tuple[float, ...]:
        """Return the moments of inertia (3,) that the simulator is given; all equal if only one rotation is free."""
        moments = numbers_of(self._body, BodyState.inertia)
        if not self.turns:
            return 1.0, 1.0, 1.0
        if len(self.turns) > 1 or moments[0] == moments[1] == moments[2] > 0.0:
            return moments
        axis = [1.0 if a in self.turns else 0.0 for a in range(3)]
        if self.dimensions == 3:
            own = rotate(Quaternion(*self.start).conjugate, Vector(*axis))
            axis = [own.x, own.y, own.z]
        J = sum(moment * e * e for moment, e in zip(moments, axis, strict=True))
        return J, J, J


class Carrier:
    """Bodies in a world of another program, which contains no other moving bodies and is stepped once per tick.

    Args:
        buffer: Flat buffer with a part of SIZE entries for each body of `carried`.
        carried: Bodies of the world.
        calls: Calls that one exchange makes, in order.
    """

    program = "the other program"  # name of the program in messages
    handing: Callable[..., None] = staticmethod(hand_over)
    taking: Callable[..., int] = staticmethod(take_over)

    def __init__(self, buffer: FloatArray, carried: Sequence[CarriedBody], calls: Sequence[Call]) -> None:
        self.buffer, self.carried = buffer, carried
        moves = [not one.fixed for one in carried]
        self.places = tuple(i * SIZE if m else -1 for i, m in enumerate(moves))
        self._moving = [one for one, m in zip(carried, moves, strict=True) if m]
        self._T = 0.0
        self._calls = calls
        self._exchange = in_turn(calls)

    @property
    def calls(self) -> Sequence[Call]:
        """Calls that one exchange makes; empty if a subclass overrides `exchange`."""
        return self._calls if type(self).exchange is Carrier.exchange else ()

    def hold(self, T: float) -> None:
        """Set the period of all following samples to T [s].

        Raises:
            InputError: If T is not a finite time above zero.
        """
        if T != self._T:
            if not 0.0 < T < math.inf:
                raise InputError("T", T, "a finite time above zero [s]")
            for one in self._moving:
                one.hold(T)
            self._set_step(T)
            self._T = T

    def exchange(self) -> None:
        """Apply the wrenches to the bodies, step the world, and receive the motions."""
        self._exchange()

    def take(self) -> int:
        """Copy the last motions to the blocks; return 0, or the fault code of the first body that cannot continue."""
        return next((code for one in self._moving if (code := one.take_over(self._T))), 0)

    def fault_text(self, code: int) -> str:
        """Return the message for the fault code of a body."""
        return str(self._fault(code))

    def step(self, T: float) -> None:
        """Move every body by T [s] under contact forces and the wrench in its block, constant over the sample.

        Raises:
            InputError: If T is not a finite time above zero, or a body cannot continue.
        """
        self.hold(T)
        for one in self._moving:
            one.hand_over(T)
        self.exchange()
        code = self.take()
        if code:
            raise self._fault(code)

    def free_motion(self, T: float) -> None:
        """Raise InputError, because the program has no implicit integrator whose new state could be predicted."""
        raise InputError(
            "integrator",
            "implicit",
            f"'semi-implicit', because {self.program} has one integrator",
            "use native dynamics",
        )

    def _set_step(self, T: float) -> None:
        raise NotImplementedError

    def _fault(self, code: int) -> InputError:
        raise NotImplementedError


def numbers_of(record: Any, field: Any) -> tuple[float, ...]:
    """Return the entries of a record's field."""
    return tuple(record.array(field).tolist())
