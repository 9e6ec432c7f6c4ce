"""Eq. (4) for point contacts on a free object: one best-fitting rigid motion instead of G, its pseudoinverse and P.

f = s + P d with s = K_ip e + K_id e', d = (K_ep - K_ip) e + (K_ed - K_id) e' and numbers for gains. P d is the rigid
motion that fits the field d best: its mean and a rotation about the centroid. Equal weights, all translations and
rotations free, no blend: the rank is decided by a tolerance.

Every function takes a flat buffer `S` (float64) and an offset, allocates nothing and uses scalars only, so that the
same source runs interpreted and compiled.
"""

from __future__ import annotations

from typing import Any

from graspfx.grasp.arms import SPLITTER

FINGERS = 0  # n
DIMENSIONS = 1  # d
EXTERNAL_STIFFNESS, EXTERNAL_DAMPING = 2, 3  # kep [N/m], ked [N s/m]
INTERNAL_STIFFNESS, INTERNAL_DAMPING = 4, 5  # kip, kid
TOLERANCE = 6  # of the contacts' rms radius: contacts nearer to a line turn about it by no force
RANK = 7  # of G, as the last call found it
# From here on n d entries each: points [m], displacements e [m], rates e' [m/s], forces on the object [N].
POINTS = 8

NOISE = 4.5e-16  # of a coordinate: contacts no farther apart than two roundings of their coordinates coincide
LEAST = 1e-280  # [m^2], so that nothing underflows


def size(n: int, d: int) -> int:
    """Count the entries of the block."""
    return POINTS + 4 * n * d


def couple_points(S: Any, o: int) -> int:
    """Compute forces of all contacts from their points, displacements and rates; return 0."""
    n, d = int(S[o + FINGERS]), int(S[o + DIMENSIONS])
    a = S[o + EXTERNAL_STIFFNESS] - S[o + INTERNAL_STIFFNESS]
    b = S[o + EXTERNAL_DAMPING] - S[o + INTERNAL_DAMPING]
    S[o + RANK] = d
    if n == 1 or (a == 0.0 and b == 0.0):
        external_alone(S, o, n * d)
    elif d == 1:
        shifted(S, o, n, d, a, b)
    elif n == 2:
        between_two(S, o, d, a, b)
    elif d == 2:
        in_plane(S, o, n, a, b)
    else:
        in_space(S, o, n, a, b)
    return 0


def couple(S: Any) -> None:
    """Couple a block that begins where its array does: the one call of a loop."""
    couple_points(S, 0)


def external_alone(S: Any, o: int, m: int) -> None:
    """Compute f = K_ep e + K_ed e': one contact, or the conventional method (eqs. 20-23)."""
    k, c = S[o + EXTERNAL_STIFFNESS], S[o + EXTERNAL_DAMPING]
    e = o + POINTS + m
    for j in range(e, e + m):
        S[j + 2 * m] = k * S[j] + c * S[j + m]


def shifted(S: Any, o: int, n: int, d: int, a: float, b: float) -> None:
    """Project by the mean: on a line, and where all contacts coincide."""
    k, c = S[o + INTERNAL_STIFFNESS], S[o + INTERNAL_DAMPING]
    m = n * d
    e = o + POINTS + m
    for i in range(d):
        mean = 0.0 * S[e - m + i]  # no number where the contacts' place is none
        for j in range(e + i, e + m, d):
            mean += a * S[j] + b * S[j + m]
        mean /= n
        for j in range(e + i, e + m, d):
            S[j + 2 * m] = k * S[j] + c * S[j + m] + mean


