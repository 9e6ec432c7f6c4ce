"""Forces in products of friction cones, by semismooth Newton.

Both laws of a friction problem (`cones.problem`) are one return map with a dilatancy theta: f = R(t), t = f - c s for
any c > 0. Associated (theta = 1): R projects on the cone; with f0 = 0 f minimises 1/2 (f - K e)' K^-1 (f - K e) over
the cones, and there is one answer. Coulomb (theta = 0): f_n = max(t_n, 0), and f_t is scaled back to mu f_n; large mu
may leave several answers.

Where forces have limits each cone is cut off at |f_i| <= L_i (`cones.cut`): the associated force still minimises the
same function. There a coefficient below zero means another cone (NO_CONE, HALF_SPACE), which is no matter of friction.
The slip s that comes out is then the cone's alone, so that what sticks at its limit stays where it holds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Many, Table
from graspfx.cones.cone import turn_back
from graspfx.cones.cut import limit_width, shorten
from graspfx.cones.elimination import eliminate
from graspfx.cones.mode_equations import Merit, compliant_share, equations_of_modes, jacobian_of_modes
from graspfx.cones.problem import STICK, Answer, FrictionProblem, Gains
from graspfx.cones.square_equations import equations_of_square, jacobian_of_square
from graspfx.spatial import NOTHING, Matrix, Vector

COULOMB, ASSOCIATED, UNRESOLVED = 0, 1, 2  # which law the answer satisfies; unresolved: all forces are zero
ROUNDING = 1e-15  # where Newton stops, relative to the forces at hand
CLOSE = 1e-13  # what is taken where rounding ends the descent earlier
LEAST = 1e-6  # of the larger gain: what a smaller one counts as; scenes have none but a damping of zero (`approach`)
NEAR = 1e-8  # what a zero counts as in each search of `approach`
SEARCHES = 8  # of it at most
STEPS = 100  # evaluations before Coulomb's law starts from elsewhere
DESCENT = 1000  # the same for the associated law: 200 were enough for gains 10^6 apart, 45 for 10^3
SHORTEST = 1e-2  # fraction of a Newton step before Coulomb's law starts from elsewhere
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)  # its multiples fill an interval evenly: the starts are the same every time
RESTARTS = 16  # where time does not matter: at kip/kep = 1000 and mu = 1.5 they leave 1 problem in 40 to the other law


@dataclass(frozen=True, slots=True)
class Search:
    """Whether a search got there, its residual [N], and how often the equations were evaluated."""

    success: bool
    residual: float
    evaluations: int


@kernel
def turn_modes(frames: Many[Matrix], motions: Table, problem: FrictionProblem, d: int, count: int) -> None:
    """Write `count` rigid modes in the contacts' frames, d coordinates each, into the problem.

    Args:
        frames: of the contacts, normal and tangents as rows.
        motions: a row for each mode: its share beta_k, then for every contact three entries in the axes in which the
            frames stand, four where d is 4: the fourth is the torsion about the normal.
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
    """Find the forces for scalar gains: K of eq. (4) in the problem's modes (`cones.mode_equations`).

    At most six unknowns. A contact of weight 0 has no force; a gain below 1e-6 of the other one counts as that, but for
    the associated law's zero, which is the limit of small gains (`approach`).
    Coulomb's law is sought from the unknowns as they are, then from the associated answer, then `restarts` times from
    around that. Where the problem is compliant (K^-1 + C)^-1 is in the place of K, C_i / w_i on each coordinate of
    contact i.

    Returns:
        The law of the answer, its residual |f - f0 - K (e + s)| [N] (f and s fulfil the law exactly), evaluations.
    """
    high = max(gains.external, gains.internal)
    if high <= 0.0:
        add_nothing(problem, d)
        return Answer(COULOMB if coulomb else ASSOCIATED, 0.0, 0)
    used = problem.modes if gains.external != gains.internal else 0  # equal gains: no contact knows of another
    if not coulomb and min(gains.external, gains.internal) <= 0.0:
        raised = Gains(max(gains.external, NEAR * high), max(gains.internal, NEAR * high))
        answer = approach(problem, d, used, raised)
        if answer.law != UNRESOLVED:
            return answer
    raised = Gains(max(gains.external, LEAST * high), max(gains.internal, LEAST * high))
    return solve(problem, d, used, raised, None, True, coulomb, restarts)


