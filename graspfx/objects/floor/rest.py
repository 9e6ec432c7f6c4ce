"""One sample of a body on fixed planes: its contact forces, and its motion under them, on flat buffers.

A contact is a spring and a damper with Coulomb friction, taken at the end of the sample:

    lambda_n = -k (g + T u_n) - b u_n,  lambda_t = -k (s + T u_t) - b u_t,  |lambda_t| <= mu lambda_n

with the gap g, the stretch s of the contact since it stuck, the velocity u = u_free + W lambda that the body will have
there, and W = T G' M^-1 G. As lambda = K (e + slip) this is K^-1 = a I + W, a = 1/(k T + b): the friction cones' form
with the six columns of M^-1/2 G, made orthogonal, for modes, and at most six unknowns however many points touch.

The forces then are held over the sample like those of the fingers: the body's own integrator moves it under all of
them together, so that what holds for it in the air (its order, momentum, exact viscosity) holds here. A body that no
plane can reach in the sample takes the same step as without planes, bit by bit.
"""

from __future__ import annotations

import math
from typing import Any

from graspfx.cones.cone import FREE as APART
from graspfx.cones.cone import modes_offset
from graspfx.cones.friction import ASSOCIATED, UNRESOLVED, friction_force, problem_size
from graspfx.objects.floor.lowest import FEATURE, MOST, lowest, thin
from graspfx.objects.integrators import (
    ANGULAR_VELOCITY,
    DIMENSIONS,
    EXACT,
    EXPLICIT,
    FORCE,
    FREE,
    GRAVITY,
    IMPLICIT,
    INERTIA,
    INTEGRATOR,
    MASS,
    NEXT_ANGULAR_VELOCITY,
    NEXT_ROTATION,
    POSITION,
    QUATERNION,
    ROTATION,
    ROTATIONAL_COMPLIANCE,
    ROTATIONAL_VISCOSITY,
    VELOCITY,
    VISCOSITY,
    coefficients,
    predict,
    spin_of,
    step,
)
from graspfx.spatial import exponential_numbers as exponential
from graspfx.spatial import rotate_numbers as rotate
from graspfx.spatial import write_orthogonal as orthogonalise

# The buffer beside the body's block.
PLANES = 0
FEATURES = 1
STIFFNESS = 2  # k of a contact point [N/m]
DAMPING = 3  # b [N s/m]
FRICTION = 4  # mu
REACH = 5  # from the centre to the farthest point [m]
TOUCHING = 6  # contacts in the last sample
OTHER_LAW = 7  # samples in which no answer of Coulomb's law was found and the associated one stands
WRENCH = 8  # force and moment of the planes on the body in the last sample [N, N m]
START = 14  # the unknowns that the next search starts from
HELD = 20  # FORCE and MOMENT of the fingers while those of the planes are added
KEPT = 26  # POSITION ... ROTATION before the sample
TABLE = KEPT + ROTATION - POSITION + 9

PLANE = 10  # entries: normal and two tangents, then the plane's distance from the origin
CONTACT = 10  # entries of a contact; offsets from its start:
WHICH = 0  # where its memory stands
ARM = 1  # from the body's centre [m]
GAP = 4  # at the end of the sample without contact [m]
SPEED = 5  # there, along the plane's normal and tangents [m/s]
FRAME = 8  # where its plane's frame stands
BEARS = 9  # its share of the stiffness

NEAR = 0.05  # of the body's reach: points so near a plane are contacts as soon as any point touches it
NO_MODE = 1e-20  # squared length of a mode that is none, relative to the longest
RESTARTS = 4  # of the search for an answer of Coulomb's law


def offsets(F: Any) -> tuple[int, int, int, int]:
    """Where planes, features, memories and contacts start."""
    planes, features = int(F[PLANES]), int(F[FEATURES])
    first = TABLE + planes * PLANE
    memory = first + features * FEATURE
    return TABLE, first, memory, memory + 2 * planes * features


def size(planes: int, features: int) -> int:
    """Entries of the buffer."""
    most = planes * MOST + features
    rows = most * CONTACT + 6 * (1 + 3 * most) + problem_size(most, 3, 6, False)
    return TABLE + planes * PLANE + features * FEATURE + 2 * planes * features + rows


def lookahead(kind: int, T: float) -> float:
    """How far beyond the end of the sample the gap is taken, so that all integrators meet it as x + T v+."""
    if kind == EXPLICIT:
        return T
    return 0.5 * T if kind == EXACT else 0.0


