"""Contact: bilateral, or forces projected on what a finger can push (eqs. 24-26)."""

from __future__ import annotations

from typing import Any

from graspfx.cones.complement import complement, release, settle
from graspfx.coupling import block as at
from graspfx.coupling.approach import AGAIN, UNRESOLVED, displace, touch
from graspfx.coupling.assemble import assemble, into_frames, out_of_frames
from graspfx.coupling.depth import damping_share, soften
from graspfx.coupling.implicit import LEAST, assemble_implicitly, is_held
from graspfx.coupling.law import bilateral, keep_elastic, push


def attached(S: Any) -> int:
    """Bilateral contact: eq. (4) as it stands, for the object's new state under the implicit integrator."""
    n = int(S[at.FINGERS])
    damped = S[at.DAMPED] != 0.0
    apart = S[at.OBSERVED] != 0.0 or S[at.LIMITS] != 0.0
    if apart:
        attach(S, n, False)
        keep_elastic(S)
    if damped or not apart:
        attach(S, n, damped)
    return 0


def attach(S: Any, n: int, damped: bool) -> None:
    """Eq. (4) into LOCAL, with or without its damping."""
    if S[at.IMPLICIT] != 0.0:
        assemble_implicitly(S, True, damped, False)
        out_of_frames(S, at.vector(n, int(S[at.COORDINATES])), at.LOCAL)
    else:
        bilateral(S, True, damped)


def unilateral(S: Any, again: bool) -> int:
    """The elastic force projected on the cones, then damping projected there; returns 0, UNRESOLVED or AGAIN.

    Elastic: f in C, s in C*, f's = 0, f = K (e + s) (eqs. 24-26 for n fingers). Damping: f = f0 + D (e' + s) in C, with
    f_i = 0 where f0_i = 0. A sticking finger that is let go of is given the contact point that it has without its
    anchor, and AGAIN asks for a second pass: else it would have no force in this sample and touch in the next.
    """
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    alone = S[at.EQUAL] != 0.0 and S[at.DENSE] == 0.0 and S[at.IMPLICIT] == 0.0
    fault = 0
    if alone:
        separate(S)
    else:
        fault = project(S)
    anew = False
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        was = S[r + at.TOUCHING] != 0.0
        S[r + at.TOUCHING] = 1.0 if push(S, i, d) > 0.0 else 0.0
        if again and was and S[at.STICK] != 0.0 and S[r + at.TOUCHING] == 0.0:
            c, e = r + at.CONTACT, r + at.DISPLACEMENT
            gx, gy, gz = S[c] + S[e], S[c + 1] + S[e + 1], S[c + 2] + S[e + 2]
            touch(S, r, d, gx, gy, gz)
            displace(S, r, gx, gy, gz)
            anew = True
    if fault == 0 and anew:
        return AGAIN
    if S[at.OBSERVED] != 0.0 or S[at.LIMITS] != 0.0:
        keep_elastic(S)
    if fault == 0 and S[at.DAMPED] != 0.0:
        if alone:
            damp_alone(S)
        else:
            fault = damp(S)
    return fault


def separate(S: Any) -> None:
    """Equal gains (the conventional method, eqs. 1 and 7-8): every finger by itself, no projector and no square."""
    d = int(S[at.DIMENSIONS])
    k = S[at.INTERNAL_STIFFNESS]
    for i in range(int(S[at.FINGERS])):
        r = at.ROW + i * at.STRIDE
        depth = 0.0
        for a in range(d):
            depth += S[r + at.NORMAL + a] * S[r + at.DISPLACEMENT + a]
        for a in range(d):
            e = 0.0
            if depth > 0.0:
                e = S[r + at.DISPLACEMENT + a] if S[at.STICK] != 0.0 else depth * S[r + at.NORMAL + a]
            S[r + at.LOCAL + a] = S[r + at.WEIGHT] * k * e
        if S[at.COORDINATES] > 3.0:
            S[r + at.LOCAL + 3] = S[r + at.WEIGHT] * k * S[r + at.DISPLACEMENT + 3] if depth > 0.0 else 0.0


def damp_alone(S: Any) -> None:
    """The damping of equal gains, finger by finger: a touching one's normal force never pulls."""
    d = int(S[at.DIMENSIONS])
    for i in range(int(S[at.FINGERS])):
        r = at.ROW + i * at.STRIDE
        if S[r + at.TOUCHING] == 0.0:
            continue
        b = S[r + at.WEIGHT] * S[at.INTERNAL_DAMPING]
        if S[at.GRADUAL] != 0.0:
            b *= damping_share(S, i, push(S, i, d))
        speed = 0.0
        for a in range(d):
            speed += S[r + at.NORMAL + a] * S[r + at.RATE + a]
        along = max(b * speed, -push(S, i, d))
        for a in range(d):
            f = along * S[r + at.NORMAL + a]
            if S[at.STICK] != 0.0:
                f += b * (S[r + at.RATE + a] - speed * S[r + at.NORMAL + a])
            S[r + at.LOCAL + a] += f
        if S[at.COORDINATES] > 3.0:
            S[r + at.LOCAL + 3] += b * S[r + at.RATE + 3]


