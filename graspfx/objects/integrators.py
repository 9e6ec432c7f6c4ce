"""How a rigid body moves during one sample: the body's block, and its integrators.

The wrench and gravity are held over the sample; viscosity is linear, m v' + b v = f + m g and
(I w)' + b_w w = tau. Free directions are world axes: a locked one carries whatever force holds it still.

| integrator | translation, plane rotation | rotation in space |
|---|---|---|
| explicit | x += T v; v += T a | q = exp(T w) q; w += T w', gyroscopic term in w' |
| semi-implicit | v += T a; x += T v | w += T w'; q = exp(T w) q |
| exact | matrix exponential | isotropic inertia or one free axis: w exact, q by Magnus; else RKMK4; 4th order |
| implicit | a taken with the new v | (I + T b_w) w+ = I w + T (tau - w x I w); q = exp(T w+) q |

Explicit and semi-implicit need b T/m < 2; exact and implicit take any viscosity. The gyroscopic term is explicit in all
but exact. With some rotations locked the equations are those of the free axes, (I w)_free' = (tau - b_w w)_free,
w_locked = 0: no approximation but the integrator's own.
"""

from __future__ import annotations

import math
from typing import Any

from graspfx.compile.records import size_of, start_of
from graspfx.objects.state import BodyState, Motion
from graspfx.spatial import exponential_numbers as exponential
from graspfx.spatial import normalised, product
from graspfx.spatial import rotate_numbers as rotate
from graspfx.spatial import write_angle_matrix as angle_matrix
from graspfx.spatial import write_quaternion_matrix as quaternion_matrix

# Offsets in the block, of its declaration.
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
NEXT_VELOCITY = _NEXT + start_of(Motion, "velocity")
NEXT_ANGULAR_VELOCITY = _NEXT + start_of(Motion, "angular_velocity")
NEXT_ROTATION = _NEXT + start_of(Motion, "rotation")
COMPLIANCE = start_of(BodyState, "compliance")
ROTATIONAL_COMPLIANCE = start_of(BodyState, "rotational_compliance")
HELD = start_of(BodyState, "translation_decay")
HELD_TURN = start_of(BodyState, "rotation_decay")
SIZE = size_of(BodyState)

EXPLICIT, SEMI_IMPLICIT, EXACT, IMPLICIT = 0, 1, 2, 3

STRIDE = 0.1  # a fourth-order step is divided so that |w| h and b_w h/I stay below: accurate, and stable
STRIDES = 10_000  # at most, so that a run that has diverged still ends


def orient(S: Any, o: int) -> None:
    """ROTATION from the quaternion or the angle."""
    if S[o + DIMENSIONS] == 3.0:
        q = o + QUATERNION
        quaternion_matrix(S, o + ROTATION, S[q], S[q + 1], S[q + 2], S[q + 3])
    else:
        angle_matrix(S, o + ROTATION, S[o + ANGLE])


def step(S: Any, o: int, T: float) -> None:
    """Advances the body by T [s] under FORCE, MOMENT, gravity and viscosity."""
    d = int(S[o + DIMENSIONS])
    kind = int(S[o + INTEGRATOR])
    m = S[o + MASS]
    p, q, r, s = kept_coefficients(S, o + HELD, kind, S[o + VISCOSITY] / m, T)
    for a in range(d):
        if S[o + FREE + a] != 0.0:
            x, v, g, f = S[o + POSITION + a], S[o + VELOCITY + a], S[o + GRAVITY + a], S[o + FORCE + a]
            S[o + POSITION + a] = x + p * v + q * g + q / m * f
            S[o + VELOCITY + a] = r * v + s * g + s / m * f
    if d == 2 and S[o + FREE + 5] != 0.0:
        J, moment = S[o + INERTIA + 2], S[o + MOMENT + 2]
        p, q, r, s = kept_coefficients(S, o + HELD_TURN, kind, S[o + ROTATIONAL_VISCOSITY] / J, T)
        w = S[o + ANGULAR_VELOCITY + 2]
        S[o + ANGLE] = S[o + ANGLE] + p * w + q / J * moment
        S[o + ANGULAR_VELOCITY + 2] = r * w + s / J * moment
        orient(S, o)
    if d == 3 and S[o + FREE + 3] + S[o + FREE + 4] + S[o + FREE + 5] > 0.0:
        if kind == EXACT:
            turn_exactly(S, o, T)
        else:
            turn(S, o, T, kind)
        orient(S, o)


