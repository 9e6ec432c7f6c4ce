"""Damped law for an object that moves under the forces of the sample, as a flexibility, in O(n) operations.

The springs and the dampers of the fingers are parallel branches. The matrices of both branches are given here without
the factor W^1/2 on either side. Fingers that do not touch are removed from each branch separately:

    K = kip (I - Q E_K Q'),    D / T = kid / T (R - R Q E_D Q'R),    M = K + D / T - J'N^-1 J,

Here J = G K + H D / T and N = C^-1 + G K G' + H D H' / T, where C is the object's compliance, T the period, and G and H
are the lever arms of springs and dampers. Q contains the modes as columns. The diagonal matrix R contains the fraction
of the damping that acts at the depth of each finger. `condense` computes E_K and E_D. Therefore M = A - V E V' with
A = kip I + R kid / T. The columns of V are those of Q, those of R Q if damping grows with depth, and the lever arms R
H' of fingertips that are not sums of modes. The friction problem needs the inverse M^-1 = A^-1 + A^-1 V Y V'A^-1 with
Y = E (I - V'A^-1 V E)^-1. The problem has at most 6 unknowns if rates refer to the contacts, and 9 if they refer to the
fingertips; if damping grows with depth, 12 and 15. It has three more unknowns if torsion acts along axes other than the
normals.
"""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Table
from graspfx.cones.factors import eliminate_rows, factor_definite, invert_part, lower, solve_factored, take_square
from graspfx.cones.friction import ASSOCIATED, friction_force_flexible
from graspfx.cones.problem import FrictionProblem, dot4, leading, tangent_of
from graspfx.coupling.contact_frames import in_frame
from graspfx.coupling.depth import compliance, is_whole
from graspfx.coupling.flexibility import combine_modes, factor
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.law import normal_force
from graspfx.coupling.recoil import damping_share, find_levers, inertia, lever
from graspfx.grasp.rigid_modes import component, motion_of
from graspfx.spatial import NOTHING, dot

SINGULAR = 1e-12  # relative bound on rounding in S, for motions that only contacts without force follow


@kernel
def damping_in_columns(grasp: GraspState, problem: FrictionProblem, d: int, slipped: bool) -> int:
    """Solve for the elastic and damping forces of touching fingers, d coordinates each; return the solution's law."""
    per = 1.0 / grasp.period
    base = pose_damped(grasp, problem, d, slipped)
    if base == 0.0:
        return ASSOCIATED
    highest = max(grasp.external_stiffness, grasp.internal_stiffness)
    highest += per * max(grasp.external_damping, grasp.internal_damping)
    soft = grasp.external_stiffness <= grasp.internal_stiffness and grasp.external_damping <= grasp.internal_damping
    return friction_force_flexible(problem, d, base, max(base, highest), soft, False, 0).law


@kernel
def pose_damped(grasp: GraspState, problem: FrictionProblem, d: int, slipped: bool) -> float:
    """Write the bilateral force and the modes of the damped law to a friction problem, d coordinates per contact.

    If `slipped` is true, the problem uses the displacements that remain after slip. Return the largest entry of A, or
    0.0 if the bilateral force lies in the cones and is therefore the solution.
    """
    find_levers(grasp, True)
    state, per = grasp.recoil, 1.0 / grasp.period
    kep, kip = grasp.external_stiffness, grasp.internal_stiffness
    ked, kid = grasp.external_damping, grasp.internal_damping
    soft = grasp.gradual and not is_whole(grasp)
    turns, p = grasp.freedom.turns, grasp.mode_count
    near = p + (turns if state.twisted else 0)
    far = p + (turns if state.distant else 0)
    count = near + far if soft else near + far - p
    base = kip + per * kid
    write_columns(grasp, problem, d, soft, kip, kid, slipped)
    add_up(grasp, problem, d, soft, kid, near, far, count, base)
    condense(grasp, problem, d, state.near, kep, kip, False, state.elastic_part)
    condense(grasp, problem, d, state.far, per * ked, per * kid, soft, state.damping_part)
    clear(grasp, count)
    twisted, distant = state.twisted, state.distant
    add_branch(grasp, state.near, state.elastic_part, state.elastic_share, state.stretch, kip, 1.0, near, 0, 0, twisted)
    first, rest = (near, near) if soft else (0, near - p)
    add_branch(
        grasp, state.far, state.damping_part, damping_share(grasp), state.rate, per * kid, grasp.period,
        far, first, rest, distant,
    )  # fmt: skip
    find_recoil(grasp, count)
    write_force(grasp, problem, d, soft, kip, kid, count)
    if is_settled(grasp, problem, d):
        return 0.0
    eliminate_motion(grasp, count)
    definite = kep <= kip and ked <= kid
    if definite:
        factor_inverse(grasp, problem, count)
    else:
        invert(grasp, count)
        factor(grasp, problem, count, False)
    root = math.sqrt(base)
    for contact in problem.contacts:
        own = base / (1.0 + base * contact.compliance) if problem.compliant else base
        for a in range(d):
            combine_modes(grasp, contact, a, count, root / own, definite)
    return base


