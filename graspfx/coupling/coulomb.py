"""Coulomb friction: elastic and damping forces in the friction cones, and displacements retained after slip."""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Table
from graspfx.cones.cone import force_size
from graspfx.cones.friction import (
    COULOMB,
    LEAST,
    friction_force,
    friction_force_flexible,
    friction_force_square,
    turn_modes,
)
from graspfx.cones.friction import UNRESOLVED as NONE
from graspfx.cones.problem import FREE, NO_FORCE, STICK, Answer, FrictionProblem, Gains, dot4, leading, tangent_of
from graspfx.coupling.contact_frames import assemble, coordinates_of, in_frame, out_of_frame, write_coordinates
from graspfx.coupling.contacts import UNRESOLVED, set_anchor
from graspfx.coupling.damping_flexibility import damping_in_columns
from graspfx.coupling.depth import compliance, is_whole, soften
from graspfx.coupling.flexibility import pose_elastic
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.implicit import assemble_implicitly
from graspfx.coupling.law import bilateral, keep_elastic
from graspfx.coupling.recoil import recoil
from graspfx.spatial import NOTHING, Vector4

RESTARTS = 2  # restarts for Coulomb's law per sample; the last sample's solution is nearly always a good initial guess
SYMMETRIC = 1e-12  # tolerance of symmetry, relative to a matrix's largest entry
SMALLEST = 1e-200  # smaller forces count as zero, because their squares underflow [N]


@kernel
def force_with_friction(grasp: GraspState) -> int:
    """Compute the elastic force f = K (e + s) in the friction cones, then add damping; return 0 or UNRESOLVED.

    The elastic force satisfies Coulomb's law or, if the search found no such force, the associated law. A sticking
    finger keeps its contact point. The field `retained` of a slipping or free finger determines the contact point of
    the next sample.
    """
    fault = elastic_in_cones(grasp)
    if grasp.observed or grasp.limited:
        keep_elastic(grasp)
    if fault == 0 and grasp.damped:
        fault = damping_in_cones(grasp)
    return fault


@kernel
def elastic_in_cones(grasp: GraspState) -> int:
    """Compute the elastic force in the cones, each finger's status and its displacement e + s after slip.

    Return 0 or UNRESOLVED.
    """
    problem = grasp.problem
    grasp.law, grasp.residual = COULOMB, 0.0
    if grasp.recoils or (not grasp.implicit and not grasp.rays):
        if grasp.recoils:
            recoil(grasp, False, False)
        else:
            bilateral(grasp, True, False)
        if sticks(grasp):
            stick_all(grasp, problem)
            return 0
    pose_problem(grasp, problem, False)
    for i, finger in enumerate(grasp.fingers):
        problem.contacts[i].displacement = in_frame(grasp, finger, finger.displacement)
        problem.contacts[i].base_force = NOTHING
    if grasp.recoils:
        answer = force_of_recoil(grasp, problem)
    elif grasp.implicit or grasp.dense:
        if grasp.implicit:
            assemble_implicitly(grasp, True, False, False)
        else:
            assemble(grasp, True)
        symmetric = symmetrise(grasp, grasp.square)
        answer = friction_force_square(problem, grasp.coordinates, grasp.square, symmetric, True, RESTARTS)
    else:
        answer = force_of_modes(grasp, problem, Gains(grasp.external_stiffness, grasp.internal_stiffness), True)
    grasp.law, grasp.residual = answer.law, answer.residual
    for i, finger in enumerate(grasp.fingers):
        contact = problem.contacts[i]
        finger.local = out_of_frame(grasp, finger, contact.force)
        finger.retained = out_of_frame(grasp, finger, contact.slip + contact.displacement)
        finger.status = max(contact.status, 0)
        finger.touching = finger.status != FREE
        if finger.weight == 0.0:
            finger.retained = NOTHING
    return UNRESOLVED if answer.law == NONE else 0


@kernel
def sticks(grasp: GraspState) -> bool:
    """Return whether the forces of all fingers lie inside their friction cones and limits."""
    inside = True
    for finger in grasp.fingers:
        inside = inside and is_inside_cone(grasp, finger, in_frame(grasp, finger, finger.local))
    return inside


@kernel
def is_inside_cone(grasp: GraspState, finger: FingerState, force: Vector4) -> bool:
    """Return whether a force in the contact frame lies inside the finger's friction cone and limit."""
    tangent = tangent_of(force)
    along = math.sqrt(tangent.x * tangent.x + tangent.y * tangent.y + tangent.z * tangent.z)
    if not force.x > SMALLEST or along > finger.coefficient * force.x:
        return False
    return not (grasp.limited and force_size(force, grasp.coordinates) > finger.cut)


