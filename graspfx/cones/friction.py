"""Contact forces in friction cones, computed by a semismooth Newton method.

Both laws of a friction problem (`cones.problem`) have the form f = R(t), t = f - c s for any c > 0, where f is the
force of a contact, s its slip, and R a return map with the dilatancy theta. Associated law (theta = 1): R(t) is the
nearest force in the cone. If f0 = 0, the forces minimise 1/2 (f - K e)' K^-1 (f - K e) over the cones, and the solution
is unique. Coulomb's law (theta = 0): f_n = max(t_n, 0), and f_t is t_t, shortened to mu f_n if it is longer. If mu is
large, the solution may not be unique.

With limits L_i, each cone is intersected with the ball |f_i| <= L_i (`cones.cone`), and the forces of the associated
law still minimise the same function. A negative coefficient then selects the whole space (NO_CONE) or a half-space
(HALF_SPACE) instead of a cone. Only the cone causes slip, not the limit: s = 0 for a contact that sticks at its limit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Many, Table
from graspfx.cones.cone import limit_width, shorten, turn_back
from graspfx.cones.equations import (
    Merit,
    compliant_share,
    equations_of_modes,
    equations_of_square,
    jacobian_of_modes,
    jacobian_of_square,
)
from graspfx.cones.factors import eliminate
from graspfx.cones.problem import STICK, Answer, FrictionProblem, Gains
from graspfx.spatial import NOTHING, Matrix, Vector

COULOMB, ASSOCIATED, UNRESOLVED = 0, 1, 2  # law that the solution satisfies; if unresolved, all forces are zero
ROUNDING = 1e-15  # relative to the forces: residual at which Newton's method stops
CLOSE = 1e-13  # relative: residual that is accepted if rounding ends the descent earlier
LEAST = 1e-6  # relative to the larger gain: smaller gains are raised to this value (for zero gains see `approach`)
NEAR = 1e-8  # relative value for a zero gain in each search of `approach`
SEARCHES = 8  # largest number of searches in `approach`
STEPS = 100  # evaluations before the search for Coulomb's law restarts from another point
DESCENT = 1000  # evaluations for the associated law: 200 were enough for gains 10^6 apart, 45 for 10^3
SHORTEST = 1e-2  # fraction of a Newton step below which the search for Coulomb's law restarts from another point
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)  # multiples modulo 1 fill an interval evenly and reproducibly
RESTARTS = 16  # for offline use: at kip/kep = 1000 and mu = 1.5, 1 problem in 40 still falls back to the associated law


@dataclass(frozen=True, slots=True)
class Search:
    """Result of a search: success, residual [N], and number of evaluations of the equations."""

    success: bool
    residual: float
    evaluations: int


@kernel
def turn_modes(frames: Many[Matrix], motions: Table, problem: FrictionProblem, d: int, count: int) -> None:
    """Write `count` rigid modes into the problem, in contact frames with d coordinates per contact.

    Args:
        frames: Contact frames, normal and tangents as rows.
        motions: One row per mode: the blend beta_k, then three entries per contact (four if d is 4), in the axes in
            which the frames are given. The fourth entry is the torsion about the normal.
    """
    width = 4 if d > 3 else 3
    problem.modes = count
    for k in range(count):
        motion = motions[k]
        problem.unknowns[k].share = motion[0]
        for i, contact in enumerate(problem.contacts):
            m = 1 + width * i
            mode = contact.modes[k]
            entries = frames[i] @ Vector(motion[m], motion[m + 1], motion[m + 2])
            mode.motion[0] = entries.x
            if d > 1:
                mode.motion[1] = entries.y
            if d > 2:
                mode.motion[2] = entries.z
            if d > 3:
                mode.motion[3] = motion[m + 3]


@kernel
def friction_force(problem: FrictionProblem, d: int, gains: Gains, coulomb: bool, restarts: int) -> Answer:
    """Compute the forces for scalar gains, where K is given by eq. (4) in the problem's modes (`cones.equations`).

    There are at most six unknowns. The force of a contact of weight 0 is zero. A gain below 1e-6 times the other gain
    is raised to that value. In the associated law, however, a gain of zero is treated as the limit of small gains
    (`approach`). The search for Coulomb's law starts from the given unknowns. If it fails, it is repeated from the
    associated solution, and then `restarts` times from points around the associated solution and around zero,
    alternately. If the problem is compliant, (K^-1 + C)^-1 replaces K, where C has the entry C_i / w_i for each
    coordinate of contact i.

    Returns:
        Law that the solution satisfies, residual |f - f0 - K (e + s)| [N], and number of evaluations. The forces f and
        slips s satisfy the law exactly.
    """
    high = max(gains.external, gains.internal)
    if high <= 0.0:
        add_nothing(problem, d)
        return Answer(COULOMB if coulomb else ASSOCIATED, 0.0, 0)
    used = problem.modes if gains.external != gains.internal else 0  # equal gains decouple the contacts
    if not coulomb and min(gains.external, gains.internal) <= 0.0:
        raised = Gains(max(gains.external, NEAR * high), max(gains.internal, NEAR * high))
        answer = approach(problem, d, used, raised)
        if answer.law != UNRESOLVED:
            return answer
    raised = Gains(max(gains.external, LEAST * high), max(gains.internal, LEAST * high))
    return solve(problem, d, used, raised, None, True, coulomb, restarts)


@kernel
def approach(problem: FrictionProblem, d: int, count: int, gains: Gains) -> Answer:
    """Solve the associated law for a gain of zero by repeated searches with a raised gain.

    Let E be the stiffness that the raised gain adds. Each search subtracts the force that E exerted in the previous
    search: f = f0 + (K + E)(e + s) - E (e + s'), where s' is the slip of the previous search. This is the proximal
    point method (Rockafellar 1976). The searches converge to f = f0 + K (e + s), the limit of small gains. Each search
    multiplies the error in a direction by eps / (eps + lambda), where eps is the size of E, and lambda the resistance
    of the contacts in that direction.

    If k_e = 0, E (e + s) = sqrt(W) Q h z, which enters g as h z', with z' from the previous search. If k_i = 0, E (e +
    s) = sqrt(W) (y - f0 + (1 + h) Q z).
    """
    for contact in problem.contacts:
        contact.lent = NOTHING
    soft = gains.external < gains.internal
    law, residual, steps = ASSOCIATED, 0.0, 0
    for _ in range(SEARCHES):
        answer = solve(problem, d, count, gains, None, True, False, 0)
        law, residual = answer.law, answer.residual
        steps += answer.evaluations
        if law == UNRESOLVED:
            break
        change, size = pull_back(problem, d, count, gains) if soft else lend(problem, d, count, gains)
        if not change > CLOSE * size:
            break
    for k in range(count):
        problem.unknowns[k].pull = 0.0
    for contact in problem.contacts:
        if contact.weight > 0.0:
            for a in range(d):
                contact.base_force[a] += contact.lent[a]
                if problem.compliant:
                    contact.displacement[a] -= contact.compliance / contact.weight * contact.lent[a]
    return Answer(law, residual, steps)


@kernel
def pull_back(problem: FrictionProblem, d: int, count: int, gains: Gains) -> tuple[float, float]:
    """Update each mode's correction of g for the raised k_e; return the largest change and the largest |y|."""
    change = size = 0.0
    for k in range(count):
        unknown = problem.unknowns[k]
        if unknown.share > 0.0:
            pull = gains.external / ((gains.internal - gains.external) * unknown.share) * unknown.value
            change = max(change, abs(pull - unknown.pull))
            unknown.pull = pull
    for contact in problem.contacts:
        if contact.weight > 0.0:
            for a in range(d):
                size = max(size, abs(contact.force[a]) / math.sqrt(contact.weight))
    return change, size


@kernel
def lend(problem: FrictionProblem, d: int, count: int, gains: Gains) -> tuple[float, float]:
    """Update each contact's correction of f0 for the raised k_i; return the largest change and the largest |y|."""
    h = gains.internal / (gains.external - gains.internal)
    change = size = 0.0
    for contact in problem.contacts:
        if contact.weight == 0.0:
            continue
        root = math.sqrt(contact.weight)
        for a in range(d):
            total = 0.0
            for k in range(count):
                total += contact.modes[k].motion[a] * problem.unknowns[k].value
            lent = contact.force[a] - contact.base_force[a] + root * (1.0 + h) * total
            more = lent - contact.lent[a]
            contact.lent[a] = lent
            contact.base_force[a] -= more
            if problem.compliant:
                contact.displacement[a] += contact.compliance / contact.weight * more
            change = max(change, abs(more) / root)
            size = max(size, abs(contact.force[a]) / root)
    return change, size


@kernel
def friction_force_flexible(
    problem: FrictionProblem, d: int, internal: float, highest: float, definite: bool, coulomb: bool, restarts: int
) -> Answer:
    """Compute the forces of a flexible problem, which defines K^-1 by modes v_k with signs h_k (`cones.equations`).

    Args:
        problem: Problem that contains the modes v_k and the signs h_k.
        d: Number of coordinates of a contact.
        internal: Gain k_i [N/m].
        highest: Upper bound of the eigenvalues of K, at least k_i [N/m].
        definite: Whether no sign is negative, so that the associated problem is convex in the unknowns.
        coulomb: Whether to try Coulomb's law before the associated law.
        restarts: Number of restarts for Coulomb's law.
    """
    return solve(problem, d, problem.modes, Gains(highest, internal), None, definite, coulomb, restarts)


@kernel
def friction_force_square(
    problem: FrictionProblem, d: int, square: Table, symmetric: bool, coulomb: bool, restarts: int
) -> Answer:
    """Compute the forces for any K > 0, given as the matrix `square` in contact frames.

    For n contacts with d coordinates each, the n d unknowns are the entries of e + s.

    The associated solution is unique also for an asymmetric K, but the search may not find it, because it has no convex
    function to decrease.
    """
    m = problem.count * d
    c = 0.0  # above every eigenvalue of K, so that the associated problem is convex
    for p in range(m):
        total = 0.0
        for q in range(m):
            total += abs(square[p, q])
        c = max(c, total)
    if c <= 0.0:
        add_nothing(problem, d)
        return Answer(COULOMB if coulomb else ASSOCIATED, 0.0, 0)
    return solve(problem, d, m, Gains(c, c), square, symmetric, coulomb, restarts)


@kernel
def solve(
    problem: FrictionProblem, d: int, count: int, gains: Gains, square: Table | None, symmetric: bool, coulomb: bool,
    restarts: int,
) -> Answer:  # fmt: skip
    """Solve Coulomb's law if `coulomb` is true; otherwise, or on failure, solve the associated law.

    The starts of the search are described in `friction_force`.
    """
    unknowns = problem.unknowns
    start_others(problem, count)
    total = 0.0
    for k in range(count):
        total += unknowns[k].value
    if not abs(total) <= 1e300:
        for k in range(count):
            unknowns[k].value = 0.0
    steps = 0
    if coulomb:
        end = newton(problem, d, count, gains, square, 0.0, False)
        steps += end.evaluations
        if end.success:
            finish(problem, d, gains.internal, square is None, 0.0)
            return Answer(COULOMB, end.residual, steps)
        for k in range(count):
            unknowns[k].value = 0.0
    end = newton(problem, d, count, gains, square, 1.0, symmetric)
    steps += end.evaluations
    if not end.success:
        clear(problem, d)
        for k in range(count):
            unknowns[k].value = 0.0
        return Answer(UNRESOLVED, end.residual, steps)
    if coulomb:
        far = 0.0
        for k in range(count):
            unknowns[k].associated = unknowns[k].value
            far = max(far, abs(unknowns[k].value))
        for start in range(restarts + 1):
            if start > 0:
                spread(problem, count, start, far)
            end = newton(problem, d, count, gains, square, 0.0, False)
            steps += end.evaluations
            if end.success:
                finish(problem, d, gains.internal, square is None, 0.0)
                return Answer(COULOMB, end.residual, steps)
        for k in range(count):
            unknowns[k].value = unknowns[k].associated
        end = newton(problem, d, count, gains, square, 1.0, symmetric)
        steps += end.evaluations
    finish(problem, d, gains.internal, square is None, 1.0)
    return Answer(ASSOCIATED, end.residual, steps)


@kernel
def start_others(problem: FrictionProblem, count: int) -> None:
    """Set the unknowns that the last search did not have to entries of that search's final g, which are near zero."""
    unknowns = problem.unknowns
    last = problem.started
    if last > 0:
        for k in range(last, count):
            unknowns[k].value = unknowns[k - last].gradient if k < 2 * last else 0.0
    if count > 0:
        problem.started = count


@kernel
def spread(problem: FrictionProblem, count: int, start: int, far: float) -> None:
    """Spread initial values over +-`far` around the associated solution if `start` is odd, and around zero if even."""
    for k in range(count):
        unknown = problem.unknowns[k]
        turn = ((start - 1) * count + k + 1) * GOLDEN
        unknown.value = far * (2.0 * (turn - math.floor(turn)) - 1.0)
        if start % 2:
            unknown.value += unknown.associated


@kernel
def clear(problem: FrictionProblem, d: int) -> None:
    """Set forces and slips to zero, and all statuses except NO_FORCE to FREE."""
    for contact in problem.contacts:
        for a in range(d):
            contact.force[a] = 0.0
            contact.slip[a] = 0.0
        contact.status = min(contact.status, 0)


@kernel
def add_nothing(problem: FrictionProblem, d: int) -> None:
    """Write the solution for zero stiffness: f = f0 at contacts that push, zero force at all others, and no slip."""
    clear(problem, d)
    for contact in problem.contacts:
        pushes = contact.base_force.x > 0.0 or (problem.limited and contact.coefficient < 0.0)
        if contact.status >= 0 and pushes:
            contact.status = STICK
            for a in range(d):
                contact.force[a] = contact.base_force[a]


@kernel
def finish(problem: FrictionProblem, d: int, c: float, weighted: bool, theta: float) -> None:
    """Compute f = sqrt(W) y, and s = (y - t) / (c sqrt(W)) with y before the limit.

    If `weighted` is false, W = I. In a compliant problem, r_i c replaces c.
    """
    for contact in problem.contacts:
        root = math.sqrt(contact.weight) if weighted else 1.0
        if problem.limited:
            turn_back(contact, d, theta, True)
        for a in range(d):
            contact.slip[a] = (contact.force[a] - contact.trial[a]) / (c * root) if root > 0.0 else 0.0
            if weighted and problem.compliant:
                contact.slip[a] /= compliant_share(problem, contact, c)
            contact.force[a] *= root
        if problem.limited:
            contact.force, _ = shorten(contact.force, limit_width(contact.coefficient, d), contact.limit)


@kernel
def newton(
    problem: FrictionProblem, d: int, count: int, gains: Gains, square: Table | None, theta: float, convex: bool
) -> Search:
    """Solve the equations g = 0 of `evaluate` by a semismooth Newton method with a line search.

    If `convex` is true, g is the gradient of a convex function, and every step decreases this function or halves the
    smallest |g| so far. If `convex` is false, every step decreases |g|.
    """
    unknowns = problem.unknowns
    step = problem.step
    value = slope = residual = 0.0
    best = length = math.inf
    t = 1.0
    limit = DESCENT if convex else STEPS
    for k in range(limit):
        merit = evaluate(problem, d, count, gains, square, theta)
        worst, residual = merit.worst, merit.residual
        if worst <= ROUNDING * merit.size or 0.5 * best < worst <= CLOSE * merit.size:
            return Search(True, residual, k + 1)
        if convex:
            # halving the smallest |g| so far cannot cycle, and works below the resolution of the function
            better = worst <= 0.5 * best or merit.value <= value + 1e-4 * t * slope
        else:
            better = worst <= (1.0 - 1e-4 * t) * length
        if k > 0 and not better:
            t *= 0.5
            if t < (1e-9 if convex else SHORTEST):
                return Search(False, residual, k + 1)
            for j in range(count):
                unknowns[j].value = unknowns[j].start + t * step[j]
            continue
        best = min(best, worst)
        value, length, t = merit.value, worst, 1.0
        for j in range(count):
            step[j] = -unknowns[j].gradient
            unknowns[j].start = unknowns[j].value
        if square is None:
            jacobian_of_modes(problem, d, count, gains, theta)
        else:
            jacobian_of_square(problem, d, gains.internal, square, theta)
        if not eliminate(problem.jacobian, step, count):
            return Search(False, residual, k + 1)
        slope = 0.0
        for j in range(count):
            along = step[j]
            if square is not None:
                along *= gains.internal  # the gradient is (c I - K) g
                for q in range(count):
                    along -= square[j, q] * step[q]
            slope += unknowns[j].gradient * along
        for j in range(count):
            unknowns[j].value += step[j]
    return Search(False, residual, limit)


@kernel
def evaluate(problem: FrictionProblem, d: int, count: int, gains: Gains, square: Table | None, theta: float) -> Merit:
    """Evaluate the equations of the modes if `square` is None, else the equations of the square matrix."""
    if square is None:
        return equations_of_modes(problem, d, count, gains, theta)
    return equations_of_square(problem, d, gains.internal, square, theta)
