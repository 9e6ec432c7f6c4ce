"""Frictionless contact for scalar gains: normal forces from one unknown per mode."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.cones.friction import UNRESOLVED as NONE
from graspfx.cones.friction import friction_force, friction_force_flexible, turn_modes
from graspfx.cones.problem import FrictionProblem, Gains
from graspfx.coupling.contacts import UNRESOLVED
from graspfx.coupling.coulomb import damping_in_cones, elastic_in_cones, pose_compliances, pose_problem
from graspfx.coupling.damping_flexibility import damping_in_columns
from graspfx.coupling.flexibility import pose_elastic
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.law import bilateral, keep_elastic, normal_force
from graspfx.coupling.recoil import find_levers, recoil
from graspfx.coupling.unilateral import damp, project
from graspfx.spatial import Vector4, inner


@kernel
def frictionless_force(grasp: GraspState) -> int:
    """Compute the elastic force f = K (e + s) along the normals, then add damping; return 0 or UNRESOLVED.

    Tangential forces are zero. If the internal gain is larger than the external gain, q_k'f therefore needs only the
    normal entries of the modes q_k. Otherwise the convex function contains the tangential entries of the modes, and all
    coordinates are needed.
    """
    fault = elastic_without_friction(grasp)
    if grasp.observed or grasp.limited:
        keep_elastic(grasp)
    if fault == 0 and grasp.damped:
        if grasp.recoils:
            pose_problem(grasp, grasp.damping_problem, True)
            law = damping_in_columns(grasp, grasp.damping_problem, 1, False)
            if law == NONE:
                fault = damp(grasp)
            else:
                write_normal_forces(grasp, grasp.damping_problem, False)
        elif grasp.external_damping <= grasp.internal_damping:
            gains = Gains(grasp.external_damping, grasp.internal_damping)
            fault = force_along_normals(grasp, grasp.damping_problem, gains, False)
        else:
            fault = damping_in_cones(grasp)
    return fault


@kernel
def elastic_without_friction(grasp: GraspState) -> int:
    """Compute the elastic force, from normal coordinates alone if the gains allow it; return 0 or UNRESOLVED."""
    if grasp.recoils or grasp.external_stiffness <= grasp.internal_stiffness:
        return elastic_along_normals(grasp)
    return elastic_in_cones(grasp)


@kernel
def elastic_along_normals(grasp: GraspState) -> int:
    """Compute the elastic force along the normals; return 0 or UNRESOLVED."""
    if grasp.dimensions == 1:
        if grasp.recoils:
            recoil(grasp, False, False)
        else:
            bilateral(grasp, True, False)
        outside = False
        for finger in grasp.fingers:
            f = normal_force(finger)
            outside = outside or f < 0.0
            if grasp.limited:
                outside = outside or f > finger.cut
            finger.touching = f > 0.0
        if not outside:
            return 0
    gains = Gains(grasp.external_stiffness, grasp.internal_stiffness)
    return force_along_normals(grasp, grasp.problem, gains, True)


@kernel
def force_along_normals(grasp: GraspState, problem: FrictionProblem, gains: Gains, elastic: bool) -> int:
    """Compute the elastic force along the normals if `elastic` is true, else add damping; return 0 or UNRESOLVED."""
    pose_problem(grasp, problem, not elastic)
    for i, finger in enumerate(grasp.fingers):
        x = finger.displacement if elastic else finger.rate
        f0 = 0.0 if elastic else normal_force(finger)
        problem.contacts[i].displacement = Vector4(inner(finger.normal, x.vector), 0.0, 0.0, 0.0)
        problem.contacts[i].base_force = Vector4(f0, 0.0, 0.0, 0.0)
    if grasp.recoils:
        find_levers(grasp, False)
        pose_elastic(grasp, problem, 1)
        high = max(gains.external, gains.internal)
        soft = gains.external <= gains.internal
        law = friction_force_flexible(problem, 1, gains.internal, high, soft, False, 0).law
        if law == NONE:
            fault = project(grasp)
            for finger in grasp.fingers:
                finger.touching = normal_force(finger) > 0.0
            return fault
    else:
        count = 0 if gains.external == gains.internal else grasp.mode_count
        turn_modes(grasp.fingers.part(FingerState.frame), grasp.modes, problem, 1, count)
        if not elastic:
            pose_compliances(grasp, problem)
        law = friction_force(problem, 1, gains, False, 0).law
    write_normal_forces(grasp, problem, elastic)
    return UNRESOLVED if law == NONE else 0


@kernel
def write_normal_forces(grasp: GraspState, problem: FrictionProblem, elastic: bool) -> None:
    """Write the normal forces of a problem to the fingers' forces; if `elastic` is true, mark the touching fingers."""
    for i, finger in enumerate(grasp.fingers):
        f = problem.contacts[i].force.x
        for a in range(grasp.dimensions):
            finger.local[a] = f * finger.normal[a]
        if elastic:
            finger.touching = f > 0.0
