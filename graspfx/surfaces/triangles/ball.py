"""Where a ball touches a triangle mesh: its centre's proxy stays a radius away from every triangle near it.

The proxy q is where the centre would be if the ball could not sink in: the point nearest to the centre g that q can
move to while it keeps off the surface (a god-object, Zilles and Salisbury, 1995, with a size: Ruspini, Kolarov and
Khatib, 1997). Every step is a convex problem. c_j being the point of triangle j nearest to q, and n_j the direction
from there to q, the triangle lies behind c_j, so that

    min |x - g|   where   n_j . (x - c_j) >= radius   for all triangles within reach

keeps x off all of them, and the segment from q to x as well: nothing is passed through, however thin it is. Where two
walls meet at most three constraints hold the proxy, and g - q is continuous, unlike the way to the nearest wall.

M holds the mesh (`tree.flatten`) from m on, S the finger from o on: as in `walk`, where LAST is the proxy.
"""

from __future__ import annotations

import math
from typing import Any

from graspfx.surfaces.triangles import tree, walk
from graspfx.surfaces.triangles.walk import (
    FREE,
    HELD,
    NEW,
    ROUNDING,
    box_distance,
    mesh_contact,
    nearest,
    nearest_on_face,
    row,
)
from graspfx.surfaces.triangles.walk import walk as descend

PLANES = walk.STATE  # up to four of what holds the proxy
PLANE = 6  # n_j, n_j . c_j + radius, and the triangle and feature that it comes from
STATE = PLANES + 4 * PLANE  # entries of a ball

STEP = 0.25  # of the radius, that the proxy moves at a time: below 2, or it could step over something
STEPS = 32  # in one sample
CHANGES = 24  # of the set of constraints that hold
PARALLEL = 1e-18  # squared volume of the normals below which they are not three, or two


def ball_contact(
    M: Any, m: int, S: Any, o: int, radius: float, gx: float, gy: float, gz: float
) -> tuple[float, float, float, float, float, float, float]:
    """Contact of a ball whose centre has moved to g, in the object's frame: (cx, cy, cz, nx, ny, nz, gap).

    n is the unit normal into the object, c - radius n the proxy, and gap > 0 outside, < 0 inside along n, the distance
    from g to the proxy. While the gap is beyond REACH, c and n may be those of an earlier sample, and the gap is one
    that it exceeds.
    """
    if S[o + walk.MODE] == NEW:
        return begin(M, m, S, o, radius, gx, gy, gz)
    q = o + walk.LAST
    scale = M[m + tree.EXTENT] + abs(gx) + abs(gy) + abs(gz)
    clear = S[o + walk.SAFE] - radius
    moved = length(gx - S[q], gy - S[q + 1], gz - S[q + 2])
    if S[o + walk.MODE] == FREE and moved + ROUNDING * scale < clear:
        S[q], S[q + 1], S[q + 2] = gx, gy, gz
        S[o + walk.SAFE] -= moved + ROUNDING * scale
        if S[o + walk.SAFE] > S[o + walk.REACH]:
            c, n = o + walk.POINT, o + walk.INWARD
            return S[c], S[c + 1], S[c + 2], S[n], S[n + 1], S[n + 2], S[o + walk.SAFE] - radius
        return free_contact(M, m, S, o, radius, gx, gy, gz)
    return settle(M, m, S, o, radius, max(clear, STEP * radius), scale, gx, gy, gz)


def begin(
    M: Any, m: int, S: Any, o: int, radius: float, gx: float, gy: float, gz: float
) -> tuple[float, float, float, float, float, float, float]:
    """A ball that has not been there before: held by the side that its centre is nearest to."""
    cx, cy, cz, nx, ny, nz, gap = mesh_contact(M, m, S, o, gx, gy, gz)
    q = o + walk.LAST
    if gap >= radius:
        S[q], S[q + 1], S[q + 2] = gx, gy, gz
        S[o + walk.SAFE] = gap
        S[o + walk.MODE] = FREE
        return cx, cy, cz, nx, ny, nz, gap - radius
    S[q], S[q + 1], S[q + 2] = cx - radius * nx, cy - radius * ny, cz - radius * nz
    scale = M[m + tree.EXTENT] + abs(gx) + abs(gy) + abs(gz)
    return settle(M, m, S, o, radius, STEP * radius, scale, gx, gy, gz)