def predict(S: Any, o: int, T: float) -> None:
    """Where the body will be after T [s] if nothing pushes it, and how far a held wrench moves it from there.

    Under the implicit integrator, x+ = NEXT_POSITION + COMPLIANCE f to the last bit, and in the plane
    angle+ = NEXT + ROTATIONAL_COMPLIANCE moment; in space R+ = exp(ROTATIONAL_COMPLIANCE moment) NEXT_ROTATION up to
    terms of T |w| times that rotation.
    """
    d = int(S[o + DIMENSIONS])
    m = S[o + MASS]
    b = S[o + ROTATIONAL_VISCOSITY]
    p, q, r, s = coefficients(IMPLICIT, S[o + VISCOSITY] / m, T)
    S[o + COMPLIANCE] = q / m
    for a in range(3):
        x, v = S[o + POSITION + a], S[o + VELOCITY + a]
        if S[o + FREE + a] != 0.0:
            x, v = x + p * v + q * S[o + GRAVITY + a], r * v + s * S[o + GRAVITY + a]
        S[o + NEXT_POSITION + a] = x
        S[o + NEXT_VELOCITY + a] = v
        S[o + NEXT_ANGULAR_VELOCITY + a] = S[o + ANGULAR_VELOCITY + a]
    for k in range(9):
        S[o + NEXT_ROTATION + k] = S[o + ROTATION + k]
        S[o + ROTATIONAL_COMPLIANCE + k] = 0.0
    if d == 2 and S[o + FREE + 5] != 0.0:
        J, w = S[o + INERTIA + 2], S[o + ANGULAR_VELOCITY + 2]
        p, q, r, s = coefficients(IMPLICIT, b / J, T)
        angle_matrix(S, o + NEXT_ROTATION, S[o + ANGLE] + p * w)
        S[o + NEXT_ANGULAR_VELOCITY + 2] = r * w
        S[o + ROTATIONAL_COMPLIANCE + 8] = q / J
    if d == 3 and S[o + FREE + 3] + S[o + FREE + 4] + S[o + FREE + 5] > 0.0:
        n = o + QUATERNION
        x, y, z, w = S[n], S[n + 1], S[n + 2], S[n + 3]
        ux, uy, uz = new_spin(S, o, T, IMPLICIT, 0.0, 0.0, 0.0)
        n = o + NEXT_ANGULAR_VELOCITY
        S[n], S[n + 1], S[n + 2] = ux, uy, uz
        ex, ey, ez, ew = exponential(T * ux, T * uy, T * uz)
        nx, ny, nz, nw = product(ex, ey, ez, ew, x, y, z, w)
        nx, ny, nz, nw = normalised(nx, ny, nz, nw)
        quaternion_matrix(S, o + NEXT_ROTATION, nx, ny, nz, nw)
        for a in range(3):
            mx = 1.0 if a == 0 else 0.0
            my = 1.0 if a == 1 else 0.0
            mz = 1.0 if a == 2 else 0.0
            ux, uy, uz = spin_of(S, o, x, y, z, w, T * b, mx, my, mz)
            n = o + ROTATIONAL_COMPLIANCE + a
            S[n], S[n + 3], S[n + 6] = T * T * ux, T * T * uy, T * T * uz


def coefficients(kind: int, a: float, T: float) -> tuple[float, float, float, float]:
    """(p, q, r, s) of x+ = x + p v + q u, v+ = r v + s u for v' = u - a v with u held: all four are of this form."""
    if kind == EXPLICIT:
        return T, 0.0, 1.0 - T * a, T
    if kind == SEMI_IMPLICIT:
        r = 1.0 - T * a
        return T * r, T * T, r, T
    if kind == IMPLICIT:
        r = 1.0 / (1.0 + T * a)
        return T * r, T * T * r, r, T * r
    E, one, two, _ = held(a * T)
    return exact_coefficients(T, E, one, two)


def exact_coefficients(T: float, E: float, one: float, two: float) -> tuple[float, float, float, float]:
    """The coefficients of the exact integrator, from what `held` gives."""
    return T * one, T * T * two, E, T * one