@kernel
def approach(problem: FrictionProblem, d: int, count: int, gains: Gains) -> Answer:
    """Seek the associated law of a zero gain, raised to E: a search that is repeated without the raise's last force.

    f = f0 + (K + E)(e + s) - E (e + s'), s' of the search before, is the proximal point method (Rockafellar 1976). It
    ends at f = f0 + K (e + s), the limit of small gains: each search leaves eps / (eps + lambda) of what is wrong along
    a direction that contacts resist with lambda, eps of E.

    k_e = 0: E (e + s) = sqrt(W) Q h z, which g has as h z'. k_i = 0: E (e + s) = sqrt(W) (y - f0 + (1 + h) Q z).
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
    """Take the raise of k_e times the answer off the next g; give by how much that changed, and the size of y."""
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
    """Take the raise of k_i times the answer off the next f0; give by how much that changed, and the size of y."""
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
    """Find the forces where the problem is flexible: K^-1 = [I + sum_k h_k v_k v_k'] / k_i (`cones.mode_equations`).

    Args:
        problem: with its modes v_k and their signs.
        d: coordinates of a contact.
        internal: k_i.
        highest: bound of the eigenvalues of K, k_i or more.
        definite: no sign is negative: the associated problem is a convex one in these unknowns too.
        coulomb: whether Coulomb's law is sought first.
        restarts: of it.
    """
    return solve(problem, d, problem.modes, Gains(highest, internal), None, definite, coulomb, restarts)


@kernel
def friction_force_square(
    problem: FrictionProblem, d: int, square: Table, symmetric: bool, coulomb: bool, restarts: int
) -> Answer:
    """Find the forces for any K > 0 in contact frames; the n d unknowns are e + s.

    An asymmetric K has one associated answer too, but no convex function leads there: it can end unresolved.
    """
    m = problem.count * d
    c = 0.0  # above every eigenvalue of K: there the associated problem is convex
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
    """Seek Coulomb from the unknowns as they are, from the associated answer, from around it; else the associated."""
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
    """Start the unknowns that the last search did not have: near zero, from where the last equations' g ended."""
    unknowns = problem.unknowns
    last = problem.started
    if last > 0:
        for k in range(last, count):
            unknowns[k].value = unknowns[k - last].gradient if k < 2 * last else 0.0
    if count > 0:
        problem.started = count


@kernel
def spread(problem: FrictionProblem, count: int, start: int, far: float) -> None:
    """Put the unknowns to start number `start`: evenly over +-far around the associated answer, and around zero."""
    for k in range(count):
        unknown = problem.unknowns[k]
        turn = ((start - 1) * count + k + 1) * GOLDEN
        unknown.value = far * (2.0 * (turn - math.floor(turn)) - 1.0)
        if start % 2:
            unknown.value += unknown.associated


@kernel
def clear(problem: FrictionProblem, d: int) -> None:
    """Put force and slip to zero."""
    for contact in problem.contacts:
        for a in range(d):
            contact.force[a] = 0.0
            contact.slip[a] = 0.0
        contact.status = min(contact.status, 0)


@kernel
def add_nothing(problem: FrictionProblem, d: int) -> None:
    """Add nothing where there is no stiffness: f = f0, no slip."""
    clear(problem, d)
    for contact in problem.contacts:
        pushes = contact.base_force.x > 0.0 or (problem.limited and contact.coefficient < 0.0)
        if contact.status >= 0 and pushes:
            contact.status = STICK
            for a in range(d):
                contact.force[a] = contact.base_force[a]


@kernel
def finish(problem: FrictionProblem, d: int, c: float, weighted: bool, theta: float) -> None:
    """Compute f = sqrt(W) y and s = (y - t) / (c sqrt(W)), y before its limit, r_i c with compliances in series."""
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
    """Seek g = 0 by semismooth Newton with a line search.

    With `convex` g belongs to the gradient of a convex function, which falls until it gets there; else |g| has to fall.
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
            # halving the least |g| so far is no cycle, and not blind where the function's digits end
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
    """Evaluate the equations: those of modes, or of a square."""
    if square is None:
        return equations_of_modes(problem, d, count, gains, theta)
    return equations_of_square(problem, d, gains.internal, square, theta)
