"""Where a finger touches a box or a sphere: a contact point that stays on its face however deep the finger is."""

from __future__ import annotations

import math

BOX, SPHERE = 0, 1

TINY = 1e-280  # a squared length below this has lost its digits


def closest(
    kind: int, d: int, a: float, b: float, c: float, x: float, y: float, z: float,
    face: int, px: float, py: float, pz: float,
) -> tuple[int, float, float, float, float, float, float, float]:  # fmt: skip
    """Contact point of a finger at (x, y, z) in the object's frame: (face, cx, cy, cz, nx, ny, nz, gap).

    c is on the surface, n the unit normal into the object, gap > 0 outside and < 0 inside along n: p - c = -gap n.

    Args:
        kind: BOX with half edges (a, b, c), or SPHERE with radius a; d of the coordinates count. In the plane a sphere
            is a disc, on the line it is an interval as a box is.
        face: the finger's face from the sample before, 0 ... 5 = +x, -x, +y, -y, +z, -z; -1 if it has none yet, then
            the face with the largest signed excess.
        px, py, pz: the contact point from the sample before; a finger at a sphere's very centre keeps its direction.
    """
    if d < 3:
        z = pz = 0.0
    if d < 2:
        y = py = 0.0
    if kind == SPHERE and d > 1:
        return on_sphere(a, x, y, z, px, py, pz)
    return on_box(d, a, b, c, x, y, z, face)


def on_box(
    d: int, a: float, b: float, c: float, x: float, y: float, z: float, face: int
) -> tuple[int, float, float, float, float, float, float, float]:
    """A finger behind its face and within the face's edges is held by it; any other is outside, at its projection.

    Sliding over an edge to a nearer face would end at that projection too: beyond an edge it is outside the neighbour.
    Outside, the finger takes the face that it is farthest beyond, so that it enters where it came from.
    """
    ex, ey, ez = abs(x) - a, abs(y) - b, abs(z) - c
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
            depth = a - sign * x
        if axis == 1 and ex <= 0.0 and ez <= 0.0:
            depth = b - sign * y
        if axis == 2 and ex <= 0.0 and ey <= 0.0:
            depth = c - sign * z
        if depth >= 0.0:
            return facing(face, sign, a, b, c, x, y, z, -depth)

    kept = face // 2 if face >= 0 else 0
    axis = kept  # a tie does not change the face
    excess = ex if axis == 0 else (ey if axis == 1 else ez)
    if ex > excess:
        axis, excess = 0, ex
    if ey > excess:
        axis, excess = 1, ey
    if ez > excess:
        axis, excess = 2, ez
    across = x if axis == 0 else (y if axis == 1 else z)
    sign = -1.0 if across < 0.0 else 1.0
    face = 2 * axis if sign > 0.0 else 2 * axis + 1
    ox, oy, oz = max(ex, 0.0), max(ey, 0.0), max(ez, 0.0)
    square = ox * ox + oy * oy + oz * oz
    if not outside or ox + oy + oz == excess or square < TINY:
        return facing(face, sign, a, b, c, x, y, z, excess)
    gap = math.sqrt(square)
    cx, cy, cz = min(max(x, -a), a), min(max(y, -b), b), min(max(z, -c), c)
    nx = -math.copysign(ox / gap, x)
    ny = -math.copysign(oy / gap, y)
    nz = -math.copysign(oz / gap, z)
    return face, cx, cy, cz, nx, ny, nz, gap


def facing(
    face: int, sign: float, a: float, b: float, c: float, x: float, y: float, z: float, gap: float
) -> tuple[int, float, float, float, float, float, float, float]:
    """Contact straight across a face: the finger's foot on it and the face's normal."""
    if face < 2:
        return face, sign * a, y, z, -sign, 0.0, 0.0, gap
    if face < 4:
        return face, x, sign * b, z, 0.0, -sign, 0.0, gap
    return face, x, y, sign * c, 0.0, 0.0, -sign, gap


def on_sphere(
    radius: float, x: float, y: float, z: float, px: float, py: float, pz: float
) -> tuple[int, float, float, float, float, float, float, float]:
    """Contact along the ray from the centre through the finger; from the centre itself, in the direction before."""
    square = x * x + y * y + z * z
    ux, uy, uz = 1.0, 0.0, 0.0
    gap = -radius
    if square >= TINY:
        r = math.sqrt(square)
        ux, uy, uz = x / r, y / r, z / r
        gap = r - radius
    else:
        square = px * px + py * py + pz * pz
        if square >= TINY:
            r = math.sqrt(square)
            ux, uy, uz = px / r, py / r, pz / r
    return 0, radius * ux, radius * uy, radius * uz, -ux, -uy, -uz, gap
