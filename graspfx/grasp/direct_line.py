"""Eq. (4) for point contacts in space, in the frame of their nearest line."""

from __future__ import annotations

import math
from dataclasses import dataclass

from graspfx.compile.kernel import inline, kernel
from graspfx.compile.records import Table
from graspfx.cones.cone import contact_frame
from graspfx.grasp.arms import SPLITTER
from graspfx.grasp.point_grasp import PointGrasp
from graspfx.spatial import ZERO, Vector

TURNS = 3


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
    """Factors L D L' of the moments: inverses of D's entries for y and z, its entry for u or 0, and the entries of L.

    The remaining entries are zero unless contacts lie on a line. They are then the axis along the line, (1, y, z) about
    u, y and z; the inverse of its moment; and the unit vector of its motion in terms of the orthonormal motions about
    y, z and u.
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
    """Compute the forces, or the modes; `noise` is the square of the coordinates' rounding error [m^2]."""
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
    """Compute x, v and w of all contacts in pairs of floats; write them in place of the forces; return the means."""
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
