"""Scaling of stiffness K and damping D by a factor gamma, for the soft start and for the trust in the readings.

The coupling applies gamma, so the forces on operator and object are both scaled. Because friction cones are invariant
to scaling, the forces for gamma K and gamma D are gamma times the forces for K and D. With the force limits L_i, they
are gamma times the forces for K and D with the limits L_i/gamma, so the step `limit` uses L_i/gamma.
"""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.loop.safety.safety_state import FingerLimits, Pace, SafetyState
from graspfx.loop.safety.tank import grow
from graspfx.loop.safety.trust import CAUSES, QUICK
from graspfx.spatial import dot


@kernel
def soften(grasp: GraspState, safety: SafetyState, pace: Pace, code: int) -> int:
    """Compute gamma of this sample, set the force limits to L_i/gamma, and check the speeds of the fingers.

    The result is `code`, the cause returned by `keep_pace`; if it is not zero, gamma does not change.
    """
    if code == 0:
        grow(grasp, safety, pace.soft * pace.trust)
    gain = safety.gain
    grasp.squeeze = grasp.outer = safety.elapsed = 1.0
    for i, finger in enumerate(grasp.fingers):
        own = safety.fingers[i]
        own.largest = min(finger.limit, own.force)
        quick = is_quick(finger, own, pace.elapsed)
        safety.elapsed = max(safety.elapsed, own.elapsed)
        if pace.cause == 0 and quick:
            pace.cause = QUICK + CAUSES * own.number
        finger.limit = own.largest / gain if gain > 0.0 else math.inf
    return code


@kernel
def is_quick(finger: FingerState, own: FingerLimits, elapsed: float) -> bool:
    """Return whether a finger exceeds its largest speed, according to the reported velocity or to positions.

    The velocity that a driver reports may be delayed, filtered or always zero. Each new position is therefore also
    compared with the positions of the second, third and fourth last new readings. Successive readings are not compared,
    because their difference may be due to the resolution of the sensor. Three intervals are used, because the positions
    of an oscillation may be equal after one or two of these intervals, but not after all three. A reading is new if the
    position has changed.
    """
    quick = dot(finger.velocity, finger.velocity) > own.speed * own.speed
    track = own.track
    if own.time == 0.0:
        for a in range(4):  # the track starts at rest
            track[a].position = finger.position
            track[a].time = elapsed - a
    own.time += elapsed
    own.elapsed = 0.0
    step = finger.position - track[0].position
    if dot(step, step) != 0.0:
        for a in range(1, 4):
            way, most = finger.position - track[a].position, (own.time - track[a].time) * own.stride
            if dot(way, way) > most * most:
                quick = True
        own.elapsed = own.time - track[0].time
        for a in range(3, 0, -1):
            track[a].position = track[a - 1].position
            track[a].time = track[a - 1].time
        track[0].position = finger.position
        track[0].time = own.time
    return quick


@kernel
def apply_gain(grasp: GraspState, safety: SafetyState) -> None:
    """Multiply limited forces, elastic forces and forces of the law by gamma, and restore the limits L_i."""
    gain = safety.gain
    for i, finger in enumerate(grasp.fingers):
        finger.limit = safety.fingers[i].largest
        if gain != 1.0:
            finger.local = gain * finger.local
            finger.elastic = gain * finger.elastic
            finger.law_force = gain * finger.law_force
