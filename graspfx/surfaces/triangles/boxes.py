"""Geometric queries on a mesh: nearest points on triangles, normals of features, and searches in the tree of boxes."""

from __future__ import annotations

from dataclasses import dataclass

from graspfx.compile.kernel import inline, kernel
from graspfx.spatial import Vector, dot, length
from graspfx.surfaces.triangles.mesh_tree import MeshTree, Node, Triangle

ROUNDING = 2e-15  # rounding of a point, relative to a mesh's extent plus the point's distance from the origin
SLACK = 3e-13  # relative depth behind a triangle at which a segment may start and still enter the triangle


@dataclass(frozen=True, slots=True)
class Foot:
    """Point of a triangle nearest to a finger."""

    feature: int  # feature of the triangle on which the point lies
    square: float  # squared distance [m^2]
    point: Vector  # [m]


@inline
def scale_at(mesh: MeshTree, g: Vector) -> float:
    """Return the length scale of rounding errors of the mesh and of a point g [m]."""
    return mesh.extent + abs(g.x) + abs(g.y) + abs(g.z)


@kernel
def nearest_on_triangle(triangle: Triangle, g: Vector) -> Foot:
    """Find the point of a triangle nearest to g, by the Voronoi regions of the triangle's features (Ericson, 2005)."""
    a = triangle.a
    b, c = triangle.b - a, triangle.c - a
    p = g - a
    d1, d2 = dot(b, p), dot(c, p)
    if d1 <= 0.0 and d2 <= 0.0:
        return Foot(4, dot(p, p), a)
    q = g - triangle.b
    d3, d4 = dot(b, q), dot(c, q)
    if d3 >= 0.0 and d4 <= d3:
        return Foot(5, dot(q, q), triangle.b)
    r = g - triangle.c
    d5, d6 = dot(b, r), dot(c, r)
    if d6 >= 0.0 and d5 <= d6:
        return Foot(6, dot(r, r), triangle.c)
    if d1 * d4 - d3 * d2 <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return on_edge(1, d1 / (d1 - d3), a, b, p)
    if d5 * d2 - d1 * d6 <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return on_edge(3, d6 / (d6 - d2), triangle.c, -c, r)
    u, v = d4 - d3, d5 - d6
    if d3 * d6 - d5 * d4 <= 0.0 and u >= 0.0 and v >= 0.0:
        return on_edge(2, u / (u + v), triangle.b, c - b, q)
    n = triangle.normal
    h = dot(p, n)
    return Foot(0, h * h, g - h * n)


@kernel
def on_edge(feature: int, t: float, a: Vector, u: Vector, p: Vector) -> Foot:
    """Return the point a + t u on an edge as the nearest point to a finger at a + p."""
    along = t * u
    rest = p - along
    return Foot(feature, dot(rest, rest), a + along)


@kernel
def height_over(triangle: Triangle, g: Vector) -> float:
    """Compute the signed distance of g from a triangle's plane, positive in front [m]."""
    return dot(g - triangle.a, triangle.normal)


@kernel
def pseudonormal(mesh: MeshTree, face: int, feature: int) -> Vector:
    """Return the outward normal of a feature of a face, not normalised.

    It is the face's normal, for an edge the sum of the normals of both faces, and for a vertex its pseudonormal.
    """
    triangle = mesh.triangles[face]
    if feature > 3:
        corner = mesh.vertices[int(triangle.vertices[feature - 4])]
        return corner.pseudonormal
    if feature > 0:
        other = int(triangle.across[feature - 1])
        if other >= 0:
            neighbour = mesh.triangles[other]
            return triangle.normal + neighbour.normal
    return triangle.normal


@kernel
def is_outside(mesh: MeshTree, face: int, feature: int, v: Vector) -> bool:
    """Return whether a finger is in front of the surface, or beyond the boundary of a shell.

    Args:
        face, feature: Face of the contact point, and the feature on which the contact point is.
        v: Vector from the contact point to the finger [m].
    """
    triangle = mesh.triangles[face]
    if feature > 3:
        corner = mesh.vertices[int(triangle.vertices[feature - 4])]
        if corner.border:
            return True
    elif feature > 0 and triangle.across[feature - 1] < 0.0:
        return True
    return dot(v, pseudonormal(mesh, face, feature)) > 0.0


