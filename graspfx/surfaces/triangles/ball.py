"""Contact of a ball with a triangle mesh: the proxy of the ball's centre keeps the distance of a radius from triangles.

The proxy q is the position that the ball's centre g would have if the ball could not penetrate the surface. It is the
point nearest to g that q can reach without crossing the surface: the god-object of Zilles and Salisbury (1995) for a
finger with a radius (Ruspini, Kolarov and Khatib, 1997). Each step of q solves a convex problem (`project`) with a
plane for each nearby triangle. The planes keep the whole segment of the step away from all triangles, so that the ball
does not pass through thin walls. Where walls meet, up to three planes hold q, and g - q is a continuous function of g.

The state of a ball is a `MeshFinger`, as for a point finger in `walk`, except that `last` is the proxy.
"""

from __future__ import annotations

import math

from graspfx import elementary
from graspfx.compile.kernel import kernel
from graspfx.compile.records import Many
from graspfx.spatial import ZERO, Vector, cross, dot, length
from graspfx.surfaces.nearest import Nearest
from graspfx.surfaces.triangles.boxes import (
    ROUNDING,
    Foot,
    box_distance,
    height_over,
    nearest,
    nearest_on_triangle,
    scale_at,
)
from graspfx.surfaces.triangles.mesh_tree import FREE, NEW, TOUCHING, MeshFinger, MeshTree, Plane, Triangle
from graspfx.surfaces.triangles.walk import mesh_contact, walk

STEP = 0.25  # largest proxy step, relative to the radius; a step of 2 could pass over something
STEPS = 32  # largest number of steps in one sample
CHANGES = 24  # largest number of changes of the active set
PARALLEL = 1e-18  # squared volume of the normals below which they are linearly dependent


@kernel
def ball_contact(mesh: MeshTree, ball: MeshFinger, radius: float, g: Vector) -> Nearest:
    """Find the contact of a ball whose centre has moved to g in the object's frame, and update the ball's state.

    The contact has a point c, the unit normal n into the object, and the gap, so that c - radius n is the proxy. A
    positive gap is the distance of the ball from the surface; a negative gap is minus the distance from g to the proxy
    along n. If g is farther from the surface than the ball's `reach`, c and n may be those of an earlier sample, and
    the gap is a lower bound.
    """
    if ball.mode == NEW:
        return begin(mesh, ball, radius, g)
    scale = scale_at(mesh, g)
    clear = ball.safe - radius
    travel = length(g - ball.last)
    if ball.mode == FREE and travel + ROUNDING * scale < clear:
        ball.last = g
        ball.safe -= travel + ROUNDING * scale
        if ball.safe > ball.reach:
            return Nearest(ball.face, ball.point, ball.inward, ball.safe - radius)
        return free_contact(mesh, ball, radius, g)
    return settle(mesh, ball, radius, max(clear, STEP * radius), scale, g)


@kernel
def begin(mesh: MeshTree, ball: MeshFinger, radius: float, g: Vector) -> Nearest:
    """Find the contact of a new ball; if the ball penetrates, the nearest surface point determines its side."""
    centre = mesh_contact(mesh, ball, g)
    if centre.gap >= radius:
        ball.last = g
        ball.safe = centre.gap
        ball.mode = FREE
        return Nearest(centre.face, centre.point, centre.normal, centre.gap - radius)
    ball.last = centre.point - radius * centre.normal
    return settle(mesh, ball, radius, STEP * radius, scale_at(mesh, g), g)


@kernel
def free_contact(mesh: MeshTree, ball: MeshFinger, radius: float, g: Vector) -> Nearest:
    """Find the contact of a ball that does not touch the surface, and update its state."""
    spot = walk(mesh, ball.face, g)
    nearer = nearest(mesh, g, spot.square)
    if nearer >= 0:
        spot = walk(mesh, nearer, g)
    away = max(math.sqrt(spot.square), 1e-300)
    n = (spot.point - g) / away
    ball.point, ball.inward = spot.point, n
    ball.face = spot.face
    ball.safe = away
    ball.mode = FREE
    if away < radius:  # due to rounding, or halfway through a shell from behind: no displacement
        return Nearest(spot.face, g + radius * n, n, max(away - radius, 0.0))
    return Nearest(spot.face, spot.point, n, max(away - radius, 0.0))


