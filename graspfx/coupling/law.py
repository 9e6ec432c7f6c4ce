"""Equations (4) and (2) in a state block: forces without cones from displacements and rates, and their wrench."""

from __future__ import annotations

import math

from graspfx.compile.kernel import inline, kernel
from graspfx.coupling.contacts import LARGEST, LOST
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.grasp.rigid_modes import motion_of
from graspfx.spatial import ZERO, cross, dot, inner, total, with_torsion

FINE = 0


@kernel
def bilateral(grasp: GraspState, elastic: bool, damping: bool) -> None:
    """Compute the law's forces without cones: the elastic part, the damping part or both parts."""
    if grasp.dense:
        combine_matrices(grasp, elastic, damping)
        return
    e = 1.0 if elastic else 0.0
    r = 1.0 if damping else 0.0
    combine(
        grasp,
        e * grasp.external_stiffness,
        r * grasp.external_damping,
        e * grasp.internal_stiffness,
        r * grasp.internal_damping,
    )


@kernel
def combine(grasp: GraspState, kep: float, ked: float, kip: float, kid: float) -> None:
    """Compute f = P (kep e + ked e') + (I - P) (kip e + kid e') (eq. 4) with one projection of one vector.

    f = s + P d with s = kip e + kid e', d = (kep - kip) e + (ked - kid) e' and P = sum_k sqrt(w) q_k beta_k q_k'
    sqrt(w).
    """
    # without rotations the modes are the free translations, whose number is known at compile time
    modes = grasp.mode_count if grasp.freedom.turns != 0 else grasp.freedom.shifts
    count = modes if kep != kip or ked != kid else 0  # equal gains do not need P
    width, soft = grasp.width, grasp.coordinates > 3
    z = grasp.mode_force
    for k in range(6):
        z[k] = 0.0
    for i, finger in enumerate(grasp.fingers):
        s = kip * finger.displacement
        d = (kep - kip) * finger.displacement
        if kid != 0.0:
            s += kid * finger.rate
        if ked != kid:
            d += (ked - kid) * finger.rate
        finger.local = finger.weight * s
        if count > 0:
            root = math.sqrt(finger.weight)
            finger.sqrt_weight = root
            for k in range(count):
                motion = motion_of(grasp.modes[k], i, width)
                along = dot(motion.shift, d.vector)
                if soft:
                    along += motion.twist * d.t
                z[k] += root * along
    for k in range(count):
        z[k] *= grasp.modes[k, 0]
    if count > 0:
        for i, finger in enumerate(grasp.fingers):
            f = finger.local
            for k in range(count):
                motion = motion_of(grasp.modes[k], i, width)
                twist = motion.twist if soft else 0.0
                f += z[k] * finger.sqrt_weight * with_torsion(motion.shift, twist)
            finger.local = f


@kernel
def combine_matrices(grasp: GraspState, elastic: bool, damping: bool) -> None:
    """Compute f = K e + D e' with the matrices in the block."""
    c = grasp.coordinates
    for i, finger in enumerate(grasp.fingers):
        for a in range(c):
            f = 0.0
            for j, other in enumerate(grasp.fingers):
                for b in range(c):
                    if elastic:
                        f += grasp.stiffness[i * c + a, j * c + b] * other.displacement[b]
                    if damping:
                        f += grasp.damping[i * c + a, j * c + b] * other.rate[b]
            finger.local[a] = f


@kernel
def keep_elastic(grasp: GraspState) -> None:
    """Copy the forces to `elastic`, before damping is added."""
    for finger in grasp.fingers:
        finger.elastic = finger.local


@inline
def normal_force(finger: FingerState) -> float:
    """Compute the normal force of a finger on the object [N]."""
    return inner(finger.normal, finger.local.vector)


@kernel
def react(grasp: GraspState) -> int:
    """Compute the forces in world axes and the wrench f_v = G f about the object's centre (eq. 2).

    Return FINE, or LOST if the wrench is not finite.
    """
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