@kernel
def stick_all(grasp: GraspState, problem: FrictionProblem) -> None:
    """Accept the present forces as the solution, with all fingers sticking, and as the start of the next search."""
    if grasp.dense:
        for i, finger in enumerate(grasp.fingers):
            e = in_frame(grasp, finger, finger.displacement)
            write_coordinates(grasp, grasp.start, i, e)
        for k in range(grasp.count * grasp.coordinates):
            problem.unknowns[k].value = grasp.start[k]
    elif grasp.recoils:
        grasp.recoil.stuck = True
    else:
        for k in range(grasp.mode_count):
            problem.unknowns[k].value = -grasp.mode_force[k]
        problem.started = max(problem.started, grasp.mode_count)
    for finger in grasp.fingers:
        finger.touching, finger.status = True, STICK
        finger.retained = finger.displacement


@kernel
def move_anchors(grasp: GraspState) -> None:
    """Set the torsion anchors of soft fingers that slip or are free to the object's present rotation."""
    if grasp.coordinates > 3:
        for finger in grasp.fingers:
            if finger.status != STICK:
                set_anchor(grasp, finger, finger.retained.t)


@kernel
def damping_in_cones(grasp: GraspState) -> int:
    """Add passive damping to the elastic force f0; return 0 or UNRESOLVED.

    The force is f = f0 + D (e' + s) with f in the friction cones, s in the dual cones and f's = 0. A finger with f0 = 0
    has f = 0.

    With the implicit integrator, f = K (e + s0 - G'u) + (D / T) (T e' - H'u) + (K + D / T) s is solved together with
    the object's displacement u. Here s0 is the slip of the elastic force, T the period, and G and H are the lever arms
    of springs and dampers.
    """
    if damping_stays(grasp):
        return 0
    problem = grasp.damping_problem
    pose_problem(grasp, problem, True)
    if grasp.recoils:
        law = damping_of_recoil(grasp, problem)
    elif grasp.implicit:
        law = damping_in_square(grasp, problem)
    else:
        law = damping_of_slip(grasp, problem)
    for i, finger in enumerate(grasp.fingers):
        finger.local = out_of_frame(grasp, finger, problem.contacts[i].force)
    return UNRESOLVED if law == NONE else 0


@kernel
def damping_stays(grasp: GraspState) -> bool:
    """Add full damping if all fingers touch and the forces stay in the cones; return whether damping was added."""
    closed = grasp.recoils or (not grasp.implicit and not grasp.rays)
    if not closed or not all_touch(grasp) or not is_whole(grasp):
        return False
    keep_elastic(grasp)
    if grasp.recoils:
        recoil(grasp, True, True)
    else:
        bilateral(grasp, False, True)
        for finger in grasp.fingers:
            finger.local += finger.elastic
    if sticks(grasp):
        return True
    for finger in grasp.fingers:
        finger.local = finger.elastic
    return False


@kernel
def force_of_recoil(grasp: GraspState, problem: FrictionProblem) -> Answer:
    """Compute the elastic force on a recoiling object in modal unknowns or, if this search fails, in all unknowns.

    If all forces of the last sample lay inside their cones, the search starts from the present bilateral forces.
    """
    kep, kip = grasp.external_stiffness, grasp.internal_stiffness
    pose_elastic(grasp, problem, grasp.coordinates)
    if grasp.recoil.stuck:
        start_from_forces(grasp, problem)
    answer = friction_force_flexible(problem, grasp.coordinates, kip, max(kep, kip), kep <= kip, True, RESTARTS)
    grasp.recoil.stuck = answer.law == NONE
    if answer.law == NONE:
        forget_start(problem)
        assemble_implicitly(grasp, True, False, False)
        symmetric = symmetrise(grasp, grasp.square)
        answer = friction_force_square(problem, grasp.coordinates, grasp.square, symmetric, True, RESTARTS)
        forget_start(problem)
    return answer


@kernel
def start_from_forces(grasp: GraspState, problem: FrictionProblem) -> None:
    """Set the start of the search from the fingers' forces: z_k = h_k v_k'y, with the symbols of `cones.equations`."""
    for k in range(problem.modes):
        problem.unknowns[k].value = 0.0
    for i, finger in enumerate(grasp.fingers):
        if finger.weight > 0.0:
            y = (1.0 / finger.sqrt_weight) * in_frame(grasp, finger, finger.local)
            for k in range(problem.modes):
                motion = leading(problem.contacts[i].modes[k].motion, grasp.coordinates)
                problem.unknowns[k].value += problem.unknowns[k].share * dot4(motion, y)
    problem.started = problem.modes


@kernel
def forget_start(problem: FrictionProblem) -> None:
    """Reset the initial guess of the next search to zero."""
    for k in range(problem.room):
        problem.unknowns[k].value = 0.0
    problem.started = 0


