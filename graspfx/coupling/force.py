"""From displacement to force: eq. (4), and its projection on what a finger can push (eqs. 24-26)."""

from __future__ import annotations

import math
from typing import Any

from graspfx.coupling import block as at
from graspfx.grasp.kernels import complement, gain_matrix, pivot, release, settle
from graspfx.objects import kernels as body


def combine(S: Any, kep: float, ked: float, kip: float, kid: float) -> None:
    """f = P (kep e + ked e') + (I - P) (kip e + kid e') (eq. 4), as kip e + kid e' and one projection of one vector."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        w = S[r + at.WEIGHT]
        for a in range(d):
            f = kip * S[r + at.DISPLACEMENT + a]
            if kid != 0.0:
                f += kid * S[r + at.RATE + a]
            S[r + at.LOCAL + a] = w * f
    if S[at.EQUAL] != 0.0:
        return
    size = 1 + 3 * n
    ke, kd = kep - kip, ked - kid
    for k in range(int(S[at.COUNT])):
        q = at.modes(n) + k * size + 1
        z = 0.0
        for i in range(n):
            r = at.ROW + i * at.STRIDE
            inner = 0.0
            for a in range(d):
                g = ke * S[r + at.DISPLACEMENT + a]
                if kd != 0.0:
                    g += kd * S[r + at.RATE + a]
                inner += S[q + 3 * i + a] * g
            z += math.sqrt(S[r + at.WEIGHT]) * inner
        z *= S[q - 1]
        for i in range(n):
            r = at.ROW + i * at.STRIDE
            share = z * math.sqrt(S[r + at.WEIGHT])
            for a in range(d):
                S[r + at.LOCAL + a] += share * S[q + 3 * i + a]


def combine_matrices(S: Any, elastic: bool, damping: bool) -> None:
    """f = K e + D e' with the squares that stand in the block."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    m = n * d
    K = at.dense(n, d)
    for i in range(n):
        for a in range(d):
            p = i * d + a
            f = 0.0
            for j in range(n):
                r = at.ROW + j * at.STRIDE
                for b in range(d):
                    q = p * m + j * d + b
                    if elastic:
                        f += S[K + q] * S[r + at.DISPLACEMENT + b]
                    if damping:
                        f += S[K + m * m + q] * S[r + at.RATE + b]
            S[at.ROW + i * at.STRIDE + at.LOCAL + a] = f


def bilateral(S: Any, elastic: bool, damping: bool) -> None:
    """The law without cones into LOCAL: its elastic part, its damping part or both."""
    if S[at.DENSE] != 0.0:
        combine_matrices(S, elastic, damping)
        return
    e = 1.0 if elastic else 0.0
    r = 1.0 if damping else 0.0
    combine(
        S,
        e * S[at.EXTERNAL_STIFFNESS],
        r * S[at.EXTERNAL_DAMPING],
        e * S[at.INTERNAL_STIFFNESS],
        r * S[at.INTERNAL_DAMPING],
    )


