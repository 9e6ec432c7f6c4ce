"""Integrators of a rigid body's motion over one sample of T [s].

The equations of motion are m v' + b v = f + m g for translation and (I w)' + b_w w = tau for rotation. Here v and w are
the velocity and the angular velocity, m the mass, I the inertia, b and b_w the viscosities, and g gravity. The force f,
the moment tau and g are constant over the sample. Free and locked directions are world axes. No force moves the body
along a locked direction.

| integrator | translation, plane rotation | rotation in space |
|---|---|---|
| explicit | x += T v; v += T a | q = exp(T w) q; w += T w', gyroscopic term in w' |
| semi-implicit | v += T a; x += T v | w += T w'; q = exp(T w) q |
| exact | matrix exponential | isotropic inertia or one free axis: w exact, q by Magnus; else RKMK4; 4th order |
| implicit | a at the new v | (I + T b_w) w+ = I w + T (tau - w x I w); q = exp(T w+) q |

Explicit and semi-implicit are stable only for b T/m < 2 and b_w T/I < 2, with the smallest moment of inertia I; exact
and implicit are stable for any viscosity. All integrators except the exact one treat the gyroscopic term explicitly. If
some rotations are locked, the equations are (I w)_free' = (tau - b_w w)_free and w_locked = 0, where the indices select
the free and the locked axes; this adds no approximation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from graspfx import elementary
from graspfx.compile.kernel import inline, kernel
from graspfx.compile.records import size_of, start_of
from graspfx.objects.body_state import EXACT, EXPLICIT, IMPLICIT, SEMI_IMPLICIT, BodyState, Decay, Motion
from graspfx.spatial import (
    ZERO,
    Matrix,
    Quaternion,
    Vector,
    angle_matrix,
    cross,
    dot,
    exponential,
    normalise,
    quaternion_matrix,
    rotate,
    total,
)

__all__ = ["EXACT", "EXPLICIT", "IMPLICIT", "SEMI_IMPLICIT", "orient", "predict", "step"]

# Offsets in the block, from its declaration.
DIMENSIONS = start_of(BodyState, "dimensions")
MASS = start_of(BodyState, "mass")
INERTIA = start_of(BodyState, "inertia")
VISCOSITY = start_of(BodyState, "viscosity")
ROTATIONAL_VISCOSITY = start_of(BodyState, "rotational_viscosity")
INTEGRATOR = start_of(BodyState, "integrator")
FREE = start_of(BodyState, "free_translation")
GRAVITY = start_of(BodyState, "gravity")
_MOTION, _NEXT = start_of(BodyState, "motion"), start_of(BodyState, "next_motion")
POSITION = _MOTION + start_of(Motion, "position")
QUATERNION = _MOTION + start_of(Motion, "quaternion")
ANGLE = _MOTION + start_of(Motion, "angle")
VELOCITY = _MOTION + start_of(Motion, "velocity")
ANGULAR_VELOCITY = _MOTION + start_of(Motion, "angular_velocity")
ROTATION = _MOTION + start_of(Motion, "rotation")
FORCE = start_of(BodyState, "force")
MOMENT = start_of(BodyState, "moment")
NEXT_POSITION = _NEXT + start_of(Motion, "position")
NEXT_ANGULAR_VELOCITY = _NEXT + start_of(Motion, "angular_velocity")
NEXT_ROTATION = _NEXT + start_of(Motion, "rotation")
COMPLIANCE = start_of(BodyState, "compliance")
ROTATIONAL_COMPLIANCE = start_of(BodyState, "rotational_compliance")
DECAY = start_of(BodyState, "translation_decay")
SIZE = size_of(BodyState)

LOCKED = Matrix(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # no rotation for any moment
STRIDE = 0.1  # largest |w| h and b_w h/I of a fourth-order substep h, for accuracy and stability
STRIDES = 10_000  # largest number of substeps, so that a diverged run still ends


# One degree of freedom: v' = u - a v with u constant ------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Coefficients:
    """Coefficients of a step x+ = x + p v + q u, v+ = r v + s u, with which all four integrators can be written.

    Here x and v are position and velocity before the step, and u is the acceleration without viscosity.
    """

    p: float
    q: float
    r: float
    s: float


def decay_integrals(z: float) -> tuple[float, float, float, float]:
    """Compute E = exp(-z) and its integrals (1 - E)/z, (z - 1 + E)/z^2, (z + z E - 2 + 2 E)/(2 z^3), to rounding.

    Under a constant wrench, the first integral determines the velocity, the second the displacement, and the third a
    term of the rotation (see `turn_steadily`). For z < 1 a series avoids cancellation.
    """
    if z >= 1.0:
        E = elementary.exp(-z)
        return E, (1.0 - E) / z, (z - 1.0 + E) / (z * z), (z + z * E - 2.0 + 2.0 * E) / (2.0 * z * z * z)
    term = 0.5  # (-z)^(k - 2)/k!
    two = term
    turn = 0.0
    k = 3
    while abs(term) > 1e-18:
        turn += 0.5 * (k - 2) * term / k  # (k - 2) (-z)^(k - 3)/(2 k!)
        term *= -z / k
        two += term
        k += 1
    return elementary.exp(-z), 1.0 - z * two, two, turn


@kernel
def update_decay(decay: Decay, z: float) -> None:
    """Compute the integrals for z, unless `decay` already contains those for z."""
    if decay.z != z or decay.exponential == 0.0:
        decay.z = z
        decay.exponential, decay.first, decay.second, decay.turn = decay_integrals(z)


@kernel
def coefficients(kind: int, a: float, T: float) -> Coefficients:
    """Compute the coefficients of an integrator's step of T [s], for a decay rate a [1/s] of the velocity."""
    if kind == EXPLICIT:
        return Coefficients(T, 0.0, 1.0 - T * a, T)
    if kind == SEMI_IMPLICIT:
        r = 1.0 - T * a
        return Coefficients(T * r, T * T, r, T)
    if kind == IMPLICIT:
        r = 1.0 / (1.0 + T * a)
        return Coefficients(T * r, T * T * r, r, T * r)
    E, one, two, _ = decay_integrals(a * T)
    return exact_coefficients(T, E, one, two)