def free_contact(
    M: Any, m: int, S: Any, o: int, radius: float, gx: float, gy: float, gz: float
) -> tuple[float, float, float, float, float, float, float]:
    """The nearest point of a ball that is off the surface."""
    face, _, square, cx, cy, cz = descend(M, m, int(S[o + walk.FACE]), gx, gy, gz)
    nearer = nearest(M, m, gx, gy, gz, square)
    if nearer >= 0:
        face, _, square, cx, cy, cz = descend(M, m, nearer, gx, gy, gz)
    away = max(math.sqrt(square), 1e-300)
    nx, ny, nz = (cx - gx) / away, (cy - gy) / away, (cz - gz) / away
    p, n = o + walk.POINT, o + walk.INWARD
    S[p], S[p + 1], S[p + 2] = cx, cy, cz
    S[n], S[n + 1], S[n + 2] = nx, ny, nz
    S[o + walk.FACE] = face
    S[o + walk.SAFE] = away
    S[o + walk.MODE] = FREE
    if away < radius:  # by rounding, or half through a shell from behind: no displacement either
        cx, cy, cz = gx + radius * nx, gy + radius * ny, gz + radius * nz
    return cx, cy, cz, nx, ny, nz, max(away - radius, 0.0)


def settle(
    M: Any, m: int, S: Any, o: int, radius: float, step: float, scale: float, gx: float, gy: float, gz: float
) -> tuple[float, float, float, float, float, float, float]:
    """Moves the proxy as near to g as the surface lets it, and tells the contact that results."""
    q = o + walk.LAST
    held = 0
    for _ in range(STEPS):
        far = length(gx - S[q], gy - S[q + 1], gz - S[q + 2])
        held, x, y, z = project(M, m, S, o, radius, radius + min(far, step), scale, gx, gy, gz)
        if held < 0:  # no way out of where it began, or none found: it stays where it is clear
            break
        ux, uy, uz = x - S[q], y - S[q + 1], z - S[q + 2]
        moved = length(ux, uy, uz)
        share = 1.0
        if moved > step:
            share = step / moved
        S[q], S[q + 1], S[q + 2] = S[q] + share * ux, S[q + 1] + share * uy, S[q + 2] + share * uz
        if share == 1.0:
            S[q], S[q + 1], S[q + 2] = x, y, z
            if moved <= ROUNDING * scale:
                break
            if held == 1:
                roll(M, m, S, o, radius, scale, gx, gy, gz)
        step = STEP * radius
    if held == 0 and S[q] == gx and S[q + 1] == gy and S[q + 2] == gz:
        return free_contact(M, m, S, o, radius, gx, gy, gz)
    S[o + walk.MODE] = HELD
    S[o + walk.SAFE] = radius
    n = o + walk.INWARD
    if held > 0:
        S[o + walk.FACE] = S[o + PLANES + 4]
    ux, uy, uz = gx - S[q], gy - S[q + 1], gz - S[q + 2]
    size = length(ux, uy, uz)
    if held > 1 and size > ROUNDING * scale:
        S[n], S[n + 1], S[n + 2] = ux / size, uy / size, uz / size
    elif held > 0:
        k = o + PLANES
        S[n], S[n + 1], S[n + 2] = -S[k], -S[k + 1], -S[k + 2]
    nx, ny, nz = S[n], S[n + 1], S[n + 2]
    if held == 0:  # nothing is in its way, which is longer than one sample: it goes on with the next, without force
        return gx + radius * nx, gy + radius * ny, gz + radius * nz, nx, ny, nz, 0.0
    gap = min(nx * (S[q] - gx) + ny * (S[q + 1] - gy) + nz * (S[q + 2] - gz), 0.0)
    cx, cy, cz = S[q] + radius * nx, S[q + 1] + radius * ny, S[q + 2] + radius * nz
    return cx, cy, cz, nx, ny, nz, gap


def project(
    M: Any, m: int, S: Any, o: int, radius: float, reach: float, scale: float, gx: float, gy: float, gz: float
) -> tuple[int, float, float, float]:
    """The point nearest to g in front of all planes within reach: how many hold it, first in PLANES, and where it is.

    A dual active set: the plane that is violated most joins those that hold, and of these four the ones that hold the
    point stay. The distance from g grows with every change, so that it ends. -1 if nothing is in front of them all.
    """
    x, y, z = gx, gy, gz
    held = 0
    for _ in range(CHANGES):
        slack = ROUNDING * scale
        amount = most_violated(M, m, S, o, radius, reach, held, slack, x, y, z)
        if amount <= slack:
            return held, x, y, z
        held = drop_covered(M, m, S, o + PLANES, held, radius, slack)
        held, x, y, z = hold(S, o + PLANES, held, gx, gy, gz, slack)
        if held < 0:
            break
    return -1, gx, gy, gz


