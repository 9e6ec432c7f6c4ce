"""Contact of a point finger with a triangle mesh: the contact point moves over the surface and never through it.

A finger is either free or in contact:

- Free: a finger that has moved by less than its distance from the surface cannot touch the surface. For a longer
  motion, the first triangle that the segment from the last to the present position crosses from its front is found. If
  the finger is within its `reach` of the surface, the nearest point is computed in every sample.
- In contact: the contact point moves over edges and vertices to the nearest point in its neighbourhood (Zilles and
  Salisbury, 1995; Ho, Basdogan and Srinivasan, 1999). A finger deep in a thin plate therefore stays in contact with
  the side through which it entered. A finger is released once it is outside according to the pseudonormal at the
  contact point (Baerentzen and Aanaes, 2005). In the same sample, the segment from the contact point to the finger is
  tested for the next contact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from graspfx.compile.kernel import kernel
from graspfx.spatial import Vector, dot, length
from graspfx.surfaces.nearest import Nearest
from graspfx.surfaces.triangles.boxes import (
    ROUNDING,
    cast,
    is_outside,
    leaf_near,
    nearest,
    nearest_on_triangle,
    pseudonormal,
    scale_at,
)
from graspfx.surfaces.triangles.mesh_tree import FREE, NEW, TOUCHING, MeshFinger, MeshTree

SAME_POINT = 1e-16  # relative distance below which two nearest points coincide
NOTHING = 1e-13  # relative depth that does not count as inside
REPEATS = 4  # largest number of steps of a walk between points that are equal within rounding


@dataclass(frozen=True, slots=True)
class Spot:
    """Point of the surface at which the distance to a finger has a local minimum."""

    face: int
    feature: int  # feature of the face
    square: float  # squared distance from the finger [m^2]
    point: Vector  # [m]


@kernel
def mesh_contact(mesh: MeshTree, finger: MeshFinger, g: Vector) -> Nearest:
    """Find the contact of a finger that has moved to g in the object's frame, and update the finger's state.

    The contact has a point c on the surface, the unit normal n into the object, and the gap, which is positive outside
    and negative inside, so that g - c = -gap n. If the gap exceeds the finger's `reach`, c and n may be those of an
    earlier sample, and the gap is a lower bound.
    """
    scale = scale_at(mesh, g)
    last = finger.last
    finger.last = g
    face = finger.face
    new = finger.mode == NEW
    touching = finger.mode == TOUCHING
    if new:
        face = leaf_near(mesh, g)
    elif not touching:
        safe = finger.safe - length(g - last) - ROUNDING * scale
        if safe > finger.reach:
            finger.safe = safe
            return Nearest(face, finger.point, finger.inward, safe)
        if safe <= 0.0:
            hit = cast(mesh, last, g, -1, 0)
            if hit >= 0:
                face = hit
                touching = True

    spot = walk(mesh, face, g)
    released = math.inf
    while touching and is_outside(mesh, spot.face, spot.feature, g - spot.point):
        touching = False
        if spot.square < released:  # otherwise the finger was already released at this point
            released = spot.square
            hit = cast(mesh, spot.point, g, spot.face, spot.feature)
            if hit >= 0:
                spot = walk(mesh, hit, g)
                touching = True

    beyond = False
    limit = math.inf  # a new finger needs to find its side
    if not new:
        limit = 2.0 * finger.reach + 0.1 * mesh.size
    finger.safe = 0.0
    if not touching:
        nearer = nearest(mesh, g, min(spot.square, limit * limit))
        if nearer >= 0:
            spot = walk(mesh, nearer, g)
        beyond = spot.square > limit * limit
        finger.safe = limit if beyond else math.sqrt(spot.square)
        if mesh.closed and not beyond:
            inside = not is_outside(mesh, spot.face, spot.feature, g - spot.point)
            touching = inside and (new or spot.square > NOTHING * scale * NOTHING * scale)
    finger.mode = TOUCHING if touching else FREE
    finger.face, finger.feature = spot.face, spot.feature
    normal, gap = across(mesh, spot, touching, scale, g)
    finger.point, finger.inward = spot.point, normal
    return Nearest(spot.face, spot.point, normal, limit if beyond else gap)


@kernel
def across(mesh: MeshTree, spot: Spot, touching: bool, scale: float, g: Vector) -> tuple[Vector, float]:
    """Return the unit normal into the object, and the gap, of a finger at g whose contact point is `spot`.

    Args:
        touching: Whether the finger is in contact; the gap is then not positive.
        scale: Length to which rounding errors at g are relative [m].
    """
    v = g - spot.point
    if spot.feature == 0:
        triangle = mesh.triangles[spot.face]
        normal = -triangle.normal
        gap = dot(triangle.a - g, normal)
        if touching:
            return normal, min(gap, 0.0)
        if mesh.closed or gap >= 0.0:
            return normal, max(gap, 0.0)
        return -normal, -gap  # behind a shell
    gap = length(v)
    sign = 1.0 if touching else -1.0
    if gap > ROUNDING * scale:
        return sign * v / gap, -sign * gap
    n = pseudonormal(mesh, spot.face, spot.feature)  # so close, the direction would be pure rounding
    size = length(n)
    if size < 1e-9:  # a fold without thickness
        flat = mesh.triangles[spot.face]
        n = flat.normal
        size = 1.0
    return -n / size, -sign * gap


@kernel
def walk(mesh: MeshTree, face: int, g: Vector) -> Spot:
    """Move from a face over its neighbours to a point at which the distance to g has a local minimum.

    Every step leads to a nearer point, so that the walk terminates. `REPEATS` steps may lead to points with an equal
    distance: near a flat edge, rounded distances can be equal although the points differ by 1e-8 of the distance.
    """
    triangles = mesh.triangles
    foot = nearest_on_triangle(triangles[face], g)
    here = Spot(face, foot.feature, foot.square, foot.point)
    step = SAME_POINT * scale_at(mesh, g)
    repeats = REPEATS
    while here.feature != 0:
        triangle = triangles[here.face]
        neighbours = triangle.across
        first, count = here.feature - 1, 1
        if here.feature > 3:
            vertex = mesh.vertices[int(triangle.vertices[here.feature - 4])]
            neighbours = mesh.rings
            first, count = vertex.ring, vertex.ring_count
        to = Spot(-1, 0, here.square, here.point)
        equal = False
        for k in range(first, first + count):
            other = int(neighbours[k])
            if other >= 0 and other != here.face:
                foot = nearest_on_triangle(triangles[other], g)
                if foot.square < to.square:
                    to = Spot(other, foot.feature, foot.square, foot.point)
                    equal = False
                elif (
                    to.face < 0
                    and repeats > 0
                    and foot.square <= here.square * (1.0 + 1e-15)
                    and distance_by_axes(foot.point, here.point) > step
                ):
                    to = Spot(other, foot.feature, to.square, foot.point)
                    equal = True
        if to.face < 0:
            break
        if equal:
            repeats -= 1
        here = to
    return here


@kernel
def distance_by_axes(a: Vector, b: Vector) -> float:
    """Compute the distance |a_x - b_x| + |a_y - b_y| + |a_z - b_z|."""
    return abs(a.x - b.x) + abs(a.y - b.y) + abs(a.z - b.z)