@kernel
def write_columns(
    grasp: GraspState, problem: FrictionProblem, d: int, soft: bool, kip: float, kid: float, slipped: bool
) -> None:
    """Write the columns V, displacements, rates and compliances 1 / A - 1 / max A of the contacts that carry force.

    Until the call of `write_force`, the fields `displacement` and `base_force` contain displacements and rates, times
    W^1/2.
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
    """Compute r_i = 1 / (1 + kid w_i C_i), the fraction of kid that acts at the finger's depth (module `depth`)."""
    if not finger.touching:
        return 1.0
    return 1.0 / (1.0 + kid * compliance(grasp, finger, normal_force(finger)))


@kernel
def add_up(
    grasp: GraspState, problem: FrictionProblem, d: int, soft: bool, kid: float, near: int, far: int, count: int,
    base: float,
) -> None:  # fmt: skip
    """Compute V'A^-1 V, V'V of the elastic columns, V'R^-1 V of the damping columns, and V'e and V'e'."""
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
    """Copy the lower triangle of a symmetric matrix to the upper triangle."""
    for j in range(count):
        for k in range(j):
            square[k, j] = square[j, k]


@kernel
def condense(
    grasp: GraspState, problem: FrictionProblem, d: int, gram: Table, external: float, internal: float, soft: bool,
    out: Table,
) -> None:  # fmt: skip
    """Compute k_i E of a branch with the gains k_e and k_i, over the contacts that carry force.

    A gain of zero is treated exactly.

    Let kappa = k_i + (k_e - k_i) beta, S = Q'R Q over the coordinates that carry force, and P = I - S, computed as a
    sum over the coordinates that carry no force. Then

        k_i E = (k_i - k_e) B^1/2 [kappa + (k_i - k_e) B^1/2 S B^1/2]^-1 B^1/2 k_i      (k_e <= k_i)
              = (k_i - k_e) B^1/2 [1 + (k_e - k_i) / k_i B^1/2 P B^1/2]^-1 B^1/2        (k_e > k_i),

    where the diagonal matrix B contains the fractions beta of the modes. The first bracket is singular only for motions
    in which no contact that carries force moves. The inverse of the second bracket is A'A, where A is updated for each
    coordinate that carries no force; if k_i = 0, the inverse is a projector.
    """
    p, A = grasp.mode_count, grasp.recoil.work
    gap = abs(external - internal)
    if external <= internal:
        for j in range(p):
            for k in range(p):
                A[j, k] = gap / internal * math.sqrt(grasp.modes[j, 0] * grasp.modes[k, 0]) * gram[j, k]
            A[j, j] += 1.0 - gap / internal * grasp.modes[j, 0]
        invert_part(A, grasp.recoil.signs, p, SINGULAR)
    else:
        for j in range(p):
            for k in range(p):
                A[j, k] = 1.0 if j == k else 0.0
        release_modes(grasp, problem, d, external, internal, soft)
    for j in range(p):
        for k in range(j + 1):
            total = A[j, k]
            if external > internal:
                total = 0.0
                for i in range(p):
                    total -= A[i, j] * A[i, k]
            out[j, k] = gap * math.sqrt(grasp.modes[j, 0] * grasp.modes[k, 0]) * total
    mirror(out, p)


