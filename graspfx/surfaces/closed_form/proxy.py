"""Contact of a finger with a closed-form shape: the contact point stays on one face at any penetration depth."""

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
    """Find the contact of a point finger with a shape about the origin of the object's frame.

    The contact has a point c on the surface, the unit normal n into the object, and the gap, which is positive outside
    and negative inside the shape, so that p - c = -gap n. If the finger is outside, c is the nearest point of the
    shape. If the finger is inside, c is on the face that the finger entered, as long as this face holds the finger. For
    an unknown kind the contact is NaN.

    Args:
        kind: Kind of the shape. It determines the meaning of `size` [m] and of the face indices:
            BOX, half edge lengths; faces 0 to 5 are +x, -x, +y, -y, +z, -z.
            SPHERE, radius; in one dimension an interval, with the faces of a box.
            HALF_SPACE, outward unit normal; the shape is all space behind the plane through the origin.
            PLANE, unit normal; the shape is a sheet through the origin, and the normal points to its side 0.
            CAPSULE, radius and half the length of the straight part, along z in space. In the plane, the straight part
            is along x, and its sides are 0 (+y) and 1 (-y).
            CYLINDER, radius and half length, along z; faces are 0 (mantle), 1 (cap at +z) and 2 (cap at -z).
            ELLIPSOID, semi-axes; faces 0 and 1 are the halves with positive and negative coordinate along the shortest.
        d: Number of dimensions; only the first d coordinates of vectors are used.
        size: Lengths or normal of the shape, see `kind`.
        p: Position of the finger in the object's frame [m].
        face: Face index of the finger's contact in the last sample; -1 for a new finger, which gets the face with the
            largest signed distance.
        last: Contact point in the last sample [m]. If several points of the shape are nearest to the finger, as for a
            finger at the centre of a sphere, the direction from the centre to `last` selects the contact point.
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
    """Find the contact of a ball fingertip of a given radius [m] with its centre at p; see `closest`.

    The gap is that between the ball and the shape; the contact point c is on the shape. The proxy of the ball's centre,
    q = c - radius n, is on the surface at the distance `radius` outside the shape, so that p - q = -gap n. The
    finger's displacement is e = p - q = p + radius n - c. The faces of the offset surface correspond to those of the
    shape, so that `face` has the same meaning as for a point finger.
    """
    centre = closest(kind, d, size, p, face, last)
    return Nearest(centre.face, centre.point, centre.normal, centre.gap - radius)


@inline
def in_dimensions(v: Vector, d: int) -> Vector:
    """Return a vector with all but its first d coordinates set to zero."""
    return Vector(v.x, v.y if d > 1 else 0.0, v.z if d > 2 else 0.0)
