"""Where a finger touches an ellipsoid: the nearest point, or on the side of a flat one that it has pressed through."""

from __future__ import annotations

import math

from graspfx.surfaces.closed_form.proxy_exact import exact_product, exact_sum
from graspfx.surfaces.closed_form.proxy_round import on_sphere

SMALL = 1e-150  # a coordinate below this share of the size counts as zero
FAR = 1e100  # beyond this multiple of the size products of pairs may overflow; there y is parallel to h_i u_i
RESOLVED = 1e-9  # |y| - 1 where the iteration in floats ends: rounding is far below
CLOSE = 1e-9  # relative step of the iteration in pairs whose square is below rounding
DOUBTFUL = 1e-6  # nearer to zero than this a difference is taken in pairs
ROUNDS = 40


def on_ellipsoid(
    d: int, a: float, b: float, c: float, x: float, y: float, z: float, face: int, px: float, py: float, pz: float
) -> tuple[int, float, float, float, float, float, float, float]:
    """c_i = e_i^2 p_i/(t + e_i^2) with the t that puts c on the surface; t = 0 there, n against c_i/e_i^2.

    The squared distance has one local minimum on the surface besides the nearest point at most, beyond the plane of
    the two longer semi-axes (Martinez 1994). So a finger has a side, 0 or 1, of the shortest semi-axis: it keeps it
    while the minimum there exists, which is to where the contact rolls off over the rim, and a lens is as hard to
    press through as a plate. Where several points are nearest it is the one next to the contact point before.
    """
    if d < 3:
        c, z, pz = max(a, b), 0.0, 0.0  # an ellipse is a section of this ellipsoid
    if a == b and b == c:
        return on_sphere(a, x, y, z, px, py, pz)
    # e1 >= e2 >= e3, and the axes i that they belong to
    e1, p1, q1, i1 = a, x, px, 0
    e2, p2, q2, i2 = b, y, py, 1
    e3, p3, q3, i3 = c, z, pz, 2
    if e1 < e2:
        e1, p1, q1, i1, e2, p2, q2, i2 = e2, p2, q2, i2, e1, p1, q1, i1
    if e2 < e3:
        e2, p2, q2, i2, e3, p3, q3, i3 = e3, p3, q3, i3, e2, p2, q2, i2
    if e1 < e2:
        e1, p1, q1, i1, e2, p2, q2, i2 = e2, p2, q2, i2, e1, p1, q1, i1
    size = math.ldexp(1.0, math.frexp(e1)[1])  # a power of two: divided by without rounding
    h1, h2, h3 = e1 / size, e2 / size, e3 / size
    u1, u2, u3 = abs(p1) / size, abs(p2) / size, abs(p3) / size
    side = face
    if h3 * u3 >= SMALL or face < 0:
        side = 1 if p3 < 0.0 or (p3 == 0.0 and q3 < 0.0) else 0
    beyond = face >= 0 and side != face
    found, s, y1, y2, y3 = False, 0.0, 0.0, 0.0, 0.0
    if beyond:
        found, s, y1, y2, y3 = far_side(h1, h2, h3, u1, u2, u3)
    if found:
        side = face
    else:
        s, y1, y2, y3 = near_side(h1, h2, h3, u1, u2, u3)
    if s == 0.0:  # on the plane or the line where nearest points meet
        if h2 > h3:
            p3 = 1.0 - 2.0 * side
        else:
            length = math.sqrt(q2 * q2 + q3 * q3)
            p2, p3 = (q2, q3) if length > 0.0 else (0.0, 1.0 - 2.0 * side)
            length = length if length > 0.0 else 1.0
            y2, y3 = y3 * (abs(p2) / length), y3 * (abs(p3) / length)
    y1, y2, y3 = math.copysign(y1, p1), math.copysign(y2, p2), (-y3 if p3 < 0.0 else y3)
    g1, g2, g3 = y1 * (h3 / h1), y2 * (h3 / h2), y3
    length = math.sqrt(g1 * g1 + g2 * g2 + g3 * g3)
    gap = size * (s / h3 - h3) * length
    c1, c2, c3 = e1 * y1, e2 * y2, e3 * y3
    g1, g2, g3 = -g1 / length, -g2 / length, -g3 / length
    cx, nx = (c1, g1) if i1 == 0 else ((c2, g2) if i2 == 0 else (c3, g3))
    cy, ny = (c1, g1) if i1 == 1 else ((c2, g2) if i2 == 1 else (c3, g3))
    cz, nz = (c1, g1) if i1 == 2 else ((c2, g2) if i2 == 2 else (c3, g3))
    return side, cx, cy, cz, nx, ny, nz, gap


