"""Equations of a friction problem with scalar gains: one unknown per mode, for any number of contacts.

K = sqrt(W) [k_i I + (k_e - k_i) sum_k beta_k q_k q_k'] sqrt(W) (eq. 4), with kappa_k = k_i + (k_e - k_i) beta_k along
q_k. Let f = sqrt(W) y, y = R(t) and t = k_i sqrt(W) e + f0 / sqrt(W) - sum_k z_k q_k. The unknowns are z, with
kappa_k z_k = (k_i - kappa_k) q_k'(y - f0 / sqrt(W)).

The stiffness may also be given by its inverse, K^-1 = [I + sum_k h_k v_k v_k'] / k_i, scaled by the same square roots
of W, with signs h_k and vectors v_k of any length. The equations are then the same with v_k in place of q_k:
z_k = h_k v_k'(y - f0 / sqrt(W)).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from graspfx.compile.kernel import kernel
from graspfx.cones.cone import turn_back
from graspfx.cones.cut import Face, cut_slope, is_plain, limit_width, shorten
from graspfx.cones.problem import (
    SLIDE,
    STICK,
    ConeContact,
    FrictionProblem,
    Gains,
    dot4,
    leading,
)
from graspfx.spatial import Vector4

NIL = 1e-30  # relative to the internal gain: modes whose gain differs by less are equal


@dataclass(frozen=True, slots=True)
class Merit:
    """Distance from a solution: the convex function, the magnitudes of the forces and of g, and the residual."""

    value: float
    size: float
    worst: float
    residual: float


@kernel
def equations_of_modes(problem: FrictionProblem, d: int, count: int, gains: Gains, theta: float) -> Merit:
    """Compute the trial forces, forces and g for the unknowns z of `count` modes.

    kappa < k_i: g = h z + Q'(f0 - y), h = kappa / (k_i - kappa). kappa > k_i: the same equation in the form
    g = h z + Q'(k_i e + y - t), h = k_i / (kappa - k_i). Both are gradients of strictly convex functions.

    With compliances in series, contact i has 1/a_i = r_i k_i instead of k_i: t = f0 + r_i (k_i e - Q z), and for
    kappa > k_i g = h z + Q'(r_i k_i e + (1 - r_i) Q z + y - t).
    """
    internal = gains.internal
    soft = gains.external < internal or problem.flexible
    value = forces = worst = residual = 0.0
    unknowns = problem.unknowns
    for k in range(count):
        unknowns[k].gradient = 0.0
    for contact in problem.contacts:
        root = math.sqrt(contact.weight)
        part = compliant_share(problem, contact, internal)
        set_trial(problem, contact, d, count, internal, root, part)
        turn_back(contact, d, theta, problem.limited)
        if root == 0.0:
            continue
        if problem.limited:
            contact.force, share = shorten(contact.force, limit_width(contact.coefficient, d), contact.limit / root)
            if soft and share < 1.0:
                value += cut_value(contact, d) / part
        for a in range(d):
            y, trial = contact.force[a], contact.trial[a]
            forces += y * y + trial * trial
            if soft:
                right_side, y = contact.base_force[a] / root, -y
            else:
                right_side, y = internal * root * contact.displacement[a], y - trial
            value += 0.5 * y * y / part if problem.compliant else 0.5 * y * y
            if problem.compliant and not soft:
                turn = 0.0
                for k in range(count):
                    turn += contact.modes[k].motion[a] * unknowns[k].value
                right_side = part * right_side + (1.0 - part) * turn
                value -= 0.5 * (1.0 - part) * turn * turn
            for k in range(count):
                q = contact.modes[k].motion[a]
                unknowns[k].gradient += q * (right_side + y)
                value += q * right_side * unknowns[k].value
    for k in range(count):
        unknown = unknowns[k]
        h, gap = stiffening(problem, unknown.share, gains)
        z = unknown.value
        unknown.gradient += h * z - unknown.pull
        value += 0.5 * h * z * z - unknown.pull * z
        forces += z * z
        worst = max(worst, abs(unknown.gradient))
        off = gap * unknown.gradient
        residual += off * off
    return Merit(value, math.sqrt(forces), worst, math.sqrt(residual))


@kernel
def set_trial(
    problem: FrictionProblem, contact: ConeContact, d: int, count: int, internal: float, root: float, part: float
) -> None:
    """Compute t = k_i sqrt(w) e + f0 / sqrt(w) - sum_k z_k q_k of a contact; r_i scales all terms but f0."""
    unknowns = problem.unknowns
    for a in range(d):
        trial = 0.0
        if root > 0.0:
            trial = internal * root * contact.displacement[a] + contact.base_force[a] / root
            for k in range(count):
                trial -= contact.modes[k].motion[a] * unknowns[k].value
            if problem.compliant:
                trial = contact.base_force[a] / root + part * (trial - contact.base_force[a] / root)
        contact.trial[a] = trial


@kernel
def compliant_share(problem: FrictionProblem, contact: ConeContact, internal: float) -> float:
    """Compute r_i = 1 / (1 + k_i C_i), the factor on a contact's gain due to a series compliance; 1 without one."""
    return 1.0 / (1.0 + internal * contact.compliance) if problem.compliant else 1.0


