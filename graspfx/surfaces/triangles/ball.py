"""Contact of a ball with a triangle mesh: the proxy of its centre stays a radius away from every nearby triangle.

The proxy q is the position that the centre would have if the ball could not penetrate: the point nearest to the centre
g that q reaches without crossing the surface (a god-object, Zilles and Salisbury, 1995, with a size: Ruspini, Kolarov
and Khatib, 1997). Every step is a convex problem (`project`). Its planes keep the whole segment of the step off all
triangles, so that the ball does not pass through even a thin wall. At most three constraints hold the proxy where walls
meet, and g - q is continuous, unlike the vector to the nearest wall.

A ball's state is a `MeshFinger`, like that of a point finger in `walk`, but with the proxy as `last`.
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
    """Find the contact of a ball whose centre has moved to g in the object's frame, and update its state.

    n is the unit normal into the object, c - radius n the proxy, and gap the distance from g to the proxy, > 0 outside
    and < 0 inside along n. If g is farther from the surface than the ball's `reach`, c and n may be those of an earlier
    sample, and the gap is a lower bound.
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
    """Find the contact of a new ball, which is held on the side of the surface nearest to its centre."""
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
    """Find the surface point nearest to a ball that does not touch the surface."""
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
    """Move the proxy as close to g as the surface allows, and return the resulting contact."""
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
    """Roll a proxy around the one edge or vertex that holds it, towards g, by at most STEP [rad], if nothing is hit.

    Tangent planes alone converge too, but more slowly the deeper g is. Both ends of this short path are a radius away
    from every triangle, so that nothing lies between them.
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
    """Find the point of an edge that is nearest to g, or return a vertex."""
    c = corner(mesh, face, (feature - 1) % 3)
    if feature > 3:
        return c
    u = corner(mesh, face, feature % 3) - c
    along = dot(g - c, u) / dot(u, u)
    along = min(max(along, 0.0), 1.0)
    return c + along * u


@kernel
def corner(mesh: MeshTree, face: int, k: int) -> Vector:
    """Return vertex k of a triangle."""
    triangle = mesh.triangles[face]
    if k == 0:
        return triangle.a
    return triangle.b if k == 1 else triangle.c


# Projection onto the region in front of planes, by a dual active-set method -------------------------------------------


@kernel
def project(
    mesh: MeshTree, ball: MeshFinger, radius: float, reach: float, scale: float, g: Vector
) -> tuple[int, Vector]:
    """Return the number of active planes, stored first, and the point nearest to g in front of all planes in reach.

    Let c_j be the point of triangle j nearest to the proxy q, and n_j the direction from c_j to q. The triangle lies
    behind c_j, so that

        min |x - g|   where   n_j . (x - c_j) >= radius   for all triangles within reach

    keeps x, and the segment from q to x, off all of them.

    The most violated plane is added to the active set. Of these planes (at most four), only those that hold the point
    remain active. The distance from g grows with every change, so that the method terminates. The number is -1 if no
    point is in front of all planes, or `CHANGES` changes do not suffice.
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
    """True if one of the `count` active planes covers a triangle (see `is_covered`)."""
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
    """Drop active planes whose triangle the new plane, at index `count`, covers; return the number of others."""
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