def near_side(h1: float, h2: float, h3: float, u1: float, u2: float, u3: float) -> tuple[float, float, float, float]:
    """s = t + h3^2 >= 0 of the nearest point and its y_i = c_i/h_i, for h1 >= h2 >= h3 and a finger at u >= 0.

    |y(s)| = 1 with y_i = h_i u_i/(s + h_i^2 - h3^2), by Newton's method for 1/|y|, which is concave: from below the
    root it rises to it and never passes. It starts at a lower bound that is near the root wherever the finger is.
    It ends in pairs of floats, since a nearby evolute magnifies rounding. s = 0 with y3 >= 0 means the plane of the
    longer semi-axes, or with h2 = h3 the line of the longest.
    """
    d1, r1 = squares_apart(h1, h3)
    d2, r2 = squares_apart(h2, h3)
    k1, k2, k3 = h1 * u1, h2 * u2, h3 * u3
    k = k3 if d2 > 0.0 else math.sqrt(k2 * k2 + k3 * k3)
    y1 = k1 / d1
    y2 = k2 / d2 if d2 > 0.0 else 0.0
    rest = y1 * y1 + y2 * y2  # |y|^2 at s = 0 but for what grows without bound there, and its slope
    slope = 2.0 * (y1 * y1 / d1 + (y2 * y2 / d2 if d2 > 0.0 else 0.0))
    above = rest - 1.0
    if k < SMALL or abs(above) < DOUBTFUL:
        y1, w1, _ = share(h1, u1, 0.0, 0.0, d1, r1)
        y2, w2, _ = share(h2, u2, 0.0, 0.0, d2, r2) if d2 > 0.0 else (0.0, 0.0, 1.0)
        above = norm_above_one(y1, w1, y2, w2, 0.0, 0.0)
        if k < SMALL and above <= 0.0:
            return 0.0, y1 + w1, y2 + w2, math.sqrt(-above)
    s = max(k, k1 - d1, k2 - d2)
    if above > 0.0:
        s = max(s, above / slope)
    if k >= SMALL:
        s = max(s, lower_bound(k, max(-above, 0.0), slope))

    y3 = 0.0
    for _ in range(ROUNDS):
        y1, y2, y3 = k1 / (s + d1), k2 / (s + d2), k3 / s
        square = y1 * y1 + y2 * y2 + y3 * y3
        length = math.sqrt(square)
        if not length > 1.0 + RESOLVED:
            break
        s += (length - 1.0) * square / (y1 * y1 / (s + d1) + y2 * y2 / (s + d2) + y3 * y3 / s)
    if s > FAR:
        length = math.sqrt(y1 * y1 + y2 * y2 + y3 * y3)
        return s * length, y1 / length, y2 / length, y3 / length
    r = 0.0
    for _ in range(ROUNDS):
        y1, w1, t1 = share(h1, u1, s, r, d1, r1)
        y2, w2, t2 = share(h2, u2, s, r, d2, r2)
        y3, w3, t3 = share(h3, u3, s, r, 0.0, 0.0)
        above = norm_above_one(y1, w1, y2, w2, y3, w3)
        slope = y1 * y1 / t1 + y2 * y2 / t2 + y3 * y3 / t3
        step = above * (1.0 + above) / ((1.0 + math.sqrt(max(1.0 + above, 0.0))) * slope)
        if not abs(step) > CLOSE * s:
            w1, w2, w3 = w1 - y1 * (step / t1), w2 - y2 * (step / t2), w3 - y3 * (step / t3)
            s += step
            break
        s, r = exact_sum(s, max(r + step, -0.5 * s))
    return s, y1 + w1, y2 + w2, y3 + w3


