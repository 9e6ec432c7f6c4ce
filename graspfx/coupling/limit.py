"""Limits of the forces in a sample: before the object moves, forces are limited to what the devices can exert.

If only the devices limited the forces, energy would be generated, because the object would receive forces that the
devices do not exert. The limits are normally part of the projection: each cone is intersected with the ball
|f_i| <= L_i of the finger's limit, and the sample is solved again. The elastic force then remains the gradient of a
convex function (`graspfx.cones.cone`). Forces that are still too large are scaled: first the internal force alone, then
the whole force.

Scaled forces stay in their cones, and the direction of the wrench does not change. Let a = P f be the smallest contact
forces with the wrench of f, and b = f - a the internal force. The scaled force is alpha (a + lambda b). If possible,
alpha = 1, and lambda is the largest number in [lambda_c, 1] for which |a_i + lambda b_i| <= L_i for every finger. If
there is no such number, lambda minimises the largest |a_i + lambda b_i| / L_i, and alpha < 1. If lambda >= lambda_c,
all forces are in their cones; below lambda_c a finger would slip or pull. P is the projector for the points at which
the forces act. It includes only the force components that the contacts transmit, which are the normal components if
there is no friction.
"""

from __future__ import annotations

import math

from graspfx.compile.kernel import inline, kernel
from graspfx.compile.records import Floats, Record
from graspfx.cones.cone import HALF_SPACE, NO_CONE, force_size, shorten
from graspfx.cones.friction import UNRESOLVED as NONE
from graspfx.cones.problem import FrictionProblem, Gains
from graspfx.coupling.contact_frames import in_frame, out_of_frame
from graspfx.coupling.contacts import UNRESOLVED
from graspfx.coupling.coulomb import force_of_modes, force_with_friction, pose_compliances, pose_problem
from graspfx.coupling.frictionless import frictionless_force
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.law import bilateral, keep_elastic, react
from graspfx.coupling.pad import press, relax
from graspfx.coupling.unilateral import damp_alone
from graspfx.spatial import NOTHING, ZERO, Vector, Vector4, cross, dot, orthogonalise, with_torsion

NEARLY = 1.0 - 1e-12  # fraction of a limit from which a force counts as limited
LIMIT_MARGIN = 1.0 - 1e-14  # used fraction of a limit, so that rounding never activates the device's own limit
ROUNDING = 1e-15  # tolerance of a finger's cone, relative to the finger's force
LEAST = 1e-14  # fraction of the longest wrench direction, below which a direction counts as zero
TOUCHING = 1.0 + 4e-15  # factor on a limit with its margin, so that projected forces count as within the limit
HALVINGS = 60  # bisections of an interval, down to rounding
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
SECTIONS = 80  # golden-section steps
NORMAL_ONLY = 1  # force that a contact transmits: 0 none, 1 along the normal, 2 in all directions


class DirectionPart(Record):
    """Part of one finger in a direction of contact forces.

    A contact without tangential force uses only the first entry.
    """

    force: Vector4


@kernel
def limit(grasp: GraspState, fault: int) -> int:
    """Reduce the forces of a sample to the limits; return `fault`, or UNRESOLVED if the limited law is not solved.

    The law's forces before limits are stored in the block, and the fingers at a limit are marked. Forces within the
    limits are unchanged.
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
    """Limit forces that were increased after the call of `limit`, and add the increase to the law's forces."""
    for finger in grasp.fingers:
        finger.law_force -= finger.force
    react(grasp)
    for finger in grasp.fingers:
        finger.law_force += finger.force
    scale(grasp, False)
    mark(grasp, False)


@kernel
def forget_limits(grasp: GraspState) -> None:
    """Set the law's forces to zero, and clear the marks of fingers at a limit."""
    for finger in grasp.fingers:
        finger.saturated = False
        finger.law_force = ZERO


@kernel
def store_law(grasp: GraspState) -> None:
    """Store the present forces, in world axes, as the law's forces, and clear the marks of fingers at a limit."""
    react(grasp)
    for finger in grasp.fingers:
        finger.saturated = False
        finger.law_force = finger.force


@kernel
def exceeds(grasp: GraspState) -> bool:
    """Return whether the force or the elastic force of some finger exceeds its limit."""
    beyond = False
    for finger in grasp.fingers:
        most = LIMIT_MARGIN * finger.limit
        if force_size(finger.local, width(grasp)) > most or force_size(finger.elastic, width(grasp)) > most:
            beyond = True
    return beyond


@kernel
def width(grasp: GraspState) -> int:
    """Return the number of force entries that a limit bounds: 4 with friction, including torsion, else 3."""
    return 4 if grasp.friction else 3


