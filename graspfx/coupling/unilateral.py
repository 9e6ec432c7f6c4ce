"""Unilateral contact: projection of the forces on pushing forces (eqs. 24-26) by principal pivoting.

Equal scalar gains need neither a projection nor matrices: in the conventional method (eqs. 1 and 7-8), each finger is
computed separately.
"""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats
from graspfx.cones.complement import Contacts, complement, release, settle
from graspfx.coupling.contact_frames import assemble, coordinates_of, in_frame, out_of_frame, write_coordinates
from graspfx.coupling.contacts import AGAIN, UNRESOLVED, displace, touch
from graspfx.coupling.depth import damping_share, is_whole, soften
from graspfx.coupling.grasp_state import GraspState
from graspfx.coupling.implicit import assemble_implicitly, carries
from graspfx.coupling.law import bilateral, keep_elastic, normal_force
from graspfx.coupling.recoil import recoil
from graspfx.spatial import NOTHING, inner, with_torsion

LEAST = 1e-8  # fraction of a coordinate's damping to add if some direction has no damping


@kernel
def unilateral(grasp: GraspState, again: bool) -> int:
    """Project the elastic force on the cones, then add damping; return 0, UNRESOLVED or AGAIN.

    The elastic force satisfies f in C, s in C*, f's = 0 and f = K (e + s) (eqs. 24-26 for n fingers), where C contains
    the pushing forces, and C* is the dual cone. With damping, f = f0 + D (e' + s) is in C, where f0 is the elastic
    force, and f_i = 0 for fingers with f0_i = 0.
    """
    fault = 0
    if grasp.alone:
        separate(grasp)
    else:
        fault = project(grasp)
    if update_touching(grasp, again) and fault == 0:
        return AGAIN
    if grasp.observed or grasp.limited:
        keep_elastic(grasp)
    if fault == 0 and grasp.damped:
        if grasp.alone:
            damp_alone(grasp)
        else:
            fault = damp(grasp)
    return fault


@kernel
def separate(grasp: GraspState) -> None:
    """Compute f_i = w_i k e_i of every finger inside the object, or only its normal part if fingers do not stick."""
    for finger in grasp.fingers:
        depth = inner(finger.normal, finger.displacement.vector)
        k = finger.weight * grasp.internal_stiffness
        for a in range(grasp.dimensions):
            e = 0.0
            if depth > 0.0:
                e = finger.displacement[a] if grasp.stick else depth * finger.normal[a]
            finger.local[a] = k * e
        if grasp.coordinates > 3:
            torsion = k * finger.displacement.t if depth > 0.0 else 0.0
            finger.local = with_torsion(finger.local.vector, torsion)


@kernel
def damp_alone(grasp: GraspState) -> None:
    """Add the damping force b_i e_i' to every touching finger, only along the normal unless the finger sticks.

    The damping force is limited so that the finger does not pull.
    """
    for finger in grasp.fingers:
        if not finger.touching:
            continue
        b = finger.weight * grasp.internal_damping
        if grasp.gradual:
            b *= damping_share(grasp, finger, normal_force(finger))
        speed = inner(finger.normal, finger.rate.vector)
        f = max(b * speed, -normal_force(finger)) * finger.normal
        if grasp.stick:
            f += b * (finger.rate.vector - speed * finger.normal)
        finger.local += with_torsion(f, b * finger.rate.t)


@kernel
def update_touching(grasp: GraspState, again: bool) -> bool:
    """Mark the fingers that push, and return whether the forces must be recomputed.

    A released finger that was sticking gets the contact point that it would have without an anchor, and the forces must
    be recomputed. Without this, the finger would exert no force in this sample and touch again in the next sample.
    """
    anew = False
    for finger in grasp.fingers:
        before = finger.touching
        finger.touching = normal_force(finger) > 0.0
        if again and before and grasp.stick and not finger.touching:
            p = finger.contact + finger.displacement.vector
            touch(grasp, finger, p)
            displace(grasp, finger, p)
            anew = True
    return anew


@kernel
def project(grasp: GraspState) -> int:
    """Compute the elastic force in the cones; release tangents or, if fingers stick, whole contacts."""
    n, c = grasp.count, grasp.coordinates
    m = n * c
    if grasp.recoils and grasp.stick:
        recoil(grasp, False, False)
        if all_push(grasp):
            return 0
    if not grasp.implicit and (grasp.stick or grasp.dimensions == 1):
        bilateral(grasp, True, False)
        lowest = 0.0
        for finger in grasp.fingers:
            lowest = min(lowest, normal_force(finger))
        if lowest >= 0.0:
            return 0
    unresolved = 1
    for attempt in range(2):
        if grasp.implicit:
            assemble_implicitly(grasp, True, False, False)
        else:
            assemble(grasp, True)
        for i, finger in enumerate(grasp.fingers):
            write_coordinates(grasp, grasp.start, i, in_frame(grasp, finger, finger.displacement))
        scale = largest(grasp.vector, m)
        for p in range(m):
            grasp.marks[p] = 1.0 if p % c and not grasp.stick else 0.0
        for i in range(n):
            grasp.engaged[i] = 1.0
        release(grasp.square, grasp.vector, m, grasp.marks, grasp.diagonal)
        contacts = Contacts(n, c, grasp.stick)
        unresolved = complement(
            grasp.square, grasp.vector, grasp.diagonal, grasp.engaged, contacts, attempt == 0, scale
        )
        # the release of sticking fingers as a whole is no projection on a cone, so pivoting may cycle; the second
        # attempt only releases contacts
        if unresolved == 0 or not grasp.stick:
            break
    if grasp.dense and not grasp.stick:
        retain(grasp)
    settle(grasp.square, grasp.vector, grasp.start, grasp.engaged, Contacts(n, c, grasp.stick))
    for i, finger in enumerate(grasp.fingers):
        finger.local = out_of_frame(grasp, finger, coordinates_of(grasp, grasp.vector, i))
    return UNRESOLVED * unresolved


