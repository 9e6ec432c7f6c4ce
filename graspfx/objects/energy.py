"""Energy of a rigid body over one sample: work, viscous loss, and energy error of the integrator.

For a body of mass m and viscosity b that moves from velocity v to v+ in a sample of T [s], under the fingers' force F,
the obstacles' force C and gravity g, all constant over the sample, with the displacement dx,

    1/2 m v+^2 - 1/2 m v^2 = (F + C + m g)'dx - loss + defect

| integrator | loss | defect |
|---|---|---|
| explicit | T b v^2 | +1/2 m (v+ - v)^2 |
| semi-implicit | T b v v+ | -1/2 m (v+ - v)^2 |
| implicit | T b v+^2 | -1/2 m (v+ - v)^2 |
| exact | integral of b v^2 | 0 |

Rotations obey the same balance, with moments and the rotation vector in place of forces and dx. In space, the rotation
of the inertia tensor from I to I+ adds the defect 1/2 w+'(I+ - I) w+, where w and w+ are the angular velocities before
and after the sample. If w+ moves the body, the defect -T w+'(w x I w) is also added.
"""

from __future__ import annotations

from dataclasses import dataclass

from graspfx import elementary
from graspfx.compile.kernel import inline, kernel
from graspfx.compile.records import Record
from graspfx.objects.body_state import EXACT, EXPLICIT, BodyState, Motion, copy_motion
from graspfx.objects.integrators import decay_integrals, momentum, multiply, vector_of
from graspfx.spatial import ZERO, Quaternion, Vector, cross, dot, total

SERIES = 0.5  # b T/m below which a series is used, because differences of exponentials cancel


class SampleStart(Record):
    """State of a body at the beginning of a sample, and the body's displacement over the sample."""

    motion: Motion
    force: Vector  # force of the fingers, constant over the sample [N]
    moment: Vector  # moment of the fingers, constant over the sample [N m]
    contact_force: Vector  # force of the obstacles over the sample [N]
    contact_moment: Vector  # moment of the obstacles over the sample [N m]
    shift: Vector  # displacement dx [m]
    turn: Vector  # rotation vector of the free rotations, world axes [rad]
    energy: float  # kinetic energy at the start [J]


@dataclass(frozen=True, slots=True)
class SampleEnergy:
    """Terms of the energy balance of one sample of a body [J]."""

    work: float  # work of the wrench
    fallen: float  # work of gravity
    met: float  # work of obstacles
    loss: float  # viscous loss in translation
    turning_loss: float  # viscous loss in rotation
    defect: float  # defect of the integrator in translation
    turning_defect: float  # defect of the integrator in rotation


@kernel
def keep(body: BodyState, start: SampleStart) -> None:
    """Store the motion, wrench and kinetic energy of a body at the beginning of a sample."""
    copy_motion(body.motion, start.motion)
    start.force, start.moment = body.force, body.moment
    start.energy = kinetic(body)


@kernel
def kinetic(body: BodyState) -> float:
    """Return the kinetic energy 1/2 m v^2 + 1/2 w'I w of a body [J]."""
    motion, d = body.motion, body.dimensions
    energy = 0.5 * body.mass * dot(motion.velocity, motion.velocity)
    w = motion.angular_velocity
    if d == 2:
        energy += 0.5 * body.inertia.z * w.z * w.z
    if d == 3:
        energy += 0.5 * dot(w, momentum(body, motion.quaternion, w))
    return energy


@kernel
def settle(body: BodyState, start: SampleStart, T: float) -> SampleEnergy:
    """Compute the energy terms of the sample of T [s] that began at `start`; write `shift` and `turn` of `start`."""
    kind, d, motion, before = body.integrator, body.dimensions, body.motion, start.motion
    m, b = body.mass, body.viscosity
    work = fallen = met = loss = turning_loss = defect = turning_defect = 0.0
    start.shift = start.turn = ZERO
    for a in range(3):
        if body.free_translation[a] != 0.0:
            dx = motion.position[a] - before.position[a]
            start.shift[a] = dx
            F, C, g = start.force[a], start.contact_force[a], body.gravity[a]
            work += F * dx
            met += C * dx
            fallen += m * g * dx
            v, after = before.velocity[a], motion.velocity[a]
            loss += viscous(kind, m, b, T, v, after, (F + C) / m + g)
            defect += velocity_defect(kind, m, v, after)
    if d == 2 and body.free_rotation.z != 0.0:
        J, turn = body.inertia.z, motion.angle - before.angle
        start.turn[2] = turn
        M, C = start.moment.z, start.contact_moment.z
        work += M * turn
        met += C * turn
        w, after = before.angular_velocity.z, motion.angular_velocity.z
        turning_loss = viscous(kind, J, body.rotational_viscosity, T, w, after, (M + C) / J)
        turning_defect = velocity_defect(kind, J, w, after)
    if d == 3 and total(body.free_rotation) > 0.0:
        start.turn = rotation_vector(body, before.quaternion)
        done = 0.0
        for a in range(3):
            work += start.moment[a] * start.turn[a]
            met += start.contact_moment[a] * start.turn[a]
            done += (start.moment[a] + start.contact_moment[a]) * start.turn[a]
        turning_loss, turning_defect = settle_rotation(body, start, T, done)
    return SampleEnergy(work, fallen, met, loss, turning_loss, defect, turning_defect)


