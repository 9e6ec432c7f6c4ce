"""Eq. (4) for point contacts on a free object, by the best-fitting rigid motion instead of G, G^+ and P.

f = s + P d with s = K_ip e + K_id e', d = (K_ep - K_ip) e + (K_ed - K_id) e' and scalar gains. P d is the rigid motion
that fits the field d best: the mean of d, and a rotation about the centroid. Weights are equal, and all translations
and rotations are free. The rank is determined with a tolerance, without a blend.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Table
from graspfx.grasp.direct_line import Line, couple_about
from graspfx.grasp.point_grasp import NOISE, PointGrasp, vector_at

LEAST = 1e-280  # smallest square of a length, against underflow [m^2]


@kernel
def couple(block: NDArray[np.float64]) -> None:
    """Compute the forces of a block that starts at entry 0 of its array."""
    couple_points(PointGrasp(block, 0))


@kernel
def couple_points(grasp: PointGrasp) -> int:
    """Compute the forces of all contacts from their points, displacements and rates; return 0."""
    n, d = grasp.count, grasp.dimensions
    grasp.rank = d
    if n == 1 or (grasp.stiffness == 0.0 and grasp.damping == 0.0):
        external_alone(grasp)
    elif d == 1:
        shifted(grasp)
    elif n == 2:
        between_two(grasp)
    elif d == 2:
        in_plane(grasp)
    else:
        in_space(grasp, None)
    return 0


@kernel
def external_alone(grasp: PointGrasp) -> None:
    """Compute f = K_ep e + K_ed e', for one contact or for the conventional method (eqs. 20-23)."""
    k, c = grasp.external_stiffness, grasp.external_damping
    e, rate, f = grasp.displacement, grasp.rate, grasp.force
    for j in range(grasp.count * grasp.dimensions):
        f[j] = k * e[j] + c * rate[j]


@kernel
def shifted(grasp: PointGrasp) -> None:
    """Compute the forces if P d is the mean: on a line, or for coincident contacts."""
    k, c, a, b = grasp.internal_stiffness, grasp.internal_damping, grasp.stiffness, grasp.damping
    e, rate, f = grasp.displacement, grasp.rate, grasp.force
    n, d = grasp.count, grasp.dimensions
    for i in range(d):
        mean = 0.0 * grasp.points[i]  # NaN if the contact's position is NaN
        for j in range(i, n * d, d):
            mean += a * e[j] + b * rate[j]
        mean /= n
        for j in range(i, n * d, d):
            f[j] = k * e[j] + c * rate[j] + mean


@kernel
def between_two(grasp: PointGrasp) -> None:
    """Compute the forces of two contacts: P d is the mean and, across their line, the difference of the field d."""
    k, c, a, b = grasp.internal_stiffness, grasp.internal_damping, grasp.stiffness, grasp.damping
    p, e, rate, f = grasp.points, grasp.displacement, grasp.rate, grasp.force
    d = grasp.dimensions
    square = along = noise = 0.0
    for i in range(d):
        q = p[d + i] - p[i]
        square += q * q
        along += q * (a * (e[d + i] - e[i]) + b * (rate[d + i] - rate[i]))
        noise += abs(p[i])
    noise *= NOISE
    if square <= noise * noise:
        shifted(grasp)
        return
    grasp.rank = 2 * d - 1
    along /= square
    for i in range(d):
        one = a * e[i] + b * rate[i]
        other = a * e[d + i] + b * rate[d + i]
        mean, across = 0.5 * (one + other), 0.5 * (other - one - along * (p[d + i] - p[i]))
        f[i] = k * e[i] + c * rate[i] + (mean - across)
        f[d + i] = k * e[d + i] + c * rate[d + i] + (mean + across)


@kernel
def in_plane(grasp: PointGrasp) -> None:
    """Compute the forces in the plane: P d is the mean and a rotation about the centroid."""
    k, c, a, b = grasp.internal_stiffness, grasp.internal_damping, grasp.stiffness, grasp.damping
    p, e, rate, f = grasp.points, grasp.displacement, grasp.rate, grasp.force
    n = grasp.count
    x0, y0 = p[0], p[1]  # coordinates relative to the first contact, because the origin may be far away
    cx = cy = mx = my = 0.0
    for j in range(0, 2 * n, 2):
        cx += p[j] - x0
        cy += p[j + 1] - y0
        mx += a * e[j] + b * rate[j]
        my += a * e[j + 1] + b * rate[j + 1]
    cx, cy, mx, my = cx / n, cy / n, mx / n, my / n
    arm = moment = 0.0
    for j in range(0, 2 * n, 2):
        x, y = p[j] - x0 - cx, p[j + 1] - y0 - cy
        arm += x * x + y * y
        moment += x * (a * e[j + 1] + b * rate[j + 1] - my) - y * (a * e[j] + b * rate[j] - mx)
    turn = 0.0
    noise = NOISE * (abs(x0) + abs(y0))
    if arm > n * noise * noise:
        turn = moment / arm
        grasp.rank = 3
    for j in range(0, 2 * n, 2):
        x, y = p[j] - x0 - cx, p[j + 1] - y0 - cy
        f[j] = k * e[j] + c * rate[j] + (mx - turn * y)
        f[j + 1] = k * e[j + 1] + c * rate[j + 1] + (my + turn * x)


@kernel
def in_space(grasp: PointGrasp, modes: Table | None) -> None:
    """Compute the forces in space: P d is the mean and a rotation, in the frame of the line nearest to the contacts.

    If `modes` is given, write the rotations into it instead.

    q points from the first contact to the farthest contact. Let x be the coordinate along which q is longest, and
    u = (1, t, s) = q / q_x. Rotations are about u, y and z. The arms about u are those of v = y - t x and w = z - s x,
    which are computed in pairs of floats, so small arms are as accurate as large arms. The 3 x 3 matrix of moments is
    graded. Elimination of y and z before u therefore loses no accuracy as contacts approach a line.
    """
    p = grasp.points
    origin = vector_at(p, 0)
    far = qx = qy = qz = 0.0
    for j in range(0, 3 * grasp.count, 3):
        q = vector_at(p, j) - origin
        square = q.x * q.x + q.y * q.y + q.z * q.z
        if square > far:
            far, qx, qy, qz = square, q.x, q.y, q.z
    noise = NOISE * (abs(origin.x) + abs(origin.y) + abs(origin.z))
    noise *= noise
    if not far > noise + LEAST:
        if modes is None:
            shifted(grasp)
        return
    if abs(qx) >= abs(qy) and abs(qx) >= abs(qz):
        couple_about(grasp, Line(0, 1, 2, qy / qx, qz / qx), noise, modes)
    elif abs(qy) >= abs(qz):
        couple_about(grasp, Line(1, 2, 0, qz / qy, qx / qy), noise, modes)
    else:
        couple_about(grasp, Line(2, 0, 1, qx / qz, qy / qz), noise, modes)
