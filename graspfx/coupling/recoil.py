"""Bilateral forces of eq. (4) at the end of a sample in which they move the object, in O(n) operations.

With the implicit integrator, the forces are f = K (e - G'u) + D (e' - H'u / T). They displace the object by u:

    [C^-1 + G K G' + H D H' / T] u = G K e + H D e',

where C is the object's compliance, and T the period. G contains the lever arms of the contacts, and H the lever arms of
the points at which rates are computed. For scalar gains, G K G' = kip G W G' + (kep - kip) T' beta T, where Q contains
the modes, beta their blends, and T now denotes the matrix Q'sqrt(W) G' with one row per mode.
"""

from __future__ import annotations

import math

from graspfx.compile.kernel import inline, kernel
from graspfx.compile.records import Table
from graspfx.cones.factors import factor_definite, solve_factored
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.grasp.rigid_modes import motion_of
from graspfx.spatial import ZERO, Vector, Vector4, cross, dot, with_torsion


@kernel
def recoil(grasp: GraspState, damped: bool, slipped: bool) -> None:
    """Compute the bilateral forces and the object's displacement u, with damping if `damped` is true.

    If `slipped` is true, the displacements are e + s, with the slip s of the elastic force.
    """
    ked = grasp.external_damping if damped else 0.0
    kid = grasp.internal_damping if damped else 0.0
    kep, kip, per = grasp.external_stiffness, grasp.internal_stiffness, 1.0 / grasp.period
    shifts, turns, state = grasp.freedom.shifts, grasp.freedom.turns, grasp.recoil
    find_levers(grasp, damped)
    stretch, rate = state.stretch, state.rate
    for k in range(grasp.mode_count):
        mode = grasp.modes[k]
        p = q = 0.0
        for i, finger in enumerate(grasp.fingers):
            motion = motion_of(mode, i, grasp.width)
            e = finger.retained if slipped else finger.displacement
            along = dot(motion.shift, e.vector)
            if grasp.coordinates > 3:
                along += motion.twist * e.t
            p += finger.sqrt_weight * along
            if damped:
                along = dot(motion.shift, finger.rate.vector)
                if grasp.coordinates > 3:
                    along += motion.twist * finger.rate.t
                q += finger.sqrt_weight * along
        stretch[k], rate[k] = p, q
    find_motion(grasp, kep, ked, kip, kid, damped, slipped)
    for k in range(grasp.mode_count):
        p, q = stretch[k], rate[k]
        for u in range(shifts + turns):
            p -= state.elastic_share[k, u] * state.motion[u]
            if damped:
                q -= per * damping_share(grasp)[k, u] * state.motion[u]
        stretch[k] = grasp.modes[k, 0] * ((kep - kip) * p + (ked - kid) * q)
    shift, turn = motion_of_object(grasp)
    for i, finger in enumerate(grasp.fingers):
        e = finger.retained if slipped else finger.displacement
        f = kip * (e - path_of(grasp, finger, shift, turn, False))
        if damped:
            f += kid * (finger.rate - per * path_of(grasp, finger, shift, turn, not grasp.at_contact))
        f = finger.weight * f
        for k in range(grasp.mode_count):
            motion = motion_of(grasp.modes[k], i, grasp.width)
            twist = motion.twist if grasp.coordinates > 3 else 0.0
            f += (stretch[k] * finger.sqrt_weight) * with_torsion(motion.shift, twist)
        finger.local = f


@kernel
def find_levers(grasp: GraspState, damped: bool) -> None:
    """Compute the levers of this sample; levers of the contacts are recomputed only if they may have changed."""
    state = grasp.recoil
    if not state.current or state.twisted:
        write_roots(grasp)
        write_levers(grasp, False, state.elastic_share, state.elastic_weight)
        state.current = True
    if damped and state.distant:
        write_levers(grasp, True, state.damping_share, state.damping_weight)


@inline
def damping_share(grasp: GraspState) -> Table:
    """Return the matrix T = Q'sqrt(W) H' of the levers H of damping."""
    return grasp.recoil.damping_share if grasp.recoil.distant else grasp.recoil.elastic_share


