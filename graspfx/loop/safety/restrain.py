"""Last part of the safety chain: limits of rate, workspace and size of the force of each finger.

The force f_i of finger i is replaced by s_i f_i with 0 <= s_i <= 1, so it does not leave the friction cone. The wrench
on the object and the energy ledger use s_i f_i. If a limit admits a force, it also admits every smaller force in the
same direction; the smallest s_i of all limits therefore satisfies all limits.
"""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.law import react
from graspfx.loop.safety.safety_state import FingerLimits, Pace, SafetyState
from graspfx.loop.safety.trust import NOT_FINITE
from graspfx.spatial import NOTHING, ZERO, Vector, dot, total

BAND = 0.005  # distance to a wall of the workspace within which the outward force decreases to zero [m]


@kernel
def restrain(grasp: GraspState, safety: SafetyState, pace: Pace) -> int:
    """Scale the forces so that they satisfy all limits.

    The result is NOT_FINITE if a force or an input of the forces is not finite, otherwise 0.
    """
    if not all_finite(grasp, safety):
        for own in safety.fingers:
            own.last = ZERO
        return NOT_FINITE
    least = 1.0
    for i, finger in enumerate(grasp.fingers):
        own = safety.fingers[i]
        share = share_of(grasp, finger, own)
        own.withheld = NOTHING
        if share < 1.0:
            new = share * finger.local
            own.withheld = new - finger.local
            finger.local = new
            least = min(least, share)
    fault = 0
    if least < 1.0:
        fault = react(grasp)
    for i, finger in enumerate(grasp.fingers):
        safety.fingers[i].last = finger.force
    safety.scale.soft = safety.gain / pace.trust if pace.trust > 0.0 else 0.0
    safety.scale.trust = pace.trust
    safety.scale.squeeze = grasp.squeeze
    safety.scale.outer = grasp.outer * least
    return NOT_FINITE if fault != 0 else 0


@kernel
def all_finite(grasp: GraspState, safety: SafetyState) -> bool:
    """Return whether forces and inputs of a sample are finite, and limits and gain are valid."""
    bad = 0.0
    for i, finger in enumerate(grasp.fingers):
        own = safety.fingers[i]
        e, r, f, g = finger.displacement, finger.rate, finger.local, finger.elastic
        sums = total(finger.position) + total(finger.velocity) + total(finger.force) + total(own.last)
        sums += e.x + e.y + e.z + e.t + r.x + r.y + r.z + r.t
        sums += f.x + f.y + f.z + f.t + g.x + g.y + g.z + g.t
        bad += 0.0 * sums if own.largest > 0.0 else 1.0
    return bad == 0.0 and safety.gain >= 0.0 and safety.gain <= 1.0


@kernel
def share_of(grasp: GraspState, finger: FingerState, own: FingerLimits) -> float:
    """Return the largest factor s <= 1 of a finger's force that satisfies the limits of rate, workspace and size."""
    f = finger.force
    size = math.sqrt(dot(f, f))
    if size == 0.0:
        return 1.0
    share = min(growth_share(f, own.last, own.growth), wall_share(grasp, finger, own))
    return min(share, own.largest / size)


@kernel
def growth_share(f: Vector, last: Vector, growth: float) -> float:
    """Compute the largest s <= 1 for which the distance of s f from the segment between zero and `last` is allowed.

    A force may decrease by any amount, so the distance from the segment, not from the last force, is limited. The set
    of allowed forces is a capsule that contains zero. The ray along f leaves the capsule once: through the side,
    through the cap around the last force or, if f'last <= 0, through the cap around zero.

    Args:
        f: Force of this sample [N].
        last: Force of the last sample [N].
        growth: Largest distance from the segment [N].
    """
    a, b, along = dot(f, f), dot(last, last), dot(f, last)
    t = 0.0
    if along > 0.0:
        t = along / b if along < b else 1.0
    gap = f - t * last
    if dot(gap, gap) <= growth * growth:
        return 1.0
    if along <= 0.0:
        return growth / math.sqrt(a)
    across = f - (along / b) * last  # component of f perpendicular to the last force
    side = math.sqrt(dot(across, across))
    if side * b >= growth * along:  # the ray leaves through the side of the segment
        return growth / side if side > growth else 1.0
    root = along * along - a * (b - growth * growth)
    return (along + math.sqrt(max(root, 0.0))) / a


@kernel
def wall_share(grasp: GraspState, finger: FingerState, own: FingerLimits) -> float:
    """Compute the largest s <= 1 for which the force does not push the finger out of its workspace.

    The force on the operator is -f. Near a wall of the workspace, the component of this force towards the wall is
    limited to L x/BAND, where x is the distance from the wall and L the largest force of the finger; outside the wall,
    the component must be zero.
    """
    share = 1.0
    for a in range(grasp.dimensions):
        f, p = finger.force[a], finger.position[a]
        room = (own.upper[a] - p) / BAND if f < 0.0 else (p - own.lower[a]) / BAND
        most = own.largest * max(room, 0.0)
        if abs(f) > most:
            share = min(share, most / abs(f))
    return share
