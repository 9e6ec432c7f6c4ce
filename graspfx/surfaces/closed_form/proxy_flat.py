"""Contact of a finger with a box, a half-space or a plane; the contact stays on its face at any penetration depth."""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.spatial import Vector, dot
from graspfx.surfaces.nearest import Nearest

TINY = 1e-280  # smaller squared lengths have lost their digits


@kernel
def on_box(d: int, half: Vector, p: Vector, face: int) -> Nearest:
    """Find the contact with a box: a face holds a finger that is behind it and within its edges.

    The contact of any other finger is its projection, for a new finger inside on the nearest face. A contact that
    slides over an edge to a nearer face would end at the same projection, because a finger beyond an edge is in front
    of the neighbouring face. Outside, the finger's face is the one that it is farthest in front of, so that it enters
    through that face.
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
    """Return the contact on a face: the finger's orthogonal projection on it, and the face's normal."""
    if face < 2:
        return Nearest(face, Vector(sign * half.x, p.y, p.z), Vector(-sign, 0.0, 0.0), gap)
    if face < 4:
        return Nearest(face, Vector(p.x, sign * half.y, p.z), Vector(0.0, -sign, 0.0), gap)
    return Nearest(face, Vector(p.x, p.y, sign * half.z), Vector(0.0, 0.0, -sign), gap)


@kernel
def on_half_space(outward: Vector, p: Vector) -> Nearest:
    """Return the finger's projection on the plane through the centre; everything behind the plane is inside."""
    height = dot(outward, p)
    return Nearest(0, p - height * outward, -outward, height)


@kernel
def on_plane(normal: Vector, p: Vector, face: int) -> Nearest:
    """Find the contact with a sheet without thickness: a finger stays on the side, 0 or 1, where it started."""
    side = face
    if face < 0:
        side = 1 if dot(normal, p) < 0.0 else 0
    foot = on_half_space(-normal if side == 1 else normal, p)
    return Nearest(side, foot.point, foot.normal, foot.gap)
