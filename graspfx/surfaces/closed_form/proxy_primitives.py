"""Contact of a finger with a box, half-space, plane, sphere, capsule or cylinder, at any penetration depth."""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.spatial import Vector, dot
from graspfx.surfaces.nearest import Nearest

TINY = 1e-280  # smaller squared lengths have lost their digits
HALVES = 134217729.0  # 2^27 + 1 splits a 53-bit significand into two halves


@kernel
def on_box(d: int, half: Vector, p: Vector, face: int) -> Nearest:
    """Find the contact of a finger at p with a box; see `closest`.

    If the finger is behind its face and its projection on the face is within the edges, the contact is this projection.
    Otherwise, the contact is the nearest point of the box if the finger is outside, or a point of the nearest face if
    it is inside. The new face is the one with the largest signed distance to the finger, so that a finger outside
    enters through this face.

    Args:
        d: Number of dimensions.
        half: Half edge lengths [m].
        p: Position of the finger [m].
        face: Face of the last sample; -1 for a new finger.
    """
    ex, ey, ez = abs(p.x) - half.x, abs(p.y) - half.y, abs(p.z) - half.z
    if d < 3:
        ez = -math.inf
    if d < 2:
        ey = -math.inf
    outside = ex > 0.0 or ey > 0.0 or ez > 0.0
    if face >= 0:
        axis = face // 2
        sign = 1.0 - 2.0 * (face - 2 * axis)
        depth = -math.inf
        if axis == 0 and ey <= 0.0 and ez <= 0.0:
            depth = half.x - sign * p.x
        if axis == 1 and ex <= 0.0 and ez <= 0.0:
            depth = half.y - sign * p.y
        if axis == 2 and ex <= 0.0 and ey <= 0.0:
            depth = half.z - sign * p.z
        if depth >= 0.0:
            return facing(face, sign, half, p, -depth)

    axis = face // 2 if face >= 0 else 0  # on a tie the face stays
    excess = ex if axis == 0 else (ey if axis == 1 else ez)
    if ex > excess:
        axis, excess = 0, ex
    if ey > excess:
        axis, excess = 1, ey
    if ez > excess:
        axis, excess = 2, ez
    across = p.x if axis == 0 else (p.y if axis == 1 else p.z)
    sign = -1.0 if across < 0.0 else 1.0
    side = 2 * axis if sign > 0.0 else 2 * axis + 1
    beyond = Vector(max(ex, 0.0), max(ey, 0.0), max(ez, 0.0))
    square = dot(beyond, beyond)
    if not outside or beyond.x + beyond.y + beyond.z == excess or square < TINY:
        return facing(side, sign, half, p, excess)
    gap = math.sqrt(square)
    point = Vector(min(max(p.x, -half.x), half.x), min(max(p.y, -half.y), half.y), min(max(p.z, -half.z), half.z))
    normal = Vector(
        -math.copysign(beyond.x / gap, p.x),
        -math.copysign(beyond.y / gap, p.y),
        -math.copysign(beyond.z / gap, p.z),
    )
    return Nearest(side, point, normal, gap)


@kernel
def facing(face: int, sign: float, half: Vector, p: Vector, gap: float) -> Nearest:
    """Return the contact with a face of a box: the orthogonal projection of p on the face, and the face's normal."""
    if face < 2:
        return Nearest(face, Vector(sign * half.x, p.y, p.z), Vector(-sign, 0.0, 0.0), gap)
    if face < 4:
        return Nearest(face, Vector(p.x, sign * half.y, p.z), Vector(0.0, -sign, 0.0), gap)
    return Nearest(face, Vector(p.x, p.y, sign * half.z), Vector(0.0, 0.0, -sign), gap)


@kernel
def on_half_space(outward: Vector, p: Vector) -> Nearest:
    """Find the contact of a finger at p with a half-space: the projection of p on the plane through the origin."""
    height = dot(outward, p)
    return Nearest(0, p - height * outward, -outward, height)