@kernel
def release_modes(
    grasp: GraspState, problem: FrictionProblem, d: int, external: float, internal: float, soft: bool
) -> None:  # fmt: skip
    """Update A'A, the inverse of the second bracket in `condense`, for coordinates without force or with a compliance.

    Each of these coordinates subtracts A'A t t'A'A / (r + t'A'A t), by Potter's square-root update of A. The vector t
    contains the components of the modes along the coordinate, times sqrt(beta), and r is the coordinate's resistance
    divided by k_e - k_i.
    """
    t, along = grasp.recoil.row, grasp.recoil.signs
    for i, finger in enumerate(grasp.fingers):
        free = problem.contacts[i].status < 0
        yields = 0.0 if free or not soft else grasp.period * compliance(grasp, finger, normal_force(finger))
        for a in range(grasp.coordinates):
            carries = not free and a < d
            if carries and yields <= 0.0:
                continue
            for j in range(grasp.mode_count):
                t[j] = math.sqrt(grasp.modes[j, 0]) * component(finger, motion_of(grasp.modes[j], i, grasp.width), a)
            resistance = internal + (1.0 / yields if carries else 0.0)
            take_square(grasp.recoil.work, t, along, resistance / (external - internal), grasp.mode_count)


@kernel
def clear(grasp: GraspState, count: int) -> None:
    """Set the sums over the branches to zero, and `system` to the inverse C^-1 of the object's compliance."""
    state = grasp.recoil
    for j in range(count):
        state.row[j] = 0.0
        for k in range(count):
            state.whole[j, k] = 0.0
        for u in range(6):
            state.levers[j, u] = 0.0
    for u in range(grasp.freedom.shifts + grasp.freedom.turns):
        state.motion[u] = 0.0
        for v in range(u + 1):
            state.system[u, v] = inertia(grasp, u, v)


@kernel
def add_branch(
    grasp: GraspState, gram: Table, part: Table, share: Table, vector: Floats, gain: float, unit: float, size: int,
    first: int, rest: int, beyond: bool,
) -> None:  # fmt: skip
    """Add a branch with the gain R - R Q part Q'R to E, J' and N, and add its force to the right-hand sides.

    Args:
        grasp: Block of the grasp.
        gram: Gram matrix of the branch's columns.
        part: Matrix k_i E of the branch, from `condense`.
        share: Coefficients of the branch's levers on the modes (T of `RecoilState`), used if the levers are sums of
            modes.
        vector: Products V'e or V'e' of all columns.
        gain: Gain k_i of the branch.
        unit: Factor on `vector`: 1 for displacements, the period for rates [s].
        size: Number of the branch's columns.
        first: Index of the branch's first mode among all columns.
        rest: Offset of the columns after the branch's modes: column j of the branch is column rest + j of all columns.
        beyond: Whether the levers of rotations are separate columns instead of sums of modes.
    """
    state, p, shifts = grasp.recoil, grasp.mode_count, grasp.freedom.shifts
    free = shifts + grasp.freedom.turns
    products, turned = state.products, state.turned
    for u in range(free):
        for j in range(size):
            total = 0.0
            if u < shifts:
                total = share[u, u] * gram[j, u]
            elif beyond:
                total = gram[j, p + u - shifts]
            else:
                for k in range(p):
                    total += gram[j, k] * share[k, u]
            products[j, u] = total
    for j in range(p):
        for u in range(free):
            total = 0.0
            for k in range(p):
                total += part[j, k] * products[k, u]
            turned[j, u] = total
    for u in range(free):
        for v in range(u + 1):
            total = 0.0
            if u < shifts:
                total = share[u, u] * products[u, v]
            elif beyond:
                total = products[p + u - shifts, v]
            else:
                for k in range(p):
                    total += share[k, u] * products[k, v]
            total *= gain
            for k in range(p):
                total -= products[k, u] * turned[k, v]
            state.system[u, v] += total
    for j in range(size):
        at = first + j if j < p else rest + j
        value = unit * vector[at]
        for u in range(free):
            total = 0.0
            if u < shifts:
                total = share[u, u] if j == u else 0.0
            elif beyond:
                total = 1.0 if j == p + u - shifts else 0.0
            elif j < p:
                total = share[j, u]
            total *= gain
            if j < p:
                total -= turned[j, u]
            state.levers[at, u] += total
            state.motion[u] += total * value
    for j in range(p):
        total = 0.0
        for k in range(p):
            state.whole[first + j, first + k] += part[j, k]
            total += part[j, k] * vector[first + k]
        state.row[first + j] += unit * total