@kernel
def is_around(mesh: MeshTree, other: int, face: int, feature: int) -> bool:
    """Return whether triangle `other` contains the given feature of a face; False if `face` is -1."""
    if face < 0:
        return False
    if feature == 0:
        return other == face
    triangle = mesh.triangles[face]
    if feature <= 3:
        return other == face or other == int(triangle.across[feature - 1])
    vertex = triangle.vertices[feature - 4]
    corners = mesh.triangles[other].vertices
    return corners[0] == vertex or corners[1] == vertex or corners[2] == vertex


@kernel
def leaf_near(mesh: MeshTree, g: Vector) -> int:
    """Return a face near g, found by a descent in the tree into the child whose box is nearer to g."""
    nodes = mesh.nodes
    i = 0
    while nodes[i].skip > i + 1:
        other = nodes[i + 1].skip
        here = box_distance(nodes[i + 1], g)
        there = box_distance(nodes[other], g)
        i = i + 1 if here <= there else other
    return nodes[i].first


@kernel
def box_distance(node: Node, g: Vector) -> float:
    """Compute the squared distance from g to a node's box, zero inside the box [m^2]."""
    low, high = node.low, node.high
    x, y, z = 0.0, 0.0, 0.0
    if g.x < low.x:
        x = low.x - g.x
    elif g.x > high.x:
        x = g.x - high.x
    if g.y < low.y:
        y = low.y - g.y
    elif g.y > high.y:
        y = g.y - high.y
    if g.z < low.z:
        z = low.z - g.z
    elif g.z > high.z:
        z = g.z - high.z
    return x * x + y * y + z * z


@kernel
def nearest(mesh: MeshTree, g: Vector, bound: float) -> int:
    """Return the face nearest to g; -1 if no face has a squared distance to g below `bound` [m^2]."""
    nodes, triangles = mesh.nodes, mesh.triangles
    count = mesh.node_count
    best = bound
    face = -1
    i = 0
    while i < count:
        node = nodes[i]
        skip = node.skip
        if not box_distance(node, g) < best:
            i = skip
            continue
        if skip == i + 1:
            for k in range(node.first, nodes[i + 1].first):
                triangle = triangles[k]
                h = height_over(triangle, g)
                if h * h < best:
                    square = nearest_on_triangle(triangle, g).square
                    if square < best:
                        best = square
                        face = k
        i += 1
    return face


@kernel
def cast(mesh: MeshTree, start: Vector, g: Vector, face: int, feature: int) -> int:
    """Return the first face that the segment from `start` to g crosses from front to back; -1 if there is none.

    Triangles are slightly enlarged, so that no segment passes between two triangles. If a finger is stopped only
    because of the enlargement, `walk.mesh_contact` releases the finger again.

    Args:
        start, g: Ends of the segment [m].
        face, feature: Face and feature on which the segment starts; triangles around this feature are not crossed. -1
            as `face` for a start elsewhere.
    """
    nodes, triangles = mesh.nodes, mesh.triangles
    count = mesh.node_count
    u = g - start
    way = length(u)
    ends = max(abs(start.x) + abs(start.y) + abs(start.z), abs(g.x) + abs(g.y) + abs(g.z))
    scale = mesh.extent + ends
    slack = SLACK * scale
    low = Vector(min(start.x, g.x) - slack, min(start.y, g.y) - slack, min(start.z, g.z) - slack)
    high = Vector(max(start.x, g.x) + slack, max(start.y, g.y) + slack, max(start.z, g.z) + slack)
    hit = -1
    first = 2.0
    i = 0
    while i < count:
        node = nodes[i]
        skip = node.skip
        if is_apart(node, low, high):
            i = skip
            continue
        if skip == i + 1:
            for k in range(node.first, nodes[i + 1].first):
                triangle = triangles[k]
                after, before = height_over(triangle, g), height_over(triangle, start)
                if after < 0.0 and before >= -slack and before > after:
                    t = max(before, 0.0) / (before - after)
                    if t < first:
                        wide = slack + ROUNDING * scale * way / (before - after)  # a grazing segment is imprecise
                        square = nearest_on_triangle(triangle, start + t * u).square
                        if square <= wide * wide and not is_around(mesh, k, face, feature):
                            first = t
                            hit = k
        i += 1
    return hit


@kernel
def is_apart(node: Node, low: Vector, high: Vector) -> bool:
    """Return whether a node's box and the box with corners `low` and `high` are disjoint."""
    return (
        node.low.x > high.x or node.high.x < low.x
        or node.low.y > high.y or node.high.y < low.y
        or node.low.z > high.z or node.high.z < low.z
    )  # fmt: skip
