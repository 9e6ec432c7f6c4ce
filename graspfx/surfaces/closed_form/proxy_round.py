"""Where a finger touches a sphere, a capsule or a cylinder: radially, or on the flat side that holds it."""

from __future__ import annotations

import math

from graspfx.surfaces.closed_form.proxy_exact import radial_excess
from graspfx.surfaces.closed_form.proxy_flat import TINY


def on_sphere(
    radius: float, x: float, y: float, z: float, px: float, py: float, pz: float
) -> tuple[int, float, float, float, float, float, float, float]:
    """Contact along the ray from the centre through the finger; from the centre itself, in the direction before."""
    ux, uy, uz, r = direction(x, y, z, px, py, pz)
    return 0, radius * ux, radius * uy, radius * uz, -ux, -uy, -uz, r - radius


def direction(x: float, y: float, z: float, px: float, py: float, pz: float) -> tuple[float, float, float, float]:
    """Unit vector along (x, y, z) and its length; along p where there is none, along x where p has none either."""
    square = x * x + y * y + z * z
    if square >= TINY:
        r = math.sqrt(square)
        return x / r, y / r, z / r, r
    square = px * px + py * py + pz * pz
    if square >= TINY:
        r = math.sqrt(square)
        return px / r, py / r, pz / r, 0.0
    return 1.0, 0.0, 0.0, 0.0


def on_capsule(
    radius: float, half: float, x: float, y: float, z: float, px: float, py: float, pz: float
) -> tuple[int, float, float, float, float, float, float, float]:
    """All points within a radius of the segment |z| <= half, x = y = 0: contact along the ray from the segment.

    From the segment itself the finger keeps the direction that it had; within the segment that is across it.
    """
    t = min(max(z, -half), half)
    along = 0.0 if -half < z < half else pz - min(max(pz, -half), half)
    ux, uy, uz, r = direction(x, y, z - t, px, py, along)
    return 0, radius * ux, radius * uy, t + radius * uz, -ux, -uy, -uz, r - radius


def on_stadium(
    radius: float, half: float, x: float, y: float, face: int, px: float, py: float
) -> tuple[int, float, float, float, float, float, float, float]:
    """A capsule in the plane, along x: two straight sides, 0 = +y and 1 = -y, and a half disc at each end.

    A side holds the finger between its ends however deep it is, as a rectangle's does; beyond them an end has it.
    """
    side = 1 if y < 0.0 or (y == 0.0 and face == 1) else 0
    if abs(x) <= half:
        if face >= 0 and (1.0 - 2.0 * face) * y <= radius:
            side = face
        sign = 1.0 - 2.0 * side
        return side, x, sign * radius, 0.0, 0.0, -sign, 0.0, sign * y - radius
    t = math.copysign(half, x)
    ux, uy, _, r = direction(x - t, y, 0.0, px - t, py, 0.0)
    return side, t + radius * ux, radius * uy, 0.0, -ux, -uy, 0.0, r - radius


def on_cylinder(
    radius: float, half: float, x: float, y: float, z: float, face: int, px: float, py: float
) -> tuple[int, float, float, float, float, float, float, float]:
    """A solid cylinder about z: its mantle is face 0, its caps are 1 = +z and 2 = -z.

    As on a box: a finger behind its face and within the face's edges is held by it, so that a flat disc is never
    passed through; any other takes the face that it is farthest beyond, and outside its projection.
    """
    ux, uy, _, rho = direction(x, y, 0.0, px, py, 0.0)
    across, along = rho - radius, abs(z) - half
    if face > 0 and across <= 0.0:
        sign = 3.0 - 2.0 * face
        if sign * z <= half:
            return face, x, y, sign * half, 0.0, 0.0, -sign, sign * z - half
    mantle = across > along or (across == along and face <= 0)  # a tie does not change the face
    if face == 0 and across <= 0.0 and along <= 0.0:
        mantle = True
    sign = -1.0 if z < 0.0 or (z == 0.0 and face == 2) else 1.0
    face = 0 if mantle else (1 if sign > 0.0 else 2)
    if across > 0.0 and along > 0.0:
        across = max(radial_excess(x, y, radius), 0.0)
        gap = math.sqrt(across * across + along * along)
        if gap > 0.0:
            n = -across / gap
            return face, radius * ux, radius * uy, sign * half, n * ux, n * uy, -sign * (along / gap), gap
    if mantle:
        return face, radius * ux, radius * uy, z, -ux, -uy, 0.0, across
    return face, x, y, sign * half, 0.0, 0.0, -sign, along