@kernel
def mark(grasp: GraspState, inside: bool) -> None:
    """Mark fingers whose force is at the limit and, if `inside`, also fingers whose elastic force is at the limit."""
    for finger in grasp.fingers:
        least = NEARLY * LIMIT_MARGIN * finger.limit
        if force_size(finger.local, width(grasp)) >= least:
            finger.saturated = True
        if inside and force_size(finger.elastic, width(grasp)) >= least:
            finger.saturated = True


@kernel
def is_inside(grasp: GraspState) -> bool:
    """Return whether the limits can be part of the projection.

    This is not possible with the implicit integrator, with matrix gains without friction, or with unequal gains
    and compliant fingertips that stick.
    """
    if grasp.padded and grasp.stick and not grasp.equal:
        return False
    return not grasp.implicit and (grasp.friction or not grasp.dense)


@kernel
def force_in_cut_cones(grasp: GraspState) -> int:
    """Compute the elastic force in the limited cones, then add damping; return 0 or UNRESOLVED."""
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
    """Limit each finger separately, for equal gains: shorten the elastic force, then the sum with damping."""
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
    """Shorten the force of every finger to its limit."""
    for finger in grasp.fingers:
        finger.local, _ = shorten(finger.local, width(grasp), finger.cut)


@kernel
def force_in_balls(grasp: GraspState) -> int:
    """Compute the forces with |f_i| <= L_i that are nearest to the law's forces, in the norms of K^-1 and D^-1.

    Contacts are attached or sticking. A sticking finger that the law released stays free, and a touching finger that
    sticks only pushes. Return 0 or UNRESOLVED.
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
    """Compute the elastic force in balls instead of cones if `elastic` is true, else add damping.

    Return 0 or UNRESOLVED.
    """
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


@kernel
def scale(grasp: GraspState, elastic: bool) -> None:
    """Scale the forces into the limits; if `elastic` is true, scale the elastic forces by the same two factors."""
    if not largest_load(grasp) > TOUCHING:
        return
    count = wrench_modes(grasp)
    project(grasp, False, count)
    low = least_squeeze(grasp)
    best = lightest(grasp, low)
    squeeze = best
    if overload(grasp, best) <= 1.0:
        squeeze = most_squeeze(grasp, best)
    load = overload(grasp, squeeze)
    alpha = 1.0 / load if load > 1.0 else 1.0
    if grasp.guarded:
        grasp.squeeze *= squeeze
        grasp.outer *= alpha
    for finger in grasp.fingers:
        finger.local = alpha * (finger.carried + squeeze * (finger.local - finger.carried))
    if elastic:
        project(grasp, True, count)
        for finger in grasp.fingers:
            finger.elastic = alpha * (finger.carried + squeeze * (finger.elastic - finger.carried))


@kernel
def largest_load(grasp: GraspState) -> float:
    """Compute the largest ratio |f_i| / L_i of a finger's force to its limit."""
    most = 0.0
    for finger in grasp.fingers:
        most = max(most, length(finger.local.vector) / (LIMIT_MARGIN * finger.limit))
    return most


@kernel
def overload(grasp: GraspState, squeeze: float) -> float:
    """Compute the largest ratio |a_i + lambda b_i| / L_i, where lambda is `squeeze`."""
    most = 0.0
    for finger in grasp.fingers:
        most = max(most, length(squeezed(finger, squeeze).vector) / (LIMIT_MARGIN * finger.limit))
    return most


@inline
def squeezed(finger: FingerState, squeeze: float) -> Vector4:
    """Compute the force a_i + lambda (f_i - a_i) of a finger, where lambda is `squeeze`."""
    return finger.carried + squeeze * (finger.local - finger.carried)


@inline
def length(v: Vector) -> float:
    """Compute |v|."""
    return math.sqrt(0.0 + v.x * v.x + v.y * v.y + v.z * v.z)


@kernel
def capacity(grasp: GraspState, finger: FingerState) -> int:
    """Return which force a contact transmits: 0 for none, 1 along the normal, 2 in all directions."""
    if grasp.attached:
        return 2
    if not finger.touching:
        return 0
    return 2 if grasp.stick or finger.coefficient > 0.0 else NORMAL_ONLY


@kernel
def wrench_modes(grasp: GraspState) -> int:
    """Write orthonormal directions of transmitted contact forces whose wrench is not zero; return their number.

    The directions span the columns of G' for the free degrees of freedom, with lever arms to the points at which forces
    act. A contact that transmits only a normal force uses only the first of its four entries, so rounding errors in
    tangential entries cannot disturb small directions.
    """
    shifts, turns = grasp.freedom.shifts, grasp.freedom.turns
    for k in range(shifts + turns):
        axis = grasp.freedom.axes[k].vector
        for i, finger in enumerate(grasp.fingers):
            kind = capacity(grasp, finger)
            force, torsion = axis, 0.0
            if k >= shifts:
                arm = finger.contact
                if not grasp.at_contact:
                    arm += finger.displacement.vector
                force = cross(axis, arm)
                if grasp.coordinates > 3:
                    torsion = finger.patch * dot(axis, finger.twist_axis)
            part = with_torsion(force, torsion)
            if kind == NORMAL_ONLY:
                part = Vector4(dot(finger.normal, force), 0.0, 0.0, 0.0)
            if kind == 0:
                part = NOTHING
            part_of(grasp.directions[k], i).force = part
    orthogonalise(grasp.directions, 0, shifts + turns)
    return normalise_directions(grasp, shifts + turns)


