"""Contact of a finger with a closed-form shape: a contact point that stays on its face at any penetration depth."""

from __future__ import annotations

import math

from graspfx.compile.kernel import inline, kernel
from graspfx.spatial import Vector
from graspfx.surfaces.closed_form.proxy_ellipsoid import on_ellipsoid
from graspfx.surfaces.closed_form.proxy_primitives import (
    on_box,
    on_capsule,
    on_cylinder,
    on_half_space,
    on_plane,
    on_sphere,
    on_stadium,
)
from graspfx.surfaces.nearest import Nearest

BOX, SPHERE, HALF_SPACE, PLANE, CAPSULE, CYLINDER, ELLIPSOID = 0, 1, 2, 3, 4, 5, 6
MESH = 7  # not a closed form: see `walk.mesh_contact`
KINDS = range(MESH + 1)


@kernel
def closest(kind: int, d: int, size: Vector, p: Vector, face: int, last: Vector) -> Nearest:
    """Find the contact of a finger at p in the object's frame; only the first d coordinates are used.

    c is on the surface, n is the unit normal into the object, and gap is > 0 outside and < 0 inside, with p - c = -gap
    n. Outside, c is the nearest point of the shape. For an unknown kind the contact is NaN.

    Args:
        kind: Kind of the shape, with the meaning of `size` [m] and the faces between which a contact does not jump:
            BOX, half edges; 0 ... 5 = +x, -x, +y, -y, +z, -z.
            SPHERE, radius; a disc in the plane; on the line the same interval as a box.
            HALF_SPACE, outward unit normal; everything behind the plane through the centre.
            PLANE, unit normal; a sheet through the centre, with side 0, to which the normal points, and side 1.
            CAPSULE, radius and half the length of the straight part, along z; in the plane along x, with the long sides
            0 = +y and 1 = -y.
            CYLINDER, radius and half length, along z; 0 mantle, 1 cap at +z, 2 cap at -z.
            ELLIPSOID, semi-axes; 0 and 1 are the halves of positive and negative coordinate along the shortest.
        face: Finger's face at the last sample; -1 for none, which selects the face with the largest signed distance.
        last: Contact point at the last sample. If several points are nearest, for example to the centre of a sphere,
            the finger keeps its direction.
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
    nothing = math.inf - abs(p.x * math.inf)  # NaN for no shape; NaN forces are a fault
    return Nearest(-1, Vector(nothing, nothing, nothing), Vector(nothing, nothing, nothing), nothing)


@kernel
def closest_to_ball(kind: int, d: int, size: Vector, radius: float, p: Vector, face: int, last: Vector) -> Nearest:
    """Find the contact of a ball fingertip centred at p: the ball's gap, and the contact point on the shape.

    The ball's centre has a proxy q on the shape offset by the ball's radius: q = c - radius n, p - q = -gap n.
    Displacements are measured from q, e = p + radius n - c, and vanish where the ball just touches. The offset shape
    has the same faces, edges, normals and centres of curvature, so that the same face holds the finger.
    """
    centre = closest(kind, d, size, p, face, last)
    return Nearest(centre.face, centre.point, centre.normal, centre.gap - radius)


@inline
def in_dimensions(v: Vector, d: int) -> Vector:
    """Return a vector whose unused coordinates are zero."""
    return Vector(v.x, v.y if d > 1 else 0.0, v.z if d > 2 else 0.0)