@kernel
def write_levers(grasp: GraspState, at_tip: bool, share: Table, weight: Table) -> None:
    """Compute T = Q'sqrt(W) G' of all free directions, and G W G' of the rotations.

    For a translation, T is known: sqrt(sum w) for the mode of that translation, and zero for the other modes. For a
    rotation about a and mode k, T is a . sum_i sqrt(w_i) r_i x q_k(i). For rotations about a and b, G W G' is
    a'(sum_i w_i (r_i^2 I - r_i r_i')) b.
    """
    shifts, turns = grasp.freedom.shifts, grasp.freedom.turns
    total = 0.0
    for finger in grasp.fingers:
        total += finger.weight
    root = math.sqrt(total)
    for k in range(6):
        for u in range(shifts + turns):
            share[k, u] = root if k == u and u < shifts else 0.0
    if turns == 0:
        return
    for k in range(grasp.mode_count):
        moment = ZERO
        for i, finger in enumerate(grasp.fingers):
            motion = motion_of(grasp.modes[k], i, grasp.width)
            moment += finger.sqrt_weight * cross(arm(grasp, finger, at_tip), motion.shift)
            if grasp.coordinates > 3:
                moment += (finger.sqrt_weight * motion.twist * finger.patch) * finger.twist_axis
        for u in range(turns):
            share[k, shifts + u] = dot(grasp.freedom.axes[shifts + u].vector, moment)
    square, x, y, z = second_moment(grasp, at_tip)
    for u in range(turns):
        axis = grasp.freedom.axes[shifts + u].vector
        along = Vector(dot(x, axis), dot(y, axis), dot(z, axis))
        for v in range(u + 1):
            other = grasp.freedom.axes[shifts + v].vector
            weight[u, v] = square * dot(axis, other) - dot(other, along)


@kernel
def second_moment(grasp: GraspState, at_tip: bool) -> tuple[float, Vector, Vector, Vector]:
    """Compute sum w r^2 and the rows of sum w (r r' - rho^2 a a'), with torsion axis a and patch length rho."""
    square = 0.0
    x = y = z = ZERO
    for finger in grasp.fingers:
        r = arm(grasp, finger, at_tip)
        w = finger.weight
        square += w * dot(r, r)
        x += (w * r.x) * r
        y += (w * r.y) * r
        z += (w * r.z) * r
        if grasp.coordinates > 3:
            t = finger.patch * finger.twist_axis
            x -= (w * t.x) * t
            y -= (w * t.y) * t
            z -= (w * t.z) * t
    return square, x, y, z


@kernel
def write_roots(grasp: GraspState) -> None:
    """Write the square roots of the weights."""
    for finger in grasp.fingers:
        finger.sqrt_weight = math.sqrt(finger.weight)


@kernel
def find_motion(grasp: GraspState, kep: float, ked: float, kip: float, kid: float, damped: bool, slipped: bool) -> None:
    """Compute u from V'e in `stretch` and V'e' in `rate`.

    Translations are eliminated first, because their inertias are equal.
    """
    state, system, motion = grasp.recoil, grasp.recoil.system, grasp.recoil.motion
    shifts, turns, per = grasp.freedom.shifts, grasp.freedom.turns, 1.0 / grasp.period
    near, far = state.elastic_share, damping_share(grasp)
    own, root = 1.0, 0.0
    if shifts > 0:
        root = near[0, 0]
        own = inertia(grasp, 0, 0) + root * root * (kep + per * ked)
    for s in range(shifts):
        motion[s] = root * (kep * state.stretch[s] + (ked * state.rate[s] if damped else 0.0))
    if turns == 0:
        for s in range(shifts):
            motion[s] /= own
        return
    moment = moment_of_displacements(grasp, kip, kid, damped, slipped)
    for u in range(turns):
        a = shifts + u
        for v in range(u + 1):
            b = shifts + v
            total = inertia(grasp, a, b) + kip * state.elastic_weight[u, v]
            if damped:
                total += per * kid * (state.damping_weight[u, v] if state.distant else state.elastic_weight[u, v])
            for k in range(grasp.mode_count):
                beta = grasp.modes[k, 0]
                total += beta * (kep - kip) * near[k, a] * near[k, b]
                if damped:
                    total += beta * per * (ked - kid) * far[k, a] * far[k, b]
            for s in range(shifts):
                total -= lever_of_shift(near, far, s, a, root, kep, per * ked) * (
                    lever_of_shift(near, far, s, b, root, kep, per * ked) / own
                )
            system[u, v] = total
        total = dot(grasp.freedom.axes[a].vector, moment)
        for k in range(grasp.mode_count):
            beta = grasp.modes[k, 0]
            total += beta * (kep - kip) * near[k, a] * state.stretch[k]
            if damped:
                total += beta * (ked - kid) * far[k, a] * state.rate[k]
        for s in range(shifts):
            total -= lever_of_shift(near, far, s, a, root, kep, per * ked) * (motion[s] / own)
        state.row[u] = total
    factor_definite(system, turns)
    solve_factored(system, state.row, turns)
    for u in range(turns):
        motion[shifts + u] = state.row[u]
    for s in range(shifts):
        total = motion[s]
        for u in range(turns):
            total -= lever_of_shift(near, far, s, shifts + u, root, kep, per * ked) * state.row[u]
        motion[s] = total / own


