"""Projection of a ball's proxy onto the region in front of planes, by a dual active-set method.

Let c_j be the point of triangle j nearest to the proxy q, and n_j the direction from c_j to q. The triangle lies behind
c_j, so that

    min |x - g|   where   n_j . (x - c_j) >= radius   for all triangles within reach

keeps x, and the segment from q to x, off all of them.
"""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Many
from graspfx.spatial import Vector, cross, dot
from graspfx.surfaces.triangles.boxes import box_distance
from graspfx.surfaces.triangles.mesh_finger import MeshFinger, Plane
from graspfx.surfaces.triangles.mesh_tree import MeshTree, Triangle
from graspfx.surfaces.triangles.triangle import ROUNDING, Foot, height_over, nearest_on_triangle

CHANGES = 24  # largest number of changes of the active set
PARALLEL = 1e-18  # squared volume of the normals below which they are linearly dependent


@kernel
def project(
    mesh: MeshTree, ball: MeshFinger, radius: float, reach: float, scale: float, g: Vector
) -> tuple[int, Vector]:
    """Return the number of active planes, stored first, and the point nearest to g in front of all planes in reach.

    The most violated plane is added to the active set. Of these planes (at most four), only those that hold the point
    remain active. The distance from g grows with every change, so that the method terminates. The number is -1 if no
    point is in front of all planes.
    """
    x = g
    count = 0
    slack = ROUNDING * scale
    for _ in range(CHANGES):
        amount = most_violated(mesh, ball, radius, reach, count, slack, x)
        if amount <= slack:
            return count, x
        count = drop_covered(mesh, ball.planes, count, radius, slack)
        count, x = hold(ball.planes, count, g, slack)
        if count < 0:
            break
    return -1, g


@kernel
def most_violated(
    mesh: MeshTree, ball: MeshFinger, radius: float, reach: float, count: int, slack: float, x: Vector
) -> float:
    """Write the plane that x violates most after the `count` active ones; return the violation, or zero."""
    q = ball.last
    nodes, triangles = mesh.nodes, mesh.triangles
    end = mesh.node_count
    bound = reach * reach
    worst = 0.0
    i = 0
    while i < end:
        node = nodes[i]
        skip = node.skip
        if not box_distance(node, q) <= bound:
            i = skip
            continue
        if skip == i + 1:
            for face in range(node.first, nodes[i + 1].first):
                triangle = triangles[face]
                h = height_over(triangle, q)
                if h * h > bound or (h <= 0.0 and not mesh.closed):
                    continue
                foot = nearest_on_triangle(triangle, q)
                # a shell is passed from behind; it holds a ball again once the ball has left it
                if foot.square > bound or (not mesh.closed and foot.square < radius * radius * (1.0 - 1e-9)):
                    continue
                n = way_off(triangle, foot, h, q)
                behind = radius - dot(n, x - foot.point)
                if behind > worst and not is_covered_by_any(ball, count, triangle, radius, slack):
                    worst = behind
                    plane = ball.planes[count]
                    plane.normal = n
                    plane.distance = radius + n.x * foot.point.x + n.y * foot.point.y + n.z * foot.point.z
                    plane.triangle, plane.feature = face, foot.feature
        i += 1
    return worst


@kernel
def way_off(triangle: Triangle, foot: Foot, height: float, q: Vector) -> Vector:
    """Return the unit vector from a triangle's nearest point to q, which is `height` in front of its plane."""
    if foot.feature != 0 and foot.square > 0.0:
        return (q - foot.point) / math.sqrt(foot.square)
    if height < 0.0:
        return -triangle.normal
    return triangle.normal


@kernel
def is_covered_by_any(ball: MeshFinger, count: int, triangle: Triangle, radius: float, slack: float) -> bool:
    """True if one of the active planes covers a triangle."""
    covered = False
    for j in range(count):
        covered = covered or is_covered(triangle, ball.planes[j], radius, slack)
    return covered


