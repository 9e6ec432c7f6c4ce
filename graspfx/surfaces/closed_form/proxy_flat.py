"""Where a finger touches a box, a half-space or a plane: on its face however deep it is."""

from __future__ import annotations

import math

TINY = 1e-280  # a squared length below this has lost its digits


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


def on_half_space(
    a: float, b: float, c: float, x: float, y: float, z: float
) -> tuple[int, float, float, float, float, float, float, float]:
    """The finger's foot on the surface through the centre; everything behind it is inside."""
    height = a * x + b * y + c * z
    return 0, x - height * a, y - height * b, z - height * c, -a, -b, -c, height


def on_plane(
    a: float, b: float, c: float, x: float, y: float, z: float, face: int
) -> tuple[int, float, float, float, float, float, float, float]:
    """A sheet without thickness or end: a finger stays for good on the side, 0 or 1, where it was at first."""
    if face < 0:
        face = 1 if a * x + b * y + c * z < 0.0 else 0
    if face == 1:
        a, b, c = -a, -b, -c
    _, cx, cy, cz, nx, ny, nz, gap = on_half_space(a, b, c, x, y, z)
    return face, cx, cy, cz, nx, ny, nz, gap