@kernel
def find_recoil(grasp: GraspState, count: int) -> None:
    """Compute the object's motion u = N^-1 r from the right-hand side r; add J'u to the columns' force coefficients."""
    state, free = grasp.recoil, grasp.freedom.shifts + grasp.freedom.turns
    factor_definite(state.system, free)
    solve_factored(state.system, state.motion, free)
    for j in range(count):
        total = 0.0
        for u in range(free):
            total += state.levers[j, u] * state.motion[u]
        state.row[j] += total


@kernel
def eliminate_motion(grasp: GraspState, count: int) -> None:
    """Add J'N^-1 J, which eliminates the object's motion, to E."""
    state, free = grasp.recoil, grasp.freedom.shifts + grasp.freedom.turns
    for j in range(count):
        lower(state.system, state.levers[j], free)
    for j in range(count):
        for k in range(j + 1):
            total = state.whole[j, k]
            for u in range(free):
                total += state.levers[j, u] * state.levers[k, u]
            state.whole[j, k] = total
    mirror(state.whole, count)


@kernel
def is_settled(grasp: GraspState, problem: FrictionProblem, d: int) -> bool:
    """Return whether all base forces lie inside their cones; if they do, write them as the solution."""
    settled = True
    for contact in problem.contacts:
        if contact.status >= 0:
            tangent = tangent_of(leading(contact.base_force, d))
            limit = contact.coefficient * contact.base_force.x
            inside = contact.base_force.x >= 0.0 and dot(tangent, tangent) <= limit * limit
            settled = settled and inside
    if settled:
        for contact in problem.contacts:
            contact.force = contact.base_force
    return settled


@kernel
def write_force(
    grasp: GraspState, problem: FrictionProblem, d: int, soft: bool, kip: float, kid: float, count: int
) -> None:
    """Write the bilateral forces of the contacts that carry force to the base forces of the problem."""
    row = grasp.recoil.row
    for i, finger in enumerate(grasp.fingers):
        contact = problem.contacts[i]
        part = damping_part(grasp, finger, kid) if soft else 1.0
        contact.base_force = kip * contact.displacement + (kid * part) * contact.base_force
        contact.displacement = NOTHING
        for a in range(d):
            total = contact.base_force[a]
            for j in range(count):
                total -= contact.modes[j].motion[a] * row[j]
            contact.base_force[a] = finger.sqrt_weight * total


@kernel
def invert(grasp: GraspState, count: int) -> None:
    """Compute Y = E (I - S E)^-1 from E in `whole` and S in `gram`, and write Y to `work`."""
    state = grasp.recoil
    A, Y = state.near, state.work
    for j in range(count):
        for k in range(count):
            total = 1.0 if j == k else 0.0
            for i in range(count):
                total -= state.whole[j, i] * state.gram[i, k]
            A[j, k] = total
            Y[j, k] = state.whole[j, k]
    eliminate_rows(A, Y, count, count)
    for j in range(count):
        for k in range(j):
            Y[j, k] = Y[k, j] = 0.5 * (Y[j, k] + Y[k, j])


@kernel
def factor_inverse(grasp: GraspState, problem: FrictionProblem, count: int) -> None:
    """Compute L, a factor of Y = F (I - F'S F)^-1 F' = L L' >= 0, where E = F F', and write L to `gram`.

    L = F U'^-1 with I - F'S F = U U'. F and L are lower triangular, and U is upper triangular.
    """
    state = grasp.recoil
    F, S, U, W = state.whole, state.gram, state.work, state.near
    factor_definite(F, count)
    for j in range(count):
        for k in range(count):
            total = 0.0
            for i in range(k, count):
                total += S[j, i] * F[i, k]
            W[j, k] = total
    for j in range(count):
        for k in range(j, count):
            total = 1.0 if j == k else 0.0
            for i in range(k, count):
                total -= F[i, k] * W[i, j]
            U[j, k] = total
    for j in range(count - 1, -1, -1):
        for i in range(j, -1, -1):
            total = U[i, j]
            for k in range(j + 1, count):
                total -= U[i, k] * U[j, k]
            if i == j:
                state.row[j] = 1.0 / math.sqrt(total)
            U[i, j] = total * state.row[j]
    for i in range(count):
        for j in range(i, -1, -1):
            total = F[i, j]
            for k in range(j + 1, i + 1):
                total -= S[i, k] * U[j, k]
            S[i, j] = total * state.row[j]
    problem.modes = count
    for k in range(count):
        problem.unknowns[k].share = 1.0