def kept_coefficients(S: Any, k: int, kind: int, a: float, T: float) -> tuple[float, float, float, float]:
    """`coefficients`, those of the exact integrator from what is kept at k."""
    if kind != EXACT:
        return coefficients(kind, a, T)
    keep_held(S, k, a * T)
    return exact_coefficients(T, S[k + 1], S[k + 2], S[k + 3])


def keep_held(S: Any, k: int, z: float) -> None:
    """z and held(z) from k on, worked out where another z stands there, or nothing yet."""
    if S[k] != z or S[k + 1] == 0.0:
        S[k] = z
        S[k + 1], S[k + 2], S[k + 3], S[k + 4] = held(z)


def held(z: float) -> tuple[float, float, float, float]:
    """exp(-z) and its integrals (1 - E)/z, (z - 1 + E)/z^2, (z + z E - 2 + 2 E)/(2 z^3), E = exp(-z), to rounding.

    They give velocity, path and turn of the axis under a held wrench; series where differences would cancel.
    """
    if z >= 1.0:
        E = math.exp(-z)
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
    return math.exp(-z), 1.0 - z * two, two, turn


def turn(S: Any, o: int, T: float, kind: int) -> None:
    """One step of rotation in space: explicit, semi-implicit or implicit."""
    w, q, m = o + ANGULAR_VELOCITY, o + QUATERNION, o + MOMENT
    nx, ny, nz = new_spin(S, o, T, kind, S[m], S[m + 1], S[m + 2])
    ux, uy, uz = nx, ny, nz
    if kind == EXPLICIT:
        ux, uy, uz = S[w], S[w + 1], S[w + 2]
    move(S, q, T * ux, T * uy, T * uz)
    S[w], S[w + 1], S[w + 2] = nx, ny, nz


def move(S: Any, q: int, x: float, y: float, z: float) -> None:
    """q = exp(u) q for the quaternion at q, normalised."""
    ex, ey, ez, ew = exponential(x, y, z)
    qx, qy, qz, qw = product(ex, ey, ez, ew, S[q], S[q + 1], S[q + 2], S[q + 3])
    S[q], S[q + 1], S[q + 2], S[q + 3] = normalised(qx, qy, qz, qw)


def new_spin(S: Any, o: int, T: float, kind: int, mx: float, my: float, mz: float) -> tuple[float, float, float]:
    """w after T under a moment m: I w' = m - b_w w - w x I w on the free axes, first order."""
    n = o + QUATERNION
    x, y, z, w = S[n], S[n + 1], S[n + 2], S[n + 3]
    n = o + ANGULAR_VELOCITY
    wx, wy, wz = S[n], S[n + 1], S[n + 2]
    b = S[o + ROTATIONAL_VISCOSITY]
    Lx, Ly, Lz = momentum(S, o, x, y, z, w, wx, wy, wz)
    mx -= wy * Lz - wz * Ly
    my -= wz * Lx - wx * Lz
    mz -= wx * Ly - wy * Lx
    if kind == IMPLICIT:
        return spin_of(S, o, x, y, z, w, T * b, Lx + T * mx, Ly + T * my, Lz + T * mz)
    ax, ay, az = spin_of(S, o, x, y, z, w, 0.0, mx - b * wx, my - b * wy, mz - b * wz)
    return wx + T * ax, wy + T * ay, wz + T * az


def momentum(
    S: Any, o: int, x: float, y: float, z: float, w: float, wx: float, wy: float, wz: float
) -> tuple[float, float, float]:
    """I w in world axes, for the orientation (x, y, z, w)."""
    a, b, c = rotate(-x, -y, -z, w, wx, wy, wz)
    n = o + INERTIA
    return rotate(x, y, z, w, S[n] * a, S[n + 1] * b, S[n + 2] * c)