@kernel
def damping_in_square(grasp: GraspState, problem: FrictionProblem) -> int:
    """Solve for elastic and damping forces together with the full matrix; return the law of the solution."""
    assemble_implicitly(grasp, True, True, True)
    for i in range(grasp.count):
        problem.contacts[i].displacement = NOTHING
        problem.contacts[i].base_force = coordinates_of(grasp, grasp.vector, i)
    symmetric = symmetrise(grasp, grasp.square)
    return friction_force_square(problem, grasp.coordinates, grasp.square, symmetric, False, 0).law


@kernel
def damping_of_recoil(grasp: GraspState, problem: FrictionProblem) -> int:
    """Solve for elastic and damping forces on a recoiling object; return the law of the solution."""
    keep_elastic(grasp)
    law = damping_in_columns(grasp, problem, grasp.coordinates, True)
    if law == NONE:
        forget_start(problem)
        law = damping_in_square(grasp, problem)
        forget_start(problem)
    return law


@kernel
def damping_of_slip(grasp: GraspState, problem: FrictionProblem) -> int:
    """Solve for the damping forces if some finger slips or is free; return the law of the solution."""
    for i, finger in enumerate(grasp.fingers):
        problem.contacts[i].displacement = in_frame(grasp, finger, finger.rate)
        problem.contacts[i].base_force = in_frame(grasp, finger, finger.local)
    if grasp.dense:
        for i in range(grasp.count):
            write_coordinates(grasp, grasp.start, i, problem.contacts[i].base_force)
        assemble(grasp, False)
        raise_least(grasp, grasp.square)
        soften(grasp, grasp.square, None, 1.0)
        symmetric = symmetrise(grasp, grasp.square)
        return friction_force_square(problem, grasp.coordinates, grasp.square, symmetric, False, 0).law
    pose_compliances(grasp, problem)
    return force_of_modes(grasp, problem, Gains(grasp.external_damping, grasp.internal_damping), False).law


@kernel
def force_of_modes(grasp: GraspState, problem: FrictionProblem, gains: Gains, coulomb: bool) -> Answer:
    """Solve a problem with scalar gains."""
    count = 0 if gains.external == gains.internal else grasp.mode_count
    turn_modes(grasp.fingers.part(FingerState.frame), grasp.modes, problem, grasp.coordinates, count)
    return friction_force(problem, grasp.coordinates, gains, coulomb, RESTARTS)


@kernel
def pose_problem(grasp: GraspState, problem: FrictionProblem, touching: bool) -> None:
    """Write weights, coefficients and limits to a problem, and mark the fingers that exert no force.

    These are the fingers with weight 0 and, if `touching` is true, the fingers that do not touch.
    """
    for i, finger in enumerate(grasp.fingers):
        contact = problem.contacts[i]
        contact.weight = finger.weight
        contact.coefficient = finger.coefficient
        free = finger.weight == 0.0 or (touching and not finger.touching)
        contact.status = NO_FORCE if free else 0
        if grasp.limited:
            contact.limit = finger.cut


@kernel
def pose_compliances(grasp: GraspState, problem: FrictionProblem) -> None:
    """Write the series compliances of the dampers (module `depth`) to a problem that contains the elastic force f0."""
    if not grasp.gradual:
        return
    for i, finger in enumerate(grasp.fingers):
        contact = problem.contacts[i]
        contact.compliance = 0.0
        if contact.status >= 0:
            contact.compliance = compliance(grasp, finger, contact.base_force.x)


@kernel
def all_touch(grasp: GraspState) -> bool:
    """Return whether every finger touches."""
    count = 0
    for finger in grasp.fingers:
        count += 1 if finger.touching else 0
    return count == grasp.count


@kernel
def symmetrise(grasp: GraspState, square: Table) -> bool:
    """Symmetrise a matrix if its skew part is of rounding size; return whether the matrix was symmetrised.

    The friction problem of a symmetric matrix is convex.

    Matrices of scalar gains are always symmetrised, because the rounding errors of these matrices are large if one
    damping is zero.
    """
    m = grasp.count * grasp.coordinates
    largest = skew = 0.0
    for p in range(m):
        for q in range(p + 1):
            largest = max(largest, abs(square[p, q]))
            skew = max(skew, abs(square[p, q] - square[q, p]))
    if grasp.dense and skew > SYMMETRIC * largest:
        return False
    for p in range(m):
        for q in range(p):
            mean = 0.5 * (square[p, q] + square[q, p])
            square[p, q] = square[q, p] = mean
    return True


@kernel
def raise_least(grasp: GraspState, square: Table) -> None:
    """Add 1e-6 of the largest row sum of a singular D to the diagonal of D; the law remains passive."""
    if not grasp.singular:
        return
    largest = 0.0
    for p in range(square.columns):
        total = 0.0
        for q in range(square.columns):
            total += abs(square[p, q])
        largest = max(largest, total)
    for p in range(square.columns):
        square[p, p] += LEAST * largest
