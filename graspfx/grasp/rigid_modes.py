"""Rigid modes of weighted contacts, which define the split in a sample, and gain matrix in contact frames."""

from __future__ import annotations

import math

from graspfx.compile.kernel import inline, kernel
from graspfx.compile.records import Floats, Many, Record, Table, many
from graspfx.spatial import ZERO, Matrix, Vector, cross, dot, orthogonalise

LEAST_ARM = 1e-13  # an rms arm below this is rounding [m]
SHORT_ARM = 1e-6  # below this arm, rounding makes a rotation visibly non-orthogonal to the translations [m]
NO_ARM = 1e-9  # up to this rms arm contacts count as on a line [m]


class Contact(Record):
    """A contact of a finger, in the object's axes."""

    contact: Vector  # c on the surface; for a ball fingertip, on the surface offset by the radius [m]
    normal: Vector  # unit normal into the object
    patch: float  # patch length rho of a soft finger, 0 for a hard one [m]
    weight: float


class FramedContact(Contact):
    """A contact with its frame."""

    frame: Matrix  # normal and tangents as rows


class Direction(Record):
    """A direction of unit length."""

    vector: Vector


class Freedom(Record):
    """Directions in which an object is free to move: translations, then axes of rotation about the object's centre."""

    shifts: int  # number of free translations
    turns: int  # number of free rotations
    axes: Many[Direction] = many("6")  # in the object's axes


class ModeMotion(Record):
    """Motion of a finger in a rigid mode."""

    shift: Vector
    twist: float  # torsion times the patch length, if some finger is soft


@inline
def motion_of(mode: Floats, i: int, width: int) -> ModeMotion:
    """Return the part of finger i in a mode, whose row contains the blend, then `width` entries per finger."""
    return ModeMotion(mode.buffer, mode.offset + (1 + width * i))


def smoothstep(x: float, low: float, high: float) -> float:
    """Compute a smooth step: 0 up to `low`, 1 from `high` on, and 3 t^2 - 2 t^3 between, with t from 0 to 1."""
    if x <= low:
        return 0.0
    if x >= high:
        return 1.0
    t = (x - low) / (high - low)
    return t * t * (3.0 - 2.0 * t)


@inline
def faded_weight(share: float, gap: float, start: float, end: float) -> float:
    """Compute a contact's weight in the metric: `share` up to the gap `start`, decreasing to 0 at the gap `end` [m]."""
    return share * (1.0 - smoothstep(gap, start, end))


@kernel
def rigid_modes(
    contacts: Many[Contact], freedom: Freedom, dimensions: int, low: float, high: float, width: int, whole: bool,
    modes: Table,
) -> tuple[int, int]:  # fmt: skip
    """Compute orthonormal rigid modes q_k(i) = sqrt(w_i) (u_k + a_k x c_i) / norm of contacts i, and their blends.

    A translation has the direction u_k, and a_k = 0. A rotation has the axis a_k, and u_k is the motion of the centroid
    along locked directions. The vector c_i is the contact point relative to the weighted centroid.

    The external projector is P = sum_k beta_k q_k q_k' (eq. 3) on displacements scaled by sqrt(w). The blend of a
    rotation is the smoothstep of its rms arm between `low` and `high` [m]; the blend of a translation is 1.

    If `width` is 4, the last entry of finger i is the torsion about the normal n_i, times the patch length rho_i:
    sqrt(w_i) rho_i a_k . n_i / norm. A finger that exerts no torsion has rho_i = 0.

    If `whole` is true, the modes include rotations whose blend is zero, and therefore span all rigid motions of the
    contacts.

    Returns:
        The number of modes, and the number of rotations with an arm above `NO_ARM` whose blend is less than 1.
    """
    total = 0.0
    base = contacts[0]
    for contact in contacts:
        if contact.weight > base.weight:
            base = contact
        total += contact.weight
    if total <= 0.0:
        return 0, 0
    origin = base.contact
    mean = ZERO  # centroid relative to the heaviest point: differences are exact far from the origin
    for contact in contacts:
        mean += contact.weight * (contact.contact - origin)
    mean = mean / total
    root = math.sqrt(total)
    for k in range(freedom.shifts):
        mode = modes[k]
        mode[0] = 1.0
        for i, contact in enumerate(contacts):
            motion = motion_of(mode, i, width)
            motion.shift = math.sqrt(contact.weight) / root * freedom.axes[k].vector
            if width > 3:
                motion.twist = 0.0
    for k in range(freedom.turns):
        write_rotation(contacts, freedom, dimensions, k, origin, mean, width, modes)
    orthogonalise(modes, freedom.shifts, freedom.turns)
    return keep_rotations(freedom, root, low, high, whole, modes)


