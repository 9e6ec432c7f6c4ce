"""The sample under the implicit integrator: forces and the object's displacement from one linear system."""

from __future__ import annotations

from typing import Any

from graspfx.cones.complement import pivot, release
from graspfx.coupling import block as at
from graspfx.coupling.assemble import add_gains, into_frames
from graspfx.coupling.depth import soften
from graspfx.objects import integrators as body

LEAST = 1e-8  # of a coordinate's own damping: what is added where some direction has none


def assemble_implicitly(S: Any, elastic: bool, damping: bool, held: bool) -> int:
    """The law in contact frames for the state at the end of the sample, the object's displacement u eliminated.

    f = K (e - G'u) + D (e' - H'u / T), u = C (G K ... + H D ...), C the object's compliance; G has the moment arms of
    the contacts and H those of the points where the rate is taken. With `held`, K and D are those of the touching
    fingers alone, all others released from each by itself: where a free finger is changes nothing; and where there is a
    coefficient, e is what slipping has left of it. Returns the rows.
    """
    n = int(S[at.FINGERS])
    c = int(S[at.COORDINATES])
    m = n * c
    u = int(S[at.SHIFTS]) + int(S[at.TURNS])
    size = m + u
    A, q = at.square(n), at.vector(n, c)
    for p in range(size * size):
        S[A + p] = 0.0
    for p in range(size):
        S[q + p] = 0.0
    if elastic:
        add_part(S, size, m, True, held)
    if damping:
        add_part(S, size, m, False, held)
    add_inertia(S, size, m)
    for p in range(m, size):
        pivot(S, A, size, S, q, p)  # type: ignore[arg-type, call-arg] # flat
    for p in range(m):
        S[at.diagonal(n, c) + p] = S[A + p * size + p]
    return size


def add_part(S: Any, size: int, m: int, elastic: bool, held: bool) -> None:
    """Adds B = K with e, or B = D / T with T e': B, -B G', G B, -G B G', and the vectors B x and G B x."""
    n = int(S[at.FINGERS])
    c = int(S[at.COORDINATES])
    T = S[at.PERIOD]
    A, q, B, x = at.square(n), at.vector(n, c), at.part(n, c), at.known(n, c)
    fill_part(S, m, elastic, held)
    kept = at.RETAINED if held and S[at.FRICTION] != 0.0 else at.DISPLACEMENT
    into_frames(S, kept if elastic else at.RATE, x)
    unit = 1.0 if elastic else T
    at_tip = not elastic and S[at.AT_CONTACT] == 0.0
    shifts = int(S[at.SHIFTS])
    for p in range(m):
        total = 0.0
        for k in range(m):
            total += S[B + p * m + k] * S[x + k]
            S[A + p * size + k] += S[B + p * m + k]
        S[q + p] += unit * total
    G = at.levers(n, c)
    for u in range(size - m):
        for k in range(m):
            S[G + u * m + k] = lever(S, u, shifts, k, c, at_tip)
    for u in range(size - m):
        for p in range(m):
            along = across = 0.0
            for k in range(m):
                g = S[G + u * m + k]
                along += S[B + p * m + k] * g
                across += g * S[B + k * m + p]
            S[A + p * size + m + u] -= along
            S[A + (m + u) * size + p] += across
            S[q + m + u] += unit * across * S[x + p]
            for v in range(size - m):
                S[A + (m + u) * size + m + v] -= across * S[G + v * m + p]


