"""The energy of a rigid body over one sample: what was done on it, what viscosity took, what its integrator made up.

With the held force F, gravity g, the planes' force C and the motion dx of the sample

    1/2 m v+^2 - 1/2 m v^2 = (F + C + m g)'dx - loss + defect

| integrator | loss | defect |
|---|---|---|
| explicit | T b v^2 | +1/2 m (v+ - v)^2 |
| semi-implicit | T b v v+ | -1/2 m (v+ - v)^2 |
| implicit | T b v+^2 | -1/2 m (v+ - v)^2 |
| exact | integral of b v^2 | 0 |

Rotations likewise with moments and the rotation vector. In space what the turn of the inertia adds is a defect, too:
1/2 w+'(I+ - I) w+, and -T w+'(w x I w) where the body is moved by w+.
"""

from __future__ import annotations

import math
from typing import Any

from graspfx.objects.integrators import (
    ANGLE,
    ANGULAR_VELOCITY,
    DIMENSIONS,
    EXACT,
    EXPLICIT,
    FORCE,
    FREE,
    GRAVITY,
    INERTIA,
    INTEGRATOR,
    MASS,
    MOMENT,
    POSITION,
    QUATERNION,
    ROTATIONAL_VISCOSITY,
    VELOCITY,
    VISCOSITY,
    held,
    momentum,
)

# What is kept of the sample's start, then what `settle` finds. Offsets from the start of that piece.
BEFORE = 0  # POSITION up to MOMENT, as in the block
CONTACT = MOMENT + 3 - POSITION  # force and moment of obstacles over the sample [N, N m]
SHIFT = CONTACT + 6  # dx [m]
TURN = SHIFT + 3  # rotation vector of the free rotations, world axes [rad]
ENERGY = TURN + 3  # kinetic energy at the sample's start [J]
SIZE = ENERGY + 1

SERIES = 0.5  # of b T/m: below, differences of exponentials would cancel


def keep(S: Any, o: int, K: Any, k: int) -> None:
    """Keeps state, wrench and kinetic energy of the body at o for the sample that begins."""
    for a in range(CONTACT):
        K[k + a] = S[o + POSITION + a]
    K[k + ENERGY] = kinetic(S, o)


def kinetic(S: Any, o: int) -> float:
    """1/2 m v^2 + 1/2 w'I w [J]."""
    v, w, d = o + VELOCITY, o + ANGULAR_VELOCITY, S[o + DIMENSIONS]
    total = 0.5 * S[o + MASS] * (S[v] * S[v] + S[v + 1] * S[v + 1] + S[v + 2] * S[v + 2])
    if d == 2.0:
        total += 0.5 * S[o + INERTIA + 2] * S[w + 2] * S[w + 2]
    if d == 3.0:
        q = o + QUATERNION
        x, y, z = momentum(S, o, S[q], S[q + 1], S[q + 2], S[q + 3], S[w], S[w + 1], S[w + 2])
        total += 0.5 * (S[w] * x + S[w + 1] * y + S[w + 2] * z)
    return float(total)


def settle(S: Any, o: int, K: Any, k: int, T: float) -> tuple[float, float, float, float, float, float, float]:
    """The sample that has just ended, from the state kept at k to the one at o [J]; SHIFT and TURN are written.

    Returns:
        Work of the wrench, of gravity and of CONTACT; viscous loss of translation and of rotation; the integrator's
        defect of translation and of rotation.
    """
    kind = int(S[o + INTEGRATOR])
    m, b = S[o + MASS], S[o + VISCOSITY]
    work = fallen = met = loss = turning_loss = defect = turning_defect = 0.0
    for a in range(3):
        K[k + SHIFT + a] = 0.0
        K[k + TURN + a] = 0.0
        if S[o + FREE + a] != 0.0:
            dx = S[o + POSITION + a] - K[k + a]
            K[k + SHIFT + a] = dx
            F, C, g = K[k + FORCE - POSITION + a], K[k + CONTACT + a], S[o + GRAVITY + a]
            work += F * dx
            met += C * dx
            fallen += m * g * dx
            before, after = K[k + VELOCITY - POSITION + a], S[o + VELOCITY + a]
            loss += viscous(kind, m, b, T, before, after, (F + C) / m + g)
            defect += made_up(kind, m, before, after)
    d = S[o + DIMENSIONS]
    w, moment = k + ANGULAR_VELOCITY - POSITION, k + MOMENT - POSITION
    if d == 2.0 and S[o + FREE + 5] != 0.0:
        J, turn = S[o + INERTIA + 2], S[o + ANGLE] - K[k + ANGLE - POSITION]
        K[k + TURN + 2] = turn
        M, C = K[moment + 2], K[k + CONTACT + 5]
        work += M * turn
        met += C * turn
        after = S[o + ANGULAR_VELOCITY + 2]
        turning_loss = viscous(kind, J, S[o + ROTATIONAL_VISCOSITY], T, K[w + 2], after, (M + C) / J)
        turning_defect = made_up(kind, J, K[w + 2], after)
    if d == 3.0 and S[o + FREE + 3] + S[o + FREE + 4] + S[o + FREE + 5] > 0.0:
        turned(S, o, K, k)
        done = 0.0
        for a in range(3):
            work += K[moment + a] * K[k + TURN + a]
            met += K[k + CONTACT + 3 + a] * K[k + TURN + a]
            done += (K[moment + a] + K[k + CONTACT + 3 + a]) * K[k + TURN + a]
        turning_loss, turning_defect = spun(S, o, K, k, T, done)
    return work, fallen, met, loss, turning_loss, defect, turning_defect