@kernel
def on_plane(normal: Vector, p: Vector, face: int) -> Nearest:
    """Find the contact of a finger at p with a sheet; the finger keeps its side (`face`, 0 or 1; -1 if new)."""
    side = face
    if face < 0:
        side = 1 if dot(normal, p) < 0.0 else 0
    foot = on_half_space(-normal if side == 1 else normal, p)
    return Nearest(side, foot.point, foot.normal, foot.gap)


# Exact sums and products of two floats, and arithmetic of float pairs -------------------------------------------------


def exact_sum(a: float, b: float) -> tuple[float, float]:
    """Return the rounded sum s of a and b, and its rounding error r, so that a + b = s + r exactly (Knuth 1969)."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


def exact_product(a: float, b: float) -> tuple[float, float]:
    """Return the rounded product p of a and b, and its rounding error r, so that a b = p + r exactly (Dekker 1971).

    The result is not exact if a product overflows or underflows.
    """
    p = a * b
    t = HALVES * a
    ah = t - (t - a)
    al = a - ah
    t = HALVES * b
    bh = t - (t - b)
    bl = b - bh
    return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl


def radial_excess(x: float, y: float, radius: float) -> float:
    """Compute sqrt(x^2 + y^2) - radius without cancellation.

    It is x^2 + y^2 - radius^2, computed from exact products, divided by sqrt(x^2 + y^2) + radius.
    """
    p, pr = exact_product(x, x)
    q, qr = exact_product(y, y)
    r, rr = exact_product(radius, radius)
    if p < q:
        p, pr, q, qr = q, qr, p, pr
    s, sr = exact_sum(p, -r)
    s, tr = exact_sum(s, q)
    return (s + (((pr - rr) + qr) + (sr + tr))) / (math.sqrt(p + q) + radius)


# Round shapes: radial, or on the flat side that holds the finger ------------------------------------------------------


@kernel
def on_sphere(radius: float, p: Vector, last: Vector) -> Nearest:
    """Find the contact of a finger at p with a sphere, on the ray from the centre through the finger.

    If the finger is at the centre, the ray has the direction of the last contact point.
    """
    u, r = direction(p, last)
    return Nearest(0, radius * u, -u, r - radius)


@kernel
def direction(v: Vector, last: Vector) -> tuple[Vector, float]:
    """Return the unit vector along v, and |v|; if v is zero, the unit vector is along `last`, or else along x."""
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
    """Find the contact of a finger at p with a capsule around the segment |z| <= half.

    The contact is on the ray from the nearest point of the segment through the finger. If the finger is on the segment,
    the ray has the direction of the last contact point, perpendicular to the segment except at the segment's ends.
    """
    t = min(max(p.z, -half), half)
    along = 0.0 if -half < p.z < half else last.z - min(max(last.z, -half), half)
    u, r = direction(Vector(p.x, p.y, p.z - t), Vector(last.x, last.y, along))
    return Nearest(0, Vector(radius * u.x, radius * u.y, t + radius * u.z), -u, r - radius)


@kernel
def on_stadium(radius: float, half: float, p: Vector, face: int, last: Vector) -> Nearest:
    """Find the contact of a finger at p with a capsule in the plane, around the segment |x| <= half.

    For |x| <= half, the contact is on the side of the last sample, 0 (+y) or 1 (-y), at any depth, as on a rectangle.
    Otherwise, the contact is on the half disc at the end of the capsule.
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
    """Find the contact of a finger at p with a solid cylinder along z.

    The faces are 0 (mantle), 1 (cap at +z) and 2 (cap at -z). As on a box, a finger keeps its face while it is behind
    the face and its projection is on the face, so that it does not pass through a thin disc. Otherwise, the new face is
    the one with the largest signed distance to the finger; if the finger is outside, the contact is the nearest point.
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
