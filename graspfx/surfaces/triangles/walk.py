"""Where a finger touches a triangle mesh: a contact point that walks over the surface and never goes through it.

A finger is free or in contact, and stays what it is until the surface says otherwise:

- free: while it moves by less than its distance from the surface it cannot touch; else the segment from where it was
  to where it is is cast against the triangles that face it. Within REACH its nearest point is found every sample.
- in contact: the contact point descends over edges and corners to the nearest point in its surroundings (Zilles and
  Salisbury, 1995; Ho, Basdogan and Srinivasan, 1999), so that a finger deep in a thin plate is held by the side that
  it came from. Once the finger is outside as seen from there, by the pseudonormal (Baerentzen and Aanaes, 2005), it is
  released; the way from the contact point to the finger is then cast in the same sample.

M holds the mesh (`tree.flatten`) from m on, S the finger from o on.
"""

from __future__ import annotations

import math
from typing import Any

from graspfx.surfaces.triangles import tree

# A finger on a mesh, offsets from o. Zeros, but for REACH, are a finger that has not been there yet.
MODE = 0  # NEW, FREE or HELD
FACE = 1  # of the contact point
FEATURE = 2  # of the face: 0 inside, 1 2 3 on ab bc ca, 4 5 6 at a b c
POINT = 3  # contact point, object's frame [m]
INWARD = 6  # unit normal into the object
LAST = 9  # where the finger was [m]
SAFE = 12  # it is free up to here from there, at least [m]
REACH = 13  # up to this gap the contact point is the nearest one; infinite: always [m]
STATE = 14  # entries

NEW, FREE, HELD = 0.0, 1.0, 2.0

ROUNDING = 2e-15  # of a point, relative to tree.EXTENT and its distance from the origin
SAME_POINT = 1e-16  # relative distance below which two nearest points are one
NOTHING = 1e-13  # relative depth that is not inside yet
SLACK = 3e-13  # relative depth from which a segment still enters
REPEATS = 4  # steps of a walk that are no descent that a float can show


def mesh_contact(
    M: Any, m: int, S: Any, o: int, gx: float, gy: float, gz: float
) -> tuple[float, float, float, float, float, float, float]:
    """Contact of a finger that has moved to g, in the object's frame: (cx, cy, cz, nx, ny, nz, gap).

    c is on the surface, n the unit normal into the object, gap > 0 outside, < 0 inside along n: g - c = -gap n. While
    the gap is beyond REACH, c and n may be those of an earlier sample, and the gap is one that it exceeds.
    """
    scale = M[m + tree.EXTENT] + abs(gx) + abs(gy) + abs(gz)
    lx, ly, lz = S[o + LAST], S[o + LAST + 1], S[o + LAST + 2]
    S[o + LAST], S[o + LAST + 1], S[o + LAST + 2] = gx, gy, gz
    face = int(S[o + FACE])
    held = S[o + MODE] == HELD
    if S[o + MODE] == NEW:
        face = leaf_near(M, m, gx, gy, gz)
    elif not held:
        moved = math.sqrt((gx - lx) * (gx - lx) + (gy - ly) * (gy - ly) + (gz - lz) * (gz - lz))
        safe = S[o + SAFE] - moved - ROUNDING * scale
        if safe > S[o + REACH]:
            S[o + SAFE] = safe
            p, q = o + POINT, o + INWARD
            return S[p], S[p + 1], S[p + 2], S[q], S[q + 1], S[q + 2], safe
        if safe <= 0.0:
            hit = cast(M, m, lx, ly, lz, gx, gy, gz, -1, 0)
            if hit >= 0:
                face = hit
                held = True

    face, feature, square, cx, cy, cz = walk(M, m, face, gx, gy, gz)
    released = math.inf
    while held and outside(M, m, face, feature, gx - cx, gy - cy, gz - cz):
        held = False
        if square < released:  # else it has been released here before
            released = square
            hit = cast(M, m, cx, cy, cz, gx, gy, gz, face, feature)
            if hit >= 0:
                face, feature, square, cx, cy, cz = walk(M, m, hit, gx, gy, gz)
                held = True

    beyond = False
    limit = math.inf  # a new finger has to know its side
    if S[o + MODE] != NEW:
        limit = 2.0 * S[o + REACH] + 0.1 * M[m + tree.SIZE]
    S[o + SAFE] = 0.0
    if not held:
        bound = min(square, limit * limit)
        nearer = nearest(M, m, gx, gy, gz, bound)
        if nearer >= 0:
            face, feature, square, cx, cy, cz = walk(M, m, nearer, gx, gy, gz)
        beyond = square > limit * limit
        S[o + SAFE] = limit if beyond else math.sqrt(square)
        if M[m + tree.CLOSED] != 0.0 and not beyond:
            inside = not outside(M, m, face, feature, gx - cx, gy - cy, gz - cz)
            held = inside and (S[o + MODE] == NEW or square > NOTHING * scale * NOTHING * scale)
    S[o + MODE] = HELD if held else FREE
    S[o + FACE] = face
    S[o + FEATURE] = feature
    nx, ny, nz, gap = across(M, m, face, feature, held, scale, gx, gy, gz, cx, cy, cz)
    if beyond:
        gap = limit
    S[o + POINT], S[o + POINT + 1], S[o + POINT + 2] = cx, cy, cz
    S[o + INWARD], S[o + INWARD + 1], S[o + INWARD + 2] = nx, ny, nz
    return cx, cy, cz, nx, ny, nz, gap


