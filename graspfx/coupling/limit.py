"""The step `limit` of a sample: before the object moves, the law's forces are limited to what devices can display.

A limit only at the device would generate energy, because the object would receive forces that are not displayed. The
limit is normally part of the projection: the cones are cut off at |f_i| <= L_i and the sample is solved again. The
elastic force then remains the gradient of a convex function (`graspfx.cones.cut`). Forces that are still too large are
scaled (`graspfx.coupling.scaling`).
"""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.cones.cut import HALF_SPACE, NO_CONE, force_size, shorten
from graspfx.cones.friction import UNRESOLVED as NONE
from graspfx.cones.problem import FrictionProblem, Gains
from graspfx.coupling.contact_frames import in_frame, out_of_frame
from graspfx.coupling.contacts import UNRESOLVED
from graspfx.coupling.conventional import damp_alone
from graspfx.coupling.coulomb import force_of_modes, force_with_friction, pose_compliances, pose_problem
from graspfx.coupling.frictionless import frictionless_force
from graspfx.coupling.grasp_state import GraspState
from graspfx.coupling.law import bilateral, keep_elastic
from graspfx.coupling.pad import press, relax
from graspfx.coupling.react import react
from graspfx.coupling.scaling import LIMIT_MARGIN, scale
from graspfx.spatial import NOTHING, ZERO

NEARLY = 1.0 - 1e-12  # fraction of a limit from which a force counts as limited


@kernel
def limit(grasp: GraspState, fault: int) -> int:
    """Reduce the forces of a sample to the limits; return `fault`, or UNRESOLVED.

    The block stores the law's unlimited forces and marks the fingers at a limit. Forces within the limits are
    unchanged.
    """
    store_law(grasp)
    if fault != 0 or not exceeds(grasp):
        return fault
    inside = is_inside(grasp)
    if inside:
        for finger in grasp.fingers:
            finger.cut = LIMIT_MARGIN * finger.limit
        fault = force_in_cut_cones(grasp)
        if grasp.padded:
            relax(grasp)
        for finger in grasp.fingers:
            finger.cut = math.inf
    if fault == 0:
        scale(grasp, True)
        mark(grasp, inside)
    return fault


@kernel
def limit_again(grasp: GraspState) -> None:
    """Limit forces that were increased after `limit`; add the same increase to the law's forces."""
    for finger in grasp.fingers:
        finger.law_force -= finger.force
    react(grasp)
    for finger in grasp.fingers:
        finger.law_force += finger.force
    scale(grasp, False)
    mark(grasp, False)


@kernel
def forget_limits(grasp: GraspState) -> None:
    """Clear the law's force and the marks of fingers at a limit."""
    for finger in grasp.fingers:
        finger.saturated = False
        finger.law_force = ZERO


@kernel
def store_law(grasp: GraspState) -> None:
    """Store the forces, in world axes, as the law's forces, and clear the marks of fingers at a limit."""
    react(grasp)
    for finger in grasp.fingers:
        finger.saturated = False
        finger.law_force = finger.force


@kernel
def exceeds(grasp: GraspState) -> bool:
    """Return whether the force or the elastic force of some finger exceeds its limit."""
    beyond = False
    for finger in grasp.fingers:
        most = LIMIT_MARGIN * finger.limit
        if force_size(finger.local, width(grasp)) > most or force_size(finger.elastic, width(grasp)) > most:
            beyond = True
    return beyond


@kernel
def width(grasp: GraspState) -> int:
    """Count the limited entries of a force; torsion is included if friction bounds it together with the force."""
    return 4 if grasp.friction else 3


@kernel
def mark(grasp: GraspState, inside: bool) -> None:
    """Mark the fingers whose force or, if `inside` the projection, whose elastic force is at the limit."""
    for finger in grasp.fingers:
        least = NEARLY * LIMIT_MARGIN * finger.limit
        if force_size(finger.local, width(grasp)) >= least:
            finger.saturated = True
        if inside and force_size(finger.elastic, width(grasp)) >= least:
            finger.saturated = True


@kernel
def is_inside(grasp: GraspState) -> bool:
    """Return whether the projection can respect the limits.

    The projection cannot respect limits with the implicit integrator, with matrix gains without a coefficient of
    friction, or with sticking compliant fingertips.
    """
    if grasp.padded and grasp.stick and not grasp.equal:
        return False
    return not grasp.implicit and (grasp.friction or not grasp.dense)


@kernel
def force_in_cut_cones(grasp: GraspState) -> int:
    """Compute the elastic force in the limited cones, then add damping in them; return 0 or UNRESOLVED."""
    if grasp.padded:
        fault = press(grasp)
        if fault != 0:
            return fault
        keep_elastic(grasp)
    if grasp.friction:
        return force_with_friction(grasp)
    if grasp.rays:
        return frictionless_force(grasp)
    if grasp.equal:
        limit_alone(grasp)
        return 0
    return force_in_balls(grasp)


@kernel
def limit_alone(grasp: GraspState) -> None:
    """For equal gains, limit each finger separately: shorten its elastic force, then the sum with damping."""
    for finger in grasp.fingers:
        finger.local = finger.elastic
    shorten_all(grasp)
    keep_elastic(grasp)
    if grasp.damped:
        if grasp.attached:
            bilateral(grasp, False, True)
            for finger in grasp.fingers:
                finger.local += finger.elastic
        else:
            damp_alone(grasp)
        shorten_all(grasp)


@kernel
def shorten_all(grasp: GraspState) -> None:
    """Shorten every force to its limit."""
    for finger in grasp.fingers:
        finger.local, _ = shorten(finger.local, width(grasp), finger.cut)


@kernel
def force_in_balls(grasp: GraspState) -> int:
    """Compute the forces with |f_i| <= L_i that are nearest to the law's forces, in the norms of K^-1 and D^-1.

    Contacts are attached or sticking. Fingers that the law released stay free; touching fingers only push. Return 0
    or UNRESOLVED.
    """
    gains = Gains(grasp.external_stiffness, grasp.internal_stiffness)
    fault = force_in_ball(grasp, grasp.problem, gains, True)
    keep_elastic(grasp)
    if fault == 0 and grasp.damped:
        gains = Gains(grasp.external_damping, grasp.internal_damping)
        fault = force_in_ball(grasp, grasp.damping_problem, gains, False)
    return fault


@kernel
def force_in_ball(grasp: GraspState, problem: FrictionProblem, gains: Gains, elastic: bool) -> int:
    """Compute the elastic force with balls instead of cones, or add damping to it; return 0 or UNRESOLVED."""
    pose_problem(grasp, problem, True)
    for i, finger in enumerate(grasp.fingers):
        contact = problem.contacts[i]
        contact.coefficient = NO_CONE if grasp.attached else HALF_SPACE
        contact.displacement = in_frame(grasp, finger, finger.displacement if elastic else finger.rate)
        contact.base_force = NOTHING
        if not elastic:
            contact.base_force = in_frame(grasp, finger, finger.local)
    if not elastic:
        pose_compliances(grasp, problem)
    law = force_of_modes(grasp, problem, gains, False).law
    for i, finger in enumerate(grasp.fingers):
        finger.local = out_of_frame(grasp, finger, problem.contacts[i].force)
    return UNRESOLVED if law == NONE else 0
