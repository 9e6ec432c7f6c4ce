"""Records of a body on fixed planes: planes, features and contacts; and the lowest point of a feature."""

from __future__ import annotations

import math

from graspfx import elementary
from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Many, Record, Ref, Table, floats, many, table
from graspfx.cones.problem import FrictionProblem
from graspfx.objects.body_state import BodyState, Motion
from graspfx.spatial import ZERO, Matrix, Vector, dot

SIDES = 8  # number of fixed points on a rim, and of directions for selecting a plane's contacts
MOST = SIDES + 1  # largest number of contacts with one plane


class FloorPlane(Record):
    """A fixed plane."""

    frame: Matrix  # rows: the unit normal towards the body, then tangents
    distance: float  # distance from the origin along the normal [m]


class Feature(Record):
    """Part of a body's surface that can touch a plane; `lowest` computes its lowest point."""

    kind: int  # BALL, RIM, NOTCH or ELLIPSOID
    place: Vector  # position in the body [m]; for an ellipsoid its semi-axes
    radius: float  # radius of a ball or rim [m]


class PlaneContact(Record):
    """Contact point of a feature with a plane in the present sample."""

    pair: int  # index of the pair of plane and feature: its row of the memory
    plane: int
    share: float  # share of the stiffness
    arm: Vector  # position from the body's centre [m]
    gap: float  # gap at the end of the sample without contact forces [m]
    speed: Vector  # velocity at that gap, along the plane's normal and tangents [m/s]
    pressed: bool  # True if the point bears a force
    slip: Vector  # slip velocity along the normal and the tangents [m/s]
    stretch: Vector  # tangential displacement since the contact stuck; first entry unused [m]


class FloorState(Record):
    """Planes, features and contacts of a body, and parameters of the contact law."""

    plane_count: int
    feature_count: int
    stiffness: float  # stiffness k of a contact point [N/m]
    damping: float  # damping b [N s/m]
    friction: float  # coefficient mu
    reach: float  # distance from the centre to the farthest point [m]
    problem: Ref[FrictionProblem]  # problem with room for all contacts
    problem_entries: int
    touching: int  # number of contacts in the last sample
    associated: int  # number of samples without a solution of Coulomb's law, which use the associated law
    force: Vector  # force of the planes on the body in the last sample [N]
    moment: Vector  # its moment [N m]
    unknowns: Floats = floats("6")  # start values of the next search
    finger_force: Vector  # force of the fingers, while that of the planes is added [N]
    finger_moment: Vector  # its moment [N m]
    before: Motion  # motion at the beginning of the sample
    planes: Many[FloorPlane] = many("plane_count")
    features: Many[Feature] = many("feature_count")
    memory: Table = table("plane_count * feature_count", "2")  # stretch of each pair's contact [m]
    contacts: Many[PlaneContact] = many("9 * plane_count + feature_count")  # room before a plane's contacts are thinned
    modes: Floats = floats("6 * (1 + 3 * (9 * plane_count + feature_count))")  # columns of M^-1/2 G
    problem_room: Floats = floats("problem_entries")


# Kinds of features.
BALL = 0  # centre in the body, and radius (zero for a corner)
RIM = 1  # z of a circle about the body's z axis, and its radius; its lowest point only
NOTCH = 2  # a fixed point of a rim, which counts while the rim is nearly flat on the plane
ELLIPSOID = 3  # semi-axes

FLAT, TILTED = 1e-4, 1e-2  # sines of a rim's tilt between which the stiffness of its lowest point fades in
STEEP = 0.5  # sine of a rim's tilt above which its fixed points do not count


@kernel
def lowest(body: BodyState, feature: Feature, n: Vector) -> tuple[float, Vector]:
    """Return the weight of a feature's stiffness, 0 to 1, and the feature's lowest point, in world axes [m].

    The point is relative to the body's centre. It is, in the body's axes, c - r m for a ball, c - r m_xy/|m_xy| for a
    rim, c for a fixed point, and -A^2 m/|A m| for an ellipsoid. Here c and r are the feature's place and radius, A is
    the diagonal matrix of the semi-axes, and m is the plane's normal, with the part m_xy in the plane of x and y.

    Args:
        n: Unit normal of the plane, towards the body.
    """
    R, kind, p = body.motion.rotation, feature.kind, feature.place
    if kind == BALL:
        return 1.0, R @ p - feature.radius * n
    m = R.transpose @ n
    tilt = math.sqrt(m.x * m.x + m.y * m.y)
    if (kind == RIM and tilt <= FLAT) or (kind == NOTCH and tilt > STEEP):
        return 0.0, ZERO
    share = 1.0
    if kind == RIM:
        # the lowest point of a flat cylinder's rim moves freely: if it acted at once, the cylinder would never rest
        s = min(1.0, (tilt - FLAT) / (TILTED - FLAT))
        share = s * s * (3.0 - 2.0 * s)
        r = feature.radius / tilt
        p = Vector(-r * m.x, -r * m.y, p.z)
    if kind == ELLIPSOID:
        a, b, c = p.x * m.x, p.y * m.y, p.z * m.z
        r = 1.0 / math.sqrt(a * a + b * b + c * c)
        p = Vector(-p.x * a * r, -p.y * b * r, -p.z * c * r)
    return share, R @ p


@kernel
def thin(contacts: Many[PlaneContact], first: int, count: int, plane: FloorPlane) -> int:
    """Select at most MOST contacts with a plane, store them first, and return their number.

    The selected contacts are the deepest one, and the outermost one in each of SIDES directions. The contacts are those
    at `first` to `first + count - 1`; the order of the selected ones is unchanged.
    """
    if count <= MOST:
        return count
    extreme = first
    for i in range(first, first + count):
        if contacts[i].gap < contacts[extreme].gap:
            extreme = i
    contacts[extreme].pair = -1 - contacts[extreme].pair  # marked
    for side in range(SIDES):
        c, s = elementary.cos(2.0 * math.pi * side / SIDES), elementary.sin(2.0 * math.pi * side / SIDES)
        outwards = c * plane.frame.second + s * plane.frame.third
        far = -math.inf
        for i in range(first, first + count):
            along = dot(contacts[i].arm, outwards)
            if along > far:
                far, extreme = along, i
        if contacts[extreme].pair >= 0:
            contacts[extreme].pair = -1 - contacts[extreme].pair
    left = 0
    for i in range(first, first + count):
        contact = contacts[i]
        if contact.pair < 0:
            to = contacts[first + left]
            to.pair, to.plane, to.share = -1 - contact.pair, contact.plane, contact.share
            to.arm, to.gap, to.speed = contact.arm, contact.gap, contact.speed
            left += 1
    return left
