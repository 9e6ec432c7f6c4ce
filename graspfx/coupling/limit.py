"""The step `limit` of a sample: the law's forces within what the devices display, before the object receives them.

A limit at the device alone creates energy, for the object receives what nobody displayed. The normal way is inside the
projection: the cones are cut off at |f_i| <= L_i and the sample is asked once more, so that the elastic force stays the
gradient of a convex function (`graspfx.cones.cut`). Whatever is still too long is scaled (`graspfx.coupling.scaling`).
"""

from __future__ import annotations

import math
from typing import Any

from graspfx.cones.cut import HALF_SPACE, NO_CONE, force_size, shorten
from graspfx.cones.friction import UNRESOLVED as NONE
from graspfx.coupling import block as at
from graspfx.coupling.approach import UNRESOLVED
from graspfx.coupling.assemble import into_frames, out_of_frames
from graspfx.coupling.depth import pose_compliances
from graspfx.coupling.law import bilateral, keep_elastic
from graspfx.coupling.projection import damp_alone
from graspfx.coupling.rays import press
from graspfx.coupling.react import react
from graspfx.coupling.scaling import scale
from graspfx.coupling.slip import friction_force_modes, pose_problem, rub

NEARLY = 1.0 - 1e-12  # of a limit: a force of that size stands at it


def limit(S: Any, fault: int) -> int:
    """Bring the forces of a sample within the limits; returns `fault`, or UNRESOLVED.

    The law's own forces stay in the block, and who stands at a limit. Nothing changes where all are short enough.
    """
    keep_law(S)
    if fault != 0 or not exceeds(S):
        return fault
    n = int(S[at.FINGERS])
    inside = is_inside(S)
    if inside:
        for i in range(n):
            S[int(S[at.LIMITS]) + i] = at.LIMIT_MARGIN * S[at.device_limits(S) + i]
        fault = within(S)
        for i in range(n):
            S[int(S[at.LIMITS]) + i] = math.inf
    if fault == 0:
        scale(S, True)
        mark(S, inside)
    return fault


def limit_again(S: Any) -> None:
    """Scale what was added to the forces since `limit` and the reaction to them; it counts as the law's."""
    add_to_law(S, -1.0)
    react(S)
    add_to_law(S, 1.0)
    scale(S, False)
    mark(S, False)


def forget_limits(S: Any) -> None:
    """Clear the law's force and who stands at a limit."""
    n = int(S[at.FINGERS])
    for k in range(4 * n):
        S[at.saturation(S) + k] = 0.0


def keep_law(S: Any) -> None:
    """Keep the forces as they are, in world axes, as the law's; nobody stands at a limit yet."""
    react(S)
    n = int(S[at.FINGERS])
    for i in range(n):
        S[at.saturation(S) + i] = 0.0
        for a in range(3):
            S[at.law_force(S) + 3 * i + a] = S[at.ROW + i * at.STRIDE + at.FORCE + a]


def add_to_law(S: Any, sign: float) -> None:
    """Add the forces in world axes to the law's, or take them off."""
    for i in range(int(S[at.FINGERS])):
        for a in range(3):
            S[at.law_force(S) + 3 * i + a] += sign * S[at.ROW + i * at.STRIDE + at.FORCE + a]


def exceeds(S: Any) -> bool:
    """Tell whether some finger's force, or its elastic one, is beyond the limit."""
    longest = 0.0
    for i in range(int(S[at.FINGERS])):
        r, most = at.ROW + i * at.STRIDE, at.LIMIT_MARGIN * S[at.device_limits(S) + i]
        if size_of(S, r + at.LOCAL) > most or size_of(S, r + at.ELASTIC) > most:
            longest = 1.0
    return longest > 0.0


def width(S: Any) -> int:
    """Count the entries of a force that the limit is about: torsion too where friction bounds both together."""
    return 4 if S[at.FRICTION] != 0.0 else 3


def size_of(S: Any, f: int) -> float:
    """Compute the length of the force at f that the limit is about."""
    return force_size(S[f], S[f + 1], S[f + 2], S[f + 3], width(S))  # type: ignore[call-arg] # flat


