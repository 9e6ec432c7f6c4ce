"""Elastic law for an object that moves under the forces of the sample, as a flexibility, in O(n) operations.

With the implicit integrator (`recoil`), the forces follow from a stiffness M that includes the object's compliance C in
series. For scalar gains, the inverse of M is a multiple of the identity plus a term of a few columns V, also after
restriction to the contacts that carry force:

    W^1/2 M^-1 W^1/2 = [I + V Y V'] / kip,    Y = diag(kip / kappa_k - 1) + kip T C T'    (elastic, V = Q),

Here kappa_k = kip + (kep - kip) beta_k and T = Q'sqrt(W) G', where Q contains the modes with the blends beta_k, W the
weights, and G the lever arms of the springs. A friction problem therefore has at most six unknowns (`cones.equations`),
or nine if torsion acts along axes other than the normals.
"""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.cones.factors import factor_definite, factor_signed, lower
from graspfx.cones.problem import ConeContact, FrictionProblem
from graspfx.coupling.grasp_state import GraspState
from graspfx.coupling.recoil import inertia, lever
from graspfx.grasp.rigid_modes import component, motion_of


@kernel
def pose_elastic(grasp: GraspState, problem: FrictionProblem, d: int) -> None:
    """Write the modes of the elastic law, with the object's compliance, to a problem of d coordinates per contact."""
    state, free = grasp.recoil, grasp.freedom.shifts + grasp.freedom.turns
    shifts, turns, p = grasp.freedom.shifts, grasp.freedom.turns, grasp.mode_count
    kep, kip = grasp.external_stiffness, grasp.internal_stiffness
    Y, count = state.work, p + (turns if state.twisted else 0)
    for j in range(count):
        for k in range(count):
            Y[j, k] = 0.0
    for k in range(p):
        Y[k, k] = (kip - kep) * grasp.modes[k, 0] / (kip + (kep - kip) * grasp.modes[k, 0])
    for u in range(turns):
        for v in range(u + 1):
            state.system[u, v] = inertia(grasp, shifts + u, shifts + v)
    factor_definite(state.system, turns)
    own = math.sqrt(kip / inertia(grasp, 0, 0)) if shifts > 0 else 0.0
    for j in range(count):  # rows of sqrt(kip) V'G'C^1/2
        for u in range(free):
            state.products[j, u] = 0.0
        for u in range(shifts):
            state.products[j, u] = own * near_share(grasp, j, u)
        for u in range(turns):
            state.row[u] = math.sqrt(kip) * near_share(grasp, j, shifts + u)
        lower(state.system, state.row, turns)
        for u in range(turns):
            state.products[j, shifts + u] = state.row[u]
    for j in range(count):
        for k in range(count):
            total = 0.0
            for u in range(free):
                total += state.products[j, u] * state.products[k, u]
            Y[j, k] += total
    factor(grasp, problem, count, kep <= kip)
    for i, finger in enumerate(grasp.fingers):
        contact = problem.contacts[i]
        for a in range(d):
            for k in range(p):
                contact.modes[k].motion[a] = component(finger, motion_of(grasp.modes[k], i, grasp.width), a)
            if state.twisted:
                for u in range(turns):
                    contact.modes[p + u].motion[a] = finger.sqrt_weight * lever(grasp, finger, shifts + u, a, False)
            combine_modes(grasp, contact, a, count, 1.0, kep <= kip)


@kernel
def near_share(grasp: GraspState, j: int, u: int) -> float:
    """Compute the coefficient of elastic column j in the contacts' motion along the object's free direction u."""
    state, p, shifts = grasp.recoil, grasp.mode_count, grasp.freedom.shifts
    if state.twisted and u >= shifts:
        return 1.0 if j == p + u - shifts else 0.0
    return state.elastic_share[j, u] if j < p else 0.0


@kernel
def combine_modes(grasp: GraspState, contact: ConeContact, a: int, count: int, gain: float, triangular: bool) -> None:
    """Replace a contact's columns V, at coordinate a, by `gain` times the modes V L, where Y = L diag(h) L'.

    If `triangular` is true, L is lower triangular.
    """
    row, L = grasp.recoil.row, grasp.recoil.gram
    for k in range(count):
        row[k] = gain * contact.modes[k].motion[a]
    for k in range(count):
        total = 0.0
        for j in range(k if triangular else 0, count):
            total += row[j] * L[j, k]
        contact.modes[k].motion[a] = total


@kernel
def factor(grasp: GraspState, problem: FrictionProblem, count: int, definite: bool) -> None:
    """Factor the matrix Y = L diag(h) L' in `work`; write L to `gram` and the signs h to the problem."""
    state = grasp.recoil
    problem.modes = count
    if definite:
        factor_definite(state.work, count)
        for j in range(count):
            for k in range(count):
                state.gram[j, k] = state.work[j, k]
            state.signs[j] = 1.0
    else:
        factor_signed(state.work, count, state.gram, state.signs)
    for k in range(count):
        problem.unknowns[k].share = state.signs[k]
