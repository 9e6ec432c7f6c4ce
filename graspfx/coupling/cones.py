"""Contact: bilateral, or forces projected on what a finger can push (eqs. 24-26)."""

from __future__ import annotations

from typing import Any

from graspfx.coupling import block as at
from graspfx.coupling.assemble import assemble, into_frames, out_of_frames
from graspfx.coupling.law import bilateral
from graspfx.grasp.kernels import complement, release, settle


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
    if S[at.EQUAL] != 0.0 and S[at.DENSE] == 0.0 and S[at.IMPLICIT] == 0.0:
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


def largest(S: Any, q: int, m: int) -> float:
    scale = 0.0
    for p in range(m):
        scale = max(scale, abs(S[q + p]))
    return scale
