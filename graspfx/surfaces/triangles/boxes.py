"""Queries of a mesh's bounding-box tree: a start face, the nearest face, the first face on a segment."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.spatial import Vector, length
from graspfx.surfaces.triangles.mesh_tree import MeshTree, Node
from graspfx.surfaces.triangles.triangle import ROUNDING, height_over, is_around, nearest_on_triangle

SLACK = 3e-13  # relative depth up to which a segment still enters


@kernel
def leaf_near(mesh: MeshTree, g: Vector) -> int:
    """Find a start face by descending the tree into the nearer box."""
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
    """Compute the squared distance from g to the box of a node [m^2]."""
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
    """Find the face nearest to g, or -1 if its squared distance is not below `bound`."""
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
    """Find the first face that the segment from `start` to g enters from its front, or -1.

    A segment that starts on a feature of a face (`face` -1: none) does not enter the triangles around that feature.
    Edges are slightly widened, so that nothing passes between two triangles. If this stops a finger by mistake, the
    walk releases it.
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
    """True if a node's box and the box between two corners are disjoint."""
    return (
        node.low.x > high.x or node.high.x < low.x
        or node.low.y > high.y or node.high.y < low.y
        or node.low.z > high.z or node.high.z < low.z
    )  # fmt: skip
