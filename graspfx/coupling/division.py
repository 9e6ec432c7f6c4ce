"""External and internal parts of forces and displacements at contacts: the sample's own P, for rows of samples."""

from __future__ import annotations

import math

from graspfx.compile.kernel import inline, kernel
from graspfx.compile.records import Floats, Many, Record, Table, floats, many, size_of, table
from graspfx.grasp.contact_state import Contact, Freedom, motion_of
from graspfx.grasp.rigid_modes import faded_weight, rigid_modes
from graspfx.spatial import NOTHING, Vector, Vector4, dot, with_torsion

SLIGHT = 1e-40  # the weight of a finger that has none: in no sum that others have a part in, but it has a motion


class DividedContact(Contact):
    """A contact as the split sees it, in axes of the world."""

    share: float  # of the metric
    root: float  # of its weight
    counts: bool  # has a weight


class Division(Record):
    """All that P is made of besides contacts, and room to compute it."""

    count: int  # n
    dimensions: int  # d
    width: int  # entries of a finger in a mode: 3, or 4 where some finger is soft
    fade: bool  # a free finger's weight goes down with its gap
    fade_start: float  # gaps between which it does [m]
    fade_end: float
    arm_low: float  # rms arms between which a rotation joins the external space [m]
    arm_high: float
    freedom: Freedom
    contacts: Many[DividedContact] = many("count")
    modes: Table = table("6", "1 + width * count")


class ContactSample(Record):
    """A contact in one sample, and what of it is divided."""

    contact: Vector  # c, W, from the object's centre where that is not free to move everywhere [m]
    normal: Vector  # into the object, W; only where some finger is soft
    gap: float  # [m]
    whole: Vector4  # force [N] or displacement [m], W, and torsion in units of the patch length
    external: Vector4  # its part that moves the object


SAMPLE = size_of(ContactSample)
NONE = -1  # place of what a row does not have


class RowPlaces(Record):
    """Entries of a row at which the first finger's numbers stand, then the others'; `NONE` for what is not there."""

    width: int  # of a row
    contact: int  # d numbers
    centre: int  # d numbers, of the object, which are taken from the contacts
    gap: int
    normal: int  # 3 numbers
    whole: int  # d numbers
    torsion: int
    external: int  # d numbers, which are written
    internal: int  # the same
    twist: int  # external part of the torsion, which is written
    count: int  # n
    fingers: Floats = floats("count")  # numbers of the grasp's fingers among those of a row


@inline
def sample_of(samples: Floats, i: int) -> ContactSample:
    """Give finger i of a sample."""
    return ContactSample(samples.buffer, samples.offset + i * SAMPLE)


@kernel
def divide_rows(division: Division, places: RowPlaces, samples: Floats, rows: Floats, count: int, dual: bool) -> None:
    """Divide forces f into P f and the rest, row by row; `dual`, displacements e by P'.

    With orthonormal modes q_k and blends beta_k of `rigid_modes`, weights w and z_k = sum_i q_k(i) . f_i / sqrt(w_i),

        P f = sqrt(w_i) sum_k beta_k q_k(i) z_k,    P' e = sum_k beta_k q_k(i) / sqrt(w_i) sum_j sqrt(w_j) q_k(j) . e_j.

    Args:
        division: what P is made of.
        places: of what stands in a row.
        samples: room for one.
        rows: `count` of them.
        dual: whether displacements are divided.
    """
    for row in range(count):
        start = row * places.width
        for i in range(division.count):
            take(division.dimensions, places, samples, rows, start, i)
        divide(division, samples, dual)
        for i in range(division.count):
            put(division.dimensions, places, samples, rows, start, i)


@kernel
def take(d: int, places: RowPlaces, samples: Floats, rows: Floats, start: int, i: int) -> None:
    """Take finger i's contact and what of it is divided from a row."""
    sample, finger = sample_of(samples, i), int(places.fingers[i])
    at, of = start + places.contact + finger * d, start + places.whole + finger * d
    for a in range(d):
        sample.contact[a] = rows[at + a]
        sample.whole[a] = rows[of + a]
    if places.centre >= 0:
        for a in range(d):
            sample.contact[a] = rows[at + a] - rows[start + places.centre + a]
    if places.gap >= 0:
        sample.gap = rows[start + places.gap + finger]
    if places.normal >= 0:
        for a in range(3):
            sample.normal[a] = rows[start + places.normal + 3 * finger + a]
    if places.torsion >= 0:
        sample.whole[3] = rows[start + places.torsion + finger]


@kernel
def put(d: int, places: RowPlaces, samples: Floats, rows: Floats, start: int, i: int) -> None:
    """Put finger i's parts into a row."""
    sample, finger = sample_of(samples, i), int(places.fingers[i])
    to = start + places.external + finger * d
    for a in range(d):
        rows[to + a] = sample.external[a]
    if places.internal >= 0:
        rest = start + places.internal + finger * d
        for a in range(d):
            rows[rest + a] = sample.whole[a] - sample.external[a]
    if places.twist >= 0:
        rows[start + places.twist + finger] = sample.external[3]


@kernel
def divide(division: Division, samples: Floats, dual: bool) -> None:
    """Divide the forces, or displacements, of one sample."""
    size = total = 0.0
    for i, contact in enumerate(division.contacts):
        sample = sample_of(samples, i)
        whole = sample.whole
        size += abs(whole.x) + abs(whole.y) + abs(whole.z) + abs(whole.t)
        sample.external = NOTHING
        contact.contact = sample.contact
        contact.normal = sample.normal
        weight = contact.share
        if division.fade:
            weight = faded_weight(contact.share, sample.gap, division.fade_start, division.fade_end)
        contact.counts = weight > 0.0
        contact.weight = max(weight, SLIGHT)
        contact.root = math.sqrt(contact.weight)
        total += weight
    if size == 0.0 or total == 0.0:
        return
    used, _ = rigid_modes(
        division.contacts, division.freedom, division.dimensions, division.arm_low, division.arm_high, division.width,
        False, division.modes,
    )  # fmt: skip
    for k in range(used):
        add_mode(division, samples, k, dual)


@kernel
def add_mode(division: Division, samples: Floats, k: int, dual: bool) -> None:
    """Add the part that one mode has of a sample."""
    mode = division.modes[k]
    z = 0.0
    for i, contact in enumerate(division.contacts):
        motion = motion_of(mode, i, division.width)
        whole = sample_of(samples, i).whole
        along = dot(motion.shift, whole.vector)
        if division.width > 3:
            along += motion.twist * whole.t
        z += contact.root * along if dual else along / contact.root
    z *= mode[0]
    for i, contact in enumerate(division.contacts):
        motion = motion_of(mode, i, division.width)
        twist = motion.twist if division.width > 3 else 0.0
        factor = z / contact.root if dual else z * contact.root
        if dual or contact.counts:
            sample_of(samples, i).external += factor * with_torsion(motion.shift, twist)
