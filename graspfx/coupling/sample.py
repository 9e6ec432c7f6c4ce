"""One complete sample: contacts, split, forces of eq. (4) in cones and limits, and the object's wrench."""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats
from graspfx.coupling.contact_frames import coordinates_of, out_of_frame
from graspfx.coupling.contacts import AGAIN, EXCESSIVE, approach, fade, refactor, turn_axes
from graspfx.coupling.coulomb import force_with_friction, move_anchors
from graspfx.coupling.frictionless import frictionless_force
from graspfx.coupling.gains import fill_gains
from graspfx.coupling.grasp_state import GraspState
from graspfx.coupling.implicit import assemble_implicitly
from graspfx.coupling.law import FINE, bilateral, keep_elastic, normal_force, react
from graspfx.coupling.limit import forget_limits, limit
from graspfx.coupling.pad import press, relax
from graspfx.coupling.recoil import recoil
from graspfx.coupling.rules import compliance_of_numbers
from graspfx.coupling.unilateral import unilateral
from graspfx.grasp.rigid_modes import motion_of
from graspfx.spatial import NOTHING, ZERO, dot


@kernel
def sample(grasp: GraspState) -> int:
    """Compute forces and the wrench from the motion; return FINE, or a fault with all forces zero."""
    fault = couple(grasp)
    if grasp.limited:
        fault = limit(grasp, fault)
    return conclude(grasp, fault)


@kernel
def couple(grasp: GraspState) -> int:
    """Compute the law's forces from the motion; return FINE or a fault."""
    fault = approach(grasp)
    passes = grasp.count  # in the worst case the fingers lose their anchors one by one
    if fault == FINE:
        resplit(grasp)
        fault = respond(grasp, True)
        if grasp.padded:
            relax(grasp)
    while fault == AGAIN:
        resplit(grasp)
        passes -= 1
        fault = respond(grasp, passes > 0)
        if grasp.padded:
            relax(grasp)
    return find_excess(grasp) if fault == FINE else fault


@kernel
def find_excess(grasp: GraspState) -> int:
    """Return EXCESSIVE, and store the largest force, if the force of a finger exceeds `force_bound`.

    Otherwise, return FINE.
    """
    largest = grasp.force_bound * grasp.force_bound
    fault = FINE
    for finger in grasp.fingers:
        f = finger.local.vector
        square = dot(f, f)
        if square > largest:
            largest = square
            fault = EXCESSIVE
    if fault != FINE:
        grasp.excess = math.sqrt(largest)
    return fault


@kernel
def resplit(grasp: GraspState) -> None:
    """Update the split if the gains require a split, and update K and D of matrix gains."""
    if grasp.mixed:
        turn_axes(grasp)
    if not grasp.equal or grasp.recoils:
        refactor(grasp)
    if grasp.dense:
        fill_gains(grasp)


@kernel
def respond(grasp: GraspState, again: bool) -> int:
    """Compute the forces on the object; return FINE, a fault or AGAIN.

    AGAIN means that the split has changed and the forces must be recomputed. It is returned only if `again` is true.
    """
    if grasp.attached:
        return attached(grasp)
    if grasp.padded:
        fault = press(grasp)
        if fault != FINE:
            return fault
    if grasp.friction:
        return force_with_friction(grasp)
    if grasp.rays:
        return frictionless_force(grasp)
    return unilateral(grasp, again)


@kernel
def conclude(grasp: GraspState, fault: int) -> int:
    """Write the wrench of the forces to the object, or zero after a fault; return FINE or the fault."""
    if fault == FINE:
        if grasp.friction:
            move_anchors(grasp)
        fault = react(grasp)
        if grasp.fade and not grasp.equal:
            check_fade(grasp)
        if grasp.freedom.turns != 0 and not grasp.equal and grasp.blended != 0:
            grasp.in_band += 1.0
    if fault != FINE:
        let_go(grasp)
    return fault


@kernel
def let_go(grasp: GraspState) -> None:
    """Set the forces on every finger and on the object to zero."""
    for finger in grasp.fingers:
        finger.touching = False
        finger.status = 0
        finger.force = ZERO
        finger.moment = ZERO
        finger.local = NOTHING
        finger.retained = NOTHING
    grasp.body.force = ZERO
    grasp.body.moment = ZERO
    if grasp.limited:
        forget_limits(grasp)


@kernel
def check_fade(grasp: GraspState) -> None:
    """Update the shortfall of `fade_start`.

    A free finger whose gap is smaller than 1/2 |1/kep - 1/kip| sum |f| can touch again.
    """
    release = grasp.release
    if not grasp.dense:
        release = compliance_of_numbers(grasp.external_stiffness, grasp.internal_stiffness)
    total = 0.0
    for finger in grasp.fingers:
        total += normal_force(finger)
    grasp.shortfall = max(grasp.shortfall, release * total - grasp.fade_start)


@kernel
def external_forces(grasp: GraspState, out: Floats) -> int:
    """Write the external part P f of this sample's forces, three components per finger in object axes [N].

    P is computed from the grasp's modes and equals that of `two_forces.divide`. The function returns FINE. The kernel
    runs after the body has moved, so the object axes are those of the recorded pose.
    """
    if grasp.fade:
        for finger in grasp.fingers:
            fade(grasp, finger)
    refactor(grasp)
    for i in range(grasp.count):
        finger = grasp.fingers[i]
        f = ZERO
        if finger.weight > 0.0:
            root = math.sqrt(finger.weight)
            for k in range(grasp.mode_count):
                mode = grasp.modes[k]
                f += (mode[0] * root * along_mode(grasp, mode)) * motion_of(mode, i, grasp.width).shift
        out[3 * i], out[3 * i + 1], out[3 * i + 2] = f.x, f.y, f.z
    return FINE


@kernel
def along_mode(grasp: GraspState, mode: Floats) -> float:
    """Compute z_k = sum_i q_k(i) . f_i / sqrt(w_i) over the fingers with positive weight."""
    z = 0.0
    for i, finger in enumerate(grasp.fingers):
        if finger.weight > 0.0:
            motion = motion_of(mode, i, grasp.width)
            share = dot(motion.shift, finger.local.vector)
            if grasp.width > 3:
                share += motion.twist * finger.local.t
            z += share / math.sqrt(finger.weight)
    return z


@kernel
def attached(grasp: GraspState) -> int:
    """Compute bilateral forces (with the implicit integrator, at the end of the sample); return 0."""
    apart = grasp.observed or grasp.limited
    if apart:
        attach(grasp, False)
        keep_elastic(grasp)
    if grasp.damped or not apart:
        attach(grasp, grasp.damped)
    return 0


@kernel
def attach(grasp: GraspState, damped: bool) -> None:
    """Compute the forces of eq. (4), with damping if `damped` is true."""
    if grasp.recoils:
        recoil(grasp, damped, False)
        return
    if not grasp.implicit:
        bilateral(grasp, True, damped)
        return
    assemble_implicitly(grasp, True, damped, False)
    for i, finger in enumerate(grasp.fingers):
        finger.local = out_of_frame(grasp, finger, coordinates_of(grasp, grasp.vector, i))