def most_violated(
    M: Any, m: int, S: Any, o: int, radius: float, reach: float, held: int, slack: float, x: float, y: float, z: float
) -> float:
    """Writes the plane that (x, y, z) is furthest behind after those that hold; returns by how much, or zero."""
    k = o + PLANES + PLANE * held
    q = o + walk.LAST
    qx, qy, qz = S[q], S[q + 1], S[q + 2]
    closed = M[m + tree.CLOSED] != 0.0
    nodes = m + int(M[m + tree.NODES])
    count = int(M[m + tree.NODE_COUNT])
    bound = reach * reach
    worst = 0.0
    i = 0
    while i < count:
        node = nodes + tree.NODE_STRIDE * i
        skip = int(M[node + tree.SKIP])
        if not box_distance(M, node, qx, qy, qz) <= bound:
            i = skip
            continue
        if skip == i + 1:
            for face in range(int(M[node + tree.FIRST]), int(M[node + tree.NODE_STRIDE + tree.FIRST])):
                f = row(M, m, face)
                n = f + tree.NORMAL
                h = (qx - M[f]) * M[n] + (qy - M[f + 1]) * M[n + 1] + (qz - M[f + 2]) * M[n + 2]
                if h * h > bound or (h <= 0.0 and not closed):
                    continue
                feature, square, cx, cy, cz = nearest_on_face(M, f, qx, qy, qz)
                # a shell is passed from behind: it holds a ball again once that is off it
                if square > bound or (not closed and square < radius * radius * (1.0 - 1e-9)):
                    continue
                nx, ny, nz = M[n], M[n + 1], M[n + 2]
                if h < 0.0:
                    nx, ny, nz = -nx, -ny, -nz
                if feature != 0 and square > 0.0:
                    away = math.sqrt(square)
                    nx, ny, nz = (qx - cx) / away, (qy - cy) / away, (qz - cz) / away
                behind = radius - (nx * (x - cx) + ny * (y - cy) + nz * (z - cz))
                if behind > worst:
                    covered = False
                    for j in range(held):
                        covered = covered or is_covered(M, f, S, o + PLANES + PLANE * j, radius, slack)
                    if covered:
                        continue
                    worst = behind
                    S[k], S[k + 1], S[k + 2] = nx, ny, nz
                    S[k + 3] = radius + nx * cx + ny * cy + nz * cz
                    S[k + 4], S[k + 5] = face, feature
        i += 1
    return worst


def is_covered(M: Any, f: int, S: Any, p: int, radius: float, slack: float) -> bool:
    """Whether what is in front of the plane at p is a radius away from the whole triangle at f, for its sake alone.

    So it is beyond a flat or convex edge; the tangent plane there would keep the proxy from crossing the edge.
    """
    behind = S[p + 3] - radius + slack
    for i in range(3):
        a = f + 3 * i
        if S[p] * M[a] + S[p + 1] * M[a + 1] + S[p + 2] * M[a + 2] > behind:
            return False
    return True


def drop_covered(M: Any, m: int, S: Any, k: int, held: int, radius: float, slack: float) -> int:
    """Leaves out of the planes that hold those whose triangle the next one covers; returns how many are left."""
    i = 0
    while i < held:
        if is_covered(M, row(M, m, int(S[k + PLANE * i + 4])), S, k + PLANE * held, radius, slack):
            swap(S, k, i, held - 1)
            swap(S, k, held - 1, held)
            held -= 1
        else:
            i += 1
    return held


def hold(S: Any, k: int, held: int, gx: float, gy: float, gz: float, slack: float) -> tuple[int, float, float, float]:
    """Projects g on what is in front of `held` + 1 planes at k, the last of them holding; those that hold come first.

    Tries the last one alone, with another one, with two others: until a point is in front of all. -1 if none is.
    """
    for size in range(3):
        for i in range(held if size > 0 else 1):
            for j in range(i + 1, held if size > 1 else i + 2):
                a = i if size > 0 else -1
                b = j if size > 1 else -1
                found, x, y, z = onto(S, k, held, a, b, gx, gy, gz)
                for other in range(held):
                    p = k + PLANE * other
                    if other != a and other != b:
                        found = found and S[p] * x + S[p + 1] * y + S[p + 2] * z >= S[p + 3] - slack
                if found:
                    if size > 0:
                        swap(S, k, 0, a)
                    if size > 1:
                        swap(S, k, 1, b)
                    swap(S, k, size, held)
                    return size + 1, x, y, z
    return -1, gx, gy, gz