def spin_of(
    S: Any, o: int, x: float, y: float, z: float, w: float, extra: float, Lx: float, Ly: float, Lz: float
) -> tuple[float, float, float]:
    """u with (I + extra) u = L on the free axes and u = 0 on the locked ones, for the orientation (x, y, z, w)."""
    i, f = o + INERTIA, o + FREE + 3
    I1, I2, I3 = S[i] + extra, S[i + 1] + extra, S[i + 2] + extra
    if S[f] + S[f + 1] + S[f + 2] == 3.0:
        a, b, c = rotate(-x, -y, -z, w, Lx, Ly, Lz)
        return rotate(x, y, z, w, a / I1, b / I2, c / I3)
    # columns of I + extra in world axes, then elimination with unit rows for the locked axes
    a, b, c = rotate(-x, -y, -z, w, 1.0, 0.0, 0.0)
    xx, xy, xz = rotate(x, y, z, w, I1 * a, I2 * b, I3 * c)
    a, b, c = rotate(-x, -y, -z, w, 0.0, 1.0, 0.0)
    _, yy, yz = rotate(x, y, z, w, I1 * a, I2 * b, I3 * c)
    a, b, c = rotate(-x, -y, -z, w, 0.0, 0.0, 1.0)
    _, _, zz = rotate(x, y, z, w, I1 * a, I2 * b, I3 * c)
    if S[f] == 0.0:
        xx, xy, xz, Lx = 1.0, 0.0, 0.0, 0.0
    if S[f + 1] == 0.0:
        xy, yy, yz, Ly = 0.0, 1.0, 0.0, 0.0
    if S[f + 2] == 0.0:
        xz, yz, zz, Lz = 0.0, 0.0, 1.0, 0.0
    g, h = xy / xx, xz / xx
    yy, yz, zz, Ly, Lz = yy - g * xy, yz - g * xz, zz - h * xz, Ly - g * Lx, Lz - h * Lx
    k = yz / yy
    uz = (Lz - k * Ly) / (zz - k * yz)
    uy = Ly / yy - k * uz
    return Lx / xx - g * uy - h * uz, uy, uz


def turn_exactly(S: Any, o: int, T: float) -> None:
    """Rotation in space by the best this block can hold: exact velocity where one exists, fourth order in any case."""
    i, f = o + INERTIA, o + FREE + 3
    axes = S[f] + S[f + 1] + S[f + 2]
    if S[i] == S[i + 1] == S[i + 2]:
        turn_steadily(S, o, T, S[i])
    elif axes == 1.0:
        # about a fixed axis the moment of inertia does not change
        n = o + QUATERNION
        x, y, z = momentum(S, o, S[n], S[n + 1], S[n + 2], S[n + 3], S[f], S[f + 1], S[f + 2])
        turn_steadily(S, o, T, S[f] * x + S[f + 1] * y + S[f + 2] * z)
    else:
        n = o + ANGULAR_VELOCITY
        least = min(S[i], S[i + 1], S[i + 2])
        speed = math.sqrt(S[n] * S[n] + S[n + 1] * S[n + 1] + S[n + 2] * S[n + 2])
        parts = T * max(speed, S[o + ROTATIONAL_VISCOSITY] / least) / STRIDE
        count = STRIDES
        if parts < STRIDES:  # NaN compares false
            count = 1 + int(parts)
        for _ in range(count):
            turn_freely(S, o, T / count)


def turn_steadily(S: Any, o: int, T: float, J: float) -> None:
    """A constant moment of inertia J: w' = (m - b_w w)/J solved exactly, the orientation by Magnus to fourth order.

    log of the turn = integral of w + 1/2 double integral of w(s) x w(t), t < s; the second is along w x m, closed form.
    """
    f, m, w = o + FREE + 3, o + MOMENT, o + ANGULAR_VELOCITY
    k = o + HELD_TURN
    keep_held(S, k, S[o + ROTATIONAL_VISCOSITY] / J * T)
    E, one, two, twist = S[k + 1], S[k + 2], S[k + 3], S[k + 4]
    ax, ay, az = S[f] * S[m] / J, S[f + 1] * S[m + 1] / J, S[f + 2] * S[m + 2] / J
    wx, wy, wz = S[w], S[w + 1], S[w + 2]
    g = -T * T * T * twist
    move(
        S, o + QUATERNION,
        T * (one * wx + T * two * ax) + g * (wy * az - wz * ay),
        T * (one * wy + T * two * ay) + g * (wz * ax - wx * az),
        T * (one * wz + T * two * az) + g * (wx * ay - wy * ax),
    )  # fmt: skip
    S[w], S[w + 1], S[w + 2] = E * wx + T * one * ax, E * wy + T * one * ay, E * wz + T * one * az


