"""Rotation of a rigid body in space during one sample: (I w)' + b_w w = tau on free axes, w = 0 on locked ones."""

from __future__ import annotations

import math

from graspfx import elementary
from graspfx.compile.kernel import inline, kernel
from graspfx.objects.body_state import EXPLICIT, IMPLICIT, BodyState, Motion
from graspfx.objects.decay import update_decay
from graspfx.spatial import Quaternion, Vector, cross, dot, exponential, normalise, rotate, total

STRIDE = 0.1  # largest |w| h and b_w h/I of a fourth-order substep h, for accuracy and stability
STRIDES = 10_000  # largest number of substeps, so that a diverged run still ends


@inline
def multiply(a: Vector, b: Vector) -> Vector:
    """Multiply two vectors component by component."""
    return Vector(a.x * b.x, a.y * b.y, a.z * b.z)


@inline
def momentum(body: BodyState, q: Quaternion, w: Vector) -> Vector:
    """Compute I w in world axes, for the orientation q."""
    return rotate(q, multiply(body.inertia, rotate(q.conjugate, w)))


@kernel
def turn(body: BodyState, T: float, kind: int) -> None:
    """Rotate by one step of the explicit, semi-implicit or implicit integrator."""
    motion = body.motion
    new = new_spin(body, T, kind, body.moment)
    w = motion.angular_velocity if kind == EXPLICIT else new
    turn_by(motion, T * w)
    motion.angular_velocity = new


@kernel
def turn_by(motion: Motion, u: Vector) -> None:
    """Rotate by the vector u [rad]: q = exp(u) q, normalised."""
    motion.quaternion = normalise(exponential(u) @ motion.quaternion)


@kernel
def vector_of(turn: Quaternion) -> Vector:
    """Compute the rotation vector of a unit quaternion [rad]; its length is at most half a turn."""
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
    """Compute w after T [s] under a moment m: I w' = m - b_w w - w x I w on free axes, to first order."""
    q, w, b = body.motion.quaternion, body.motion.angular_velocity, body.rotational_viscosity
    L = momentum(body, q, w)
    moment -= cross(w, L)
    if kind == IMPLICIT:
        return spin_of(body, q, T * b, L + T * moment)
    return w + T * spin_of(body, q, 0.0, moment - b * w)


@kernel
def spin_of(body: BodyState, q: Quaternion, extra: float, L: Vector) -> Vector:
    """Solve (I + extra) u = L on the free axes and u = 0 on the locked ones, for the orientation q."""
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
    """Rotate by the most accurate step available: with the exact angular velocity if possible, else of fourth order."""
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
    """Rotate with a constant moment of inertia J: w' = (m - b_w w)/J exactly, the orientation to 4th order (Magnus).

    log of the rotation = integral of w + 1/2 double integral of w(s) x w(t), t < s. The double integral is along w x m
    and has a closed form.
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
    """Rotate a body of any inertia: a fourth-order Runge-Kutta-Munthe-Kaas step (Munthe-Kaas 1999).

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
    """Compute the angular acceleration in body axes, for the orientation q and the angular velocity w in body axes."""
    I = body.inertia  # noqa: E741 (the inertia's letter)
    gyroscopic = Vector((I.z - I.y) * w.y * w.z, (I.x - I.z) * w.z * w.x, (I.y - I.x) * w.x * w.y)
    moment = rotate(q.conjugate, body.moment) - (body.rotational_viscosity * w + gyroscopic)
    if total(body.free_rotation) == 3.0:
        return Vector(moment.x / I.x, moment.y / I.y, moment.z / I.z)
    return rotate(q.conjugate, spin_of(body, q, 0.0, rotate(q, moment)))