def step_on_planes(S: Any, o: int, F: Any, T: float) -> int:
    """Advances the body by T [s]; returns how many contacts there are, -1 if their forces did not settle."""
    for k in range(ROTATION - POSITION):
        F[KEPT + k] = S[o + POSITION + k]
    for k in range(9):
        F[KEPT + ROTATION - POSITION + k] = S[o + ROTATION + k]
    step(S, o, T)
    count = meet(S, o, F, T)
    if count == 0:
        if F[TOUCHING] > 0.0:
            part(F)
        return 0
    if not solve(S, o, F, T, count):
        return -1
    for k in range(ROTATION - POSITION):
        S[o + POSITION + k] = F[KEPT + k]
    for k in range(9):
        S[o + ROTATION + k] = F[KEPT + ROTATION - POSITION + k]
    for k in range(6):
        F[HELD + k] = S[o + FORCE + k]
        S[o + FORCE + k] += F[WRENCH + k]
    step(S, o, T)
    for k in range(6):
        S[o + FORCE + k] = F[HELD + k]
    remember(S, o, F, T, count)
    return count


def part(F: Any) -> None:
    """No contact: no force and no memory."""
    _, _, memory, rows = offsets(F)
    for k in range(memory, rows):
        F[k] = 0.0
    for k in range(6):
        F[WRENCH + k] = 0.0
        F[START + k] = 0.0
    F[TOUCHING] = 0.0


def speed_at(S: Any, o: int, F: Any, r: int, direction: int) -> float:
    """The velocity of the body at the arm at r, along a direction in the buffer."""
    v, w = o + VELOCITY, o + ANGULAR_VELOCITY
    x, y, z = F[r], F[r + 1], F[r + 2]
    return float(
        F[direction] * (S[v] + S[w + 1] * z - S[w + 2] * y)
        + F[direction + 1] * (S[v + 1] + S[w + 2] * x - S[w] * z)
        + F[direction + 2] * (S[v + 2] + S[w] * y - S[w + 1] * x)
    )


def meet(S: Any, o: int, F: Any, T: float) -> int:
    """Lists the contacts of a body that has moved freely; none if every point ends above every plane."""
    first, features, _, rows = offsets(F)
    x, v, w = o + POSITION, o + VELOCITY, o + ANGULAR_VELOCITY
    ahead = lookahead(int(S[o + INTEGRATOR]), T)
    spin = math.sqrt(S[w] * S[w] + S[w + 1] * S[w + 1] + S[w + 2] * S[w + 2])
    near = NEAR * F[REACH]
    count = 0
    touched = False
    for p in range(int(F[PLANES])):
        n = first + p * PLANE
        nx, ny, nz = F[n], F[n + 1], F[n + 2]
        height = nx * S[x] + ny * S[x + 1] + nz * S[x + 2] - F[n + 9]
        sink = nx * S[v] + ny * S[v + 1] + nz * S[v + 2]
        if height + ahead * (sink - spin * F[REACH]) > F[REACH] + near:
            continue
        found = 0
        for f in range(int(F[FEATURES])):
            bears, ax, ay, az = lowest(S, o, F, features + f * FEATURE, nx, ny, nz)
            if bears <= 0.0:
                continue
            r = rows + (count + found) * CONTACT
            F[r + ARM], F[r + ARM + 1], F[r + ARM + 2] = ax, ay, az
            F[r + SPEED] = speed_at(S, o, F, r + ARM, n)
            gap = height + nx * ax + ny * ay + nz * az + ahead * F[r + SPEED]
            if gap < near:
                F[r + WHICH] = float(p * int(F[FEATURES]) + f)
                F[r + GAP] = gap
                F[r + FRAME] = float(n)
                F[r + BEARS] = bears
                touched = touched or gap < 0.0
                found += 1
        count += thin(F, rows + count * CONTACT, CONTACT, found, ARM, GAP, n)
    if not touched:
        return 0
    for i in range(count):
        r = rows + i * CONTACT
        for a in range(1, int(S[o + DIMENSIONS])):
            F[r + SPEED + a] = speed_at(S, o, F, r + ARM, int(F[r + FRAME]) + 3 * a)
    return count


