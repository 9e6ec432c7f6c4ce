"""Contact of a finger with a sphere, a capsule or a cylinder: radial, or on the flat side that holds the finger."""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.spatial import Vector, dot
from graspfx.surfaces.closed_form.proxy_exact import radial_excess
from graspfx.surfaces.closed_form.proxy_flat import TINY
from graspfx.surfaces.nearest import Nearest


@kernel
def on_sphere(radius: float, p: Vector, last: Vector) -> Nearest:
    """Find the contact on the ray from the centre through the finger; at the centre, keep the last direction."""
    u, r = direction(p, last)
    return Nearest(0, radius * u, -u, r - radius)


@kernel
def direction(v: Vector, last: Vector) -> tuple[Vector, float]:
    """Return the unit vector along v, and its length; for v = 0 along `last`, or along x if that is zero too."""
    square = dot(v, v)
    if square >= TINY:
        r = math.sqrt(square)
        return v / r, r
    square = dot(last, last)
    if square >= TINY:
        return last / math.sqrt(square), 0.0
    return Vector(1.0, 0.0, 0.0), 0.0


@kernel
def on_capsule(radius: float, half: float, p: Vector, last: Vector) -> Nearest:
    """Find the contact with a capsule about the segment |z| <= half: on the ray from the segment through the finger.

    On the segment itself the finger keeps its direction, which is across the segment except at its ends.
    """
    t = min(max(p.z, -half), half)
    along = 0.0 if -half < p.z < half else last.z - min(max(last.z, -half), half)
    u, r = direction(Vector(p.x, p.y, p.z - t), Vector(last.x, last.y, along))
    return Nearest(0, Vector(radius * u.x, radius * u.y, t + radius * u.z), -u, r - radius)


@kernel
def on_stadium(radius: float, half: float, p: Vector, face: int, last: Vector) -> Nearest:
    """Find the contact with a capsule in the plane, along x: sides 0 = +y and 1 = -y, and a half disc at each end.

    A side holds the finger between its ends at any depth, as a rectangle's side does; beyond them the half disc holds
    it.
    """
    side = 1 if p.y < 0.0 or (p.y == 0.0 and face == 1) else 0
    if abs(p.x) <= half:
        if face >= 0 and (1.0 - 2.0 * face) * p.y <= radius:
            side = face
        sign = 1.0 - 2.0 * side
        return Nearest(side, Vector(p.x, sign * radius, 0.0), Vector(0.0, -sign, 0.0), sign * p.y - radius)
    t = math.copysign(half, p.x)
    u, r = direction(Vector(p.x - t, p.y, 0.0), Vector(last.x - t, last.y, 0.0))
    return Nearest(side, Vector(t + radius * u.x, radius * u.y, 0.0), Vector(-u.x, -u.y, 0.0), r - radius)


@kernel
def on_cylinder(radius: float, half: float, p: Vector, face: int, last: Vector) -> Nearest:
    """Find the contact with a solid cylinder along z: its mantle is face 0, its caps are 1 = +z and 2 = -z.

    As on a box, a face holds a finger that is behind it and within its edges, so that a finger never passes through a
    flat disc. Any other finger is assigned the face that it is farthest in front of; outside, its contact is its
    projection.
    """
    u, rho = direction(Vector(p.x, p.y, 0.0), Vector(last.x, last.y, 0.0))
    across, along = rho - radius, abs(p.z) - half
    if face > 0 and across <= 0.0:
        sign = 3.0 - 2.0 * face
        if sign * p.z <= half:
            return Nearest(face, Vector(p.x, p.y, sign * half), Vector(0.0, 0.0, -sign), sign * p.z - half)
    mantle = across > along or (across == along and face <= 0)  # on a tie the face stays
    if face == 0 and across <= 0.0 and along <= 0.0:
        mantle = True
    sign = -1.0 if p.z < 0.0 or (p.z == 0.0 and face == 2) else 1.0
    side = 0 if mantle else (1 if sign > 0.0 else 2)
    if across > 0.0 and along > 0.0:
        across = max(radial_excess(p.x, p.y, radius), 0.0)
        gap = math.sqrt(across * across + along * along)
        if gap > 0.0:
            n = -across / gap
            rim = Vector(radius * u.x, radius * u.y, sign * half)
            return Nearest(side, rim, Vector(n * u.x, n * u.y, -sign * (along / gap)), gap)
    if mantle:
        return Nearest(side, Vector(radius * u.x, radius * u.y, p.z), Vector(-u.x, -u.y, 0.0), across)
    return Nearest(side, Vector(p.x, p.y, sign * half), Vector(0.0, 0.0, -sign), along)
