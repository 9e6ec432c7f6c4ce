"""Eq. (4) for point contacts in space, in the frame of the line that they are nearest to."""

from __future__ import annotations

from dataclasses import dataclass

from graspfx.compile.kernel import inline, kernel
from graspfx.grasp.arms import SPLITTER
from graspfx.grasp.point_grasp import PointGrasp
from graspfx.spatial import Vector


@dataclass(frozen=True, slots=True)
class Line:
    """A line along u = (1, t, s): the places of x, y and z among the coordinates, and its slopes."""

    x: int
    y: int
    z: int
    t: float
    s: float


@dataclass(frozen=True, slots=True)
class Centre:
    """The centroid in x, v = y - t x and w = z - s x from the first contact, and the mean of the field d."""

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


@kernel
def couple_about(grasp: PointGrasp, line: Line, noise: float) -> None:
    """Compute the forces; `noise` is the square of what the coordinates are rounded by [m^2]."""
    centre = centre_of(grasp, line)
    moments = moments_of(grasp, line, centre)
    turn_forces(grasp, line, centre, turn_of(grasp, line, moments, noise))


@inline
def exact_difference(a: float, b: float) -> tuple[float, float]:
    """Compute a - b as rounded difference and exact remainder (Knuth)."""
    x = a - b
    h = x - a
    return x, (a - (x - h)) - (b + h)


@inline
def halves(x: float) -> tuple[float, float]:
    """Cut a number into two halves whose products are exact (Dekker)."""
    h = SPLITTER * x
    high = h - (h - x)
    return high, x - high


@kernel
def centre_of(grasp: PointGrasp, line: Line) -> Centre:
    """Write x, v and w of every contact, formed in pairs of floats, where its force will be; give their means."""
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
        # less t x and s x, the products with what rounding takes from them
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
def turn_of(grasp: PointGrasp, line: Line, m: Moments, noise: float) -> Vector:
    """Solve for the rotation about u, y and z by L D L' of the moments about y, z, u; decide the rank."""
    i_y = 1.0 / (m.xx + m.zz)
    l_zy, l_uy = m.yz * i_y, m.uy * i_y
    rest = m.uz - l_uy * m.yz
    i_z = 1.0 / (m.xx + m.yy - l_zy * m.yz)
    l_uz = rest * i_z
    arm = m.uu - l_uy * m.uy - l_uz * rest
    about_z = m.about_z - l_zy * m.about_y
    about_u = m.about_u - (l_uy * m.about_y + l_uz * about_z)
    turn = 0.0
    grasp.rank = 5
    total = m.xx + m.yy + m.zz
    least = (grasp.tolerance * grasp.tolerance * total + grasp.count * noise) * (
        1.0 + line.t * line.t + line.s * line.s
    )
    if arm > least:
        turn = about_u / arm
        grasp.rank = 6
    z = about_z * i_z - l_uz * turn
    return Vector(turn, m.about_y * i_y - l_zy * z - l_uy * turn, z)


@kernel
def turn_forces(grasp: PointGrasp, line: Line, centre: Centre, turn: Vector) -> None:
    """Compute the forces from the internal gains, the mean of the field d and its rotation."""
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