@inline
def exact_coefficients(T: float, E: float, one: float, two: float) -> Coefficients:
    """Return the coefficients of the exact integrator, from the first three results of `decay_integrals`."""
    return Coefficients(T * one, T * T * two, E, T * one)


@kernel
def step_coefficients(decay: Decay, kind: int, a: float, T: float) -> Coefficients:
    """Compute the coefficients of a step of T [s] as `coefficients` does, with cached integrals if `kind` is EXACT."""
    if kind != EXACT:
        return coefficients(kind, a, T)
    update_decay(decay, a * T)
    return exact_coefficients(T, decay.exponential, decay.first, decay.second)


# Rotation in space: (I w)' + b_w w = tau on free axes, w = 0 on locked ones -------------------------------------------


@inline
def multiply(a: Vector, b: Vector) -> Vector:
    """Multiply two vectors component by component."""
    return Vector(a.x * b.x, a.y * b.y, a.z * b.z)


@inline
def momentum(body: BodyState, q: Quaternion, w: Vector) -> Vector:
    """Return I w in world axes, for the inertia I in body axes, the orientation q and the angular velocity w."""
    return rotate(q, multiply(body.inertia, rotate(q.conjugate, w)))


@kernel
def turn(body: BodyState, T: float, kind: int) -> None:
    """Rotate the body by one step of T [s] of the explicit, semi-implicit or implicit integrator."""
    motion = body.motion
    new = new_spin(body, T, kind, body.moment)
    w = motion.angular_velocity if kind == EXPLICIT else new
    turn_by(motion, T * w)
    motion.angular_velocity = new


@kernel
def turn_by(motion: Motion, u: Vector) -> None:
    """Rotate by the rotation vector u [rad] in world axes: the quaternion q becomes exp(u) q, normalised."""
    motion.quaternion = normalise(exponential(u) @ motion.quaternion)


@kernel
def vector_of(turn: Quaternion) -> Vector:
    """Return the rotation vector of a unit quaternion [rad], of a length of at most half a turn."""
    u, cosine = turn.vector, turn.w
    sine = math.sqrt(dot(u, u))
    scale = 2.0
    if cosine < 0.0:
        cosine, scale = -cosine, -2.0
    if sine > 0.0:
        scale *= elementary.atan2(sine, cosine) / sine
    return scale * u


@kernel
def new_spin(body: BodyState, T: float, kind: int, moment: Vector) -> Vector:
    """Compute the angular velocity after T [s] under a moment, to first order, by I w' = moment - b_w w - w x I w."""
    q, w, b = body.motion.quaternion, body.motion.angular_velocity, body.rotational_viscosity
    L = momentum(body, q, w)
    moment -= cross(w, L)
    if kind == IMPLICIT:
        return spin_of(body, q, T * b, L + T * moment)
    return w + T * spin_of(body, q, 0.0, moment - b * w)


