"""Where a finger touches a shape in closed form: a contact point that stays on its face however deep the finger is."""

from __future__ import annotations

from graspfx.surfaces.closed_form.proxy_ellipsoid import on_ellipsoid
from graspfx.surfaces.closed_form.proxy_flat import on_box, on_half_space, on_plane
from graspfx.surfaces.closed_form.proxy_round import on_capsule, on_cylinder, on_sphere, on_stadium

BOX, SPHERE, HALF_SPACE, PLANE, CAPSULE, CYLINDER, ELLIPSOID = 0, 1, 2, 3, 4, 5, 6
MESH = 7  # not in closed form: `walk.mesh_contact`


def closest(
    kind: int, d: int, a: float, b: float, c: float, x: float, y: float, z: float,
    face: int, px: float, py: float, pz: float,
) -> tuple[int, float, float, float, float, float, float, float]:  # fmt: skip
    """Contact point of a finger at (x, y, z) in the object's frame: (face, cx, cy, cz, nx, ny, nz, gap).

    c is on the surface, n the unit normal into the object, gap > 0 outside and < 0 inside along n: p - c = -gap n.
    Outside, c is the nearest point of the shape. d of the coordinates count.

    Args:
        kind: and (a, b, c), lengths in m, with the faces between which a finger's contact point does not jump:
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
        px, py, pz: the contact point from the sample before; a finger that several points are nearest to, as all are
            to a sphere's centre, keeps its direction.
    """
    if d < 3:
        z = pz = 0.0
    if d < 2:
        y = py = 0.0
    if kind == BOX or (kind == SPHERE and d == 1):
        return on_box(d, a, b, c, x, y, z, face)
    if kind == SPHERE:
        return on_sphere(a, x, y, z, px, py, pz)
    if kind == HALF_SPACE:
        return on_half_space(a, b, c, x, y, z)
    if kind == PLANE:
        return on_plane(a, b, c, x, y, z, face)
    if kind == CYLINDER:
        return on_cylinder(a, b, x, y, z, face, px, py)
    if kind == ELLIPSOID:
        return on_ellipsoid(d, a, b, c, x, y, z, face, px, py, pz)
    if d == 2:
        return on_stadium(a, b, x, y, face, px, py)
    return on_capsule(a, b, x, y, z, px, py, pz)


def closest_to_ball(
    kind: int, d: int, a: float, b: float, c: float, radius: float, x: float, y: float, z: float,
    face: int, px: float, py: float, pz: float,
) -> tuple[int, float, float, float, float, float, float, float]:  # fmt: skip
    """The same for a spherical fingertip about (x, y, z): the gap is the ball's, the contact point is on the shape.

    The ball's centre has its own proxy, on the shape grown by the ball's radius: q = c - radius n, p - q = -gap n. So
    displacements count from there, e = p + radius n - c, and vanish where the ball just touches. Growing a shape keeps
    its faces with their edges, its normals and its centres of curvature, so the same face holds the finger.
    """
    face, cx, cy, cz, nx, ny, nz, gap = closest(kind, d, a, b, c, x, y, z, face, px, py, pz)
    return face, cx, cy, cz, nx, ny, nz, gap - radius
