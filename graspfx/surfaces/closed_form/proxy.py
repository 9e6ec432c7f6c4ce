"""Where a finger touches a shape in closed form: a contact point that stays on its face however deep the finger is."""

from __future__ import annotations

import math

from graspfx.compile.kernel import inline, kernel
from graspfx.spatial import Vector
from graspfx.surfaces.closed_form.proxy_ellipsoid import on_ellipsoid
from graspfx.surfaces.closed_form.proxy_flat import on_box, on_half_space, on_plane
from graspfx.surfaces.closed_form.proxy_round import on_capsule, on_cylinder, on_sphere, on_stadium
from graspfx.surfaces.nearest import Nearest

BOX, SPHERE, HALF_SPACE, PLANE, CAPSULE, CYLINDER, ELLIPSOID = 0, 1, 2, 3, 4, 5, 6
MESH = 7  # not in closed form: `walk.mesh_contact`
KINDS = range(MESH + 1)


@kernel
def closest(kind: int, d: int, size: Vector, p: Vector, face: int, last: Vector) -> Nearest:
    """Find the contact of a finger at p in the object's frame, of which d coordinates count.

    c is on the surface, n the unit normal into the object, gap > 0 outside and < 0 inside along n: p - c = -gap n.
    Outside, c is the nearest point of the shape. A kind that is none of these has a contact that is not a number.

    Args:
        kind: and the shape's `size`, lengths in m, with the faces between which a finger's contact does not jump:
            BOX, half edges; 0 ... 5 = +x, -x, +y, -y, +z, -z.
            SPHERE, radius; in the plane a disc; on the line the interval that a box is.
            HALF_SPACE, outward unit normal; all that is below the plane through the centre.
            PLANE, unit normal; a sheet through the centre with the sides 0, where the normal points, and 1.
            CAPSULE, radius and half the straight part's length, along z; in the plane along x, its long sides 0 = +y
            and 1 = -y.
            CYLINDER, radius and half length, along z; 0 mantle, 1 cap at +z, 2 cap at -z.
            ELLIPSOID, semi-axes; 0 and 1 are the two sides of the shortest.
        face: the finger's face from the sample before; -1 if it has none yet, then the face with the largest signed
            excess.
        last: the contact point from the sample before; a finger that several points are nearest to, as all are to a
            sphere's centre, keeps its direction.
    """
    p, last = in_dimensions(p, d), in_dimensions(last, d)
    if kind == BOX or (kind == SPHERE and d == 1):
        return on_box(d, size, p, face)
    if kind == SPHERE:
        return on_sphere(size.x, p, last)
    if kind == HALF_SPACE:
        return on_half_space(size, p)
    if kind == PLANE:
        return on_plane(size, p, face)
    if kind == CYLINDER:
        return on_cylinder(size.x, size.y, p, face, last)
    if kind == ELLIPSOID:
        return on_ellipsoid(d, size, p, face, last)
    if kind == CAPSULE and d == 2:
        return on_stadium(size.x, size.y, p, face, last)
    if kind == CAPSULE:
        return on_capsule(size.x, size.y, p, last)
    nothing = math.inf - abs(p.x * math.inf)  # no shape: not a number, forces neither, which is a fault
    return Nearest(-1, Vector(nothing, nothing, nothing), Vector(nothing, nothing, nothing), nothing)


@kernel
def closest_to_ball(kind: int, d: int, size: Vector, radius: float, p: Vector, face: int, last: Vector) -> Nearest:
    """Find the contact of a spherical fingertip about p: the gap is the ball's, the contact point is on the shape.

    The ball's centre has its own proxy, on the shape grown by the ball's radius: q = c - radius n, p - q = -gap n. So
    displacements count from there, e = p + radius n - c, and vanish where the ball just touches. Growing a shape keeps
    its faces with their edges, its normals and its centres of curvature, so the same face holds the finger.
    """
    centre = closest(kind, d, size, p, face, last)
    return Nearest(centre.face, centre.point, centre.normal, centre.gap - radius)


@inline
def in_dimensions(v: Vector, d: int) -> Vector:
    """Give a vector with zeros for the coordinates that do not count."""
    return Vector(v.x, v.y if d > 1 else 0.0, v.z if d > 2 else 0.0)