def far_side(
    h1: float, h2: float, h3: float, u1: float, u2: float, u3: float
) -> tuple[bool, float, float, float, float]:
    """Whether there is a minimum across the plane of the longer semi-axes; if so s < 0 and y as in `near_side`, y3 < 0.

    It is the root next to s = 0 in (h3^2 - h2^2, 0), where |y|^2 - 1 is convex: Newton's method falls to it, or out.
    """
    d1, r1 = squares_apart(h1, h3)
    d2, r2 = squares_apart(h2, h3)
    k1, k2, k3 = h1 * u1, h2 * u2, h3 * u3
    if d2 <= 0.0 or k3 < SMALL:
        return False, 0.0, 0.0, 0.0, 0.0
    y1, y2 = k1 / d1, k2 / d2
    left = 1.0 - y1 * y1 - y2 * y2
    if left <= 0.0:
        return False, 0.0, 0.0, 0.0, 0.0
    s = -k3 / math.sqrt(left)
    for _ in range(ROUNDS):
        if not -d2 < s < 0.0:
            return False, 0.0, 0.0, 0.0, 0.0
        y1, y2, y3 = k1 / (s + d1), k2 / (s + d2), k3 / s
        slope = y1 * y1 / (s + d1) + y2 * y2 / (s + d2) + y3 * y3 / s
        if slope >= 0.0:
            return False, 0.0, 0.0, 0.0, 0.0
        above = y1 * y1 + y2 * y2 + y3 * y3 - 1.0
        if not above > RESOLVED:
            break
        s += above / (2.0 * slope)
    r = 0.0
    w1 = w2 = w3 = 0.0
    for _ in range(ROUNDS):
        y1, w1, t1 = share(h1, u1, s, r, d1, r1)
        y2, w2, t2 = share(h2, u2, s, r, d2, r2)
        y3, w3, t3 = share(h3, u3, s, r, 0.0, 0.0)
        slope = y1 * y1 / t1 + y2 * y2 / t2 + y3 * y3 / t3
        if slope >= 0.0:
            return False, 0.0, 0.0, 0.0, 0.0
        step = norm_above_one(y1, w1, y2, w2, y3, w3) / (2.0 * slope)
        if not abs(step) > CLOSE * -s:
            w1, w2, w3 = w1 - y1 * (step / t1), w2 - y2 * (step / t2), w3 - y3 * (step / t3)
            s += step
            break
        s, r = exact_sum(s, r + step)
        if not -d2 < s < 0.0:
            return False, 0.0, 0.0, 0.0, 0.0
    return True, s, y1 + w1, y2 + w2, y3 + w3


def lower_bound(k: float, left: float, slope: float) -> float:
    """An s with (k/s)^2 >= left + slope s, from which the root of equality is a small factor away."""
    bound = k / math.sqrt(2.0 * left) if left > 0.0 else math.inf
    if slope > 0.0:
        exponent = (2 * math.frexp(k)[1] - 3 - math.frexp(slope)[1]) // 3  # the cube root of k^2/(2 slope) rounded down
        bound = min(bound, math.ldexp(1.0, exponent))
    return bound


def squares_apart(a: float, b: float) -> tuple[float, float]:
    """a^2 - b^2 as a pair."""
    p, pr = exact_product(a, a)
    q, qr = exact_product(b, b)
    s, sr = exact_sum(p, -q)
    return exact_sum(s, sr + (pr - qr))


def share(h: float, u: float, s: float, r: float, d: float, dr: float) -> tuple[float, float, float]:
    """y = h u/((s + r) + (d + dr)) as a pair, and the divisor."""
    n, nr = exact_product(h, u)
    t, tr = exact_sum(s, d)
    t, tr = exact_sum(t, tr + (r + dr))
    y = n / t
    p, pr = exact_product(y, t)
    return y, ((n - p) - pr + nr - y * tr) / t, t


def norm_above_one(y1: float, w1: float, y2: float, w2: float, y3: float, w3: float) -> float:
    """|y + w|^2 - 1, summed in pairs."""
    a, ar = exact_product(y1, y1)
    b, br = exact_product(y2, y2)
    c, cr = exact_product(y3, y3)
    t, tr = exact_sum(a, b)
    s, sr = exact_sum(t, c)
    v, vr = exact_sum(s, -1.0)
    return v + (vr + (sr + tr) + (ar + br + cr) + 2.0 * (y1 * w1 + y2 * w2 + y3 * w3))
