"""Eq. (4) for point contacts on a free object, from the best-fitting rigid motion, without G, G^+ or P.

The forces are f = s + P d with s = K_ip e + K_id e', d = (K_ep - K_ip) e + (K_ed - K_id) e' and scalar gains. P d is
the rigid motion that fits the field d best: the mean of d, and a rotation about the centroid. Weights are equal, and
all translations and rotations are free. The rank of G is determined with a tolerance, and rotations have no blend.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.kernel import inline, kernel
from graspfx.compile.records import Floats, Record, Table, floats
from graspfx.cones.cone import contact_frame
from graspfx.grasp.matrix import SPLITTER
from graspfx.spatial import ZERO, Vector

LEAST = 1e-280  # smallest square of a length, against underflow [m^2]
NOISE = 4.5e-16  # relative: contacts closer than two roundings of their coordinates coincide
TURNS = 3  # steps of inverse iteration
HALF = math.sqrt(0.5)


class PointGrasp(Record):
    """Equally weighted contacts on an object that is free to move. Each array is ordered contact by contact."""

    count: int  # n
    dimensions: int  # d
    external_stiffness: float  # kep [N/m]
    external_damping: float  # ked [N s/m]
    internal_stiffness: float  # kip [N/m]
    internal_damping: float  # kid [N s/m]
    tolerance: float  # relative to the contacts' rms radius; contacts closer to a line do not rotate about it
    rank: int  # rank of G at the last call; d if P was not needed
    points: Floats = floats("count * dimensions")  # [m]
    displacement: Floats = floats("count * dimensions")  # e [m]
    rate: Floats = floats("count * dimensions")  # e' [m/s]
    force: Floats = floats("count * dimensions")  # f, on the object [N]

    @property
    def stiffness(self) -> float:
        """Factor kep - kip of e in the field d [N/m]."""
        return self.external_stiffness - self.internal_stiffness

    @property
    def damping(self) -> float:
        """Factor ked - kid of e' in the field d [N s/m]."""
        return self.external_damping - self.internal_damping


@inline
def vector_at(numbers: Floats, j: int) -> Vector:
    """Read the vector that starts at entry j."""
    return Vector(numbers[j], numbers[j + 1], numbers[j + 2])


