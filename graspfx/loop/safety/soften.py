"""Stiffness and damping of a sample scaled by gamma: soft start and trust, on the coupling, so that both sides see it.

Cones are cones: with gamma K and gamma D the law's force is gamma times that of K and D. Cut at |f_i| <= L_i it is
gamma times that of K and D cut at L_i/gamma, which is what the step `limit` is asked for in between.
"""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.coupling.grasp_state import GraspState
from graspfx.loop.safety.safety_state import Pace, SafetyState
from graspfx.loop.safety.tank import grow
from graspfx.loop.safety.trust import CAUSES, QUICK
from graspfx.spatial import dot


@kernel
def soften(grasp: GraspState, safety: SafetyState, pace: Pace, code: int) -> int:
    """Find gamma of this sample, watch the fingers' speeds, and let `limit` work at L_i/gamma; give `code`."""
    if code == 0:
        grow(grasp, safety, pace.soft * pace.trust)
    gain = safety.gain
    grasp.squeeze = grasp.outer = 1.0
    for i, finger in enumerate(grasp.fingers):
        own = safety.fingers[i]
        own.largest = min(finger.limit, own.force)
        if pace.cause == 0 and dot(finger.velocity, finger.velocity) > own.speed * own.speed:
            pace.cause = QUICK + CAUSES * own.number
        finger.limit = own.largest / gain if gain > 0.0 else math.inf
    return code


@kernel
def apply_gain(grasp: GraspState, safety: SafetyState) -> None:
    """Scale the limited forces by gamma, the elastic ones and the law's too; limits are L_i again."""
    gain = safety.gain
    for i, finger in enumerate(grasp.fingers):
        finger.limit = safety.fingers[i].largest
        if gain != 1.0:
            finger.local = gain * finger.local
            finger.elastic = gain * finger.elastic
            finger.law_force = gain * finger.law_force
