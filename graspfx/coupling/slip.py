"""Friction with a coefficient: elastic force and damping in the cones, and what fingers retain of displacements."""

from __future__ import annotations

import math
from typing import Any

from graspfx.cones.cut import force_size
from graspfx.cones.friction import COULOMB, LEAST, friction_force, friction_force_square, turn_modes
from graspfx.cones.friction import UNRESOLVED as NONE
from graspfx.cones.problem import FREE, STICK
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
    first = at.cones(S, o)
    known, force, slip = first + at.CONE_DISPLACEMENT, first + at.CONE_FORCE, first + at.CONE_SLIP
    square = S[at.IMPLICIT] != 0.0 or S[at.DENSE] != 0.0
    into_frames(S, at.DISPLACEMENT, known, at.CONE)
    if S[at.IMPLICIT] == 0.0 and S[at.RAYS] == 0.0:
        bilateral(S, True, False)
        into_frames(S, at.LOCAL, force, at.CONE)
        if sticks(S, first):  # the answer as it is, and where the next one starts
            start_next(S, o, square)
            for i in range(n):
                r = at.ROW + i * at.STRIDE
                S[r + at.TOUCHING], S[r + at.STATUS] = 1.0, STICK
                for a in range(4):
                    S[r + at.RETAINED + a] = S[r + at.DISPLACEMENT + a]
            return 0
    pose_problem(S, o, False)
    for i in range(n):
        for a in range(c):
            S[first + i * at.CONE + at.CONE_BASE + a] = 0.0
    if square:
        size = assemble_implicitly(S, True, False, False) if S[at.IMPLICIT] != 0.0 else assemble(S, True)
        even = made_symmetric(S, at.square(n), size, n * c)
        law, residual, _ = friction_force_square(S, o, c, S, at.square(n), size, even, True, RESTARTS)  # type: ignore[arg-type, call-arg, misc] # flat
    else:
        law, residual, _ = friction_force_modes(S, o, S[at.EXTERNAL_STIFFNESS], S[at.INTERNAL_STIFFNESS], True)
    S[at.LAW], S[at.RESIDUAL] = law, residual
    out_of_frames(S, force, at.LOCAL, at.CONE)
    for i in range(n):
        for a in range(c):
            S[slip + i * at.CONE + a] += S[known + i * at.CONE + a]
    out_of_frames(S, slip, at.RETAINED, at.CONE)
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        status = max(S[first + i * at.CONE + at.CONE_STATUS], 0.0)
        S[r + at.STATUS] = status
        S[r + at.TOUCHING] = 0.0 if status == FREE else 1.0
        if S[r + at.WEIGHT] == 0.0:
            for a in range(4):
                S[r + at.RETAINED + a] = 0.0
    return UNRESOLVED if law == NONE else 0


def start_next(S: Any, o: int, square: bool) -> None:
    """Put the unknowns of the elastic problem at o to those of an answer in which all fingers stick."""
    n = int(S[at.FINGERS])
    c = int(S[at.COORDINATES])
    known, unknowns = at.cones(S, o) + at.CONE_DISPLACEMENT, o + at.UNKNOWNS
    if square:
        for i in range(n):
            for a in range(c):
                S[unknowns + (i * c + a) * at.UNKNOWN] = S[known + i * at.CONE + a]
    else:
        for k in range(int(S[at.COUNT])):
            S[unknowns + k * at.UNKNOWN] = -S[at.scratch(n, c) + k]
        S[o + at.STARTED] = max(S[o + at.STARTED], S[at.COUNT])


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
    first = at.cones(S, o)
    known, start, force = first + at.CONE_DISPLACEMENT, first + at.CONE_BASE, first + at.CONE_FORCE
    pose_problem(S, o, True)
    if S[at.IMPLICIT] != 0.0:
        size = assemble_implicitly(S, True, True, True)
        for i in range(n):
            for a in range(c):
                S[known + i * at.CONE + a] = 0.0
                S[start + i * at.CONE + a] = S[at.vector(n, c) + i * c + a]
        even = made_symmetric(S, at.square(n), size, m)
        law, _, _ = friction_force_square(S, o, c, S, at.square(n), size, even, False, 0)  # type: ignore[arg-type, call-arg, misc] # flat
    else:
        into_frames(S, at.LOCAL, start, at.CONE)
        into_frames(S, at.RATE, known, at.CONE)
        law = 0
        if not (S[at.RAYS] == 0.0 and all_touch(S) and is_whole(S) and stays(S, first)):
            if S[at.DENSE] != 0.0:
                assemble(S, False)
                raise_least(S, at.square(n), m)
                soften(S, at.square(n), m, -1, 1.0, start, at.CONE)
                even = made_symmetric(S, at.square(n), m, m)
                law, _, _ = friction_force_square(S, o, c, S, at.square(n), m, even, False, 0)  # type: ignore[arg-type, call-arg, misc] # flat
            else:
                pose_compliances(S, o)
                law, _, _ = friction_force_modes(S, o, S[at.EXTERNAL_DAMPING], S[at.INTERNAL_DAMPING], False)
    out_of_frames(S, force, at.LOCAL, at.CONE)
    return UNRESOLVED if law == NONE else 0