@kernel
def write_rotation(
    contacts: Many[Contact], freedom: Freedom, dimensions: int, k: int, origin: Vector, mean: Vector, width: int,
    modes: Table,
) -> None:  # fmt: skip
    """Write the contacts' motion under free rotation k, without the component along the free translations."""
    mode = modes[freedom.shifts + k]
    axis = freedom.axes[freedom.shifts + k].vector
    field = cross(axis, origin + mean)  # motion of the centroid; zero if all translations are free
    if freedom.shifts == dimensions:
        field = ZERO
    else:
        for j in range(freedom.shifts):
            u = freedom.axes[j].vector
            field -= dot(field, u) * u
    for i, contact in enumerate(contacts):
        w = math.sqrt(contact.weight)
        motion = motion_of(mode, i, width)
        motion.shift = w * (cross(axis, contact.contact - origin - mean) + field)
        if width > 3:
            motion.twist = w * contact.patch * dot(axis, contact.normal)


@kernel
def keep_rotations(
    freedom: Freedom, root: float, low: float, high: float, whole: bool, modes: Table
) -> tuple[int, int]:
    """Scale the rotations that `rigid_modes` retains to unit length, and move them to the rows after the translations.

    Return the number of modes and the number of blended rotations.
    """
    count, blended = freedom.shifts, 0
    for k in range(freedom.shifts, freedom.shifts + freedom.turns):
        mode = modes[k]
        square = 0.0
        for j in range(1, modes.columns):
            square += mode[j] * mode[j]
        norm = math.sqrt(square)
        beta = smoothstep(norm / root, low, high)
        if beta < 1.0 and norm > NO_ARM * root:
            blended += 1
        if beta > 0.0 or (whole and norm > LEAST_ARM * root):
            to = modes[count]
            to[0] = beta
            for j in range(1, modes.columns):
                to[j] = mode[j] / norm
            if whole and norm < SHORT_ARM * root:
                separate_mode(modes, freedom.shifts, count)
            count += 1
    return count, blended


@kernel
def separate_mode(modes: Table, count: int, k: int) -> None:
    """Orthogonalise mode k, whose rms arm is close to rounding, against `count` other modes."""
    for j in range(count):
        along = 0.0
        for a in range(1, modes.columns):
            along += modes[j, a] * modes[k, a]
        for a in range(1, modes.columns):
            modes[k, a] -= along * modes[j, a]


@kernel
def gain_matrix(
    contacts: Many[FramedContact], modes: Table, count: int, external: float, internal: float, coordinates: int,
    square: Table, row: Floats,
) -> None:  # fmt: skip
    """Add sqrt(W) [k_i I + (k_e - k_i) P] sqrt(W) in contact frames to the matrix `square` (eq. 4, scalar gains).

    `row` (6 entries) is workspace. If `coordinates` is 4, modes and frames include torsion.
    """
    width = 4 if coordinates > 3 else 3
    for i, contact in enumerate(contacts):
        w = math.sqrt(contact.weight)
        for a in range(coordinates):
            p = i * coordinates + a
            square[p, p] += internal * contact.weight
            for k in range(count):
                g = component(contact, motion_of(modes[k], i, width), a)
                row[k] = w * (external - internal) * modes[k, 0] * g
            for j, other in enumerate(contacts):
                v = math.sqrt(other.weight)
                for b in range(coordinates):
                    total = 0.0
                    for k in range(count):
                        total += row[k] * component(other, motion_of(modes[k], j, width), b)
                    square[p, j * coordinates + b] += v * total


@inline
def component(contact: FramedContact, motion: ModeMotion, a: int) -> float:
    """Compute the component of a motion along coordinate a of a contact: normal, tangents or torsion."""
    return motion.twist if a > 2 else dot(contact.frame.row(a), motion.shift)