def solve(S: Any, o: int, F: Any, T: float, n: int) -> bool:
    """The contact forces at the points that `meet` has listed, as WRENCH; False if they did not settle."""
    _, _, memory, rows = offsets(F)
    d = int(S[o + DIMENSIONS])
    k, b = F[STIFFNESS], F[DAMPING]
    gain = k * T + b
    modes = rows + n * CONTACT
    count, stiffest = contact_modes(S, o, F, T, n, d, rows, modes)
    problem = modes + 6 * (1 + n * d)
    least = 1.0 / (1.0 / gain + stiffest)
    m = n * d
    for i in range(n):
        r = rows + i * CONTACT
        F[problem + i], F[problem + n + i], F[problem + 2 * n + i] = F[r + BEARS], F[FRICTION], float(APART)
        e = problem + 3 * n + i * d
        gap = F[r + GAP]
        F[e] = -(k * gap + b * F[r + SPEED]) / gain if gap < 0.0 else -gap / T
        s = memory + 2 * int(F[r + WHICH])
        for a in range(1, d):
            F[e + a] = -k * F[s + a - 1] / gain - F[r + SPEED + a]
        for a in range(d):
            F[e + m + a] = 0.0
    start = problem + 3 * n + 5 * m
    to = modes_offset(problem, n, d, count)
    for j in range(count):
        F[start + j] = F[START + j]
        q = modes + j * (1 + m)
        kappa = 1.0 / (1.0 / gain + F[q])
        F[to + j * (1 + m)] = (gain - kappa) / (gain - least) if gain > least else 1.0
        for c in range(1, 1 + m):
            F[to + j * (1 + m) + c] = F[q + c]
    law, _, _ = friction_force(F, problem, n, d, count, least, gain, True, RESTARTS)
    if law == UNRESOLVED:
        return False
    if law == ASSOCIATED:
        F[OTHER_LAW] += 1.0
    for j in range(6):
        F[START + j] = F[start + j] if j < count else 0.0
    for j in range(6):
        F[WRENCH + j] = 0.0
    for i in range(n):
        r = rows + i * CONTACT
        f = problem + 3 * n + 2 * m + i * d
        x = y = z = 0.0
        for a in range(d):
            t = int(F[r + FRAME]) + 3 * a
            x, y, z = x + F[f + a] * F[t], y + F[f + a] * F[t + 1], z + F[f + a] * F[t + 2]
        ax, ay, az = F[r + ARM], F[r + ARM + 1], F[r + ARM + 2]
        F[WRENCH] += x
        F[WRENCH + 1] += y
        F[WRENCH + 2] += z
        F[WRENCH + 3] += ay * z - az * y
        F[WRENCH + 4] += az * x - ax * z
        F[WRENCH + 5] += ax * y - ay * x
        # the row now keeps what the memory needs when the body has moved: whether the contact bears, and its slip
        F[r + GAP] = 1.0 if F[f] > 0.0 else 0.0
        for a in range(1, d):
            F[r + SPEED + a] = F[f + m + a]
    return True


def contact_modes(
    S: Any, o: int, F: Any, T: float, n: int, d: int, rows: int, modes: int
) -> tuple[int, float]:  # fmt: skip
    """Orthogonal vectors whose squares sum to W, normalised after their squared length; how many, and the longest.

    W = T G' M^-1 G: velocity of the contacts per force held over the sample.
    """
    lead = 1 + n * d
    kind = int(S[o + INTEGRATOR])
    share = math.sqrt(coefficients(kind, S[o + VISCOSITY] / S[o + MASS], T)[3] / S[o + MASS])
    xx, yx, yy, zx, zy, zz = turning_roots(S, o, T, d, kind)
    for i in range(n):
        r = rows + i * CONTACT
        ax, ay, az = F[r + ARM], F[r + ARM + 1], F[r + ARM + 2]
        root = math.sqrt(F[r + BEARS])
        for a in range(d):
            t = int(F[r + FRAME]) + 3 * a
            c = modes + 1 + i * d + a
            x, y, z = root * F[t], root * F[t + 1], root * F[t + 2]
            F[c] = share * x * S[o + FREE]
            F[c + lead] = share * y * S[o + FREE + 1]
            F[c + 2 * lead] = share * z * S[o + FREE + 2]
            mx, my, mz = ay * z - az * y, az * x - ax * z, ax * y - ay * x
            F[c + 3 * lead] = xx * mx + yx * my + zx * mz
            F[c + 4 * lead] = yy * my + zy * mz
            F[c + 5 * lead] = zz * mz
    orthogonalise(F, modes, 6, lead)
    longest = 0.0
    for j in range(6):
        q = modes + j * lead
        F[q] = 0.0
        for c in range(1, lead):
            F[q] += F[q + c] * F[q + c]
        longest = max(longest, F[q])
    count = 0
    for j in range(6):
        q = modes + j * lead
        if F[q] > NO_MODE * longest:
            to = modes + count * lead
            square = F[q]
            root = 1.0 / math.sqrt(square)
            for c in range(1, lead):
                F[to + c] = root * F[q + c]
            F[to] = square
            count += 1
    return count, longest