def onto(
    S: Any, k: int, last: int, a: int, b: int, gx: float, gy: float, gz: float
) -> tuple[bool, float, float, float]:
    """g + sum l_j n_j on the planes `last`, a and b (-1: not that one), and whether it is there with all l_j >= 0."""
    p = k + PLANE * last
    nx, ny, nz = S[p], S[p + 1], S[p + 2]
    u = S[p + 3] - (nx * gx + ny * gy + nz * gz)
    if a < 0:
        return u >= 0.0, gx + u * nx, gy + u * ny, gz + u * nz
    p = k + PLANE * a
    ax, ay, az = S[p], S[p + 1], S[p + 2]
    v = S[p + 3] - (ax * gx + ay * gy + az * gz)
    na = nx * ax + ny * ay + nz * az
    if b < 0:
        det = 1.0 - na * na
        if det <= PARALLEL:
            return False, gx, gy, gz
        s, t = (u - na * v) / det, (v - na * u) / det
        return s >= 0.0 and t >= 0.0, gx + s * nx + t * ax, gy + s * ny + t * ay, gz + s * nz + t * az
    p = k + PLANE * b
    bx, by, bz = S[p], S[p + 1], S[p + 2]
    w = S[p + 3] - (bx * gx + by * gy + bz * gz)
    # the rows of the inverse are the cross products over the volume
    abx, aby, abz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    bnx, bny, bnz = by * nz - bz * ny, bz * nx - bx * nz, bx * ny - by * nx
    nax, nay, naz = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
    volume = nx * abx + ny * aby + nz * abz
    if volume * volume <= PARALLEL:
        return False, gx, gy, gz
    dx = (u * abx + v * bnx + w * nax) / volume
    dy = (u * aby + v * bny + w * nay) / volume
    dz = (u * abz + v * bnz + w * naz) / volume
    inside = (
        (dx * abx + dy * aby + dz * abz) * volume >= 0.0
        and (dx * bnx + dy * bny + dz * bnz) * volume >= 0.0
        and (dx * nax + dy * nay + dz * naz) * volume >= 0.0
    )
    return inside, gx + dx, gy + dy, gz + dz


def swap(S: Any, k: int, i: int, j: int) -> None:
    """Exchanges two planes."""
    p, q = k + PLANE * i, k + PLANE * j
    for a in range(PLANE):
        kept = S[p + a]
        S[p + a] = S[q + a]
        S[q + a] = kept


def roll(M: Any, m: int, S: Any, o: int, radius: float, scale: float, gx: float, gy: float, gz: float) -> None:
    """Takes a proxy that an edge or a corner alone holds around it towards g, to the end or by STEP, if that is free.

    Tangent planes alone get there too, the more slowly the deeper g is. Both ends of so short a way are a radius away
    from every triangle, and so nothing is between them.
    """
    k = o + PLANES
    feature = int(S[k + 5])
    if feature == 0:
        return
    f = row(M, m, int(S[k + 4]))
    first = f + 3 * ((feature - 1) % 3)
    cx, cy, cz = M[first], M[first + 1], M[first + 2]
    if feature <= 3:
        second = f + 3 * (feature % 3)
        ux, uy, uz = M[second] - cx, M[second + 1] - cy, M[second + 2] - cz
        along = ((gx - cx) * ux + (gy - cy) * uy + (gz - cz) * uz) / (ux * ux + uy * uy + uz * uz)
        along = min(max(along, 0.0), 1.0)
        cx, cy, cz = cx + along * ux, cy + along * uy, cz + along * uz
    q = o + walk.LAST
    dx, dy, dz = S[q] - cx, S[q + 1] - cy, S[q + 2] - cz
    away = length(dx, dy, dz)
    if not away > 0.0:
        return
    dx, dy, dz = dx / away, dy / away, dz / away
    wx, wy, wz = gx - cx, gy - cy, gz - cz
    along = wx * dx + wy * dy + wz * dz
    tx, ty, tz = wx - along * dx, wy - along * dy, wz - along * dz
    across = length(tx, ty, tz)
    if not across > 0.0:
        return
    angle = min(math.atan2(across, along), STEP)
    d, t = radius * math.cos(angle), radius * math.sin(angle) / across
    if angle < STEP:
        d = t = radius / length(wx, wy, wz)
        dx, dy, dz, tx, ty, tz = wx, wy, wz, 0.0, 0.0, 0.0
    x, y, z = cx + d * dx + t * tx, cy + d * dy + t * ty, cz + d * dz + t * tz
    bound = radius - ROUNDING * scale
    if (
        length(x - S[q], y - S[q + 1], z - S[q + 2]) <= 2.0 * STEP * radius
        and nearest(M, m, x, y, z, bound * bound) < 0
    ):
        S[q], S[q + 1], S[q + 2] = x, y, z


def length(x: float, y: float, z: float) -> float:
    return math.sqrt(x * x + y * y + z * z)