def between_two(S: Any, o: int, d: int, a: float, b: float) -> None:
    """Project by the mean and what the two differ by across the line through them."""
    k, c = S[o + INTERNAL_STIFFNESS], S[o + INTERNAL_DAMPING]
    m = 2 * d
    p = o + POINTS
    e, f = p + m, p + 3 * m
    square = along = noise = 0.0
    for i in range(d):
        q = S[p + d + i] - S[p + i]
        square += q * q
        along += q * (a * (S[e + d + i] - S[e + i]) + b * (S[e + m + d + i] - S[e + m + i]))
        noise += abs(S[p + i])
    noise *= NOISE
    if square <= noise * noise:
        shifted(S, o, 2, d, a, b)
        return
    S[o + RANK] = 2.0 * d - 1.0
    along /= square
    for i in range(d):
        one = a * S[e + i] + b * S[e + m + i]
        other = a * S[e + d + i] + b * S[e + m + d + i]
        mean, across = 0.5 * (one + other), 0.5 * (other - one - along * (S[p + d + i] - S[p + i]))
        S[f + i] = k * S[e + i] + c * S[e + m + i] + (mean - across)
        S[f + d + i] = k * S[e + d + i] + c * S[e + m + d + i] + (mean + across)


def in_plane(S: Any, o: int, n: int, a: float, b: float) -> None:
    """Project by the mean and a rotation about the centroid."""
    k, c = S[o + INTERNAL_STIFFNESS], S[o + INTERNAL_DAMPING]
    m = 2 * n
    p = o + POINTS
    e = p + m
    x0, y0 = S[p], S[p + 1]  # from the first contact: the origin may be far away
    cx = cy = mx = my = 0.0
    for j in range(p, p + m, 2):
        cx += S[j] - x0
        cy += S[j + 1] - y0
        mx += a * S[j + m] + b * S[j + 2 * m]
        my += a * S[j + m + 1] + b * S[j + 2 * m + 1]
    cx, cy, mx, my = cx / n, cy / n, mx / n, my / n
    arm = moment = 0.0
    for j in range(p, p + m, 2):
        x, y = S[j] - x0 - cx, S[j + 1] - y0 - cy
        arm += x * x + y * y
        moment += x * (a * S[j + m + 1] + b * S[j + 2 * m + 1] - my) - y * (a * S[j + m] + b * S[j + 2 * m] - mx)
    turn = 0.0
    noise = NOISE * (abs(x0) + abs(y0))
    if arm > n * noise * noise:
        turn = moment / arm
        S[o + RANK] = 3.0
    for j in range(e, e + m, 2):
        x, y = S[j - m] - x0 - cx, S[j - m + 1] - y0 - cy
        S[j + 2 * m] = k * S[j] + c * S[j + m] + (mx - turn * y)
        S[j + 2 * m + 1] = k * S[j + 1] + c * S[j + m + 1] + (my + turn * x)


def in_space(S: Any, o: int, n: int, a: float, b: float) -> None:
    """Project by the mean and a rotation about the centroid, in the frame of the line that is nearest to the contacts.

    q leads from the first contact to the one farthest from it. With x the coordinate along which q is longest and
    u = (1, t, s) = q / q_x, rotations are taken about u, y and z. The arms about u are those of v = y - t x and
    w = z - s x, formed in pairs of floats: small ones are as accurate as large ones, the 3 x 3 matrix of moments is
    graded, and its elimination, y and z before u, loses nothing as contacts come near a line.
    """
    m = 3 * n
    p = o + POINTS
    x0, y0, z0 = S[p], S[p + 1], S[p + 2]
    far = qx = qy = qz = 0.0
    for j in range(p, p + m, 3):
        x, y, z = S[j] - x0, S[j + 1] - y0, S[j + 2] - z0
        square = x * x + y * y + z * z
        if square > far:
            far, qx, qy, qz = square, x, y, z
    noise = NOISE * (abs(x0) + abs(y0) + abs(z0))
    noise *= noise
    if not far > noise + LEAST:
        shifted(S, o, n, 3, a, b)
        return
    if abs(qx) >= abs(qy) and abs(qx) >= abs(qz):
        about_line(S, o, n, a, b, 0, 1, 2, qy / qx, qz / qx, noise)
    elif abs(qy) >= abs(qz):
        about_line(S, o, n, a, b, 1, 2, 0, qz / qy, qx / qy, noise)
    else:
        about_line(S, o, n, a, b, 2, 0, 1, qx / qz, qy / qz, noise)