def add_gains(S: Any, size: int, external: float, internal: float, elastic: float, damping: float) -> None:
    """Adds a gain matrix in contact frames to the square: scalar gains, or elastic K + damping D of the block."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    out = at.square(n)
    if S[at.DENSE] == 0.0:
        count = 0 if S[at.EQUAL] != 0.0 else int(S[at.COUNT])
        gain_matrix(
            S, at.ROW, at.STRIDE, at.WEIGHT, at.FRAME, n, d,
            at.modes(n), count, external, internal, out, size, at.scratch(n, d),
        )  # fmt: skip
        return
    m = n * d
    K = at.dense(n, d)
    for i in range(n):
        for j in range(n):
            for a in range(d):
                f = at.ROW + i * at.STRIDE + at.FRAME + 3 * a
                for b in range(d):
                    g = at.ROW + j * at.STRIDE + at.FRAME + 3 * b
                    total = 0.0
                    for p in range(d):
                        for q in range(d):
                            k = (i * d + p) * m + j * d + q
                            value = elastic * S[K + k] + damping * S[K + m * m + k]
                            total += S[f + p] * value * S[g + q]
                    S[out + (i * d + a) * size + j * d + b] += total


def assemble(S: Any, elastic: bool, damping: bool) -> int:
    """The square and the vector of the law (elastic, damping or both) in contact frames; returns how many rows.

    Under the implicit integrator the object's displacement u over the sample is unknown too: f = K (e - G'u) +
    D (e' - G'u / T) and G f = u / compliance; u is eliminated here, so that what remains has the object's give in it.
    """
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    implicit = S[at.IMPLICIT] != 0.0
    m = n * d
    shifts, turns = int(S[at.SHIFTS]), int(S[at.TURNS])
    size = m + (shifts + turns if implicit else 0)
    A, q = at.square(n), at.vector(n, d)
    for p in range(size * size):
        S[A + p] = 0.0
    bilateral(S, elastic, damping)
    into_frames(S, at.LOCAL, q)
    if elastic:
        add_gains(S, size, S[at.EXTERNAL_STIFFNESS], S[at.INTERNAL_STIFFNESS], 1.0, 0.0)
    if damping:
        per = 1.0 / S[at.PERIOD] if implicit else 1.0
        add_gains(S, size, per * S[at.EXTERNAL_DAMPING], per * S[at.INTERNAL_DAMPING], 0.0, per)
    if implicit:
        add_object(S, size, m, shifts, turns)
        for p in range(m, size):
            pivot(S, A, size, q, size, p)
    for p in range(m):
        S[at.diagonal(n, d) + p] = S[A + p * size + p]
    return size


def add_object(S: Any, size: int, m: int, shifts: int, turns: int) -> None:
    """The rows and columns of the object's displacement: -B G', G B and -(G B G' + 1/compliance)."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    T = S[at.PERIOD]
    A, q = at.square(n), at.vector(n, d)
    for u in range(shifts + turns):
        for p in range(m):
            along = 0.0
            across = 0.0
            for k in range(m):
                g = lever(S, u, shifts, k, d)
                along += S[A + p * size + k] * g
                across += g * S[A + k * size + p]
            S[A + p * size + m + u] = -along
            S[A + (m + u) * size + p] = across
    for u in range(shifts + turns):
        force = 0.0
        for k in range(m):
            force += lever(S, u, shifts, k, d) * S[q + k]
        S[q + m + u] = force
        for v in range(shifts + turns):
            total = 0.0
            for k in range(m):
                total += S[A + (m + u) * size + k] * lever(S, v, shifts, k, d)
            if u == v and u < shifts:
                total += (S[at.BODY + body.MASS] + T * S[at.BODY + body.VISCOSITY]) / (T * T)
            if u >= shifts and v >= shifts:
                for a in range(3):
                    inertia = S[at.BODY + body.INERTIA + a] + T * S[at.BODY + body.ROTATIONAL_VISCOSITY]
                    total += S[at.AXES + 3 * u + a] * S[at.AXES + 3 * v + a] * inertia / (T * T)
            S[A + (m + u) * size + m + v] = -total


def lever(S: Any, u: int, shifts: int, k: int, d: int) -> float:
    """One entry of G in contact frames: what force coordinate k does along the object's free direction u."""
    r = at.ROW + (k // d) * at.STRIDE
    f = r + at.FRAME + 3 * (k % d)
    o = at.AXES + 3 * u
    if u < shifts:
        return float(S[o] * S[f] + S[o + 1] * S[f + 1] + S[o + 2] * S[f + 2])
    c = r + at.CONTACT
    mx = S[c + 1] * S[f + 2] - S[c + 2] * S[f + 1]
    my = S[c + 2] * S[f] - S[c] * S[f + 2]
    mz = S[c] * S[f + 1] - S[c + 1] * S[f]
    return float(S[o] * mx + S[o + 1] * my + S[o + 2] * mz)


def into_frames(S: Any, what: int, q: int) -> None:
    """A vector of every finger's row as contact coordinates (normal, tangents) at q."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        for a in range(d):
            total = 0.0
            for b in range(d):
                total += S[r + at.FRAME + 3 * a + b] * S[r + what + b]
            S[q + i * d + a] = total


def out_of_frames(S: Any, q: int) -> None:
    """Contact coordinates at q as LOCAL forces."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        for b in range(d):
            total = 0.0
            for a in range(d):
                total += S[r + at.FRAME + 3 * a + b] * S[q + i * d + a]
            S[r + at.LOCAL + b] = total


def largest(S: Any, q: int, m: int) -> float:
    scale = 0.0
    for p in range(m):
        scale = max(scale, abs(S[q + p]))
    return scale


def attached(S: Any) -> int:
    """Bilateral contact: eq. (4) as it stands, for the object's new state under the implicit integrator."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    damped = S[at.DAMPED] != 0.0
    if S[at.IMPLICIT] != 0.0:
        assemble(S, True, damped)
        out_of_frames(S, at.vector(n, d))
    else:
        bilateral(S, True, damped)
    return 0


def unilateral(S: Any) -> int:
    """The elastic force projected on the cones, then damping projected there; returns 2 if either was not resolved.

    Elastic: f in C, s in C*, f's = 0, f = K (e + s) (eqs. 24-26 for n fingers). Damping: f = f0 + D (e' + s) in C, with
    f_i = 0 where f0_i = 0.
    """
    if S[at.EQUAL] != 0.0 and S[at.IMPLICIT] == 0.0:
        separate(S)
        return 0
    fault = project(S)
    for i in range(int(S[at.FINGERS])):
        S[at.ROW + i * at.STRIDE + at.TOUCHING] = 1.0 if push(S, i, int(S[at.DIMENSIONS])) > 0.0 else 0.0
    if S[at.DAMPED] != 0.0:
        fault = max(fault, damp(S))
    return fault


def push(S: Any, i: int, d: int) -> float:
    """The normal force of finger i on the object [N]."""
    r = at.ROW + i * at.STRIDE
    total = 0.0
    for a in range(d):
        total += S[r + at.NORMAL + a] * S[r + at.LOCAL + a]
    return total


def separate(S: Any) -> None:
    """Equal gains (the conventional method, eqs. 1 and 7-8): every finger by itself, no projector and no square."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    k, b = S[at.INTERNAL_STIFFNESS], S[at.INTERNAL_DAMPING]
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        w = S[r + at.WEIGHT]
        depth = speed = 0.0
        for a in range(d):
            depth += S[r + at.NORMAL + a] * S[r + at.DISPLACEMENT + a]
            speed += S[r + at.NORMAL + a] * S[r + at.RATE + a]
        S[r + at.TOUCHING] = 1.0 if k * depth > 0.0 else 0.0
        normal = max(w * (k * depth + b * speed), 0.0) if depth > 0.0 else 0.0
        for a in range(d):
            f = normal * S[r + at.NORMAL + a]
            if S[at.STICK] != 0.0 and depth > 0.0:
                e = S[r + at.DISPLACEMENT + a] - depth * S[r + at.NORMAL + a]
                u = S[r + at.RATE + a] - speed * S[r + at.NORMAL + a]
                f += w * (k * e + b * u)
            S[r + at.LOCAL + a] = f


def project(S: Any) -> int:
    """The elastic force in the cones: released tangents without friction, whole fingers where the contact sticks."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    stick = S[at.STICK] != 0.0
    if S[at.IMPLICIT] == 0.0 and (stick or d == 1):
        bilateral(S, True, False)
        lowest = 0.0
        for i in range(n):
            lowest = min(lowest, push(S, i, d))
        if lowest >= 0.0:
            return 0
    A, q, e = at.square(n), at.vector(n, d), at.known(n, d)
    state, marks, diagonal = at.engaged(n, d), at.marks(n, d), at.diagonal(n, d)
    into_frames(S, at.DISPLACEMENT, e)
    unresolved = 1
    for attempt in range(2):
        size = assemble(S, True, False)
        scale = largest(S, q, n * d)
        for p in range(n * d):
            S[marks + p] = 1.0 if p % d and not stick else 0.0
        for i in range(n):
            S[state + i] = 1.0
        release(S, A, size, q, size, n * d, marks, diagonal)
        unresolved = complement(S, A, size, q, size, n, d, stick, attempt == 0, state, diagonal, scale)
        # a sticking finger is released whole, which is no cone: where going back and forth does not end, only let go
        if unresolved == 0 or not stick:
            break
    settle(S, A, size, q, e, n, d, stick, state)
    out_of_frames(S, q)
    return 2 * unresolved


def damp(S: Any) -> int:
    """Adds the damping force, projected on the cones too: never active; (26)'s rate term when nothing is clamped."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    implicit = S[at.IMPLICIT] != 0.0
    stick = S[at.STICK] != 0.0
    A, q, f0 = at.square(n), at.vector(n, d), at.known(n, d)
    state, marks, diagonal = at.engaged(n, d), at.marks(n, d), at.diagonal(n, d)
    into_frames(S, at.LOCAL, f0)
    size = assemble(S, implicit, True)
    for i in range(n):
        touching = S[at.ROW + i * at.STRIDE + at.TOUCHING] != 0.0
        S[state + i] = 1.0 if touching else -1.0
        for a in range(d):
            S[marks + i * d + a] = 0.0 if touching and (stick or a == 0) else 1.0
    release(S, A, size, q, size, n * d, marks, diagonal)
    if not implicit:
        for i in range(n):
            if S[state + i] > 0.0:
                for a in range(d if stick else 1):
                    S[q + i * d + a] += S[f0 + i * d + a]
    scale = max(largest(S, q, n * d), largest(S, f0, n * d))
    unresolved = complement(S, A, size, q, size, n, d, False, True, state, diagonal, scale)
    for i in range(n):
        # a clamped normal holds a rate, its tangents are still forces; an absent finger holds rates only
        S[q + i * d] = max(S[q + i * d], 0.0) if S[state + i] == 1.0 else 0.0
        for a in range(1, d):
            if S[state + i] < 0.0 or not stick:
                S[q + i * d + a] = 0.0
    out_of_frames(S, q)
    return 2 * unresolved