@kernel
def spin_of(body: BodyState, q: Quaternion, extra: float, L: Vector) -> Vector:
    """Solve (I + extra) u = L on the free axes, with u = 0 on the locked axes, in world axes at the orientation q."""
    free = body.free_rotation
    I = Vector(body.inertia.x + extra, body.inertia.y + extra, body.inertia.z + extra)  # noqa: E741 (the inertia's letter)
    if total(free) == 3.0:
        u = rotate(q.conjugate, L)
        return rotate(q, Vector(u.x / I.x, u.y / I.y, u.z / I.z))
    # columns of I + extra in world axes, then elimination with unit rows for the locked axes
    x = rotate(q, multiply(I, rotate(q.conjugate, Vector(1.0, 0.0, 0.0))))
    y = rotate(q, multiply(I, rotate(q.conjugate, Vector(0.0, 1.0, 0.0))))
    z = rotate(q, multiply(I, rotate(q.conjugate, Vector(0.0, 0.0, 1.0))))
    xx, xy, xz, yy, yz, zz = x.x, x.y, x.z, y.y, y.z, z.z
    Lx, Ly, Lz = L.x, L.y, L.z
    if free.x == 0.0:
        xx, xy, xz, Lx = 1.0, 0.0, 0.0, 0.0
    if free.y == 0.0:
        xy, yy, yz, Ly = 0.0, 1.0, 0.0, 0.0
    if free.z == 0.0:
        xz, yz, zz, Lz = 0.0, 0.0, 1.0, 0.0
    g, h = xy / xx, xz / xx
    yy, yz, zz, Ly, Lz = yy - g * xy, yz - g * xz, zz - h * xz, Ly - g * Lx, Lz - h * Lx
    k = yz / yy
    uz = (Lz - k * Ly) / (zz - k * yz)
    uy = Ly / yy - k * uz
    return Vector(Lx / xx - g * uy - h * uz, uy, uz)


@kernel
def turn_exactly(body: BodyState, T: float) -> None:
    """Rotate by T [s]: at an exact angular velocity for equal moments or one free axis, otherwise to fourth order."""
    I, free = body.inertia, body.free_rotation  # noqa: E741 (the inertia's letter)
    if I.x == I.y == I.z:
        turn_steadily(body, T, I.x)
    elif total(free) == 1.0:
        # about a fixed axis the moment of inertia is constant
        L = momentum(body, body.motion.quaternion, free)
        turn_steadily(body, T, free.x * L.x + free.y * L.y + free.z * L.z)
    else:
        w = body.motion.angular_velocity
        speed = math.sqrt(w.x * w.x + w.y * w.y + w.z * w.z)
        parts = T * max(speed, body.rotational_viscosity / min(I.x, I.y, I.z)) / STRIDE
        count = STRIDES
        if parts < STRIDES:  # NaN compares false
            count = 1 + int(parts)
        for _ in range(count):
            turn_freely(body, T / count)


@kernel
def turn_steadily(body: BodyState, T: float, J: float) -> None:
    """Rotate by T [s] with a constant moment of inertia J, so that w' = (m - b_w w)/J for a moment m.

    The angular velocity w is exact, and the orientation is exact to fourth order: by the Magnus expansion, the rotation
    vector is the integral of w plus half the double integral of w(s) x w(t) over t < s. The double integral is a
    multiple of w x m, and is computed in closed form.
    """
    motion, decay = body.motion, body.rotation_decay
    update_decay(decay, body.rotational_viscosity / J * T)
    one, two = decay.first, decay.second
    w = motion.angular_velocity
    a = multiply(body.free_rotation, body.moment) / J
    g = -T * T * T * decay.turn
    turn_by(motion, T * (one * w + T * two * a) + g * cross(w, a))
    motion.angular_velocity = decay.exponential * w + T * one * a


@kernel
def turn_freely(body: BodyState, h: float) -> None:
    """Rotate a body of any inertia by a fourth-order Runge-Kutta-Munthe-Kaas step of h [s] (Munthe-Kaas 1999).

    The step is computed in body axes.
    """
    motion = body.motion
    q = motion.quaternion
    k = 0.5 * h
    a = rotate(q.conjugate, motion.angular_velocity)
    f = body_acceleration(body, q, a)
    slopes = f

    b = a + k * f
    f = body_acceleration(body, q @ exponential(k * a), b)
    slopes += 2.0 * f

    g = h * h / 8.0  # the commutator, which transforms the second slope into the frame of the first
    c = a + k * f
    f = body_acceleration(body, q @ exponential(k * b + g * cross(a, b)), c)
    slopes += 2.0 * f

    d = a + h * f
    f = body_acceleration(body, q @ exponential(h * c), d)

    k, g = h / 6.0, h * h / 12.0
    q = normalise(q @ exponential(k * (a + 2.0 * (b + c) + d) + g * cross(a, d)))
    motion.quaternion = q
    motion.angular_velocity = multiply(body.free_rotation, rotate(q, a + k * (slopes + f)))


