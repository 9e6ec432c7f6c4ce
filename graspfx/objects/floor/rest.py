"""One sample of a body on fixed planes: contact forces, and motion under these forces.

A contact is a spring and a damper with Coulomb friction, evaluated at the end of the sample of T [s]:

    lambda_n = -k (g + T u_n) - b u_n,  lambda_t = -k (s + T u_t) - b u_t,  |lambda_t| <= mu lambda_n

The contact force lambda and the velocity u of the contact point have a normal part (n) and a tangential part (t). k is
the stiffness, b the damping and mu the coefficient of friction. g is the gap and s the tangential displacement since
the contact last began to stick, both at the start of the sample. The velocity at the end of the sample,
u = u_free + W lambda, includes the effect of the forces, with W = T G' M^-1 G, the grasp matrix G of the contacts and
the mass matrix M. Equivalently, lambda = K (e + slip) with K^-1 = a I + W and a = 1/(k T + b), where e is the
displacement without forces or slip. This is the form of `cones.problem`. Its modes are the six orthogonalised columns
of M^-1/2 G, so that there are at most six unknowns for any number of contacts. The contact forces are constant over the
sample like those of the fingers. The body's integrator then moves the body under all forces together, so that the
integrator's order, momentum and exact viscosity in free motion are kept. If a body cannot reach a plane in the sample,
its step is bitwise that of a body without planes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from graspfx.compile.kernel import inline, kernel
from graspfx.compile.records import Table
from graspfx.cones.friction import ASSOCIATED, UNRESOLVED, friction_force
from graspfx.cones.problem import FREE, Gains
from graspfx.objects.body_state import EXACT, EXPLICIT, IMPLICIT, BodyState, Motion, copy_motion
from graspfx.objects.floor.planes import FloorState, lowest, thin
from graspfx.objects.integrators import coefficients, multiply, predict, spin_of, step
from graspfx.spatial import ZERO, Matrix, Vector, cross, dot, exponential, orthogonalise, rotate, total

NEAR = 0.05  # relative to the body's reach: closer points are contacts as soon as any point touches the plane
NO_MODE = 1e-20  # squared length, relative to the longest mode, below which a mode is zero
RESTARTS = 4  # number of restarts of the search for a solution of Coulomb's law


def lookahead(kind: int, T: float) -> float:
    """Return the time between the end of the sample and the time at which the gap is evaluated [s].

    With this time, a change dv of the velocity at the end of a sample of T [s] changes the gap by T dv for every
    integrator.
    """
    if kind == EXPLICIT:
        return T
    return 0.5 * T if kind == EXACT else 0.0


@kernel
def step_on_planes(body: BodyState, floor: FloorState, T: float) -> int:
    """Move the body by T [s]; return the number of contacts, or -1 if the contact forces did not converge."""
    copy_motion(body.motion, floor.before)
    step(body, T)
    count = meet(body, floor, T)
    if count == 0:
        if floor.touching > 0:
            part(floor)
        return 0
    if not solve(body, floor, T, count):
        return -1
    copy_motion(floor.before, body.motion)
    floor.finger_force, floor.finger_moment = body.force, body.moment
    body.force += floor.force
    body.moment += floor.moment
    step(body, T)
    body.force, body.moment = floor.finger_force, floor.finger_moment
    remember(body, floor, T, count)
    return count


@kernel
def part(floor: FloorState) -> None:
    """Set all contact forces and all stretches to zero, because the body has left the planes."""
    forget(floor)
    floor.force = floor.moment = ZERO
    for k in range(6):
        floor.unknowns[k] = 0.0
    floor.touching = 0


@kernel
def forget(floor: FloorState) -> None:
    """Set the stretch of every pair of plane and feature to zero."""
    for k in range(floor.plane_count * floor.feature_count):
        floor.memory[k, 0] = 0.0
        floor.memory[k, 1] = 0.0


@inline
def point_velocity(motion: Motion, arm: Vector) -> Vector:
    """Return the velocity v + w x r of a point of a body at r = `arm` from the centre [m/s]; r is in world axes."""
    v, w = motion.velocity, motion.angular_velocity
    return Vector(
        v.x + w.y * arm.z - w.z * arm.y,
        v.y + w.z * arm.x - w.x * arm.z,
        v.z + w.x * arm.y - w.y * arm.x,
    )


@kernel
def meet(body: BodyState, floor: FloorState, T: float) -> int:
    """List the contacts of a body that has moved without contact forces, and return their number.

    The number is 0 if no feature is below a plane at the end of the sample.
    """
    motion, contacts = body.motion, floor.contacts
    lead = lookahead(body.integrator, T)
    w = motion.angular_velocity
    spin = math.sqrt(w.x * w.x + w.y * w.y + w.z * w.z)
    near = NEAR * floor.reach
    count = 0
    touches = False
    for p, plane in enumerate(floor.planes):
        n = plane.frame.first
        height = dot(n, motion.position) - plane.distance
        sink = dot(n, motion.velocity)
        if height + lead * (sink - spin * floor.reach) > floor.reach + near:
            continue
        close = 0
        for f, feature in enumerate(floor.features):
            share, arm = lowest(body, feature, n)
            if share <= 0.0:
                continue
            speed = dot(n, point_velocity(motion, arm))
            gap = height + n.x * arm.x + n.y * arm.y + n.z * arm.z + lead * speed
            if gap < near:
                contact = contacts[count + close]
                contact.pair, contact.plane, contact.share = p * floor.feature_count + f, p, share
                contact.arm, contact.gap, contact.speed[0] = arm, gap, speed
                touches = touches or gap < 0.0
                close += 1
        count += thin(contacts, count, close, plane)
    if not touches:
        return 0
    for i in range(count):
        contact = contacts[i]
        velocity = point_velocity(motion, contact.arm)
        for a in range(1, body.dimensions):
            contact.speed[a] = dot(floor.planes[contact.plane].frame.row(a), velocity)
    return count


@kernel
def solve(body: BodyState, floor: FloorState, T: float, n: int) -> bool:
    """Compute the forces of the first n contacts and their sum; return False if the forces did not converge."""
    d = body.dimensions
    k, b = floor.stiffness, floor.damping
    gain = k * T + b
    modes = Table(floor.modes.buffer, floor.modes.offset, 1 + n * d)
    count, stiffest = contact_modes(body, floor, T, n, modes)
    least = 1.0 / (1.0 / gain + stiffest)
    problem = floor.problem
    problem.count = n
    for i, cone in enumerate(problem.contacts):
        contact = floor.contacts[i]
        cone.weight, cone.coefficient, cone.status = contact.share, floor.friction, FREE
        cone.displacement[0] = (
            -(k * contact.gap + b * contact.speed.x) / gain if contact.gap < 0.0 else -contact.gap / T
        )
        for a in range(1, d):
            cone.displacement[a] = -k * floor.memory[contact.pair, a - 1] / gain - contact.speed[a]
        for a in range(d):
            cone.base_force[a] = 0.0
    problem.modes = problem.started = count
    for j in range(count):
        unknown = problem.unknowns[j]
        unknown.value = floor.unknowns[j]
        kappa = 1.0 / (1.0 / gain + modes[j, 0])
        unknown.share = (gain - kappa) / (gain - least) if gain > least else 1.0
        for i, cone in enumerate(problem.contacts):
            for a in range(d):
                cone.modes[j].motion[a] = modes[j, 1 + i * d + a]
    law = friction_force(problem, d, Gains(least, gain), True, RESTARTS).law
    if law == UNRESOLVED:
        return False
    if law == ASSOCIATED:
        floor.associated += 1
    for j in range(6):
        floor.unknowns[j] = problem.unknowns[j].value if j < count else 0.0
    take_forces(floor, d)
    return True


@kernel
def take_forces(floor: FloorState, d: int) -> None:
    """Sum the contact forces, and their moments about the body's centre, and store each contact's slip."""
    floor.force = floor.moment = ZERO
    for i, cone in enumerate(floor.problem.contacts):
        contact = floor.contacts[i]
        force = ZERO
        for a in range(d):
            force += cone.force[a] * floor.planes[contact.plane].frame.row(a)
        floor.force += force
        floor.moment += cross(contact.arm, force)
        contact.pressed = cone.force.x > 0.0
        for a in range(1, d):
            contact.slip[a] = cone.slip[a]


@kernel
def remember(body: BodyState, floor: FloorState, T: float, n: int) -> None:
    """Set the stretch s of loaded contacts to s + T (u - slip), where u is the new velocity, and all others to zero."""
    for i in range(n):
        contact = floor.contacts[i]
        contact.stretch = ZERO
        if contact.pressed:
            velocity = point_velocity(body.motion, contact.arm)
            for a in range(1, body.dimensions):
                u = dot(floor.planes[contact.plane].frame.row(a), velocity)
                contact.stretch[a] = floor.memory[contact.pair, a - 1] + T * (u - contact.slip[a])
    forget(floor)
    touching = 0
    for i in range(n):
        contact = floor.contacts[i]
        touching += 1 if contact.pressed else 0
        for a in range(2):
            floor.memory[contact.pair, a] = contact.stretch[a + 1]
    floor.touching = touching


@kernel
def predict_on_planes(body: BodyState, floor: FloorState, T: float) -> None:
    """Predict the implicit integrator's motion over T [s] under the planes' forces of the last sample.

    The fingers exert no wrench. With these forces, a body that rests on a floor is predicted to remain there.
    """
    gravity, next_motion = body.gravity, body.next_motion
    body.gravity += floor.force / body.mass
    predict(body, T)
    body.gravity = gravity
    turn = body.rotational_compliance @ floor.moment
    if turn.x == 0.0 and turn.y == 0.0 and turn.z == 0.0:
        return
    q, R = exponential(turn), next_motion.rotation
    x = rotate(q, Vector(R.xx, R.yx, R.zx))
    y = rotate(q, Vector(R.xy, R.yy, R.zy))
    z = rotate(q, Vector(R.xz, R.yz, R.zz))
    next_motion.rotation = Matrix(x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z)
    next_motion.angular_velocity += turn / T


# Compliance at the contacts: W = T G' M^-1 G as orthogonal modes ------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Triangle:
    """A lower triangular matrix, with entries named by row and column."""

    xx: float
    yx: float
    yy: float
    zx: float
    zy: float
    zz: float

    def transposed_times(self, v: Vector) -> Vector:
        return Vector(
            self.xx * v.x + self.yx * v.y + self.zx * v.z,
            self.yy * v.y + self.zy * v.z,
            self.zz * v.z,
        )


@kernel
def contact_modes(body: BodyState, floor: FloorState, T: float, n: int, modes: Table) -> tuple[int, float]:
    """Compute orthogonal vectors whose outer products sum to W, and store the squared length and unit vector of each.

    W = T G' M^-1 G is the velocity of the contacts due to a contact force that is constant over the sample of T [s].

    Returns:
        Number of vectors (modes), and the largest squared length.
    """
    d = body.dimensions
    m = body.mass
    c = coefficients(body.integrator, body.viscosity / m, T)
    root_mobility = math.sqrt(c.s / m)
    L = turning_root(body, T)
    for i in range(n):
        contact = floor.contacts[i]
        root = math.sqrt(contact.share)
        for a in range(d):
            e = root * floor.planes[contact.plane].frame.row(a)
            shift = multiply(root_mobility * e, body.free_translation)
            turn = L.transposed_times(cross(contact.arm, e))
            k = 1 + i * d + a
            modes[0, k], modes[1, k], modes[2, k] = shift.x, shift.y, shift.z
            modes[3, k], modes[4, k], modes[5, k] = turn.x, turn.y, turn.z
    orthogonalise(modes, 0, 6)
    return normalise_modes(modes)


@kernel
def normalise_modes(modes: Table) -> tuple[int, float]:
    """Normalise the modes, store each squared length before its unit vector, and remove modes of length zero.

    Returns:
        Number of modes, and the largest squared length.
    """
    longest = 0.0
    for j in range(6):
        modes[j, 0] = 0.0
        for c in range(1, modes.columns):
            modes[j, 0] += modes[j, c] * modes[j, c]
        longest = max(longest, modes[j, 0])
    count = 0
    for j in range(6):
        if modes[j, 0] > NO_MODE * longest:
            square = modes[j, 0]
            root = 1.0 / math.sqrt(square)
            for c in range(1, modes.columns):
                modes[count, c] = root * modes[j, c]
            modes[count, 0] = square
            count += 1
    return count, longest


@kernel
def turning_root(body: BodyState, T: float) -> Triangle:
    """Compute L such that L L' is the angular velocity due to a unit moment over T [s]; zero for locked rotations."""
    d, kind, b, free = body.dimensions, body.integrator, body.rotational_viscosity, body.free_rotation
    if d < 3:
        J = body.inertia.z
        if d == 1 or free.z == 0.0:
            return Triangle(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        c = coefficients(kind, b / J, T)
        return Triangle(0.0, 0.0, 0.0, 0.0, 0.0, math.sqrt(c.s / J))
    if total(free) == 0.0:
        return Triangle(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    extra = 0.0
    if kind == IMPLICIT:
        extra = T * b
    if kind == EXACT:
        extra = 0.5 * T * b  # (1 - exp(-z))/z = 1/(1 + z/2) to second order
    q = body.motion.quaternion
    x = spin_of(body, q, extra, Vector(T, 0.0, 0.0))
    y = spin_of(body, q, extra, Vector(0.0, T, 0.0))
    z = spin_of(body, q, extra, Vector(0.0, 0.0, T))
    xx = yx = yy = zx = zy = zz = 0.0
    if free.x != 0.0:
        xx = math.sqrt(x.x)
        yx, zx = x.y / xx, x.z / xx
    if free.y != 0.0:
        yy = math.sqrt(y.y - yx * yx)
        zy = (y.z - zx * yx) / yy
    if free.z != 0.0:
        zz = math.sqrt(z.z - zx * zx - zy * zy)
    return Triangle(xx, yx, yy, zx, zy, zz)
