"""Touching without friction where gains are numbers: forces along the normals, in as many unknowns as the modes."""

from __future__ import annotations

from typing import Any

from graspfx.cones.friction import UNRESOLVED as NONE
from graspfx.cones.friction import friction_force, turn_modes
from graspfx.coupling import block as at
from graspfx.coupling.approach import UNRESOLVED
from graspfx.coupling.depth import pose_compliances
from graspfx.coupling.law import bilateral, keep_elastic
from graspfx.coupling.slip import brake, grip, pose_problem


def press(S: Any) -> int:
    """The elastic force f = K (e + s) along the normals, then damping there; returns 0 or UNRESOLVED.

    Tangents carry nothing, so that q_k'f asks for the modes' normal entries alone, as long as the internal gain is the
    larger one: else the convex function has the tangents' part of the modes in it, and all coordinates are needed.
    """
    if S[at.EXTERNAL_STIFFNESS] <= S[at.INTERNAL_STIFFNESS]:
        fault = along_normals(S, int(S[at.PROBLEM]), True)
    else:
        fault = grip(S)
    if S[at.OBSERVED] != 0.0 or S[at.LIMITS] != 0.0:
        keep_elastic(S)
    if fault == 0 and S[at.DAMPED] != 0.0:
        if S[at.EXTERNAL_DAMPING] <= S[at.INTERNAL_DAMPING]:
            fault = along_normals(S, int(S[at.BRAKE]), False)
        else:
            fault = brake(S)
    return fault


def along_normals(S: Any, o: int, elastic: bool) -> int:
    """The elastic force into LOCAL, or damping added to the one that is there."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    if elastic and d == 1:
        bilateral(S, True, False)
        pulls = False
        for i in range(n):
            r = at.ROW + i * at.STRIDE
            push = S[r + at.NORMAL] * S[r + at.LOCAL]
            pulls = pulls or push < 0.0
            if S[at.LIMITS] != 0.0:
                pulls = pulls or push > S[int(S[at.LIMITS]) + i]
            S[r + at.TOUCHING] = 1.0 if push > 0.0 else 0.0
        if not pulls:
            return 0
    external = S[at.EXTERNAL_STIFFNESS] if elastic else S[at.EXTERNAL_DAMPING]
    internal = S[at.INTERNAL_STIFFNESS] if elastic else S[at.INTERNAL_DAMPING]
    what = at.DISPLACEMENT if elastic else at.RATE
    count = 0 if external == internal else int(S[at.COUNT])
    pose_problem(S, o, not elastic)
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        x = f0 = 0.0
        for a in range(d):
            x += S[r + at.NORMAL + a] * S[r + what + a]
            f0 += S[r + at.NORMAL + a] * S[r + at.LOCAL + a]
        cone = at.cones(S, o) + i * at.CONE
        S[cone + at.CONE_DISPLACEMENT] = x
        S[cone + at.CONE_BASE] = 0.0 if elastic else f0
    lead = 1 + (4 if S[at.COORDINATES] > 3.0 else 3) * n
    turn_modes(S, at.ROW + at.FRAME, at.STRIDE, n, S, at.modes(n), lead, S, o, 1, count)  # type: ignore[arg-type, call-arg] # flat
    if not elastic:
        pose_compliances(S, o)
    law, _, _ = friction_force(S, o, 1, external, internal, False, 0)  # type: ignore[arg-type, call-arg, misc] # flat
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        f = S[at.cones(S, o) + i * at.CONE + at.CONE_FORCE]
        for a in range(d):
            S[r + at.LOCAL + a] = f * S[r + at.NORMAL + a]
        if elastic:
            S[r + at.TOUCHING] = 1.0 if f > 0.0 else 0.0
    return UNRESOLVED if law == NONE else 0  # type: ignore[has-type] # flat
