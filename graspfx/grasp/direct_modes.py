"""Rigid modes of point contacts on a free object: orthonormal columns of P = U U', computed from the points."""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Table
from graspfx.cones.cone import contact_frame
from graspfx.grasp.direct import couple_points, in_space
from graspfx.grasp.point_grasp import NOISE, PointGrasp, vector_at

HALF = math.sqrt(0.5)


@kernel
def couple_rows(
    grasp: PointGrasp, points: Floats, displacement: Floats, rate: Floats, force: Floats, rows: int
) -> None:  # fmt: skip
    """Compute the forces of many grasps of equal size; `grasp` contains gains, and workspace for one grasp."""
    size = grasp.count * grasp.dimensions
    for row in range(rows):
        at = row * size
        for j in range(size):
            grasp.points[j] = points[at + j]
            grasp.displacement[j] = displacement[at + j]
            grasp.rate[j] = rate[at + j]
        couple_points(grasp)
        for j in range(size):
            force[at + j] = grasp.force[j]


@kernel
def mode_rows(grasp: PointGrasp, points: Floats, modes: Floats, ranks: Floats, rows: int) -> None:
    """Write the modes and ranks of many grasps of equal size, one row per grasp."""
    size = grasp.count * grasp.dimensions
    room = size * (2 * grasp.dimensions if grasp.dimensions > 2 else 2 * grasp.dimensions - 1)
    for row in range(rows):
        for j in range(size):
            grasp.points[j] = points[row * size + j]
            grasp.displacement[j] = 0.0
            grasp.rate[j] = 0.0
        for j in range(room):
            modes[row * room + j] = 0.0
        ranks[row] = point_modes(grasp, Table(modes.buffer, modes.offset + row * room, size))


@kernel
def point_modes(grasp: PointGrasp, modes: Table) -> int:
    """Write the modes of one free grasp into zeroed rows; return their number, the rank of G."""
    n, d = grasp.count, grasp.dimensions
    grasp.rank = d
    share = 1.0 / math.sqrt(n)
    for k in range(d):
        for i in range(n):
            modes[k, i * d + k] = share
    if n > 1 and d > 1:
        if n == 2:
            across_two(grasp, modes)
        elif d == 2:
            turn_in_plane(grasp, modes)
        else:
            in_space(grasp, modes)
    return grasp.rank


@kernel
def across_two(grasp: PointGrasp, modes: Table) -> None:
    """Write the relative motions of two contacts across the line through them."""
    p, d = grasp.points, grasp.dimensions
    square = noise = 0.0
    for i in range(d):
        q = p[d + i] - p[i]
        square += q * q
        noise += abs(p[i])
    noise *= NOISE
    if square <= noise * noise:
        return
    grasp.rank = 2 * d - 1
    size = math.sqrt(square)
    if d == 2:
        x, y = (p[2] - p[0]) / size, (p[3] - p[1]) / size
        modes[2, 0], modes[2, 1], modes[2, 2], modes[2, 3] = HALF * y, -HALF * x, -HALF * y, HALF * x
        return
    frame = contact_frame((vector_at(p, 3) - vector_at(p, 0)) / size, 3)
    one, other = HALF * frame.second, HALF * frame.third
    modes[3, 0], modes[3, 1], modes[3, 2] = -one.x, -one.y, -one.z
    modes[3, 3], modes[3, 4], modes[3, 5] = one.x, one.y, one.z
    modes[4, 0], modes[4, 1], modes[4, 2] = -other.x, -other.y, -other.z
    modes[4, 3], modes[4, 4], modes[4, 5] = other.x, other.y, other.z


@kernel
def turn_in_plane(grasp: PointGrasp, modes: Table) -> None:
    """Write the rotation about the centroid, unless all contacts coincide."""
    p, n = grasp.points, grasp.count
    x0, y0 = p[0], p[1]
    cx = cy = arm = 0.0
    for j in range(0, 2 * n, 2):
        cx += p[j] - x0
        cy += p[j + 1] - y0
    cx, cy = cx / n, cy / n
    for j in range(0, 2 * n, 2):
        x, y = p[j] - x0 - cx, p[j + 1] - y0 - cy
        arm += x * x + y * y
    noise = NOISE * (abs(x0) + abs(y0))
    if arm > n * noise * noise:
        grasp.rank = 3
        size = 1.0 / math.sqrt(arm)
        for j in range(0, 2 * n, 2):
            modes[2, j], modes[2, j + 1] = -size * (p[j + 1] - y0 - cy), size * (p[j] - x0 - cx)