def mark(S: Any, inside: bool) -> None:
    """Mark the fingers whose force stands at the limit; inside the projection, also whose elastic force does."""
    for i in range(int(S[at.FINGERS])):
        r, least = at.ROW + i * at.STRIDE, NEARLY * at.LIMIT_MARGIN * S[at.device_limits(S) + i]
        if size_of(S, r + at.LOCAL) >= least:
            S[at.saturation(S) + i] = 1.0
        if inside and size_of(S, r + at.ELASTIC) >= least:
            S[at.saturation(S) + i] = 1.0


def is_inside(S: Any) -> bool:
    """Tell whether the projection itself can be asked for forces within limits.

    Not with the implicit integrator, nor where gains are matrices and there is no coefficient of friction.
    """
    return bool(S[at.IMPLICIT] == 0.0 and (S[at.FRICTION] != 0.0 or S[at.DENSE] == 0.0))


def within(S: Any) -> int:
    """Find the forces of the cut cones: the elastic one, then damping; returns 0 or UNRESOLVED."""
    if S[at.FRICTION] != 0.0:
        return rub(S)
    if S[at.RAYS] != 0.0:
        return press(S)
    if S[at.EQUAL] != 0.0:
        within_alone(S)
        return 0
    return within_balls(S)


def within_alone(S: Any) -> None:
    """Limit every finger by itself, where gains are equal: elastic force and sum are shortened one after the other."""
    n = int(S[at.FINGERS])
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        for a in range(4):
            S[r + at.LOCAL + a] = S[r + at.ELASTIC + a]
    shorten_all(S)
    keep_elastic(S)
    if S[at.DAMPED] != 0.0:
        if S[at.ATTACHED] != 0.0:
            bilateral(S, False, True)
            for i in range(n):
                r = at.ROW + i * at.STRIDE
                for a in range(4):
                    S[r + at.LOCAL + a] += S[r + at.ELASTIC + a]
        else:
            damp_alone(S)
        shorten_all(S)


def shorten_all(S: Any) -> None:
    """Shorten every force to its limit."""
    for i in range(int(S[at.FINGERS])):
        f = at.ROW + i * at.STRIDE + at.LOCAL
        S[f], S[f + 1], S[f + 2], S[f + 3], _ = shorten(  # type: ignore[call-arg, misc] # flat
            S[f], S[f + 1], S[f + 2], S[f + 3], width(S), S[int(S[at.LIMITS]) + i]
        )


def within_balls(S: Any) -> int:
    """Find the forces of attached and sticking contacts nearest to the law's, by K^-1 and D^-1, with |f_i| <= L_i.

    Fingers that the law has let go of stay free, and those that it holds only push.
    """
    fault = ball_force(S, int(S[at.PROBLEM]), at.DISPLACEMENT, S[at.EXTERNAL_STIFFNESS], S[at.INTERNAL_STIFFNESS])
    keep_elastic(S)
    if fault == 0 and S[at.DAMPED] != 0.0:
        fault = ball_force(S, int(S[at.BRAKE]), at.RATE, S[at.EXTERNAL_DAMPING], S[at.INTERNAL_DAMPING])
    return fault


def ball_force(S: Any, o: int, what: int, external: float, internal: float) -> int:
    """Put the elastic force into LOCAL, or add damping by what is a RATE to the one that is there."""
    n, c = int(S[at.FINGERS]), int(S[at.COORDINATES])
    first = at.cones(S, o)
    pose_problem(S, o, True)
    for i in range(n):
        S[first + i * at.CONE + at.CONE_COEFFICIENT] = NO_CONE if S[at.ATTACHED] != 0.0 else HALF_SPACE
    into_frames(S, what, first + at.CONE_DISPLACEMENT, at.CONE)
    if what == at.RATE:
        into_frames(S, at.LOCAL, first + at.CONE_BASE, at.CONE)
        pose_compliances(S, o)
    else:
        for i in range(n):
            for a in range(c):
                S[first + i * at.CONE + at.CONE_BASE + a] = 0.0
    law, _, _ = friction_force_modes(S, o, external, internal, False)
    out_of_frames(S, first + at.CONE_FORCE, at.LOCAL, at.CONE)
    return UNRESOLVED if law == NONE else 0