def viscous(kind: int, m: float, b: float, T: float, v: float, after: float, u: float) -> float:
    """What viscosity takes over a sample [J]; u = force/m."""
    if kind != EXACT:
        if kind == EXPLICIT:
            return T * b * v * v
        return T * b * after * (v if kind < EXACT else after)
    z = b * T / m
    rise = T * (u - b / m * v)  # v(t) = v + rise (1 - exp(-z t/T))/z
    return T * b * (v * v + 2.0 * v * rise * held(z)[2] + rise * rise * squared(z))


def squared(z: float) -> float:
    """Integral of ((1 - exp(-z s))/z)^2 over s from 0 to 1: (z - 2 (1 - E) + (1 - E^2)/2)/z^3, 1/3 at zero."""
    if z > SERIES:
        E = math.exp(-z)
        return (z - 2.0 * (1.0 - E) + 0.5 * (1.0 - E * E)) / (z * z * z)
    total, power, twos, k = 0.0, 0.5, 4.0, 2  # power = (-z)^(k - 2)/k!
    while abs(power) * twos > 1e-18:
        total += (twos - 2.0) * power / (k + 1)
        k += 1
        power *= -z / k
        twos *= 2.0
    return total


def made_up(kind: int, m: float, before: float, after: float) -> float:
    """m (v+ - v) times the mean velocity less that which moved the body [J]."""
    if kind == EXACT:
        return 0.0
    return (0.5 if kind == EXPLICIT else -0.5) * m * (after - before) * (after - before)


def turned(S: Any, o: int, K: Any, k: int) -> None:
    """TURN, the rotation vector from the orientation kept to the present one; zero about locked axes."""
    p, q = o + QUATERNION, k + QUATERNION - POSITION
    x, y, z, w = S[p], S[p + 1], S[p + 2], S[p + 3]
    i, j, n, r = -K[q], -K[q + 1], -K[q + 2], K[q + 3]
    a = w * i + x * r + y * n - z * j
    b = w * j + y * r + z * i - x * n
    c = w * n + z * r + x * j - y * i
    s = w * r - x * i - y * j - z * n
    sine = math.sqrt(a * a + b * b + c * c)
    scale = 2.0
    if s < 0.0:
        s, scale = -s, -2.0
    if sine > 0.0:
        scale *= math.atan2(sine, s) / sine
    f = o + FREE + 3
    K[k + TURN], K[k + TURN + 1], K[k + TURN + 2] = S[f] * scale * a, S[f + 1] * scale * b, S[f + 2] * scale * c


def spun(S: Any, o: int, K: Any, k: int, T: float, done: float) -> tuple[float, float]:
    """Viscous loss and defect of rotation in space [J]; `done` is the work of all moments.

    Exact about one axis, and of a body with equal moments. Where exact is of fourth order, the loss is that of the mean
    square velocity and the defect what energy the step has beyond the work.
    """
    kind = int(S[o + INTEGRATOR])
    b, i, f = S[o + ROTATIONAL_VISCOSITY], o + INERTIA, o + FREE + 3
    w, q = k + ANGULAR_VELOCITY - POSITION, k + QUATERNION - POSITION
    vx, vy, vz = K[w], K[w + 1], K[w + 2]
    u = o + ANGULAR_VELOCITY
    ux, uy, uz = S[u], S[u + 1], S[u + 2]
    Lx, Ly, Lz = momentum(S, o, K[q], K[q + 1], K[q + 2], K[q + 3], vx, vy, vz)
    if kind == EXACT:
        J = S[i]
        axes = S[f] + S[f + 1] + S[f + 2]
        if axes == 1.0:
            x, y, z = momentum(S, o, K[q], K[q + 1], K[q + 2], K[q + 3], S[f], S[f + 1], S[f + 2])
            J = S[f] * x + S[f + 1] * y + S[f + 2] * z
        if axes == 1.0 or S[i] == S[i + 1] == S[i + 2]:
            loss = 0.0
            for a in range(3):
                if S[f + a] != 0.0:
                    M = K[k + MOMENT - POSITION + a] + K[k + CONTACT + 3 + a]
                    loss += viscous(kind, J, b, T, K[w + a], S[u + a], M / J)
            return loss, 0.0
        loss = T * b * (vx * vx + vx * ux + ux * ux + vy * vy + vy * uy + uy * uy + vz * vz + vz * uz + uz * uz) / 3.0
        p = o + QUATERNION
        x, y, z = momentum(S, o, S[p], S[p + 1], S[p + 2], S[p + 3], ux, uy, uz)
        return loss, 0.5 * (ux * x + uy * y + uz * z - vx * Lx - vy * Ly - vz * Lz) - done + loss
    dx, dy, dz = ux - vx, uy - vy, uz - vz
    x, y, z = momentum(S, o, K[q], K[q + 1], K[q + 2], K[q + 3], dx, dy, dz)
    defect = 0.5 * (dx * x + dy * y + dz * z)
    if kind == EXPLICIT:
        loss = T * b * (vx * vx + vy * vy + vz * vz)
    else:
        defect = -defect - T * (ux * (vy * Lz - vz * Ly) + uy * (vz * Lx - vx * Lz) + uz * (vx * Ly - vy * Lx))
        if kind < EXACT:
            loss = T * b * (vx * ux + vy * uy + vz * uz)
        else:
            loss = T * b * (ux * ux + uy * uy + uz * uz)
    x, y, z = momentum(S, o, K[q], K[q + 1], K[q + 2], K[q + 3], ux, uy, uz)
    p = o + QUATERNION
    X, Y, Z = momentum(S, o, S[p], S[p + 1], S[p + 2], S[p + 3], ux, uy, uz)
    return loss, defect + 0.5 * (ux * (X - x) + uy * (Y - y) + uz * (Z - z))