@kernel
def cut_value(contact: ConeContact, d: int) -> float:
    """Compute y'(t - y), which a limit adds to 1/2 |y|^2 so that the gradient of the sum is y."""
    total = 0.0
    for a in range(d):
        total += contact.force[a] * (contact.trial[a] - contact.force[a])
    return total


@kernel
def stiffening(problem: FrictionProblem, beta: float, gains: Gains) -> tuple[float, float]:
    """Compute h of a mode, and |kappa / k_i - 1|; for a flexible problem, the mode's sign and a bound."""
    if problem.flexible:
        return beta, gains.external / gains.internal
    external, internal = gains.external, gains.internal
    gap = max(abs(external - internal) * beta, NIL * internal)
    kappa = internal + (external - internal) * beta
    return (kappa if external < internal else internal) / gap, gap / internal


@kernel
def jacobian_of_modes(problem: FrictionProblem, d: int, count: int, gains: Gains, theta: float) -> None:
    """Compute h + Q'R' Q, or h + Q'(I - R') Q, of the last equations; R' = u v' + bend b b' if a contact slides.

    With compliances in series, r_i R' replaces the R' of contact i.
    """
    soft = gains.external < gains.internal or problem.flexible
    H = problem.jacobian
    for k in range(count):
        for j in range(count):
            H[k, j] = 0.0
        H[k, k], _ = stiffening(problem, problem.unknowns[k].share, gains)
    for contact in problem.contacts:
        if contact.weight == 0.0:
            continue
        face = turn_back(contact, d, theta, problem.limited)
        part = compliant_share(problem, contact, gains.internal)
        if problem.limited and not is_plain(contact, d, contact.limit / math.sqrt(contact.weight), face.status):
            add_cut(problem, contact, d, count, theta, face, soft, part)
            continue
        if (face.status == STICK) == soft or (problem.compliant and face.status == STICK):
            add_whole(problem, contact, d, count, face.status == STICK, part if soft else 1.0 - part)
        if face.status == SLIDE:
            add_edge(problem, contact, d, count, theta, face, soft, part)


@kernel
def add_cut(
    problem: FrictionProblem,
    contact: ConeContact,
    d: int,
    count: int,
    theta: float,
    face: Face,
    soft: bool,
    part: float,
) -> None:
    """Add q_k'R' q_j, or q_k'(I - R') q_j, of a contact whose force is at its limit."""
    H = problem.jacobian
    limit = contact.limit / math.sqrt(contact.weight)
    for j in range(count):
        x = leading(contact.modes[j].motion, d)
        y = cut_slope(contact, d, theta, limit, face, x)
        if problem.compliant:
            y = Vector4(part * y.x, part * y.y, part * y.z, part * y.t)
        if not soft:
            y = Vector4(x.x - y.x, x.y - y.y, x.z - y.z, x.t - y.t)
        for k in range(count):
            H[k, j] += dot4(leading(contact.modes[k].motion, d), y)


@kernel
def add_whole(problem: FrictionProblem, contact: ConeContact, d: int, count: int, sticks: bool, part: float) -> None:
    """Add q_k'q_j of a contact; if it sticks and has a series compliance, add only the fraction `part`."""
    H = problem.jacobian
    modes = contact.modes
    for k in range(count):
        for j in range(k + 1):
            more = 0.0
            for a in range(d):
                more += modes[k].motion[a] * modes[j].motion[a]
            if problem.compliant and sticks:
                more *= part
            H[k, j] += more
            if j < k:
                H[j, k] += more


@kernel
def add_edge(
    problem: FrictionProblem,
    contact: ConeContact,
    d: int,
    count: int,
    theta: float,
    face: Face,
    soft: bool,
    part: float,
) -> None:
    """Add or subtract q_k'(u v' + bend b b') q_j of a contact that slides."""
    H = problem.jacobian
    unknowns = problem.unknowns
    modes = contact.modes
    sign = 1.0 if soft else -1.0
    mu = contact.coefficient
    share = 1.0 / (1.0 + theta * mu * mu)
    for k in range(count):
        q = leading(modes[k].motion, d)
        along = across = 0.0
        if d > 1:
            along = face.direction.x * q.y
        if d > 2:
            along += face.direction.y * q.z
            across = face.direction.x * q.z - face.direction.y * q.y
        if d > 3:
            along += face.direction.z * q.t
            across = along
        unknown = unknowns[k]
        unknown.left, unknown.right, unknown.across = q.x + mu * along, share * (q.x + theta * mu * along), across
    for k in range(count):
        left, bent = sign * unknowns[k].left, sign * face.bend * unknowns[k].across
        if problem.compliant:
            left, bent = part * left, part * bent
        if d > 3:  # two tangential directions across the sliding direction: all tangents minus that direction
            bent = -bent
            for j in range(count):
                more = 0.0
                for a in range(1, d):
                    more += modes[k].motion[a] * modes[j].motion[a]
                if problem.compliant:
                    more *= part
                H[k, j] += sign * face.bend * more
        for j in range(count):
            H[k, j] += left * unknowns[j].right + bent * unknowns[j].across