@kernel
def is_covered(triangle: Triangle, plane: Plane, radius: float, slack: float) -> bool:
    """True if every point in front of a plane is a radius away from the whole triangle.

    This holds across a flat or convex edge, where the triangle's own plane would keep the proxy from crossing the edge.
    """
    behind = plane.distance - radius + slack
    n = plane.normal
    return not (dot(n, triangle.a) > behind or dot(n, triangle.b) > behind or dot(n, triangle.c) > behind)


@kernel
def drop_covered(mesh: MeshTree, planes: Many[Plane], count: int, radius: float, slack: float) -> int:
    """Drop active planes whose triangle the next plane covers; return the number of the remaining ones."""
    i = 0
    left = count
    while i < left:
        if is_covered(mesh.triangles[planes[i].triangle], planes[left], radius, slack):
            swap(planes, i, left - 1)
            swap(planes, left - 1, left)
            left -= 1
        else:
            i += 1
    return left


@kernel
def hold(planes: Many[Plane], count: int, g: Vector, slack: float) -> tuple[int, Vector]:
    """Project g onto the region in front of `count` + 1 planes, the last one active; active planes move to the front.

    Try the last plane alone, then with one other plane, then with two others, until a point is in front of all planes;
    return -1 if none is.
    """
    for size in range(3):
        for i in range(count if size > 0 else 1):
            for j in range(i + 1, count if size > 1 else i + 2):
                a = i if size > 0 else -1
                b = j if size > 1 else -1
                success, x = onto(planes, count, a, b, g)
                for other in range(count):
                    if other != a and other != b:
                        plane = planes[other]
                        success = success and dot(plane.normal, x) >= plane.distance - slack
                if success:
                    if size > 0:
                        swap(planes, 0, a)
                    if size > 1:
                        swap(planes, 1, b)
                    swap(planes, size, count)
                    return size + 1, x
    return -1, g


@kernel
def onto(planes: Many[Plane], last: int, a: int, b: int, g: Vector) -> tuple[bool, Vector]:
    """Compute g + sum l_j n_j on the planes `last`, a and b (-1: not used), and whether all l_j >= 0."""
    plane = planes[last]
    n = plane.normal
    u = plane.distance - dot(n, g)
    if a < 0:
        return u >= 0.0, g + u * n
    plane = planes[a]
    na = plane.normal
    v = plane.distance - dot(na, g)
    if b < 0:
        return onto_two(n, na, u, v, g)
    plane = planes[b]
    nb = plane.normal
    w = plane.distance - dot(nb, g)
    # the rows of the inverse are the cross products, divided by the volume
    ab, bn, nna = cross(na, nb), cross(nb, n), cross(n, na)
    volume = dot(n, ab)
    if volume * volume <= PARALLEL:
        return False, g
    d = (u * ab + v * bn + w * nna) / volume
    inside = dot(d, ab) * volume >= 0.0 and dot(d, bn) * volume >= 0.0 and dot(d, nna) * volume >= 0.0
    return inside, g + d


@kernel
def onto_two(n: Vector, a: Vector, u: float, v: float, g: Vector) -> tuple[bool, Vector]:
    """Compute g + s n + t a on two planes that are u and v in front of g, and whether s, t >= 0."""
    na = dot(n, a)
    det = 1.0 - na * na
    if det <= PARALLEL:
        return False, g
    s, t = (u - na * v) / det, (v - na * u) / det
    return s >= 0.0 and t >= 0.0, g + s * n + t * a


@kernel
def swap(planes: Many[Plane], i: int, j: int) -> None:
    """Exchange two planes."""
    p, q = planes[i], planes[j]
    p.normal, q.normal = q.normal, p.normal
    p.distance, q.distance = q.distance, p.distance
    p.triangle, q.triangle = q.triangle, p.triangle
    p.feature, q.feature = q.feature, p.feature