def fill_part(S: Any, m: int, elastic: bool, held: bool) -> None:
    """K or D / T in contact frames, m x m; with `held`, condensed to what touches, zero rows and columns elsewhere."""
    n = int(S[at.FINGERS])
    c = int(S[at.COORDINATES])
    B, q, marks, diagonal = at.part(n, c), at.rest(n, c), at.marks(n, c), at.diagonal(n, c)
    per = 1.0 / S[at.PERIOD]
    for p in range(m * m):
        S[B + p] = 0.0
    if elastic:
        add_gains(S, B, m, S[at.EXTERNAL_STIFFNESS], S[at.INTERNAL_STIFFNESS], 1.0, 0.0)
    else:
        add_gains(S, B, m, per * S[at.EXTERNAL_DAMPING], per * S[at.INTERNAL_DAMPING], 0.0, per)
    if not held:
        return
    if not elastic and S[at.GRADUAL] != 0.0:
        if S[at.SINGULAR] != 0.0:
            for p in range(m):
                S[B + p * m + p] *= 1.0 + LEAST
        into_frames(S, at.LOCAL, at.known(n, c))
        soften(S, B, m, -1, per, at.known(n, c))
    for p in range(m):
        if not elastic and S[at.SINGULAR] != 0.0 and S[at.GRADUAL] == 0.0:
            S[B + p * m + p] *= 1.0 + LEAST
        S[diagonal + p] = S[B + p * m + p]
        S[marks + p] = 0.0 if is_held(S, p, c) else 1.0
    release(S, B, m, S, q, m, S, marks, S, diagonal)  # type: ignore[arg-type, call-arg] # flat
    for p in range(m):
        for k in range(m):
            if not (is_held(S, p, c) and is_held(S, k, c)):
                S[B + p * m + k] = 0.0


def is_held(S: Any, p: int, c: int) -> bool:
    """Whether contact coordinate p carries force: a touching finger's normal, and its tangents if it has friction."""
    touching = S[at.ROW + (p // c) * at.STRIDE + at.TOUCHING] != 0.0
    return touching and (p % c == 0 or S[at.STICK] != 0.0 or S[at.FRICTION] != 0.0)


def add_inertia(S: Any, size: int, m: int) -> None:
    """Adds -1/compliance of the object's free directions: -(M + T B) / T^2."""
    n = int(S[at.FINGERS])
    T = S[at.PERIOD]
    A, shifts = at.square(n), int(S[at.SHIFTS])
    for u in range(size - m):
        for v in range(size - m):
            total = 0.0
            if u == v and u < shifts:
                total = S[at.BODY + body.MASS] + T * S[at.BODY + body.VISCOSITY]
            if u >= shifts and v >= shifts:
                for a in range(3):
                    inertia = S[at.BODY + body.INERTIA + a] + T * S[at.BODY + body.ROTATIONAL_VISCOSITY]
                    total += S[at.AXES + 3 * u + a] * S[at.AXES + 3 * v + a] * inertia
            S[A + (m + u) * size + m + v] -= total / (T * T)


def lever(S: Any, u: int, shifts: int, k: int, c: int, at_tip: bool) -> float:
    """One entry of G in contact frames: what force coordinate k does along the object's free direction u."""
    r = at.ROW + (k // c) * at.STRIDE
    f = r + at.FRAME + 3 * (k % c)
    o = at.AXES + 3 * u
    if k % c == 3:
        f = r + at.TWIST_AXIS
        turn = S[o] * S[f] + S[o + 1] * S[f + 1] + S[o + 2] * S[f + 2]
        return float(S[r + at.PATCH] * turn) if u >= shifts else 0.0
    if u < shifts:
        return float(S[o] * S[f] + S[o + 1] * S[f + 1] + S[o + 2] * S[f + 2])
    x, y, z = S[r + at.CONTACT], S[r + at.CONTACT + 1], S[r + at.CONTACT + 2]
    if at_tip:
        x += S[r + at.DISPLACEMENT]
        y += S[r + at.DISPLACEMENT + 1]
        z += S[r + at.DISPLACEMENT + 2]
    mx = y * S[f + 2] - z * S[f + 1]
    my = z * S[f] - x * S[f + 2]
    mz = x * S[f + 1] - y * S[f]
    return float(S[o] * mx + S[o + 1] * my + S[o + 2] * mz)
