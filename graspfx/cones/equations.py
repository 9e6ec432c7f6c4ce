"""Equations of a friction problem and their derivatives, per mode for scalar gains and per coordinate otherwise.

The displacements e, base forces f0 and forces f of all contacts are stacked. W contains the contacts' weights, and R is
the return map of the law (`cones.friction`).

With scalar gains there is one unknown z_k per mode q_k, for any number of contacts. The stiffness is K = sqrt(W) [k_i I
+ (k_e - k_i) sum_k beta_k q_k q_k'] sqrt(W) (eq. 4). Its gain along q_k is kappa_k = k_i + (k_e - k_i) beta_k. With the
scaled trial force t = k_i sqrt(W) e + f0 / sqrt(W) - sum_k z_k q_k, the force is f = sqrt(W) y, y = R(t). The unknowns
satisfy kappa_k z_k = (k_i - kappa_k) q_k'(y - f0 / sqrt(W)).

A flexible problem gives the inverse stiffness between the same factors, sqrt(W) K^-1 sqrt(W) = [I + sum_k h_k v_k v_k']
/ k_i, with signs h_k and vectors v_k of any length. Its equations have v_k in place of q_k, and z_k = h_k v_k'(y - f0 /
sqrt(W)).

Any other K > 0 is given as a square matrix in contact frames, with one unknown per coordinate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Table
from graspfx.cones.cone import Face, cut_slope, is_plain, limit_width, shorten, turn_back
from graspfx.cones.problem import SLIDE, STICK, ConeContact, FrictionProblem, Gains, dot4, leading, tangent_of
from graspfx.spatial import Vector4, dot

NIL = 1e-30  # relative to the internal gain: modes whose gain differs by less are equal
SMALL = 1e-13  # relative to a square's largest row: regularises Newton's matrix if no contact touches


@dataclass(frozen=True, slots=True)
class Merit:
    """Distance from a solution: value of the convex function, magnitude of the forces, largest |g_k|, and residual."""

    value: float
    size: float
    worst: float
    residual: float


@kernel
def equations_of_modes(problem: FrictionProblem, d: int, count: int, gains: Gains, theta: float) -> Merit:
    """Compute the trial forces t, the forces y = R(t) and the equations' values g for the unknowns z of `count` modes.

    In the symbols of the module, with e and f0 scaled as in t: if kappa < k_i, g = h z + Q'(f0 - y) with h = kappa /
    (k_i - kappa). If kappa > k_i, the same equation has the form g = h z + Q'(k_i e + y - t) with h = k_i / (kappa -
    k_i). Both forms are gradients of strictly convex functions.

    With a compliance in series, contact i has the gain r_i k_i (`compliant_share`) instead of k_i. Then t = f0 + r_i
    (k_i e - Q z), and for kappa > k_i, g = h z + Q'(r_i k_i e + (1 - r_i) Q z + y - t).
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
    """Compute a contact's trial force t = k_i sqrt(w) e + f0 / sqrt(w) - sum_k z_k q_k.

    The factor `part` (r_i, see `compliant_share`) multiplies all terms except f0 / sqrt(w).
    """
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
    """Compute r_i = 1 / (1 + k_i C_i), by which a series compliance C_i reduces the gain of contact i.

    Without compliances the result is 1.
    """
    return 1.0 / (1.0 + internal * contact.compliance) if problem.compliant else 1.0


@kernel
def cut_value(contact: ConeContact, d: int) -> float:
    """Compute y'(t - y) of a contact at its limit.

    With this term added to |y|^2 / 2, the gradient with respect to t is y.
    """
    total = 0.0
    for a in range(d):
        total += contact.force[a] * (contact.trial[a] - contact.force[a])
    return total


@kernel
def stiffening(problem: FrictionProblem, beta: float, gains: Gains) -> tuple[float, float]:
    """Compute h of a mode and |kappa / k_i - 1|; for a flexible problem, the mode's sign and a bound on K / k_i."""
    if problem.flexible:
        return beta, gains.external / gains.internal
    external, internal = gains.external, gains.internal
    gap = max(abs(external - internal) * beta, NIL * internal)
    kappa = internal + (external - internal) * beta
    return (kappa if external < internal else internal) / gap, gap / internal


@kernel
def jacobian_of_modes(problem: FrictionProblem, d: int, count: int, gains: Gains, theta: float) -> None:
    """Compute dg/dz of `equations_of_modes`: h + Q'R'Q if kappa < k_i, or h + Q'(I - R')Q if kappa > k_i.

    The derivative of the return map is R' = u v' + bend b b' for a contact that slides.

    If compliances stand in series, r_i R' replaces R' of contact i.
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
    """Add the term q_k'R'q_j of a contact at its limit or at the boundary of a half-space.

    If `soft` is false, the term is q_k'(I - R')q_j.
    """
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
    """Add q_k'q_j of a contact; if the contact sticks and has a series compliance, multiply by `part`."""
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
    """Add (if `soft`) or subtract q_k'(u v' + bend b b')q_j of a contact that slides."""
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


