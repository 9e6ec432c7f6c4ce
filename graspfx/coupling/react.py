"""Reaction of a sample: forces in world axes, and their wrench on the object."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.coupling.contacts import LARGEST, LOST
from graspfx.coupling.grasp_state import GraspState
from graspfx.spatial import ZERO, cross, total

FINE = 0


@kernel
def react(grasp: GraspState) -> int:
    """Compute forces in world axes and their wrench f_v = G f about the object's centre (eq. 2); LOST if not finite."""
    motion = grasp.motion
    force = moment = ZERO
    for finger in grasp.fingers:
        f = finger.local.vector
        if grasp.dimensions > 1:
            f = motion.rotation @ f
        finger.force = f
        force += f
        if grasp.dimensions > 1:
            point = finger.contact_world if grasp.at_contact else finger.position
            moment += cross(point - motion.position, f)
        if grasp.friction or grasp.coordinates > 3:
            finger.normal_world = motion.rotation @ finger.normal if grasp.dimensions > 1 else finger.normal
        if grasp.coordinates > 3:
            finger.moment = motion.rotation @ (finger.patch * finger.local.t * finger.twist_axis)
            finger.twist_axis_world = motion.rotation @ finger.twist_axis
            moment += finger.moment
    grasp.body.force = force
    grasp.body.moment = moment
    return FINE if abs(total(force) + total(moment)) <= LARGEST else LOST