def project(S: Any) -> int:
    """The elastic force in the cones: released tangents without friction, whole fingers where the contact sticks."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    c = int(S[at.COORDINATES])
    stick = S[at.STICK] != 0.0
    if S[at.IMPLICIT] == 0.0 and (stick or d == 1):
        bilateral(S, True, False)
        lowest = 0.0
        for i in range(n):
            lowest = min(lowest, push(S, i, d))
        if lowest >= 0.0:
            return 0
    A, q, e = at.square(n), at.vector(n, c), at.known(n, c)
    state, marks, diagonal = at.engaged(n, c), at.marks(n, c), at.diagonal(n, c)
    unresolved = 1
    for attempt in range(2):
        size = assemble_implicitly(S, True, False, False) if S[at.IMPLICIT] != 0.0 else assemble(S, True)
        into_frames(S, at.DISPLACEMENT, e)
        scale = largest(S, q, n * c)
        for p in range(n * c):
            S[marks + p] = 1.0 if p % c and not stick else 0.0
        for i in range(n):
            S[state + i] = 1.0
        release(S, A, size, S, q, n * c, S, marks, S, diagonal)  # type: ignore[arg-type, call-arg] # flat
        unresolved = complement(S, A, size, S, q, S, diagonal, S, state, n, c, stick, attempt == 0, scale)  # type: ignore[arg-type, call-arg] # flat
        # a sticking finger is released whole, which is no cone: where going back and forth does not end, only let go
        if unresolved == 0 or not stick:
            break
    if S[at.DENSE] != 0.0 and not stick:
        retain(S, q, e, state)
    settle(S, A, size, S, q, S, e, S, state, n, c, stick)  # type: ignore[arg-type, call-arg] # flat
    out_of_frames(S, q, at.LOCAL)
    return UNRESOLVED * unresolved


def retain(S: Any, q: int, e: int, state: int) -> None:
    """Keep e + s of contacts that slip freely: s stands at q, but the normals of fingers that push have none."""
    n = int(S[at.FINGERS])
    c = int(S[at.COORDINATES])
    for i in range(n):
        for a in range(c):
            p = i * c + a
            if a > 0 or S[state + i] == 0.0:
                S[e + p] += S[q + p]
    out_of_frames(S, e, at.RETAINED)
    into_frames(S, at.DISPLACEMENT, e)
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        if S[r + at.WEIGHT] == 0.0:
            for a in range(4):
                S[r + at.RETAINED + a] = 0.0


def damp(S: Any) -> int:
    """Adds the damping force, projected on the cones too: never active; (26)'s rate term when nothing is clamped."""
    n = int(S[at.FINGERS])
    c = int(S[at.COORDINATES])
    implicit = S[at.IMPLICIT] != 0.0
    A, q, f0 = at.square(n), at.vector(n, c), at.known(n, c)
    state, marks, diagonal = at.engaged(n, c), at.marks(n, c), at.diagonal(n, c)
    for i in range(n):
        S[state + i] = 1.0 if S[at.ROW + i * at.STRIDE + at.TOUCHING] != 0.0 else -1.0
    if implicit:
        size = assemble_implicitly(S, True, True, True)
    else:
        into_frames(S, at.LOCAL, f0)
        size = assemble(S, False)
        make_regular(S, n, c)
        soften(S, A, size, q, 1.0, f0)
        for p in range(n * c):
            S[marks + p] = 0.0 if is_held(S, p, c) else 1.0
        release(S, A, size, S, q, n * c, S, marks, S, diagonal)  # type: ignore[arg-type, call-arg] # flat
        for p in range(n * c):
            if is_held(S, p, c):
                S[q + p] += S[f0 + p]
    scale = largest(S, q, n * c)
    unresolved = complement(S, A, size, S, q, S, diagonal, S, state, n, c, False, True, scale)  # type: ignore[arg-type, call-arg] # flat
    for p in range(n * c):
        # a clamped normal holds a rate, its tangents are still forces; what is not held carries nothing
        if not is_held(S, p, c) or (p % c == 0 and S[state + p // c] == 0.0):
            S[q + p] = 0.0
        elif p % c == 0:
            S[q + p] = max(S[q + p], 0.0)
    out_of_frames(S, q, at.LOCAL)
    return UNRESOLVED * unresolved


def make_regular(S: Any, n: int, c: int) -> None:
    """Where D is singular (ked or kid zero), raises it by 1e-8 of its diagonal, with the force that goes with that.

    The law stays passive, and no finger hangs on a pivot of rounding size.
    """
    if S[at.SINGULAR] == 0.0:
        return
    for p in range(n * c):
        more = LEAST * S[at.diagonal(n, c) + p]
        S[at.square(n) + p * n * c + p] += more
        r = at.ROW + (p // c) * at.STRIDE
        rate = S[r + at.RATE + 3] if p % c == 3 else 0.0
        for b in range(min(c, 3) if p % c < 3 else 0):
            rate += S[r + at.FRAME + 3 * (p % c) + b] * S[r + at.RATE + b]
        S[at.vector(n, c) + p] += more * rate


def largest(S: Any, q: int, m: int) -> float:
    scale = 0.0
    for p in range(m):
        scale = max(scale, abs(S[q + p]))
    return scale
