"""Columns of the law with damping (modes and levers of the touching fingers), and their dot products."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Table
from graspfx.cones.problem import FrictionProblem, dot4, leading
from graspfx.coupling.contact_frames import in_frame
from graspfx.coupling.depth import compliance
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.law import normal_force
from graspfx.coupling.recoil import lever
from graspfx.grasp.contact_state import motion_of
from graspfx.grasp.rigid_modes import component


@kernel
def write_columns(
    grasp: GraspState, problem: FrictionProblem, d: int, soft: bool, kip: float, kid: float, slipped: bool
) -> None:
    """Write columns V, displacements and rates of the force-carrying coordinates, and compliances 1 / A - 1 / max A.

    The contacts' `displacement` and `base_force` contain displacements and rates until `write_force`.
    """
    state, p = grasp.recoil, grasp.mode_count
    shifts, turns, per = grasp.freedom.shifts, grasp.freedom.turns, 1.0 / grasp.period
    for i, finger in enumerate(grasp.fingers):
        contact = problem.contacts[i]
        root = finger.sqrt_weight if contact.status >= 0 else 0.0
        part = damping_part(grasp, finger, kid) if soft else 1.0
        if problem.compliant:
            contact.compliance = per * kid * (1.0 - part) / ((kip + per * kid) * (kip + per * kid * part))
        e = finger.retained if slipped else finger.displacement
        contact.displacement = root * in_frame(grasp, finger, e)
        contact.base_force = root * in_frame(grasp, finger, finger.rate)
        for a in range(d):
            for j in range(p):
                q = component(finger, motion_of(grasp.modes[j], i, grasp.width), a) if root > 0.0 else 0.0
                contact.modes[j].motion[a] = q
            k = p
            if state.twisted:
                for u in range(turns):
                    contact.modes[k].motion[a] = root * lever(grasp, finger, shifts + u, a, False)
                    k += 1
            if soft:
                for j in range(p):
                    contact.modes[k].motion[a] = part * contact.modes[j].motion[a]
                    k += 1
            if state.distant:
                for u in range(turns):
                    contact.modes[k].motion[a] = part * root * lever(grasp, finger, shifts + u, a, True)
                    k += 1


@kernel
def damping_part(grasp: GraspState, finger: FingerState, kid: float) -> float:
    """Compute r_i = 1 / (1 + kid C_i), the fraction of kid that acts at the finger's depth."""
    if not finger.touching:
        return 1.0
    return 1.0 / (1.0 + kid * compliance(grasp, finger, normal_force(finger)))


@kernel
def add_up(
    grasp: GraspState, problem: FrictionProblem, d: int, soft: bool, kid: float, near: int, far: int, count: int,
    base: float,
) -> None:  # fmt: skip
    """Compute V'A^-1 V, V'V of elastic columns, V'R^-1 V of damping columns, and V'e and V'e' of all columns."""
    state, p = grasp.recoil, grasp.mode_count
    for j in range(count):
        e = rate = 0.0
        for contact in problem.contacts:
            v = leading(contact.modes[j].motion, d)
            e += dot4(v, contact.displacement)
            rate += dot4(v, contact.base_force)
        state.stretch[j], state.rate[j] = e, rate
        for k in range(j + 1):
            total = whole = rest = 0.0
            for i, finger in enumerate(grasp.fingers):
                contact = problem.contacts[i]
                both = dot4(leading(contact.modes[j].motion, d), leading(contact.modes[k].motion, d))
                if soft:
                    total += (1.0 / base + contact.compliance) * both
                    whole += both
                    if k >= near:
                        rest += both / damping_part(grasp, finger, kid)
                else:
                    total += both
            state.gram[j, k] = total if soft else total / base
            if soft and j < near:
                state.near[j, k] = whole
            if soft and k >= near:
                state.far[j - near, k - near] = rest
    if not soft:
        for j in range(near):
            for k in range(j + 1):
                state.near[j, k] = base * state.gram[j, k]
        for j in range(far):
            for k in range(j + 1):
                a, b = j if j < p else near + j - p, k if k < p else near + k - p
                state.far[j, k] = base * state.gram[a, b]
    mirror(state.gram, count)
    mirror(state.near, near)
    mirror(state.far, far)


@kernel
def mirror(square: Table, count: int) -> None:
    """Copy the lower triangle of a symmetric matrix to the upper one."""
    for j in range(count):
        for k in range(j):
            square[k, j] = square[j, k]