@kernel
def settle(mesh: MeshTree, ball: MeshFinger, radius: float, step: float, scale: float, g: Vector) -> Nearest:
    """Move the proxy as close to g as the surface allows, and return the contact.

    Args:
        step: Largest length of the first step of the proxy [m].
        scale: Length to which rounding errors at g are relative [m].
    """
    count = 0
    farthest = step
    for _ in range(STEPS):
        q = ball.last
        far = length(g - q)
        count, x = project(mesh, ball, radius, radius + min(far, farthest), scale, g)
        if count < 0:  # no point is in front of all planes: the proxy stays
            break
        u = x - q
        travel = length(u)
        if travel > farthest:
            ball.last = q + (farthest / travel) * u
        else:
            ball.last = x
            if travel <= ROUNDING * scale:
                break
            if count == 1:
                roll(mesh, ball, radius, scale, g)
        farthest = STEP * radius
    q = ball.last
    if count == 0 and q.x == g.x and q.y == g.y and q.z == g.z:
        return free_contact(mesh, ball, radius, g)
    ball.mode = TOUCHING
    ball.safe = radius
    first = ball.planes[0]
    if count > 0:
        ball.face = first.triangle
    u = g - q
    size = length(u)
    if count > 1 and size > ROUNDING * scale:
        ball.inward = u / size
    elif count > 0:
        ball.inward = -first.normal
    n = ball.inward
    if count == 0:  # the path is free but too long for one sample: it continues in the next one, without force
        return Nearest(ball.face, g + radius * n, n, 0.0)
    return Nearest(ball.face, q + radius * n, n, min(dot(n, q - g), 0.0))


@kernel
def roll(mesh: MeshTree, ball: MeshFinger, radius: float, scale: float, g: Vector) -> None:
    """Move the proxy towards g on the circle around the edge or vertex that holds it, by at most STEP [rad].

    Steps along tangent planes (`project`) would converge more slowly, the more so the deeper g is. The proxy moves only
    if its new position has the distance of a radius from all triangles; since the path is short, no triangle is between
    its ends.
    """
    plane = ball.planes[0]
    if plane.feature == 0:
        return
    c = nearest_on_feature(mesh, plane.triangle, plane.feature, g)
    q = ball.last
    d = q - c
    away = length(d)
    if not away > 0.0:
        return
    d = d / away
    w = g - c
    along = dot(w, d)
    t = w - along * d
    across = length(t)
    if not across > 0.0:
        return
    angle = min(elementary.atan2(across, along), STEP)
    sin, cos = elementary.sin_cos(angle)
    x = c + radius * cos * d + radius * sin / across * t
    if angle < STEP:
        share = radius / length(w)
        x = c + share * w + ZERO  # turns minus zero into zero
    bound = radius - ROUNDING * scale
    if length(x - q) <= 2.0 * STEP * radius and nearest(mesh, x, bound * bound) < 0:
        ball.last = x


@kernel
def nearest_on_feature(mesh: MeshTree, face: int, feature: int, g: Vector) -> Vector:
    """Return the point nearest to g of a feature of a triangle: an edge (1, 2, 3), or a vertex (4, 5, 6)."""
    c = corner(mesh, face, (feature - 1) % 3)
    if feature > 3:
        return c
    u = corner(mesh, face, feature % 3) - c
    along = dot(g - c, u) / dot(u, u)
    along = min(max(along, 0.0), 1.0)
    return c + along * u


@kernel
def corner(mesh: MeshTree, face: int, k: int) -> Vector:
    """Return vertex k = 0, 1 or 2 of a triangle."""
    triangle = mesh.triangles[face]
    if k == 0:
        return triangle.a
    return triangle.b if k == 1 else triangle.c


# Projection onto the region in front of planes, by a dual active-set method -------------------------------------------


