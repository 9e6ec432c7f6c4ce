"""The step `limit` of a sample: the law's forces within what the devices display, before the object receives them.

A limit at the device alone creates energy, for the object receives what nobody displayed. The normal way is inside the
projection: the cones are cut off at |f_i| <= L_i and the sample is asked once more, so that the elastic force stays the
gradient of a convex function (`graspfx.cones.cut`). Whatever is still too long is scaled (`graspfx.coupling.scaling`).
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

NEARLY = 1.0 - 1e-12  # of a limit: a force of that size stands at it


@kernel
def limit(grasp: GraspState, fault: int) -> int:
    """Bring the forces of a sample within the limits; give `fault`, or UNRESOLVED.

    The law's own forces stay in the block, and who stands at a limit. Nothing changes where all are short enough.
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
    """Scale what was added to the forces since `limit` and the reaction to them; it counts as the law's."""
    for finger in grasp.fingers:
        finger.law_force -= finger.force
    react(grasp)
    for finger in grasp.fingers:
        finger.law_force += finger.force
    scale(grasp, False)
    mark(grasp, False)


@kernel
def forget_limits(grasp: GraspState) -> None:
    """Clear the law's force and who stands at a limit."""
    for finger in grasp.fingers:
        finger.saturated = False
        finger.law_force = ZERO


@kernel
def store_law(grasp: GraspState) -> None:
    """Copy the forces, in world axes, to the law's; nobody stands at a limit yet."""
    react(grasp)
    for finger in grasp.fingers:
        finger.saturated = False
        finger.law_force = finger.force


@kernel
def exceeds(grasp: GraspState) -> bool:
    """Tell whether some finger's force, or its elastic one, is beyond the limit."""
    beyond = False
    for finger in grasp.fingers:
        most = LIMIT_MARGIN * finger.limit
        if force_size(finger.local, width(grasp)) > most or force_size(finger.elastic, width(grasp)) > most:
            beyond = True
    return beyond


@kernel
def width(grasp: GraspState) -> int:
    """Count the entries of a force that the limit is about: torsion too where friction bounds both together."""
    return 4 if grasp.friction else 3


@kernel
def mark(grasp: GraspState, inside: bool) -> None:
    """Mark the fingers whose force stands at the limit; inside the projection, also whose elastic force does."""
    for finger in grasp.fingers:
        least = NEARLY * LIMIT_MARGIN * finger.limit
        if force_size(finger.local, width(grasp)) >= least:
            finger.saturated = True
        if inside and force_size(finger.elastic, width(grasp)) >= least:
            finger.saturated = True


@kernel
def is_inside(grasp: GraspState) -> bool:
    """Tell whether the projection itself can be asked for forces within limits.

    Not with the implicit integrator, nor where gains are matrices and there is no coefficient of friction, nor where
    compliant fingertips stick.
    """
    if grasp.padded and grasp.stick and not grasp.equal:
        return False
    return not grasp.implicit and (grasp.friction or not grasp.dense)


@kernel
def force_in_cut_cones(grasp: GraspState) -> int:
    """Find the forces of the cut cones: the elastic one, then damping; give 0 or UNRESOLVED."""
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
    """Limit every finger by itself, where gains are equal: elastic force and sum are shortened one after the other."""
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
    """Find the forces of attached and sticking contacts nearest to the law's, by K^-1 and D^-1, with |f_i| <= L_i.

    Fingers that the law has let go of stay free, and those that it holds only push; give 0 or UNRESOLVED.
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
    """Find the elastic force of balls for cones, or add damping to the one that is there; give 0 or UNRESOLVED."""
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