@kernel
def couple(block: NDArray[np.float64]) -> None:
    """Compute the forces of the grasp whose block starts at entry 0 of an array."""
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
    """Compute the forces if P d is the mean of d, as it is on a line and for coincident contacts."""
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
    """Compute the forces of two contacts, where P d is d across the line through them and the mean of d along it."""
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
    """Compute the forces in the plane, where P d is the mean of d plus a rotation about the centroid."""
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
    """Compute the forces in space, where P d is the mean of d plus a rotation about the centroid.

    The rotation is computed in a frame along the line through two contacts. If `modes` is given, the rotations are
    written to `modes`, and no forces are computed.

    q points from the first contact to the farthest contact. Let x be the coordinate along which q is longest, and
    u = (1, t, s) = q / q_x. Rotations are about u, y and z. The arms about u depend only on v = y - t x and w = z - s
    x, which are computed in pairs of floats, so small arms are as accurate as large arms. The 3 x 3 matrix of moments
    is graded, so elimination of y and z before u loses no accuracy as contacts approach a line.
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


@dataclass(frozen=True, slots=True)
class Line:
    """A line along u = (1, t, s): the indices of x, y and z among the coordinates, and the slopes."""

    x: int
    y: int
    z: int
    t: float
    s: float


@dataclass(frozen=True, slots=True)
class Centre:
    """Centroid relative to the first contact, in x, v = y - t x and w = z - s x; and mean of the field d."""

    arm: Vector
    mean: Vector


@dataclass(frozen=True, slots=True)
class Moments:
    """Second moments of the arms about y, z and u, and the moments of the field d about u, y and z."""

    xx: float
    yy: float
    zz: float
    yz: float
    uu: float
    uy: float
    uz: float
    about_u: float
    about_y: float
    about_z: float


@dataclass(frozen=True, slots=True)
class Pivots:
    """Factors L D L' of the moments: inverse entries of D for y and z, its entry for u (or 0), and entries of L.

    The remaining entries are zero unless contacts lie on a line up to the tolerance, but not exactly. In this case the
    axis along the line is (1, `axis_y`, `axis_z`) about u, y and z; `loose` is the inverse of the moment about this
    axis; and `slant` is the unit vector of the motion about this axis in terms of the orthonormal motions about y, z
    and u.
    """

    y: float
    z: float
    arm: float
    zy: float
    uy: float
    uz: float
    axis_y: float
    axis_z: float
    loose: float
    slant: Vector


@kernel
def couple_about(grasp: PointGrasp, line: Line, noise: float, modes: Table | None) -> None:
    """Compute the forces if `modes` is None, else write the modes.

    The square of the coordinates' rounding error is `noise` [m^2].
    """
    centre = centre_of(grasp, line)
    moments = moments_of(grasp, line, centre)
    pivots = pivots_of(grasp, line, moments, noise)
    if modes is None:
        turn_forces(grasp, line, centre, turn_of(moments, pivots))
    else:
        turn_modes(grasp, line, centre, pivots, modes)


@inline
def exact_difference(a: float, b: float) -> tuple[float, float]:
    """Compute a - b as a rounded difference and its exact remainder (Knuth)."""
    x = a - b
    h = x - a
    return x, (a - (x - h)) - (b + h)


@inline
def halves(x: float) -> tuple[float, float]:
    """Split a number into two halves whose products are exact (Dekker)."""
    h = SPLITTER * x
    high = h - (h - x)
    return high, x - high


@kernel
def centre_of(grasp: PointGrasp, line: Line) -> Centre:
    """Write x, v and w of all contacts, computed in pairs of floats, in place of the forces; return the means."""
    p, e, rate, f = grasp.points, grasp.displacement, grasp.rate, grasp.force
    a, b, ix, iy, iz, t, s = grasp.stiffness, grasp.damping, line.x, line.y, line.z, line.t, line.s
    x0, y0, z0 = p[ix], p[iy], p[iz]
    th, tl = halves(t)
    sh, sl = halves(s)
    cx = cv = cw = mx = my = mz = 0.0
    for i in range(0, 3 * grasp.count, 3):
        x, dx = exact_difference(p[i + ix], x0)
        y, dy = exact_difference(p[i + iy], y0)
        z, dz = exact_difference(p[i + iz], z0)
        # minus t x and s x, products that include their rounding error
        xh, xl = halves(x)
        g = t * x
        v = (y - g) + ((dy - t * dx) - (((th * xh - g) + th * xl + tl * xh) + tl * xl))
        g = s * x
        w = (z - g) + ((dz - s * dx) - (((sh * xh - g) + sh * xl + sl * xh) + sl * xl))
        f[i], f[i + 1], f[i + 2] = x, v, w
        cx, cv, cw = cx + x, cv + v, cw + w
        mx += a * e[i + ix] + b * rate[i + ix]
        my += a * e[i + iy] + b * rate[i + iy]
        mz += a * e[i + iz] + b * rate[i + iz]
    share = 1.0 / grasp.count
    return Centre(Vector(cx * share, cv * share, cw * share), Vector(mx * share, my * share, mz * share))


@kernel
def moments_of(grasp: PointGrasp, line: Line, centre: Centre) -> Moments:
    """Compute the moments of the arms and of the field d about the centroid."""
    e, rate, f = grasp.displacement, grasp.rate, grasp.force
    a, b, ix, iy, iz, t, s = grasp.stiffness, grasp.damping, line.x, line.y, line.z, line.t, line.s
    xx = yy = zz = yz = uu = uy = uz = mu = nu = lu = 0.0
    for i in range(0, 3 * grasp.count, 3):
        x, v, w = f[i] - centre.arm.x, f[i + 1] - centre.arm.y, f[i + 2] - centre.arm.z
        y, z, g = v + t * x, w + s * x, t * w - s * v
        ex = a * e[i + ix] + b * rate[i + ix] - centre.mean.x
        ey = a * e[i + iy] + b * rate[i + iy] - centre.mean.y
        ez = a * e[i + iz] + b * rate[i + iz] - centre.mean.z
        xx += x * x
        yy += y * y
        zz += z * z
        yz -= y * z
        uu += v * v + w * w + g * g
        uy += g * z - v * x
        uz -= g * y + w * x
        mu += g * ex - w * ey + v * ez
        nu += z * ex - x * ez
        lu += x * ey - y * ex
    return Moments(xx, yy, zz, yz, uu, uy, uz, mu, nu, lu)


@kernel
def pivots_of(grasp: PointGrasp, line: Line, m: Moments, noise: float) -> Pivots:
    """Factor the moments about y, z, u as L D L', and decide the rank."""
    i_y = 1.0 / (m.xx + m.zz)
    l_zy, l_uy = m.yz * i_y, m.uy * i_y
    rest = m.uz - l_uy * m.yz
    i_z = 1.0 / (m.xx + m.yy - l_zy * m.yz)
    l_uz = rest * i_z
    arm = m.uu - l_uy * m.uy - l_uz * rest
    grasp.rank = 6
    total = m.xx + m.yy + m.zz
    t, s = line.t, line.s
    square = 1.0 + t * t + s * s
    axis_y = axis_z = loose = 0.0
    slant = ZERO
    if not arm > (grasp.tolerance * grasp.tolerance * total + grasp.count * noise) * square:
        grasp.rank = 5
        if arm > 0.0:
            # principal axis by inverse iteration; each step multiplies the error by h^2, h the arm about the axis
            by = bz = 0.0
            for _ in range(TURNS):
                about_y = t + axis_y
                about_z = s + axis_z - l_zy * about_y
                share = arm / (square + t * axis_y + s * axis_z - l_uy * about_y - l_uz * about_z)
                by, bz = about_y * i_y * share, about_z * i_z * share
                axis_z = bz - l_uz
                axis_y = by - l_zy * axis_z - l_uy
            moment = by * by / i_y + bz * bz / i_z + arm
            size = math.sqrt(moment)
            loose = 1.0 / moment
            slant = Vector(by / (math.sqrt(i_y) * size), bz / (math.sqrt(i_z) * size), math.sqrt(arm) / size)
        else:
            arm = 0.0
    return Pivots(i_y, i_z, arm, l_zy, l_uy, l_uz, axis_y, axis_z, loose, slant)


