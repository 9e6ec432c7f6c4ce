"""Friction with a coefficient: elastic force and damping in the cones, and what fingers retain of displacements."""

from __future__ import annotations

import math
from typing import Any

from graspfx.cones.cone import FREE, STICK, modes_offset
from graspfx.cones.cut import force_size
from graspfx.cones.friction import COULOMB, LEAST, friction_force, friction_force_square, turn_modes
from graspfx.cones.friction import UNRESOLVED as NONE
from graspfx.coupling import block as at
from graspfx.coupling.approach import UNRESOLVED, set_anchor
from graspfx.coupling.assemble import assemble, into_frames, out_of_frames
from graspfx.coupling.depth import is_whole, pose_compliances, soften
from graspfx.coupling.implicit import assemble_implicitly
from graspfx.coupling.law import bilateral, keep_elastic

RESTARTS = 2  # of Coulomb's law in a sample: the last sample's answer is nearly always a start that leads there
SYMMETRIC = 1e-12  # of a square's largest entry
NOTHING = 1e-200  # [N]: less counts as no force, its square would


def rub(S: Any) -> int:
    """The elastic force f = K (e + s) in the friction cones, then damping in them; returns 0 or UNRESOLVED.

    Coulomb's law, or where it has no answer that was found the associated one. A finger keeps its contact point while
    it sticks; RETAINED tells the next sample where the contact of one that slips or is free has to be.
    """
    fault = grip(S)
    if S[at.OBSERVED] != 0.0 or S[at.LIMITS] != 0.0:
        keep_elastic(S)
    if fault == 0 and S[at.DAMPED] != 0.0:
        fault = brake(S)
    return fault


def grip(S: Any) -> int:
    """The elastic force in the cones into LOCAL, each finger's status, and e + s."""
    n = int(S[at.FINGERS])
    c = int(S[at.COORDINATES])
    o = int(S[at.PROBLEM])
    S[at.LAW], S[at.RESIDUAL] = COULOMB, 0.0
    known, force, slip, unknowns = o + 3 * n, o + 3 * n + 2 * n * c, o + 3 * n + 3 * n * c, o + 3 * n + 5 * n * c
    square = S[at.IMPLICIT] != 0.0 or S[at.DENSE] != 0.0
    into_frames(S, at.DISPLACEMENT, known)
    if S[at.IMPLICIT] == 0.0 and S[at.RAYS] == 0.0:
        bilateral(S, True, False)
        into_frames(S, at.LOCAL, force)
        if sticks(S, force):  # the answer as it is, and where the next one starts
            for k in range(n * c if square else int(S[at.COUNT])):
                S[unknowns + k] = S[known + k] if square else -S[at.scratch(n, c) + k]
            for i in range(n):
                r = at.ROW + i * at.STRIDE
                S[r + at.TOUCHING], S[r + at.STATUS] = 1.0, STICK
                for a in range(4):
                    S[r + at.RETAINED + a] = S[r + at.DISPLACEMENT + a]
            return 0
    pose_problem(S, o, False)
    for p in range(n * c):
        S[known + n * c + p] = 0.0
    if square:
        size = assemble_implicitly(S, True, False, False) if S[at.IMPLICIT] != 0.0 else assemble(S, True)
        even = made_symmetric(S, at.square(n), size, n * c)
        cut = 0 if S[at.IMPLICIT] != 0.0 else int(S[at.LIMITS])
        law, residual, _ = friction_force_square(S, o, n, c, at.square(n), size, even, True, RESTARTS, cut)
    else:
        law, residual, _ = friction_force_modes(S, o, S[at.EXTERNAL_STIFFNESS], S[at.INTERNAL_STIFFNESS], True, -1)
    S[at.LAW], S[at.RESIDUAL] = law, residual
    out_of_frames(S, force, at.LOCAL)
    for p in range(n * c):
        S[slip + p] += S[known + p]
    out_of_frames(S, slip, at.RETAINED)
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        status = max(S[o + 2 * n + i], 0.0)
        S[r + at.STATUS] = status
        S[r + at.TOUCHING] = 0.0 if status == FREE else 1.0
        if S[r + at.WEIGHT] == 0.0:
            for a in range(4):
                S[r + at.RETAINED + a] = 0.0
    return UNRESOLVED if law == NONE else 0


def move_anchors(S: Any) -> None:
    """From here on the torsion of soft fingers that do not stick counts from the object's rotation now."""
    if S[at.COORDINATES] > 3.0:
        for i in range(int(S[at.FINGERS])):
            r = at.ROW + i * at.STRIDE
            if S[r + at.STATUS] != STICK:
                set_anchor(S, r, S[r + at.RETAINED + 3])