@kernel
def project(
    mesh: MeshTree, ball: MeshFinger, radius: float, reach: float, scale: float, g: Vector
) -> tuple[int, Vector]:
    """Find the point x nearest to g in front of the planes of all triangles within a distance `reach` of the proxy q.

    Let c_j be the point of triangle j nearest to q, and n_j the unit vector from c_j to q. Then x is the solution of

        min |x - g|   subject to   n_j . (x - c_j) >= radius   for all triangles j within `reach`.

    Since each triangle is behind the plane through c_j normal to n_j, x and the segment from q to x have at least the
    distance `radius` from all these triangles.

    The method is a dual active-set method. Each iteration adds the most violated plane to the active planes and removes
    those that no longer hold the solution. The distance from x to g increases in each iteration, so that the method
    terminates.

    Returns:
        Number of active planes, which are the first entries of `ball.planes`, and x. The number is -1 if no point is in
        front of all planes, or after `CHANGES` iterations.
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
    """Find the plane that x violates most, and write it to index `count` of the ball's planes, after the active ones.

    Returns:
        Violation of the plane [m]; zero if x violates no plane.
    """
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
    """Return the unit vector from the triangle's point nearest to q (`foot`) to q.

    If the foot is inside the triangle, the unit vector is the normal, with the sign of the signed distance `height` of
    q from the triangle's plane.
    """
    if foot.feature != 0 and foot.square > 0.0:
        return (q - foot.point) / math.sqrt(foot.square)
    if height < 0.0:
        return -triangle.normal
    return triangle.normal


@kernel
def is_covered_by_any(ball: MeshFinger, count: int, triangle: Triangle, radius: float, slack: float) -> bool:
    """Return whether one of the `count` active planes covers a triangle (see `is_covered`)."""
    covered = False
    for j in range(count):
        covered = covered or is_covered(triangle, ball.planes[j], radius, slack)
    return covered


@kernel
def is_covered(triangle: Triangle, plane: Plane, radius: float, slack: float) -> bool:
    """Return whether all points in front of a plane have at least the distance `radius` from a triangle.

    For example, the plane of a triangle covers the neighbour across a flat or convex edge. The neighbour's own plane
    would prevent the proxy from crossing the edge.
    """
    behind = plane.distance - radius + slack
    n = plane.normal
    return not (dot(n, triangle.a) > behind or dot(n, triangle.b) > behind or dot(n, triangle.c) > behind)


@kernel
def drop_covered(mesh: MeshTree, planes: Many[Plane], count: int, radius: float, slack: float) -> int:
    """Remove the active planes whose triangles the new plane, at index `count`, covers; return the number that remain.

    The new plane moves to the index after the remaining active planes.
    """
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
    """Find the point nearest to g in front of the first `count` + 1 planes, with the last of these planes active.

    The function tries the last plane alone, then with one other plane, then with two other planes, until the projection
    of g is in front of all planes. The active planes are moved to the front.

    Returns:
        Number of active planes, or -1 if no projection is in front of all planes; and the point.
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
    """Project g onto the intersection of up to three planes.

    Args:
        last, a, b: Indices of the planes; -1 for no plane.

    Returns:
        Whether all coefficients l_j of the projection g + sum l_j n_j are non-negative, where n_j is the normal of
        plane j; and the projection.
    """
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
    """Project g onto the intersection of two planes with unit normals n and a at signed distances u and v from g.

    Returns:
        Whether both coefficients of the projection g + s n + t a are non-negative, and the projection.
    """
    na = dot(n, a)
    det = 1.0 - na * na
    if det <= PARALLEL:
        return False, g
    s, t = (u - na * v) / det, (v - na * u) / det
    return s >= 0.0 and t >= 0.0, g + s * n + t * a


@kernel
def swap(planes: Many[Plane], i: int, j: int) -> None:
    """Exchange planes i and j."""
    p, q = planes[i], planes[j]
    p.normal, q.normal = q.normal, p.normal
    p.distance, q.distance = q.distance, p.distance
    p.triangle, q.triangle = q.triangle, p.triangle
    p.feature, q.feature = q.feature, p.feature
