"""Exchange between a body's block and MuJoCo's joints: the wrench of a sample, and the motion after it."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.objects.body_state import BodyState
from graspfx.objects.guest import GuestState, hand_over
from graspfx.objects.integrators import orient
from graspfx.objects.rotation import momentum, multiply, spin_of, turn_exactly, vector_of
from graspfx.spatial import ZERO, Quaternion, Vector, cross, exponential, inner, rotate

OUT_OF_RANGE = 2
UNTOUCHED = 1e-16  # squared relative change of an angular velocity below which it is rounding
RANGE = 1e10  # largest number that MuJoCo does not treat as a failure


@kernel
def hand_to_joints(body: BodyState, guest: GuestState, T: float) -> None:
    """Compute force and moment for MuJoCo's step in world axes, reduced by viscosity (see `hand_over`).

    If the moments of inertia differ, the moment is that for the rotation described in `drift`.
    """
    hand_over(body, guest, T)
    if guest.turns > 1:
        J = guest.moments
        if not (J.x == J.y == J.z):
            drift(body, guest, T)


@kernel
def drift(body: BodyState, guest: GuestState, T: float) -> None:
    """Compute the moment for which MuJoCo's step rotates the body as far as it rotates freely after a push.

    The push changes the angular velocity by T J^-1 M, where M is the moment reduced by viscosity. Then the body rotates
    for T by Euler's equations without a moment, to fourth order. This is semi-implicit like the translation, but free
    of the error of the gyroscopic term. MuJoCo rotates by its new spin u+ = u + T J^-1 (N - u x J u), which has to
    equal the mean angular velocity of that rotation.
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
    """Write the motion after a step of T [s] to the block; return OUT_OF_RANGE if a number is too large for MuJoCo.

    `guest.place` and `guest.velocity` are those of slide joints, `guest.turn` is MuJoCo's quaternion w, x, y, z, and
    `guest.spin` is in the body's axes. For one free rotation `guest.angle` is the angle, and `spin` is in world axes.
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