def about_line(
    S: Any, o: int, n: int, a: float, b: float, ix: int, iy: int, iz: int, t: float, s: float, noise: float
) -> None:
    """Do `in_space` for the places of x, y and z among coordinates; the forces' entries hold x, v and w meanwhile."""
    m = 3 * n
    p = o + POINTS
    f = p + 3 * m
    x0, y0, z0 = S[p + ix], S[p + iy], S[p + iz]
    h = SPLITTER * t
    th = h - (h - t)
    tl = t - th
    h = SPLITTER * s
    sh = h - (h - s)
    sl = s - sh
    cx = cv = cw = mx = my = mz = 0.0
    for i in range(0, m, 3):
        j = p + i
        # x + dx, y + dy, z + dz are the exact differences from the first contact (Knuth)
        g = S[j + ix]
        x = g - x0
        h = x - g
        dx = (g - (x - h)) - (x0 + h)
        g = S[j + iy]
        y = g - y0
        h = y - g
        dy = (g - (y - h)) - (y0 + h)
        g = S[j + iz]
        z = g - z0
        h = z - g
        dz = (g - (z - h)) - (z0 + h)
        # less t x and s x, the products with what rounding takes from them (Dekker)
        h = SPLITTER * x
        xh = h - (h - x)
        xl = x - xh
        g = t * x
        v = (y - g) + ((dy - t * dx) - (((th * xh - g) + th * xl + tl * xh) + tl * xl))
        g = s * x
        w = (z - g) + ((dz - s * dx) - (((sh * xh - g) + sh * xl + sl * xh) + sl * xl))
        S[f + i], S[f + i + 1], S[f + i + 2] = x, v, w
        cx, cv, cw = cx + x, cv + v, cw + w
        j += m
        mx += a * S[j + ix] + b * S[j + m + ix]
        my += a * S[j + iy] + b * S[j + m + iy]
        mz += a * S[j + iz] + b * S[j + m + iz]
    share = 1.0 / n
    cx, cv, cw, mx, my, mz = cx * share, cv * share, cw * share, mx * share, my * share, mz * share
    xx = yy = zz = yz = uu = uy = uz = mu = nu = lu = 0.0
    for i in range(0, m, 3):
        x, v, w = S[f + i] - cx, S[f + i + 1] - cv, S[f + i + 2] - cw
        y, z, g = v + t * x, w + s * x, t * w - s * v
        j = p + m + i
        ex = a * S[j + ix] + b * S[j + m + ix] - mx
        ey = a * S[j + iy] + b * S[j + m + iy] - my
        ez = a * S[j + iz] + b * S[j + m + iz] - mz
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
    # L D L' of the moments about y, z, u
    total = xx + yy + zz
    i_y = 1.0 / (xx + zz)
    l_zy, l_uy = yz * i_y, uy * i_y
    rest = uz - l_uy * yz
    i_z = 1.0 / (xx + yy - l_zy * yz)
    l_uz = rest * i_z
    arm = uu - l_uy * uy - l_uz * rest
    lu -= l_zy * nu
    mu -= l_uy * nu + l_uz * lu
    turn = 0.0
    S[o + RANK] = 5.0
    tolerance = S[o + TOLERANCE]
    if arm > (tolerance * tolerance * total + n * noise) * (1.0 + t * t + s * s):
        turn = mu / arm
        S[o + RANK] = 6.0
    about_z = lu * i_z - l_uz * turn
    about_y = nu * i_y - l_zy * about_z - l_uy * turn
    k, c = S[o + INTERNAL_STIFFNESS], S[o + INTERNAL_DAMPING]
    for i in range(0, m, 3):
        x, v, w = S[f + i] - cx, S[f + i + 1] - cv, S[f + i + 2] - cw
        y, z, g = v + t * x, w + s * x, t * w - s * v
        j = p + m + i
        S[f + i + ix] = k * S[j + ix] + c * S[j + m + ix] + (mx + (turn * g + about_y * z - about_z * y))
        S[f + i + iy] = k * S[j + iy] + c * S[j + m + iy] + (my + (about_z * x - turn * w))
        S[f + i + iz] = k * S[j + iz] + c * S[j + m + iz] + (mz + (turn * v - about_y * x))
