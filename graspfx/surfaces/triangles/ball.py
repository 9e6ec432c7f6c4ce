"""Contact of a ball with a triangle mesh: the proxy of its centre stays a radius away from every nearby triangle.

The proxy q is the position that the centre would have if the ball could not penetrate: the point nearest to the centre
g that q reaches without crossing the surface (a god-object, Zilles and Salisbury, 1995, with a size: Ruspini, Kolarov
and Khatib, 1997). Every step is a convex problem (`constraints`). Its planes keep the whole segment of the step off all
triangles, so that the ball does not pass through even a thin wall. At most three constraints hold the proxy where walls
meet, and g - q is continuous, unlike the vector to the nearest wall.

A ball's state is that of a finger in `walk`; its `last` is the proxy.
"""

from __future__ import annotations

import math

from graspfx import elementary
from graspfx.compile.kernel import kernel
from graspfx.spatial import ZERO, Vector, dot, length
from graspfx.surfaces.nearest import Nearest
from graspfx.surfaces.triangles.boxes import nearest
from graspfx.surfaces.triangles.constraints import project
from graspfx.surfaces.triangles.mesh_finger import FREE, NEW, TOUCHING, MeshFinger
from graspfx.surfaces.triangles.mesh_tree import MeshTree
from graspfx.surfaces.triangles.triangle import ROUNDING, scale_at
from graspfx.surfaces.triangles.walk import mesh_contact, walk

STEP = 0.25  # largest proxy step, relative to the radius; a step of 2 could pass over something
STEPS = 32  # largest number of steps in one sample


@kernel
def ball_contact(mesh: MeshTree, ball: MeshFinger, radius: float, g: Vector) -> Nearest:
    """Find the contact of a ball whose centre has moved to g in the object's frame, and update its state.

    n is the unit normal into the object, c - radius n the proxy, and gap the distance from g to the proxy, > 0 outside
    and < 0 inside along n. If the gap exceeds the ball's reach, c and n may be those of an earlier sample, and the gap
    is a lower bound.
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