def across(
    M: Any, m: int, face: int, feature: int, held: bool, scale: float,
    gx: float, gy: float, gz: float, cx: float, cy: float, cz: float,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Unit normal into the object and gap of a finger at g whose contact point c is on a feature of a face."""
    f = row(M, m, face)
    vx, vy, vz = gx - cx, gy - cy, gz - cz
    if feature == 0:
        nx, ny, nz = -M[f + tree.NORMAL], -M[f + tree.NORMAL + 1], -M[f + tree.NORMAL + 2]
        gap = (M[f] - gx) * nx + (M[f + 1] - gy) * ny + (M[f + 2] - gz) * nz
        if held:
            return nx, ny, nz, min(gap, 0.0)
        if M[m + tree.CLOSED] != 0.0 or gap >= 0.0:
            return nx, ny, nz, max(gap, 0.0)
        return -nx, -ny, -nz, -gap  # behind a shell
    gap = math.sqrt(vx * vx + vy * vy + vz * vz)
    sign = 1.0 if held else -1.0
    if gap > ROUNDING * scale:
        return sign * vx / gap, sign * vy / gap, sign * vz / gap, -sign * gap
    nx, ny, nz = pseudonormal(M, m, face, feature)  # at this distance rounding is all that the direction would be
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if length < 1e-9:  # a fold without thickness
        nx, ny, nz = M[f + tree.NORMAL], M[f + tree.NORMAL + 1], M[f + tree.NORMAL + 2]
        length = 1.0
    return -nx / length, -ny / length, -nz / length, -sign * gap


def row(M: Any, m: int, face: int) -> int:
    """Offset of a face."""
    return m + int(M[m + tree.FACES]) + tree.FACE_STRIDE * face


def corner(M: Any, m: int, f: int, feature: int) -> int:
    """Offset of the vertex that the face at f has as feature 4, 5 or 6."""
    return m + int(M[m + tree.VERTICES]) + tree.VERTEX_STRIDE * int(M[f + tree.CORNER_NUMBERS + feature - 4])


def nearest_on_face(M: Any, f: int, gx: float, gy: float, gz: float) -> tuple[int, float, float, float, float]:
    """Nearest point on the face at f: (feature, squared distance, x, y, z), by regions (Ericson, 2005)."""
    ax, ay, az = M[f], M[f + 1], M[f + 2]
    bx, by, bz = M[f + 3] - ax, M[f + 4] - ay, M[f + 5] - az
    cx, cy, cz = M[f + 6] - ax, M[f + 7] - ay, M[f + 8] - az
    px, py, pz = gx - ax, gy - ay, gz - az
    d1 = bx * px + by * py + bz * pz
    d2 = cx * px + cy * py + cz * pz
    if d1 <= 0.0 and d2 <= 0.0:
        return 4, px * px + py * py + pz * pz, ax, ay, az
    qx, qy, qz = gx - M[f + 3], gy - M[f + 4], gz - M[f + 5]
    d3 = bx * qx + by * qy + bz * qz
    d4 = cx * qx + cy * qy + cz * qz
    if d3 >= 0.0 and d4 <= d3:
        return 5, qx * qx + qy * qy + qz * qz, M[f + 3], M[f + 4], M[f + 5]
    rx, ry, rz = gx - M[f + 6], gy - M[f + 7], gz - M[f + 8]
    d5 = bx * rx + by * ry + bz * rz
    d6 = cx * rx + cy * ry + cz * rz
    if d6 >= 0.0 and d5 <= d6:
        return 6, rx * rx + ry * ry + rz * rz, M[f + 6], M[f + 7], M[f + 8]
    if d1 * d4 - d3 * d2 <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        t = d1 / (d1 - d3)
        return on_edge(1, t, ax, ay, az, bx, by, bz, px, py, pz)
    if d5 * d2 - d1 * d6 <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        t = d6 / (d6 - d2)
        return on_edge(3, t, M[f + 6], M[f + 7], M[f + 8], -cx, -cy, -cz, rx, ry, rz)
    u, v = d4 - d3, d5 - d6
    if d3 * d6 - d5 * d4 <= 0.0 and u >= 0.0 and v >= 0.0:
        t = u / (u + v)
        return on_edge(2, t, M[f + 3], M[f + 4], M[f + 5], cx - bx, cy - by, cz - bz, qx, qy, qz)
    nx, ny, nz = M[f + tree.NORMAL], M[f + tree.NORMAL + 1], M[f + tree.NORMAL + 2]
    h = px * nx + py * ny + pz * nz
    return 0, h * h, gx - h * nx, gy - h * ny, gz - h * nz


def on_edge(
    feature: int, t: float, ax: float, ay: float, az: float, ux: float, uy: float, uz: float,
    px: float, py: float, pz: float,
) -> tuple[int, float, float, float, float]:  # fmt: skip
    """The point a + t u of an edge as `nearest_on_face` returns it, for a finger at a + p."""
    x, y, z = t * ux, t * uy, t * uz
    square = (px - x) * (px - x) + (py - y) * (py - y) + (pz - z) * (pz - z)
    return feature, square, ax + x, ay + y, az + z


def walk(M: Any, m: int, face: int, gx: float, gy: float, gz: float) -> tuple[int, int, float, float, float, float]:
    """Descends from a face to the nearest point in its surroundings: (face, feature, squared distance, x, y, z).

    Every step is to a strictly nearer point, so that it ends; but two sides of a flat edge are equally far in floats
    while their nearest points are 1e-8 of the distance apart, so a few steps that are equal to rounding are allowed.
    """
    feature, square, x, y, z = nearest_on_face(M, row(M, m, face), gx, gy, gz)
    step = SAME_POINT * (M[m + tree.EXTENT] + abs(gx) + abs(gy) + abs(gz))
    repeats = REPEATS
    while feature != 0:
        f = row(M, m, face)
        first, count = f + tree.ACROSS + feature - 1, 1
        if feature > 3:
            v = corner(M, m, f, feature)
            first, count = m + int(M[m + tree.RINGS]) + int(M[v + tree.RING]), int(M[v + tree.RING_COUNT])
        to, best = -1, square
        to_feature, tx, ty, tz = 0, x, y, z
        equal = False
        for k in range(first, first + count):
            other = int(M[k])
            if other >= 0 and other != face:
                kind, d, px, py, pz = nearest_on_face(M, row(M, m, other), gx, gy, gz)
                if d < best:
                    to, best, to_feature, tx, ty, tz = other, d, kind, px, py, pz
                    equal = False
                elif (
                    to < 0
                    and repeats > 0
                    and d <= square * (1.0 + 1e-15)
                    and abs(px - x) + abs(py - y) + abs(pz - z) > step
                ):
                    to, to_feature, tx, ty, tz = other, kind, px, py, pz
                    equal = True
        if to < 0:
            break
        if equal:
            repeats -= 1
        face, feature, square, x, y, z = to, to_feature, best, tx, ty, tz
    return face, feature, square, x, y, z


def pseudonormal(M: Any, m: int, face: int, feature: int) -> tuple[float, float, float]:
    """Outward normal of a feature, of any length: of the face, the sum of two, or the corner's, weighted by angles."""
    f = row(M, m, face)
    k = f + tree.NORMAL
    if feature > 3:
        k = corner(M, m, f, feature)
    elif feature > 0:
        other = int(M[f + tree.ACROSS + feature - 1])
        if other >= 0:
            j = row(M, m, other) + tree.NORMAL
            return M[k] + M[j], M[k + 1] + M[j + 1], M[k + 2] + M[j + 2]
    return M[k], M[k + 1], M[k + 2]


def outside(M: Any, m: int, face: int, feature: int, vx: float, vy: float, vz: float) -> bool:
    """Whether a finger at v from its contact point is in front of the surface, or past where the surface ends."""
    f = row(M, m, face)
    if feature > 3:
        if M[corner(M, m, f, feature) + tree.BORDER] != 0.0:
            return True
    elif feature > 0 and M[f + tree.ACROSS + feature - 1] < 0.0:
        return True
    nx, ny, nz = pseudonormal(M, m, face, feature)
    return bool(vx * nx + vy * ny + vz * nz > 0.0)


def leaf_near(M: Any, m: int, gx: float, gy: float, gz: float) -> int:
    """A face to begin with: down the tree by the nearer box."""
    nodes = m + int(M[m + tree.NODES])
    i = 0
    while int(M[nodes + tree.NODE_STRIDE * i + tree.SKIP]) > i + 1:
        other = int(M[nodes + tree.NODE_STRIDE * (i + 1) + tree.SKIP])
        here = box_distance(M, nodes + tree.NODE_STRIDE * (i + 1), gx, gy, gz)
        there = box_distance(M, nodes + tree.NODE_STRIDE * other, gx, gy, gz)
        i = i + 1 if here <= there else other
    return int(M[nodes + tree.NODE_STRIDE * i + tree.FIRST])


def box_distance(M: Any, k: int, gx: float, gy: float, gz: float) -> float:
    """Squared distance from g to the box of the node at k."""
    x, y, z = 0.0, 0.0, 0.0
    if gx < M[k]:
        x = M[k] - gx
    elif gx > M[k + 3]:
        x = gx - M[k + 3]
    if gy < M[k + 1]:
        y = M[k + 1] - gy
    elif gy > M[k + 4]:
        y = gy - M[k + 4]
    if gz < M[k + 2]:
        z = M[k + 2] - gz
    elif gz > M[k + 5]:
        z = gz - M[k + 5]
    return x * x + y * y + z * z


def nearest(M: Any, m: int, gx: float, gy: float, gz: float, bound: float) -> int:
    """The face nearest to g if that is strictly nearer than the square root of `bound`, else -1."""
    nodes = m + int(M[m + tree.NODES])
    count = int(M[m + tree.NODE_COUNT])
    found = -1
    i = 0
    while i < count:
        k = nodes + tree.NODE_STRIDE * i
        skip = int(M[k + tree.SKIP])
        if not box_distance(M, k, gx, gy, gz) < bound:
            i = skip
            continue
        if skip == i + 1:
            for face in range(int(M[k + tree.FIRST]), int(M[k + tree.NODE_STRIDE + tree.FIRST])):
                f = row(M, m, face)
                n = f + tree.NORMAL
                h = (gx - M[f]) * M[n] + (gy - M[f + 1]) * M[n + 1] + (gz - M[f + 2]) * M[n + 2]
                if h * h < bound:
                    square = nearest_on_face(M, f, gx, gy, gz)[1]
                    if square < bound:
                        bound = square
                        found = face
        i += 1
    return found


def cast(
    M: Any, m: int, lx: float, ly: float, lz: float, gx: float, gy: float, gz: float, face: int, feature: int
) -> int:
    """The first face that the segment from l to g enters from its front, or -1.

    A segment that starts on a feature of a face (`face` -1: it does not) does not enter the triangles around that
    feature. Edges are a little wider than they are, so that nothing passes between two triangles; who is stopped
    there by mistake is released by the walk.
    """
    nodes = m + int(M[m + tree.NODES])
    count = int(M[m + tree.NODE_COUNT])
    ux, uy, uz = gx - lx, gy - ly, gz - lz
    length = math.sqrt(ux * ux + uy * uy + uz * uz)
    scale = M[m + tree.EXTENT] + max(abs(lx) + abs(ly) + abs(lz), abs(gx) + abs(gy) + abs(gz))
    slack = SLACK * scale
    x0, x1 = min(lx, gx) - slack, max(lx, gx) + slack
    y0, y1 = min(ly, gy) - slack, max(ly, gy) + slack
    z0, z1 = min(lz, gz) - slack, max(lz, gz) + slack
    hit = -1
    first = 2.0
    i = 0
    while i < count:
        k = nodes + tree.NODE_STRIDE * i
        skip = int(M[k + tree.SKIP])
        if M[k] > x1 or M[k + 3] < x0 or M[k + 1] > y1 or M[k + 4] < y0 or M[k + 2] > z1 or M[k + 5] < z0:
            i = skip
            continue
        if skip == i + 1:
            for other in range(int(M[k + tree.FIRST]), int(M[k + tree.NODE_STRIDE + tree.FIRST])):
                f = row(M, m, other)
                nx, ny, nz = M[f + tree.NORMAL], M[f + tree.NORMAL + 1], M[f + tree.NORMAL + 2]
                after = (gx - M[f]) * nx + (gy - M[f + 1]) * ny + (gz - M[f + 2]) * nz
                before = (lx - M[f]) * nx + (ly - M[f + 1]) * ny + (lz - M[f + 2]) * nz
                if after < 0.0 and before >= -slack and before > after:
                    t = max(before, 0.0) / (before - after)
                    if t < first:
                        wide = slack + ROUNDING * scale * length / (before - after)  # a grazing segment is not sharp
                        square = nearest_on_face(M, f, lx + t * ux, ly + t * uy, lz + t * uz)[1]
                        if square <= wide * wide and not around(M, m, other, face, feature):
                            first = t
                            hit = other
        i += 1
    return hit


def around(M: Any, m: int, other: int, face: int, feature: int) -> bool:
    """Whether a triangle has that feature of that face."""
    if face < 0:
        return False
    f = row(M, m, face)
    if feature == 0:
        return other == face
    if feature <= 3:
        return other == face or other == int(M[f + tree.ACROSS + feature - 1])
    v = M[f + tree.CORNER_NUMBERS + feature - 4]
    k = row(M, m, other) + tree.CORNER_NUMBERS
    return bool(M[k] == v or M[k + 1] == v or M[k + 2] == v)