def turn_freely(S: Any, o: int, h: float) -> None:
    """Any inertia: Euler's equations by a fourth-order Runge-Kutta-Munthe-Kaas step in body axes (Munthe-Kaas 1999)."""
    q, n = o + QUATERNION, o + ANGULAR_VELOCITY
    x, y, z, w = S[q], S[q + 1], S[q + 2], S[q + 3]
    k = 0.5 * h
    ax, ay, az = rotate(-x, -y, -z, w, S[n], S[n + 1], S[n + 2])
    fx, fy, fz = body_acceleration(S, o, x, y, z, w, ax, ay, az)
    sx, sy, sz = fx, fy, fz

    rx, ry, rz, rw = exponential(k * ax, k * ay, k * az)
    rx, ry, rz, rw = product(x, y, z, w, rx, ry, rz, rw)
    bx, by, bz = ax + k * fx, ay + k * fy, az + k * fz
    fx, fy, fz = body_acceleration(S, o, rx, ry, rz, rw, bx, by, bz)
    sx, sy, sz = sx + 2.0 * fx, sy + 2.0 * fy, sz + 2.0 * fz

    g = h * h / 8.0  # the commutator that brings the second slope into the frame of the first
    rx, ry, rz, rw = exponential(
        k * bx + g * (ay * bz - az * by), k * by + g * (az * bx - ax * bz), k * bz + g * (ax * by - ay * bx)
    )
    rx, ry, rz, rw = product(x, y, z, w, rx, ry, rz, rw)
    cx, cy, cz = ax + k * fx, ay + k * fy, az + k * fz
    fx, fy, fz = body_acceleration(S, o, rx, ry, rz, rw, cx, cy, cz)
    sx, sy, sz = sx + 2.0 * fx, sy + 2.0 * fy, sz + 2.0 * fz

    rx, ry, rz, rw = exponential(h * cx, h * cy, h * cz)
    rx, ry, rz, rw = product(x, y, z, w, rx, ry, rz, rw)
    dx, dy, dz = ax + h * fx, ay + h * fy, az + h * fz
    fx, fy, fz = body_acceleration(S, o, rx, ry, rz, rw, dx, dy, dz)

    k, g = h / 6.0, h * h / 12.0
    rx, ry, rz, rw = exponential(
        k * (ax + 2.0 * (bx + cx) + dx) + g * (ay * dz - az * dy),
        k * (ay + 2.0 * (by + cy) + dy) + g * (az * dx - ax * dz),
        k * (az + 2.0 * (bz + cz) + dz) + g * (ax * dy - ay * dx),
    )
    rx, ry, rz, rw = product(x, y, z, w, rx, ry, rz, rw)
    x, y, z, w = normalised(rx, ry, rz, rw)
    ux, uy, uz = rotate(x, y, z, w, ax + k * (sx + fx), ay + k * (sy + fy), az + k * (sz + fz))
    S[q], S[q + 1], S[q + 2], S[q + 3] = x, y, z, w
    f = o + FREE + 3
    S[n], S[n + 1], S[n + 2] = S[f] * ux, S[f + 1] * uy, S[f + 2] * uz


def body_acceleration(
    S: Any, o: int, x: float, y: float, z: float, w: float, a: float, b: float, c: float
) -> tuple[float, float, float]:
    """The angular acceleration in body axes of a body that is turned by (x, y, z, w) and spins with (a, b, c) there."""
    i, m, f = o + INERTIA, o + MOMENT, o + FREE + 3
    I1, I2, I3 = S[i], S[i + 1], S[i + 2]
    viscosity = S[o + ROTATIONAL_VISCOSITY]
    mx, my, mz = rotate(-x, -y, -z, w, S[m], S[m + 1], S[m + 2])
    mx -= viscosity * a + (I3 - I2) * b * c
    my -= viscosity * b + (I1 - I3) * c * a
    mz -= viscosity * c + (I2 - I1) * a * b
    if S[f] + S[f + 1] + S[f + 2] == 3.0:
        return mx / I1, my / I2, mz / I3
    mx, my, mz = rotate(x, y, z, w, mx, my, mz)
    mx, my, mz = spin_of(S, o, x, y, z, w, 0.0, mx, my, mz)
    return rotate(-x, -y, -z, w, mx, my, mz)