@inline
def part_of(direction: Floats, i: int) -> DirectionPart:
    """Return finger i's part of a direction."""
    return DirectionPart(direction.buffer, direction.offset + (1 + 4 * i))


@kernel
def normalise_directions(grasp: GraspState, count: int) -> int:
    """Normalise the directions whose length exceeds rounding, move them to the front, and return their number."""
    size = grasp.directions.columns
    longest = 0.0
    for k in range(count):
        direction = grasp.directions[k]
        square = 0.0
        for j in range(1, size):
            square += direction[j] * direction[j]
        direction[0] = math.sqrt(square)
        longest = max(longest, direction[0])
    used = 0
    for k in range(count):
        norm = grasp.directions[k, 0]
        if norm > LEAST * longest:
            for j in range(1, size):
                grasp.directions[used, j] = grasp.directions[k, j] / norm
            used += 1
    return used


@kernel
def project(grasp: GraspState, elastic: bool, count: int) -> None:
    """Compute a = P f of the forces or, if `elastic` is true, of the elastic forces.

    The projection is repeated once, so that the wrench of f - a is zero up to rounding errors.
    """
    for finger in grasp.fingers:
        finger.carried = NOTHING
    for _ in range(2):
        for k in range(count):
            direction = grasp.directions[k]
            along = 0.0
            for i, finger in enumerate(grasp.fingers):
                u, a = part_of(direction, i).force, finger.carried
                f = finger.elastic if elastic else finger.local
                if capacity(grasp, finger) == NORMAL_ONLY:
                    along += u.x * (dot(finger.normal, f.vector) - a.x)
                else:
                    along += u.x * (f.x - a.x)
                    along += u.y * (f.y - a.y)
                    along += u.z * (f.z - a.z)
                    along += u.t * (f.t - a.t)
            for i, finger in enumerate(grasp.fingers):
                finger.carried += along * part_of(direction, i).force
    for finger in grasp.fingers:
        if capacity(grasp, finger) == NORMAL_ONLY:
            finger.carried = with_torsion(finger.carried.x * finger.normal, finger.carried.t)


@kernel
def depth_in_cone(grasp: GraspState, finger: FingerState, squeeze: float) -> float:
    """Compute mu f_n - |f_t|, or f_n without friction, of a_i + lambda b_i, where lambda is `squeeze`.

    A rounding tolerance is added; a negative result means that the force is outside its cone.
    """
    f, x = finger.local, squeezed(finger, squeeze)
    normal = dot(x.vector, finger.normal)
    slack = ROUNDING * math.sqrt(f.x * f.x + f.y * f.y + f.z * f.z + f.t * f.t)
    if grasp.stick or finger.coefficient == 0.0:
        return normal + slack
    tangent = x.vector - normal * finger.normal
    along = math.sqrt(tangent.x * tangent.x + tangent.y * tangent.y + tangent.z * tangent.z + x.t * x.t)
    return finger.coefficient * normal - along + slack


@kernel
def least_squeeze(grasp: GraspState) -> float:
    """Find lambda_c, the smallest lambda for which all forces are in their cones, by bisection.

    `depth_in_cone` is concave, so all forces are in their cones for every lambda in [lambda_c, 1].
    """
    least = 0.0
    if grasp.attached:
        return least
    for finger in grasp.fingers:
        if capacity(grasp, finger) != 0 and depth_in_cone(grasp, finger, least) < 0.0:
            low, high = least, 1.0
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                if depth_in_cone(grasp, finger, middle) < 0.0:
                    low = middle
                else:
                    high = middle
            least = high
    return least


@kernel
def lightest(grasp: GraspState, low: float) -> float:
    """Find the lambda in [low, 1] for which `overload`, a convex function of lambda, is smallest."""
    high = 1.0
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_left, at_right = overload(grasp, left), overload(grasp, right)
    for _ in range(SECTIONS):
        if at_left <= at_right:
            high, right, at_right = right, left, at_left
            left = high - GOLDEN * (high - low)
            at_left = overload(grasp, left)
        else:
            low, left, at_left = left, right, at_right
            right = low + GOLDEN * (high - low)
            at_right = overload(grasp, right)
    return left if at_left <= at_right else right


@kernel
def most_squeeze(grasp: GraspState, low: float) -> float:
    """Find the largest lambda in [low, 1] for which `overload` is at most 1; this must hold for `low`."""
    high = 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if overload(grasp, middle) <= 1.0:
            low = middle
        else:
            high = middle
    return low