@kernel
def body_acceleration(body: BodyState, q: Quaternion, w: Vector) -> Vector:
    """Compute the angular acceleration for the orientation q and the angular velocity w, both vectors in body axes."""
    I = body.inertia  # noqa: E741 (the inertia's letter)
    gyroscopic = Vector((I.z - I.y) * w.y * w.z, (I.x - I.z) * w.z * w.x, (I.y - I.x) * w.x * w.y)
    moment = rotate(q.conjugate, body.moment) - (body.rotational_viscosity * w + gyroscopic)
    if total(body.free_rotation) == 3.0:
        return Vector(moment.x / I.x, moment.y / I.y, moment.z / I.z)
    return rotate(q.conjugate, spin_of(body, q, 0.0, rotate(q, moment)))


# The whole body -------------------------------------------------------------------------------------------------------


@kernel
def orient(body: BodyState) -> None:
    """Compute the rotation matrix of a body from its quaternion or its angle."""
    motion = body.motion
    if body.dimensions == 3:
        motion.rotation = quaternion_matrix(motion.quaternion)
    else:
        motion.rotation = angle_matrix(motion.angle)


@kernel
def step(body: BodyState, T: float) -> None:
    """Move the body by T [s] under the wrench in its block, gravity and viscosity."""
    d, kind, m, motion = body.dimensions, body.integrator, body.mass, body.motion
    c = step_coefficients(body.translation_decay, kind, body.viscosity / m, T)
    for a in range(d):
        if body.free_translation[a] != 0.0:
            x, v, g, f = motion.position[a], motion.velocity[a], body.gravity[a], body.force[a]
            motion.position[a] = x + c.p * v + c.q * g + c.q / m * f
            motion.velocity[a] = c.r * v + c.s * g + c.s / m * f
    if d == 2 and body.free_rotation.z != 0.0:
        J, moment, w = body.inertia.z, body.moment.z, motion.angular_velocity.z
        c = step_coefficients(body.rotation_decay, kind, body.rotational_viscosity / J, T)
        motion.angle = motion.angle + c.p * w + c.q / J * moment
        motion.angular_velocity[2] = c.r * w + c.s / J * moment
        orient(body)
    if d == 3 and total(body.free_rotation) > 0.0:
        if kind == EXACT:
            turn_exactly(body, T)
        else:
            turn(body, T, kind)
        orient(body)


@kernel
def predict(body: BodyState, T: float) -> None:
    """Compute a body's motion after T [s] without a wrench, and its compliance, for the implicit integrator.

    A force f and a moment then give the position x+ = x_next + C f to the last bit, with the compliances C and C_r. In
    the plane the angle is angle_next + C_r moment. In space the rotation matrix is exp(C_r moment) R_next, with an
    error of the order of T |w| times the rotation C_r moment, where w is the angular velocity.
    """
    d, motion, next_motion = body.dimensions, body.motion, body.next_motion
    c = coefficients(IMPLICIT, body.viscosity / body.mass, T)
    body.compliance = c.q / body.mass
    for a in range(3):
        x, v = motion.position[a], motion.velocity[a]
        if body.free_translation[a] != 0.0:
            x, v = x + c.p * v + c.q * body.gravity[a], c.r * v + c.s * body.gravity[a]
        next_motion.position[a] = x
        next_motion.velocity[a] = v
    next_motion.angular_velocity = motion.angular_velocity
    next_motion.rotation = motion.rotation
    body.rotational_compliance = LOCKED
    if d == 2 and body.free_rotation.z != 0.0:
        J, w = body.inertia.z, motion.angular_velocity.z
        c = coefficients(IMPLICIT, body.rotational_viscosity / J, T)
        next_motion.rotation = angle_matrix(motion.angle + c.p * w)
        next_motion.angular_velocity[2] = c.r * w
        body.rotational_compliance[8] = c.q / J
    if d == 3 and total(body.free_rotation) > 0.0:
        q, extra = motion.quaternion, T * body.rotational_viscosity
        spin = new_spin(body, T, IMPLICIT, ZERO)
        next_motion.angular_velocity = spin
        next_motion.rotation = quaternion_matrix(normalise(exponential(T * spin) @ q))
        x_column = spin_of(body, q, extra, Vector(1.0, 0.0, 0.0))
        y_column = spin_of(body, q, extra, Vector(0.0, 1.0, 0.0))
        z_column = spin_of(body, q, extra, Vector(0.0, 0.0, 1.0))
        body.rotational_compliance = Matrix(
            T * T * x_column.x, T * T * y_column.x, T * T * z_column.x,
            T * T * x_column.y, T * T * y_column.y, T * T * z_column.y,
            T * T * x_column.z, T * T * y_column.z, T * T * z_column.z,
        )  # fmt: skip