@kernel
def equations_of_square(problem: FrictionProblem, d: int, c: float, square: Table, theta: float) -> Merit:
    """Compute the equations' values g = f0 + K w - R(t) for w = e + s, where t = f0 + K w - c (w - e).

    The gradient of the convex function is (c I - K) g.
    """
    value = forces = worst = 0.0
    unknowns = problem.unknowns
    m = problem.count * d
    for i, contact in enumerate(problem.contacts):
        for a in range(d):
            p = i * d + a
            total = 0.0
            for q in range(m):
                total += square[p, q] * unknowns[q].value
            w, e, f0 = unknowns[p].value, contact.displacement[a], contact.base_force[a]
            right_side = f0 + total
            unknowns[p].gradient = right_side
            contact.trial[a] = right_side - c * (w - e)
            value += (0.5 * total + f0) * (c * w - total)
            forces += c * c * (w * w + e * e) + f0 * f0
    for contact in problem.contacts:
        turn_back(contact, d, theta, problem.limited)
        if problem.limited:
            contact.force, share = shorten(contact.force, limit_width(contact.coefficient, d), contact.limit)
            if share < 1.0:
                value += cut_value(contact, d)
    for i, contact in enumerate(problem.contacts):
        for a in range(d):
            unknown = unknowns[i * d + a]
            y = contact.force[a]
            unknown.gradient -= y
            value += 0.5 * y * y
            worst = max(worst, abs(unknown.gradient))
    return Merit(value, math.sqrt(forces), worst, worst)


@kernel
def jacobian_of_square(problem: FrictionProblem, d: int, c: float, square: Table, theta: float) -> None:
    """Compute dg/dw = K - R'(K - c I) of `equations_of_square`."""
    m = problem.count * d
    H = problem.jacobian
    for i, contact in enumerate(problem.contacts):
        face = turn_back(contact, d, theta, problem.limited)
        r = i * d
        if problem.limited and not is_plain(contact, d, contact.limit, face.status):
            add_cut_rows(problem, contact, r, d, c, square, theta, face)
            continue
        for a in range(r, r + d):
            for j in range(m):
                H[a, j] = 0.0 if face.status == STICK else square[a, j]
            H[a, a] += c if face.status == STICK else SMALL * c
        if face.status == SLIDE:
            subtract_edge(problem, contact, r, d, c, square, theta, face)


@kernel
def subtract_edge(
    problem: FrictionProblem, contact: ConeContact, r: int, d: int, c: float, square: Table, theta: float, face: Face
) -> None:
    """Subtract R'(K - c I) of a sliding contact from the contact's rows of the Jacobian, which begin with row r."""
    H = problem.jacobian
    mu = contact.coefficient
    share = 1.0 / (1.0 + theta * mu * mu)
    t = face.direction
    for j in range(problem.count * d):
        x = shifted_entries(square, r, d, j, c)
        along = dot(t, tangent_of(x))
        normal = share * (x.x + theta * mu * along)
        H[r, j] -= normal
        if d == 2:
            H[r + 1, j] -= mu * t.x * normal
        if d == 3:
            across = face.bend * (t.x * x.z - t.y * x.y)
            H[r + 1, j] -= mu * t.x * normal - t.y * across
            H[r + 2, j] -= mu * t.y * normal + t.x * across
        if d > 3:
            H[r + 1, j] -= mu * t.x * normal + face.bend * (x.y - t.x * along)
            H[r + 2, j] -= mu * t.y * normal + face.bend * (x.z - t.y * along)
            H[r + 3, j] -= mu * t.z * normal + face.bend * (x.t - t.z * along)


@kernel
def shifted_entries(square: Table, r: int, d: int, j: int, c: float) -> Vector4:
    """Return d entries of column j of K - c I, from row r on, followed by zeros."""
    x1 = x2 = x3 = 0.0
    if d > 1:
        x1 = square[r + 1, j] - (c if j == r + 1 else 0.0)
    if d > 2:
        x2 = square[r + 2, j] - (c if j == r + 2 else 0.0)
    if d > 3:
        x3 = square[r + 3, j] - (c if j == r + 3 else 0.0)
    return Vector4(square[r, j] - (c if j == r else 0.0), x1, x2, x3)


@kernel
def add_cut_rows(
    problem: FrictionProblem, contact: ConeContact, r: int, d: int, c: float, square: Table, theta: float, face: Face
) -> None:
    """Write the rows of K - R'(K - c I), from row r on, of a contact at its limit or at the edge of a half-space."""
    H = problem.jacobian
    for j in range(problem.count * d):
        x = cut_slope(contact, d, theta, contact.limit, face, shifted_entries(square, r, d, j, c))
        H[r, j] = square[r, j] - x.x
        if d > 1:
            H[r + 1, j] = square[r + 1, j] - x.y
        if d > 2:
            H[r + 2, j] = square[r + 2, j] - x.z
        if d > 3:
            H[r + 3, j] = square[r + 3, j] - x.t
    for a in range(r, r + d):
        H[a, a] += SMALL * c