@inline
def lever_of_shift(near: Table, far: Table, s: int, a: int, root: float, kep: float, ked: float) -> float:
    """Compute the entry of the system that couples translation s and rotation a by springs and dampers."""
    return root * (kep * near[s, a] + ked * far[s, a])


@kernel
def moment_of_displacements(grasp: GraspState, kip: float, kid: float, damped: bool, slipped: bool) -> Vector:
    """Compute the moment of w (kip e + kid e') about the object's centre, with separate levers for e and e'."""
    moment = ZERO
    for finger in grasp.fingers:
        e = finger.retained if slipped else finger.displacement
        f = kip * e
        moment += finger.weight * cross(finger.contact, f.vector)
        if damped:
            drag = kid * finger.rate
            moment += finger.weight * cross(arm(grasp, finger, not grasp.at_contact), drag.vector)
            f += drag
        if grasp.coordinates > 3:
            moment += (finger.weight * finger.patch * f.t) * finger.twist_axis
    return moment


@kernel
def inertia(grasp: GraspState, u: int, v: int) -> float:
    """Compute the entry of C^-1 = (M + T B) / T^2 for the object's free directions u and v.

    M is the inertia, B the viscosity and T the period.
    """
    T, body, shifts = grasp.period, grasp.body, grasp.freedom.shifts
    total = 0.0
    if u == v and u < shifts:
        total = body.mass + T * body.viscosity
    if u >= shifts and v >= shifts:
        one, other = grasp.freedom.axes[u], grasp.freedom.axes[v]
        for a in range(3):
            total += one.vector[a] * other.vector[a] * (body.inertia[a] + T * body.rotational_viscosity)
    return total / (T * T)


@kernel
def motion_of_object(grasp: GraspState) -> tuple[Vector, Vector]:
    """Return the object's displacement u as a translation and a rotation, in the object's axes."""
    shifts, motion = grasp.freedom.shifts, grasp.recoil.motion
    shift = turn = ZERO
    for u in range(shifts):
        shift += motion[u] * grasp.freedom.axes[u].vector
    for u in range(grasp.freedom.turns):
        turn += motion[shifts + u] * grasp.freedom.axes[shifts + u].vector
    return shift, turn


@inline
def path_of(grasp: GraspState, finger: FingerState, shift: Vector, turn: Vector, at_tip: bool) -> Vector4:
    """Compute the displacement and torsion that a small motion of the object causes at a finger's contact or tip."""
    way = shift + cross(turn, arm(grasp, finger, at_tip)) if grasp.freedom.turns > 0 else shift
    return with_torsion(way, finger.patch * dot(turn, finger.twist_axis) if grasp.coordinates > 3 else 0.0)


@inline
def arm(grasp: GraspState, finger: FingerState, at_tip: bool) -> Vector:
    """Return the vector from the object's centre to a finger's contact or tip."""
    return finger.contact + finger.displacement.vector if at_tip else finger.contact


@kernel
def lever(grasp: GraspState, finger: FingerState, u: int, a: int, at_tip: bool) -> float:
    """Compute an entry of G in contact frames: coordinate a of a contact, for the object's free direction u."""
    axis = grasp.freedom.axes[u].vector
    if a == 3:
        return finger.patch * dot(axis, finger.twist_axis) if u >= grasp.freedom.shifts else 0.0
    f = finger.frame.row(a)
    if u < grasp.freedom.shifts:
        return dot(axis, f)
    return dot(axis, cross(arm(grasp, finger, at_tip), f))
