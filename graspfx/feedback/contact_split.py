"""Division of another simulator's contact forces into push and squeeze by one kernel: merge, split, gains, fade."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.kernel import inline, kernel
from graspfx.compile.records import Floats, Record, Table, floats, room, table
from graspfx.grasp.direct import PointGrasp, couple_points
from graspfx.numeric import LARGEST
from graspfx.spatial import Vector, cross, dot

FloatArray = NDArray[np.float64]

LEAST = 1e-30  # smallest square of a length that defines a direction [m^2]


class Shown(NamedTuple):
    """Forces on the operator, scaled by the gains.

    Attributes:
        push: Net force of the object on the hand, for a device with one channel, (d,) [N].
        moment: Net moment about the reference point, (3,), or (1,) in the plane [N m].
        grip: Mean over the touching fingers of the internal force along the normal into the object [N]. A positive grip
            closes the hand. A grasp that presses on an object therefore has a negative grip, which opens the operator's
            fingers.
        fingers: Force on each finger, (n, d) [N], for a device with one channel per finger: `external` + `internal`.
        external, internal: The two parts of `fingers`, (n, d) [N].
        touching: Mask of the fingers that touch, (n,).
        message: Message that forces fade to zero if there is no contact; otherwise empty.
    """

    push: FloatArray
    moment: FloatArray
    grip: float
    fingers: FloatArray
    external: FloatArray
    internal: FloatArray
    touching: NDArray[np.bool_]
    message: str


class ContactSplitState(Record):
    """Contacts of one sample, the resulting forces on the fingers, and the forces on the operator."""

    fingers: int  # n
    dimensions: int  # d
    capacity: int  # largest number of contacts
    grasp_entries: int
    contacts: int  # number of contacts of this sample
    normals: bool  # normals are given
    torques: bool  # torques are given
    referred: bool  # a reference point is given
    begun: bool  # a sample has been computed before
    faulty: bool  # a value of this sample is not finite or beyond `LARGEST`, or a force is implausibly large
    touching: int  # number of touching fingers
    time: float  # [s]
    before: float  # time of the previous sample [s]
    largest: float  # largest plausible component of a force [N]
    fade: float  # time over which the jump of forces at a change of contacts is faded out [s]
    grip: float  # [N]
    grip_offset: float
    changed: float  # time of the last sample before contacts changed [s]
    reference: Vector  # point of the moment [m]
    moment_offset: Vector
    push: Vector  # forces on the operator, contiguous up to `touched` [N]
    moment: Vector  # [N m]; in the plane the last entry
    felt: Table = table("fingers", "3")  # force on each finger [N]
    external: Table = table("fingers", "3")  # its external and internal part, with gains and fade
    internal: Table = table("fingers", "3")
    touched: Floats = floats("fingers")  # whether each finger touches
    finger: Floats = floats("capacity")  # finger of each contact
    point: Table = table("capacity", "3")  # [m]
    force: Table = table("capacity", "3")  # force of the object on the finger [N]
    normal: Table = table("capacity", "3")  # normal into the object
    torque: Table = table("capacity", "3")  # [N m]
    push_gain: Table = table("3", "3")
    squeeze_gain: Table = table("3", "3")
    moment_gain: Table = table("3", "3")
    touched_before: Floats = floats("fingers")
    weight: Floats = floats("fingers")  # sum of |force| of a finger's contacts [N]
    place: Table = table("fingers", "3")  # point of each finger's force [m]
    load: Table = table("fingers", "3")  # force on each finger [N]
    inward: Table = table("fingers", "3")  # unit normal into the object, zero without one
    external_offset: Table = table("fingers", "3")  # offset of forces at the last change of contacts, which fades out
    internal_offset: Table = table("fingers", "3")
    grasp: PointGrasp = room("grasp_entries")


@inline
def row_of(rows: Table, i: int) -> Vector:
    """Return a row of three numbers."""
    return Vector(rows[i, 0], rows[i, 1], rows[i, 2])


@kernel
def write_row(rows: Table, i: int, v: Vector) -> None:
    """Write a row of three numbers."""
    rows[i, 0] = v.x
    rows[i, 1] = v.y
    rows[i, 2] = v.z


@kernel
def divide_contacts(block: NDArray[np.float64]) -> None:
    """Compute the forces on the operator for the contacts in a block."""
    divide_sample(ContactSplitState(block, 0))


@kernel
def divide_sample(state: ContactSplitState) -> int:
    """Merge contacts, divide forces, apply gains and fade changes.

    Return 1 if `is_sound` rejects the values, else 0.
    """
    if not is_sound(state):
        state.faulty = True
        return 1
    state.faulty = False
    merge(state)
    changed = remember(state)
    divide_fingers(state)
    find_inward(state)
    moment = apply_gains(state)
    fade(state, moment, changed)
    state.before, state.begun = state.time, True
    return 0


@kernel
def is_sound(state: ContactSplitState) -> bool:
    """Return whether the given values are finite, no product of them overflows, and no force is implausibly large."""
    most = 0.0
    sums = abs(state.time)
    if state.referred:
        sums += abs(state.reference.x) + abs(state.reference.y) + abs(state.reference.z)
    for j in range(state.contacts):
        for a in range(3):
            sums += abs(state.point[j, a]) + abs(state.force[j, a])
            if state.torques:
                sums += abs(state.torque[j, a])
            if state.normals:
                sums += abs(state.normal[j, a])
            most = max(most, abs(state.force[j, a]))
    return sums <= LARGEST and most <= state.largest  # NaN is not


@kernel
def merge(state: ContactSplitState) -> None:
    """Compute each finger's total contact force, at the mean contact point weighted by the size of the forces.

    The contact point of a finger without force is the mean of the finger's points; a finger without contacts keeps its
    last contact point.
    """
    d = state.dimensions
    for i in range(state.fingers):
        state.touched_before[i] = state.touched[i]
        state.touched[i] = state.weight[i] = 0.0
        for a in range(3):
            state.load[i, a] = state.inward[i, a] = 0.0
    for j in range(state.contacts):
        i = int(state.finger[j])
        size = 1e-12  # weight of unloaded contacts, which matters only if no contact is loaded
        for a in range(d):
            size += abs(state.force[j, a])
        share = size / (state.weight[i] + size)
        state.weight[i] += size
        state.touched[i] = 1.0
        for a in range(3):
            state.place[i, a] = (
                state.point[j, a]
                if share == 1.0
                else (state.place[i, a] + share * (state.point[j, a] - state.place[i, a]))
            )
            state.load[i, a] += state.force[j, a]
            if state.normals:
                state.inward[i, a] += size * state.normal[j, a]
    state.touching = 0
    for i in range(state.fingers):
        state.touching += int(state.touched[i])


@kernel
def divide_fingers(state: ContactSplitState) -> None:
    """Divide the forces of touching fingers, f = P f + (I - P) f (eq. 3), by the kernel of `PointCoupling`."""
    d, grasp = state.dimensions, state.grasp
    grasp.count, grasp.dimensions = state.touching, d
    grasp.external_stiffness, grasp.internal_stiffness = 1.0, 0.0
    grasp.external_damping = grasp.internal_damping = 0.0
    k = 0
    for i in range(state.fingers):
        if state.touched[i] != 0.0:
            for a in range(d):
                grasp.points[k] = state.place[i, a]
                grasp.displacement[k] = state.load[i, a]
                grasp.rate[k] = 0.0
                k += 1
    if state.touching > 0:
        couple_points(grasp)
    k = 0
    for i in range(state.fingers):
        for a in range(3):
            state.external[i, a] = state.internal[i, a] = 0.0
        if state.touched[i] != 0.0:
            for a in range(d):
                state.external[i, a] = grasp.force[k]
                state.internal[i, a] = state.load[i, a] - grasp.force[k]
                k += 1


@kernel
def find_inward(state: ContactSplitState) -> None:
    """Set the reference point and the unit normals.

    Without given normals, the normal of a finger points to the mean of the other fingers' points.
    """
    n = state.touching
    centre = Vector(0.0, 0.0, 0.0)
    for i in range(state.fingers):
        if state.touched[i] != 0.0:
            centre += row_of(state.place, i)
    if n > 0:
        centre = centre / n
    if not state.referred:
        state.reference = centre
    for i in range(state.fingers):
        if state.touched[i] != 0.0:
            along = row_of(state.inward, i)
            if not state.normals:  # n/(n - 1) (centre - p) points to the mean of the others
                along = centre - row_of(state.place, i)
            square = dot(along, along)
            size = 1.0 / math.sqrt(square) if square > LEAST else 0.0
            write_row(state.inward, i, size * along)


@kernel
def remember(state: ContactSplitState) -> bool:
    """Return whether a finger has made or broken contact; if it has, store the present forces on the operator."""
    changed = False
    for i in range(state.fingers):
        changed = changed or state.touched[i] != state.touched_before[i]
    if changed:
        state.changed = state.before if state.begun else state.time
        state.grip_offset, state.moment_offset = state.grip, state.moment
        for i in range(state.fingers):
            for a in range(3):
                state.external_offset[i, a] = state.external[i, a]
                state.internal_offset[i, a] = state.internal[i, a]
    return changed


@kernel
def apply_gains(state: ContactSplitState) -> Vector:
    """Apply the gains to external and internal forces, and compute the grip; return the moment times its gain."""
    moment = Vector(0.0, 0.0, 0.0)
    for j in range(state.contacts):  # f_v = G f (eq. 2), with the contacts' own torques
        point = row_of(state.point, j)
        force = row_of(state.force, j)
        moment += cross(point - state.reference, force)
        if state.torques:
            moment += row_of(state.torque, j)
    state.grip = 0.0
    for i in range(state.fingers):
        squeezed = scaled(state.squeeze_gain, row_of(state.internal, i))
        if state.touched[i] != 0.0:
            state.grip += dot(squeezed, row_of(state.inward, i)) / state.touching
        write_row(state.external, i, scaled(state.push_gain, row_of(state.external, i)))
        write_row(state.internal, i, squeezed)
    return scaled(state.moment_gain, moment)


@kernel
def scaled(gain: Table, v: Vector) -> Vector:
    """Compute the product of a gain and a vector."""
    return Vector(
        gain[0, 0] * v.x + gain[0, 1] * v.y + gain[0, 2] * v.z,
        gain[1, 0] * v.x + gain[1, 1] * v.y + gain[1, 2] * v.z,
        gain[2, 0] * v.x + gain[2, 1] * v.y + gain[2, 2] * v.z,
    )


@kernel
def fade(state: ContactSplitState, moment: Vector, changed: bool) -> None:
    """Add the remainder of the last change of contacts to the forces on the operator.

    The remainder is the difference between the forces before the change and the forces of the new contacts.

    The remainder decreases to zero linearly in time. Each new change starts from the present forces, so the remainder
    decreases even if contacts change in every sample.
    """
    left = max(1.0 - (state.time - state.changed) / state.fade, 0.0)
    if changed:
        state.grip_offset -= state.grip
        state.moment_offset -= moment
        for i in range(state.fingers):
            for a in range(3):
                state.external_offset[i, a] -= state.external[i, a]
                state.internal_offset[i, a] -= state.internal[i, a]
    state.grip += left * state.grip_offset
    state.moment = moment + left * state.moment_offset
    push = Vector(0.0, 0.0, 0.0)
    for i in range(state.fingers):
        for a in range(3):
            state.external[i, a] += left * state.external_offset[i, a]
            state.internal[i, a] += left * state.internal_offset[i, a]
        push += row_of(state.external, i)
        write_row(state.felt, i, row_of(state.external, i) + row_of(state.internal, i))
    state.push = push