@kernel
def all_push(grasp: GraspState) -> bool:
    """Return whether every finger pushes."""
    count = 0
    for finger in grasp.fingers:
        count += 1 if normal_force(finger) > 0.0 else 0
    return count == grasp.count


@kernel
def retain(grasp: GraspState) -> None:
    """Compute e + s of contacts that slip freely; s is in `vector`, except for pushing normals, where s is zero."""
    for i, finger in enumerate(grasp.fingers):
        for a in range(grasp.coordinates):
            p = i * grasp.coordinates + a
            if a > 0 or grasp.engaged[i] == 0.0:
                grasp.start[p] += grasp.vector[p]
        finger.retained = out_of_frame(grasp, finger, coordinates_of(grasp, grasp.start, i))
        write_coordinates(grasp, grasp.start, i, in_frame(grasp, finger, finger.displacement))
        if finger.weight == 0.0:
            finger.retained = NOTHING


@kernel
def damp(grasp: GraspState) -> int:
    """Add the passive damping force, projected on the cones; return 0 or UNRESOLVED.

    Where the projection has no effect, the damping force is the rate term of eq. (26).
    """
    c, m = grasp.coordinates, grasp.count * grasp.coordinates
    if grasp.recoils and grasp.stick and all_push(grasp) and is_whole(grasp):
        keep_elastic(grasp)
        recoil(grasp, True, False)
        if all_push(grasp):
            return 0
        for finger in grasp.fingers:
            finger.local = finger.elastic
    for i, finger in enumerate(grasp.fingers):
        grasp.engaged[i] = 1.0 if finger.touching else -1.0
    if grasp.implicit:
        assemble_implicitly(grasp, True, True, True)
    else:
        assemble_damping(grasp)
    contacts = Contacts(grasp.count, c, False)
    unresolved = complement(
        grasp.square, grasp.vector, grasp.diagonal, grasp.engaged, contacts, True, largest(grasp.vector, m)
    )
    for i, finger in enumerate(grasp.fingers):
        for a in range(c):
            p = i * c + a
            # the entry of a clamped normal is a rate, while its tangents are still forces; other entries carry no force
            if not carries(grasp, finger, a) or (a == 0 and grasp.engaged[i] == 0.0):
                grasp.vector[p] = 0.0
            elif a == 0:
                grasp.vector[p] = max(grasp.vector[p], 0.0)
        finger.local = out_of_frame(grasp, finger, coordinates_of(grasp, grasp.vector, i))
    return UNRESOLVED * unresolved


@kernel
def assemble_damping(grasp: GraspState) -> None:
    """Compute D and f0 + D e' of the coordinates that carry force, and release all other coordinates."""
    for i, finger in enumerate(grasp.fingers):
        write_coordinates(grasp, grasp.start, i, in_frame(grasp, finger, finger.local))
    assemble(grasp, False)
    make_regular(grasp)
    soften(grasp, grasp.square, grasp.vector, 1.0)
    for i, finger in enumerate(grasp.fingers):
        for a in range(grasp.coordinates):
            grasp.marks[i * grasp.coordinates + a] = 0.0 if carries(grasp, finger, a) else 1.0
    release(grasp.square, grasp.vector, grasp.count * grasp.coordinates, grasp.marks, grasp.diagonal)
    for i, finger in enumerate(grasp.fingers):
        for a in range(grasp.coordinates):
            if carries(grasp, finger, a):
                grasp.vector[i * grasp.coordinates + a] += grasp.start[i * grasp.coordinates + a]


@kernel
def make_regular(grasp: GraspState) -> None:
    """Add 1e-8 of its diagonal to a singular D (ked or kid is zero), and add the force of this additional damping.

    The law remains passive, and every pivot is larger than rounding errors.
    """
    if not grasp.singular:
        return
    for i, finger in enumerate(grasp.fingers):
        rate = in_frame(grasp, finger, finger.rate)
        write_coordinates(grasp, grasp.rest, i, rate)
        for a in range(grasp.coordinates):
            p = i * grasp.coordinates + a
            more = LEAST * grasp.diagonal[p]
            grasp.square[p, p] += more
            grasp.vector[p] += more * grasp.rest[p]


@kernel
def largest(numbers: Floats, count: int) -> float:
    """Return the largest absolute value of `count` numbers."""
    scale = 0.0
    for p in range(count):
        scale = max(scale, abs(numbers[p]))
    return scale