def stays(S: Any, first: int) -> bool:
    """Whether the elastic forces and all the damping, which become the problem's forces, lie in the cones.

    `first` is the offset of the problem's first contact.
    """
    bilateral(S, False, True)
    into_frames(S, at.LOCAL, first + at.CONE_FORCE, at.CONE)
    for i in range(int(S[at.FINGERS])):
        r = first + i * at.CONE
        for a in range(int(S[at.COORDINATES])):
            S[r + at.CONE_FORCE + a] += S[r + at.CONE_BASE + a]
    return sticks(S, first)


def friction_force_modes(S: Any, o: int, external: float, internal: float, coulomb: bool) -> tuple[int, float, int]:
    """`friction_force` for the modes that stand in the block."""
    n = int(S[at.FINGERS])
    c = int(S[at.COORDINATES])
    count = 0 if external == internal else int(S[at.COUNT])
    lead = 1 + (4 if c > 3 else 3) * n
    turn_modes(S, at.ROW + at.FRAME, at.STRIDE, n, S, at.modes(n), lead, S, o, c, count)  # type: ignore[arg-type, call-arg] # flat
    return friction_force(S, o, c, external, internal, coulomb, RESTARTS)  # type: ignore[arg-type, call-arg, return-value] # flat


def pose_problem(S: Any, o: int, touching: bool) -> None:
    """Weights, coefficients, limits and which fingers are held at no force, for the problem at o."""
    n = int(S[at.FINGERS])
    first = at.cones(S, o)
    for i in range(n):
        r, cone = at.ROW + i * at.STRIDE, first + i * at.CONE
        S[cone] = S[r + at.WEIGHT]
        S[cone + at.CONE_COEFFICIENT] = S[r + at.COEFFICIENT]
        held = S[r + at.WEIGHT] == 0.0 or (touching and S[r + at.TOUCHING] == 0.0)
        S[cone + at.CONE_STATUS] = -1.0 if held else 0.0
        if S[at.LIMITS] != 0.0:
            S[cone + at.CONE_LIMIT] = S[int(S[at.LIMITS]) + i]


def sticks(S: Any, first: int) -> bool:
    """Whether all forces of the problem with its first contact at `first` lie inside their cones and limits."""
    n = int(S[at.FINGERS])
    c = int(S[at.COORDINATES])
    for i in range(n):
        r = first + i * at.CONE + at.CONE_FORCE
        along = 0.0
        for a in range(1, c):
            along += S[r + a] * S[r + a]
        if not S[r] > NOTHING or math.sqrt(along) > S[at.ROW + i * at.STRIDE + at.COEFFICIENT] * S[r]:
            return False
        if S[at.LIMITS] != 0.0 and force_size(S[r], S[r + 1], S[r + 2], S[r + 3], c) > S[int(S[at.LIMITS]) + i]:  # type: ignore[call-arg] # flat
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