def viscous(kind: int, m: float, b: float, T: float, v: float, after: float, u: float) -> float:
    """Return the viscous loss of one degree of freedom over a sample [J].

    Args:
        kind: Integrator.
        m, b: Mass [kg] and viscosity [N s/m], or moment of inertia [kg m^2] and rotational viscosity [N m s/rad].
        T: Duration of the sample [s].
        v, after: Velocity before and after the sample.
        u: Acceleration due to all forces except viscosity.
    """
    if kind != EXACT:
        if kind == EXPLICIT:
            return T * b * v * v
        return T * b * after * (v if kind < EXACT else after)
    z = b * T / m
    rise = T * (u - b / m * v)  # v(t) = v + rise (1 - exp(-z t/T))/z
    return T * b * (v * v + 2.0 * v * rise * decay_integrals(z)[2] + rise * rise * decay_square(z))


def decay_square(z: float) -> float:
    """Integrate ((1 - exp(-z s))/z)^2 over s from 0 to 1: (z - 2 (1 - E) + (1 - E^2)/2)/z^3, where E = exp(-z)."""
    if z > SERIES:
        E = elementary.exp(-z)
        return (z - 2.0 * (1.0 - E) + 0.5 * (1.0 - E * E)) / (z * z * z)
    total, power, twos, k = 0.0, 0.5, 4.0, 2  # power = (-z)^(k - 2)/k!
    while abs(power) * twos > 1e-18:
        total += (twos - 2.0) * power / (k + 1)
        k += 1
        power *= -z / k
        twos *= 2.0
    return total


def velocity_defect(kind: int, m: float, before: float, after: float) -> float:
    """Compute the integrator's energy error of one degree of freedom, +-1/2 m (v+ - v)^2 [J]; 0 if exact."""
    if kind == EXACT:
        return 0.0
    return (0.5 if kind == EXPLICIT else -0.5) * m * (after - before) * (after - before)


@inline
def quotient(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return the product of p and the conjugate of q, two unit quaternions: the rotation from q to p."""
    x, y, z, w = -q.x, -q.y, -q.z, q.w
    return Quaternion(
        p.w * x + p.x * w + p.y * z - p.z * y,
        p.w * y + p.y * w + p.z * x - p.x * z,
        p.w * z + p.z * w + p.x * y - p.y * x,
        p.w * w - p.x * x - p.y * y - p.z * z,
    )


@kernel
def rotation_vector(body: BodyState, before: Quaternion) -> Vector:
    """Compute the rotation vector from the orientation `before` to the present one [rad]; zero about locked axes."""
    return multiply(body.free_rotation, vector_of(quotient(body.motion.quaternion, before)))


@kernel
def settle_rotation(body: BodyState, start: SampleStart, T: float, done: float) -> tuple[float, float]:
    """Compute the viscous loss and the defect of a rotation in space [J], where `done` is the work of all moments.

    The results are exact if one axis is free, or if the moments of inertia are equal. Otherwise, for the exact
    integrator, the loss is computed from the mean square of the angular velocity, linearly interpolated over the
    sample, and the defect is the remainder of the energy balance.
    """
    kind, b = body.integrator, body.rotational_viscosity
    q, v, u = start.motion.quaternion, start.motion.angular_velocity, body.motion.angular_velocity
    L = momentum(body, q, v)
    if kind == EXACT:
        I, free = body.inertia, body.free_rotation  # noqa: E741 (the inertia's letter)
        J, axes = I.x, total(free)
        if axes == 1.0:
            J = dot(free, momentum(body, q, free))
        if axes == 1.0 or I.x == I.y == I.z:
            loss = 0.0
            for a in range(3):
                if body.free_rotation[a] != 0.0:
                    M = start.moment[a] + start.contact_moment[a]
                    w, after = start.motion.angular_velocity[a], body.motion.angular_velocity[a]
                    loss += viscous(kind, J, b, T, w, after, M / J)
            return loss, 0.0
        squares = v.x * v.x + v.x * u.x + u.x * u.x + v.y * v.y + v.y * u.y + u.y * u.y
        loss = T * b * (squares + v.z * v.z + v.z * u.z + u.z * u.z) / 3.0
        gain = dot(u, momentum(body, body.motion.quaternion, u)) - v.x * L.x - v.y * L.y - v.z * L.z
        return loss, 0.5 * gain - done + loss
    change = u - v
    defect = 0.5 * dot(change, momentum(body, q, change))
    if kind == EXPLICIT:
        loss = T * b * dot(v, v)
    else:
        defect = -defect - T * dot(u, cross(v, L))
        loss = T * b * (dot(v, u) if kind < EXACT else dot(u, u))
    return loss, defect + 0.5 * dot(u, momentum(body, body.motion.quaternion, u) - momentum(body, q, u))
