"""The end of the safety chain: growth, workspace and size of each finger's force, which is only ever scaled as a whole.

A share s_i of the force of finger i is what comes out, so that no finger leaves its cone; the wrench and all accounts
are those of s_i f_i. Each rule leaves a set of forces that holds, with a force, all shares of it: the least share of
the rules keeps all of them.
"""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.react import react
from graspfx.loop.safety.safety_state import FingerLimits, Pace, SafetyState
from graspfx.loop.safety.trust import NOT_FINITE
from graspfx.spatial import NOTHING, ZERO, Vector, dot, total

BAND = 0.005  # before a wall of the workspace, over which the outward part of a force goes to zero [m]


@kernel
def restrain(grasp: GraspState, safety: SafetyState, pace: Pace) -> int:
    """Bring the finished forces within all limits; give 0, or NOT_FINITE and forces of zero."""
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
    """Tell whether all that goes into the forces of a sample, and these, are finite, and the limits are limits."""
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
    """Give the largest share of a finger's force, at most 1, that keeps growth, workspace and size."""
    f = finger.force
    size = math.sqrt(dot(f, f))
    if size == 0.0:
        return 1.0
    share = min(growth_share(f, own.last, own.growth), wall_share(grasp, finger, own))
    return min(share, own.largest / size)


@kernel
def growth_share(f: Vector, last: Vector, growth: float) -> float:
    """Find the largest share s <= 1 with s f at most `growth` from the segment between the last force and zero.

    To let go is free, from there a force grows or turns by so much: a convex set with zero inside, which the ray along
    f leaves once, through the side of the segment or through the cap around the last force.
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
    across = f - (along / b) * last  # of f, at right angles to the last force
    side = math.sqrt(dot(across, across))
    if side * b >= growth * along:  # it leaves before the last force's foot
        return growth / side if side > growth else 1.0
    root = along * along - a * (b - growth * growth)
    return (along + math.sqrt(max(root, 0.0))) / a


@kernel
def wall_share(grasp: GraspState, finger: FingerState, own: FingerLimits) -> float:
    """Find the largest share s <= 1 of a force that pushes no finger out of its workspace.

    The operator feels -f. Its part outward along an axis is at most L x/BAND at the distance x from that wall, and
    nothing beyond.
    """
    share = 1.0
    for a in range(grasp.dimensions):
        f, p = finger.force[a], finger.position[a]
        room = (own.upper[a] - p) / BAND if f < 0.0 else (p - own.lower[a]) / BAND
        most = own.largest * max(room, 0.0)
        if abs(f) > most:
            share = min(share, most / abs(f))
    return share