def turning_roots(S: Any, o: int, T: float, d: int, kind: int) -> tuple[float, float, float, float, float, float]:
    """L, lower triangle row by row, with L L' the angular velocity per moment held over T; zero where locked."""
    b = S[o + ROTATIONAL_VISCOSITY]
    f = o + FREE + 3
    if d < 3:
        J = S[o + INERTIA + 2]
        if d == 1 or S[f + 2] == 0.0:
            return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        return 0.0, 0.0, 0.0, 0.0, 0.0, math.sqrt(coefficients(kind, b / J, T)[3] / J)
    if S[f] + S[f + 1] + S[f + 2] == 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    extra = 0.0
    if kind == IMPLICIT:
        extra = T * b
    if kind == EXACT:
        extra = 0.5 * T * b  # (1 - exp(-z))/z = 1/(1 + z/2) to second order
    n = o + QUATERNION
    x, y, z, w = S[n], S[n + 1], S[n + 2], S[n + 3]
    cxx, cyx, czx = spin_of(S, o, x, y, z, w, extra, T, 0.0, 0.0)
    _, cyy, czy = spin_of(S, o, x, y, z, w, extra, 0.0, T, 0.0)
    _, _, czz = spin_of(S, o, x, y, z, w, extra, 0.0, 0.0, T)
    xx = yx = yy = zx = zy = zz = 0.0
    if S[f] != 0.0:
        xx = math.sqrt(cxx)
        yx, zx = cyx / xx, czx / xx
    if S[f + 1] != 0.0:
        yy = math.sqrt(cyy - yx * yx)
        zy = (czy - zx * yx) / yy
    if S[f + 2] != 0.0:
        zz = math.sqrt(czz - zx * zx - zy * zy)
    return xx, yx, yy, zx, zy, zz


def remember(S: Any, o: int, F: Any, T: float, n: int) -> None:
    """The stretch of every contact that bears, s + T (u - slip) with the velocity as it became; others forget."""
    _, _, memory, rows = offsets(F)
    scratch = rows + n * CONTACT
    for i in range(n):
        r = rows + i * CONTACT
        s = memory + 2 * int(F[r + WHICH])
        for a in range(2):
            F[scratch + 2 * i + a] = 0.0
        if F[r + GAP] != 0.0:
            for a in range(1, int(S[o + DIMENSIONS])):
                u = speed_at(S, o, F, r + ARM, int(F[r + FRAME]) + 3 * a)
                F[scratch + 2 * i + a - 1] = F[s + a - 1] + T * (u - F[r + SPEED + a])
    for k in range(memory, rows):
        F[k] = 0.0
    touching = 0.0
    for i in range(n):
        r = rows + i * CONTACT
        touching += F[r + GAP]
        s = memory + 2 * int(F[r + WHICH])
        for a in range(2):
            F[s + a] = F[scratch + 2 * i + a]
    F[TOUCHING] = touching


def predict_on_planes(S: Any, o: int, F: Any, T: float) -> None:
    """The implicit integrator's motion with no wrench but the last sample's contact forces, as `kernels.predict`.

    A body at rest on a floor is predicted to rest, and not to fall from it until its contacts are known.
    """
    m = S[o + MASS]
    for a in range(3):
        F[HELD + a] = S[o + GRAVITY + a]
        S[o + GRAVITY + a] += F[WRENCH + a] / m
    predict(S, o, T)
    for a in range(3):
        S[o + GRAVITY + a] = F[HELD + a]
    x, y, z = F[WRENCH + 3], F[WRENCH + 4], F[WRENCH + 5]
    c = o + ROTATIONAL_COMPLIANCE
    tx = S[c] * x + S[c + 1] * y + S[c + 2] * z
    ty = S[c + 3] * x + S[c + 4] * y + S[c + 5] * z
    tz = S[c + 6] * x + S[c + 7] * y + S[c + 8] * z
    if tx == 0.0 and ty == 0.0 and tz == 0.0:
        return
    ux, uy, uz, uw = exponential(tx, ty, tz)
    for j in range(3):
        R = o + NEXT_ROTATION + j
        S[R], S[R + 3], S[R + 6] = rotate(ux, uy, uz, uw, S[R], S[R + 3], S[R + 6])
    w = o + NEXT_ANGULAR_VELOCITY
    S[w], S[w + 1], S[w + 2] = S[w] + tx / T, S[w + 1] + ty / T, S[w + 2] + tz / T
