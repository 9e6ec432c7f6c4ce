"""End of the safety chain: limits on the rate, workspace and size of each finger's force, by scaling the whole force.

Finger i exerts s_i f_i with 0 <= s_i <= 1, so no force leaves its cone. The wrench and the energy ledger use s_i f_i.
The set of forces that a rule admits is star-shaped about zero, so the smallest s_i of all rules satisfies every rule.
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
    """Bring the final forces within all limits; return NOT_FINITE if they or their inputs are not finite, else 0."""
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
    """Return whether the forces of a sample and their inputs are finite and the limits are valid."""
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
    """Return the largest scale of a finger's force, at most 1, that respects the limits on rate, workspace and size."""
    f = finger.force
    size = math.sqrt(dot(f, f))
    if size == 0.0:
        return 1.0
    share = min(growth_share(f, own.last, own.growth), wall_share(grasp, finger, own))
    return min(share, own.largest / size)


@kernel
def growth_share(f: Vector, last: Vector, growth: float) -> float:
    """Find the largest s <= 1 for which s f is at most `growth` from the segment between the last force and zero.

    A force may decrease without limit; from any point of the segment it may grow or turn by `growth`. The admitted set
    is a capsule that contains zero. The ray along f leaves it once: through its side, the cap around the last force or,
    if f does not point along the last force, the cap around zero.
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
    """Find the largest scale s <= 1 at which the force does not push the finger out of its workspace.

    The operator feels -f. At the distance x from a wall, the component towards the wall is at most L x/BAND, where L
    is the finger's largest force; beyond the wall the component is zero.
    """
    share = 1.0
    for a in range(grasp.dimensions):
        f, p = finger.force[a], finger.position[a]
        room = (own.upper[a] - p) / BAND if f < 0.0 else (p - own.lower[a]) / BAND
        most = own.largest * max(room, 0.0)
        if abs(f) > most:
            share = min(share, most / abs(f))
    return share