def brake(S: Any) -> int:
    """Adds damping: f = f0 + D (e' + s) in the cones, s in C*, f's = 0, nothing where f0 is zero; never active.

    The implicit integrator has f = K (e + s0 - G'u) + (D / T) (T e' - H'u) + (K + D / T) s,
    for the object's new state, with s0 the slip of the elastic force: one system for all three.
    """
    n = int(S[at.FINGERS])
    c = int(S[at.COORDINATES])
    m = n * c
    o = int(S[at.BRAKE])
    known, force = o + 3 * n, o + 3 * n + 2 * m
    start = known + m
    pose_problem(S, o, True)
    if S[at.IMPLICIT] != 0.0:
        size = assemble_implicitly(S, True, True, True)
        for p in range(m):
            S[known + p] = 0.0
            S[start + p] = S[at.vector(n, c) + p]
        even = made_symmetric(S, at.square(n), size, m)
        law, _, _ = friction_force_square(S, o, n, c, at.square(n), size, even, False, 0)
    else:
        into_frames(S, at.LOCAL, start)
        into_frames(S, at.RATE, known)
        law = 0
        if not (S[at.RAYS] == 0.0 and all_touch(S) and is_whole(S) and stays(S, start, force)):
            if S[at.DENSE] != 0.0:
                assemble(S, False)
                raise_least(S, at.square(n), m)
                soften(S, at.square(n), m, -1, 1.0, start)
                even = made_symmetric(S, at.square(n), m, m)
                law, _, _ = friction_force_square(S, o, n, c, at.square(n), m, even, False, 0, int(S[at.LIMITS]))
            else:
                series = pose_compliances(S, o, c)
                law, _, _ = friction_force_modes(S, o, S[at.EXTERNAL_DAMPING], S[at.INTERNAL_DAMPING], False, series)
    out_of_frames(S, force, at.LOCAL)
    return UNRESOLVED if law == NONE else 0


def stays(S: Any, start: int, force: int) -> bool:
    """Whether the elastic force at `start` and all the damping, which go to `force`, lie in the cones."""
    bilateral(S, False, True)
    into_frames(S, at.LOCAL, force)
    for p in range(int(S[at.FINGERS]) * int(S[at.COORDINATES])):
        S[force + p] += S[start + p]
    return sticks(S, force)


def friction_force_modes(
    S: Any, o: int, external: float, internal: float, coulomb: bool, series: int
) -> tuple[int, float, int]:
    """`friction_force` for the modes that stand in the block."""
    n = int(S[at.FINGERS])
    c = int(S[at.COORDINATES])
    count = 0 if external == internal else int(S[at.COUNT])
    turn_modes(S, at.ROW, at.STRIDE, at.FRAME, n, c, at.modes(n), count, modes_offset(o, n, c, count))
    return friction_force(S, o, n, c, count, external, internal, coulomb, RESTARTS, int(S[at.LIMITS]), series)


def pose_problem(S: Any, o: int, touching: bool) -> None:
    """Weights, coefficients and which fingers are held at no force, for the problem at o."""
    n = int(S[at.FINGERS])
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        S[o + i] = S[r + at.WEIGHT]
        S[o + n + i] = S[r + at.COEFFICIENT]
        held = S[r + at.WEIGHT] == 0.0 or (touching and S[r + at.TOUCHING] == 0.0)
        S[o + 2 * n + i] = -1.0 if held else 0.0


def sticks(S: Any, q: int) -> bool:
    """Whether all contact forces at q lie inside their cones and limits."""
    n = int(S[at.FINGERS])
    c = int(S[at.COORDINATES])
    for i in range(n):
        r = q + i * c
        along = 0.0
        for a in range(1, c):
            along += S[r + a] * S[r + a]
        if not S[r] > NOTHING or math.sqrt(along) > S[at.ROW + i * at.STRIDE + at.COEFFICIENT] * S[r]:
            return False
        if S[at.LIMITS] != 0.0 and force_size(S, r, c) > S[int(S[at.LIMITS]) + i]:
            return False
    return True


def all_touch(S: Any) -> bool:
    n = int(S[at.FINGERS])
    count = 0
    for i in range(n):
        count += 1 if S[at.ROW + i * at.STRIDE + at.TOUCHING] != 0.0 else 0
    return count == n


def made_symmetric(S: Any, square: int, lead: int, m: int) -> bool:
    """Whether a square is symmetric but for rounding, which is taken out of it: the solver then has a convex problem.

    Numbers for gains make no other squares, though a damping of which one part is zero leaves a lot to rounding.
    """
    largest = skew = 0.0
    for p in range(m):
        for q in range(p + 1):
            largest = max(largest, abs(S[square + p * lead + q]))
            skew = max(skew, abs(S[square + p * lead + q] - S[square + q * lead + p]))
    if S[at.DENSE] != 0.0 and skew > SYMMETRIC * largest:
        return False
    for p in range(m):
        for q in range(p):
            mean = 0.5 * (S[square + p * lead + q] + S[square + q * lead + p])
            S[square + p * lead + q] = S[square + q * lead + p] = mean
    return True


def raise_least(S: Any, square: int, m: int) -> None:
    """Where D is singular, raises it by 1e-6 of its largest row: the law stays passive."""
    if S[at.SINGULAR] == 0.0:
        return
    largest = 0.0
    for p in range(m):
        total = 0.0
        for q in range(m):
            total += abs(S[square + p * m + q])
        largest = max(largest, total)
    for p in range(m):
        S[square + p * m + p] += LEAST * largest
