"""Which points of a body can touch a plane: its features, and where each is lowest."""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Many
from graspfx.objects.body_state import BodyState
from graspfx.objects.floor.planes import MOST, SIDES, Feature, FloorPlane, PlaneContact
from graspfx.spatial import ZERO, Vector, dot

# Kinds of features.
BALL = 0  # centre in the body and radius: a corner has none
RIM = 1  # z of a circle about the body's z axis, and its radius: the lowest point alone
NOTCH = 2  # a fixed point of a rim, which counts while the rim lies nearly flat
ELLIPSOID = 3  # semi-axes

FLAT, TILTED = 1e-4, 1e-2  # sines of a rim's tilt between which its lowest point comes to bear
STEEP = 0.5  # sine of a rim's tilt above which its fixed points do not count


@kernel
def lowest(body: BodyState, feature: Feature, n: Vector) -> tuple[float, Vector]:
    """Give the share of its stiffness with which a feature bears, and its lowest point from the centre, world.

    Ball c - r n; rim of radius r about z: c - r m_xy/|m_xy|; ellipsoid -A^2 m/|A m|, with m = R'n the normal in the
    body's axes.

    Args:
        n: the plane's unit normal, towards the body.
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
        # a point that runs round the rim of a cylinder that lies flat must not bear there at once: it would never rest
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
    """Leave of more than MOST contacts with a plane the deepest and the outermost in SIDES directions of the plane.

    They stand one after another from `first` on. Those that stay move to the front, in their order; their number is
    returned.
    """
    if count <= MOST:
        return count
    chosen = first
    for i in range(first, first + count):
        if contacts[i].gap < contacts[chosen].gap:
            chosen = i
    contacts[chosen].pair = -1 - contacts[chosen].pair  # marked
    for side in range(SIDES):
        c, s = math.cos(2.0 * math.pi * side / SIDES), math.sin(2.0 * math.pi * side / SIDES)
        outwards = c * plane.frame.second + s * plane.frame.third
        far = -math.inf
        for i in range(first, first + count):
            along = dot(contacts[i].arm, outwards)
            if along > far:
                far, chosen = along, i
        if contacts[chosen].pair >= 0:
            contacts[chosen].pair = -1 - contacts[chosen].pair
    left = 0
    for i in range(first, first + count):
        contact = contacts[i]
        if contact.pair < 0:
            to = contacts[first + left]
            to.pair, to.plane, to.share = -1 - contact.pair, contact.plane, contact.share
            to.arm, to.gap, to.speed = contact.arm, contact.gap, contact.speed
            left += 1
    return left