@kernel
def turn_of(m: Moments, p: Pivots) -> Vector:
    """Solve for the rotation about u, y and z."""
    about_z = m.about_z - p.zy * m.about_y
    about_u = m.about_u - (p.uy * m.about_y + p.uz * about_z)
    turn = 0.0
    if p.arm > 0.0:
        turn = about_u / p.arm
    z = about_z * p.z - p.uz * turn
    y = m.about_y * p.y - p.zy * z - p.uy * turn
    if p.loose > 0.0:
        share = p.loose * (m.about_u + p.axis_y * m.about_y + p.axis_z * m.about_z)
        return Vector(turn - share, y - share * p.axis_y, z - share * p.axis_z)
    return Vector(turn, y, z)


@kernel
def turn_forces(grasp: PointGrasp, line: Line, centre: Centre, turn: Vector) -> None:
    """Compute the forces from the internal gains, and from the mean and rotation of the field d."""
    e, rate, f = grasp.displacement, grasp.rate, grasp.force
    k, c, ix, iy, iz, t, s = (
        grasp.internal_stiffness, grasp.internal_damping, line.x, line.y, line.z, line.t, line.s
    )  # fmt: skip
    for i in range(0, 3 * grasp.count, 3):
        x, v, w = f[i] - centre.arm.x, f[i + 1] - centre.arm.y, f[i + 2] - centre.arm.z
        y, z, g = v + t * x, w + s * x, t * w - s * v
        mean = centre.mean
        f[i + ix] = k * e[i + ix] + c * rate[i + ix] + (mean.x + (turn.x * g + turn.y * z - turn.z * y))
        f[i + iy] = k * e[i + iy] + c * rate[i + iy] + (mean.y + (turn.z * x - turn.x * w))
        f[i + iz] = k * e[i + iz] + c * rate[i + iz] + (mean.z + (turn.x * v - turn.y * x))


@kernel
def turn_modes(grasp: PointGrasp, line: Line, centre: Centre, p: Pivots, modes: Table) -> None:
    """Write the rotations as orthonormal modes: about y, then z, then u.

    If contacts lie on a line, write the two rotations that are orthogonal to the rotation about that line.
    """
    f = grasp.force
    ix, iy, iz, t, s = line.x, line.y, line.z, line.t, line.s
    size_y, size_z, size_u = math.sqrt(p.y), math.sqrt(p.z), 0.0
    if p.arm > 0.0:
        size_u = 1.0 / math.sqrt(p.arm)
    on_line = p.loose > 0.0
    frame = contact_frame(p.slant, 3)
    for i in range(0, 3 * grasp.count, 3):
        x, v, w = f[i] - centre.arm.x, f[i + 1] - centre.arm.y, f[i + 2] - centre.arm.z
        y, z, g = v + t * x, w + s * x, t * w - s * v
        about_y = Vector(z, 0.0, -x)
        about_z = Vector(-y, x, 0.0) - p.zy * about_y
        about_u = size_u * (Vector(g, -w, v) - p.uy * about_y - p.uz * about_z)
        about_y = size_y * about_y
        about_z = size_z * about_z
        if on_line:
            one, other = frame.second, frame.third
            first = one.x * about_y + one.y * about_z + one.z * about_u
            second = other.x * about_y + other.y * about_z + other.z * about_u
            about_y, about_z, about_u = first, second, ZERO
        modes[3, i + ix], modes[3, i + iy], modes[3, i + iz] = about_y.x, about_y.y, about_y.z
        modes[4, i + ix], modes[4, i + iy], modes[4, i + iz] = about_z.x, about_z.y, about_z.z
        modes[5, i + ix], modes[5, i + iy], modes[5, i + iz] = about_u.x, about_u.y, about_u.z


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
    """Write the relative motions of two contacts across the line through them, unless the contacts coincide."""
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
