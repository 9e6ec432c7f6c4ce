"""Contact of a finger with an ellipsoid: the nearest point of the surface, or of one side of a flat ellipsoid."""

from __future__ import annotations

import math
from dataclasses import dataclass

from graspfx.compile.kernel import inline, kernel
from graspfx.spatial import ZERO, Vector, dot
from graspfx.surfaces.closed_form.proxy_primitives import exact_product, exact_sum, on_sphere
from graspfx.surfaces.nearest import Nearest

SMALL = 1e-150  # relative to the size: a smaller coordinate counts as zero
FAR = 1e100  # relative to the size: farther away products of pairs may overflow; there y is parallel to h_i u_i
RESOLVED = 1e-9  # |y| - 1 at which the iteration in floats stops, well above rounding
CLOSE = 1e-9  # relative step of the iteration in pairs, whose square is below rounding
DOUBTFUL = 1e-6  # closer to zero than this, a difference is computed in pairs
ROUNDS = 40


@dataclass(frozen=True, slots=True)
class Axis:
    """Semi-axis of an ellipsoid.

    Attributes:
        length: Length of the semi-axis [m].
        now: Coordinate of the finger along the semi-axis [m].
        last: Coordinate of the last contact point along the semi-axis [m].
        number: Coordinate axis of the semi-axis: 0, 1 or 2.
    """

    length: float
    now: float
    last: float
    number: int


@dataclass(frozen=True, slots=True)
class Foot:
    """Local minimum of the distance between a finger and an ellipsoid with semi-axes h1 >= h2 >= h3.

    Attributes:
        success: Whether the minimum exists; otherwise the other attributes have no meaning.
        s: Shifted parameter t + h3^2, with the parameter t of `on_ellipsoid`; all lengths relative to a unit of length.
        y: Contact point c in units of the semi-axes, y_i = c_i/h_i.
    """

    success: bool
    s: float
    y: Vector


@dataclass(frozen=True, slots=True)
class Pairs:
    """Three quotients in double-double arithmetic: leading parts y, remainders w, and divisors t."""

    y: Vector
    w: Vector
    t: Vector


@kernel
def on_ellipsoid(d: int, size: Vector, p: Vector, face: int, last: Vector) -> Nearest:
    """Find the contact of a finger at p with an ellipsoid with semi-axes e_i = `size`; see `closest`.

    The contact point is c_i = e_i^2 p_i/(t + e_i^2), with the parameter t for which sum c_i^2/e_i^2 = 1; t is zero if p
    is on the surface. The inward normal n has the direction of the vector with entries -c_i/e_i^2.

    Besides the nearest point, the distance has at most one local minimum on the surface, on the other side of the plane
    of the two longer semi-axes (Martinez 1994). The finger's face, 0 or 1, is the side of this plane on which the
    contact point is. The finger keeps its face as long as the distance has a minimum on this side. A finger that pushes
    into a flat ellipsoid is therefore held as by a plate. If several points are nearest, the contact is the point
    nearest to the last contact point.
    """
    if d < 3:  # an ellipse is a section of this ellipsoid
        size = Vector(size.x, size.y, max(size.x, size.y))
        p, last = Vector(p.x, p.y, 0.0), Vector(last.x, last.y, 0.0)
    if size.x == size.y and size.y == size.z:
        return on_sphere(size.x, p, last)
    one, two, three = sorted_axes(
        Axis(size.x, p.x, last.x, 0), Axis(size.y, p.y, last.y, 1), Axis(size.z, p.z, last.z, 2)
    )
    unit = power_above(one.length)  # division by it is exact
    h = Vector(one.length / unit, two.length / unit, three.length / unit)
    u = Vector(abs(one.now) / unit, abs(two.now) / unit, abs(three.now) / unit)
    side = face
    if h.z * u.z >= SMALL or face < 0:
        side = 1 if three.now < 0.0 or (three.now == 0.0 and three.last < 0.0) else 0
    foot = Foot(False, 0.0, ZERO)
    if face >= 0 and side != face:
        foot = far_side(h, u)
    if foot.success:
        side = face
    else:
        foot = near_side(h, u)
    s, y = foot.s, foot.y
    p2, p3 = two.now, three.now
    if s == 0.0:  # on the plane or line on which several points are nearest
        if h.y > h.z:
            p3 = 1.0 - 2.0 * side
        else:
            length = math.sqrt(two.last * two.last + three.last * three.last)
            p2, p3 = (two.last, three.last) if length > 0.0 else (0.0, 1.0 - 2.0 * side)
            length = length if length > 0.0 else 1.0
            y = Vector(y.x, y.z * (abs(p2) / length), y.z * (abs(p3) / length))
    y = Vector(math.copysign(y.x, one.now), math.copysign(y.y, p2), (-y.z if p3 < 0.0 else y.z))
    g = Vector(y.x * (h.z / h.x), y.y * (h.z / h.y), y.z)
    length = math.sqrt(dot(g, g))
    gap = unit * (s / h.z - h.z) * length
    c = Vector(one.length * y.x, two.length * y.y, three.length * y.z)
    n = Vector(-g.x / length, -g.y / length, -g.z / length)
    point = Vector(entry(c, one, two, 0), entry(c, one, two, 1), entry(c, one, two, 2))
    normal = Vector(entry(n, one, two, 0), entry(n, one, two, 1), entry(n, one, two, 2))
    return Nearest(side, point, normal, gap)


@inline
def entry(v: Vector, one: Axis, two: Axis, axis: int) -> float:
    """Return the component along coordinate axis `axis` of a vector v given along the sorted semi-axes."""
    return v.x if one.number == axis else (v.y if two.number == axis else v.z)


def power_above(length: float) -> float:
    """Return the smallest power of two greater than `length`."""
    return math.ldexp(1.0, math.frexp(length)[1])


@kernel
def sorted_axes(a: Axis, b: Axis, c: Axis) -> tuple[Axis, Axis, Axis]:
    """Sort three semi-axes from the longest to the shortest."""
    if a.length < b.length:
        a, b = b, a
    if b.length < c.length:
        b, c = c, b
    if a.length < b.length:
        a, b = b, a
    return a, b, c


@kernel
def near_side(h: Vector, u: Vector) -> Foot:
    """Find the point of an ellipsoid nearest to a finger, which has s >= 0.

    The equation |y(s)| = 1, where y_i = h_i u_i/(s + h_i^2 - h3^2), is solved by Newton's method for 1/|y|. Since 1/|y|
    is concave, iterates below the root increase and do not pass it; the initial s is a close lower bound. The last
    iterations use double-double arithmetic, because rounding errors grow near the evolute. If the result is s = 0, the
    finger is in the plane of the two longer semi-axes or, for h2 = h3, on the longest semi-axis.

    Args:
        h: Semi-axes h1 >= h2 >= h3.
        u: Absolute values of the finger's coordinates along the semi-axes.
    """
    d1, r1 = squares_apart(h.x, h.z)
    d2, r2 = squares_apart(h.y, h.z)
    k1, k2, k3 = h.x * u.x, h.y * u.y, h.z * u.z
    k = k3 if d2 > 0.0 else math.sqrt(k2 * k2 + k3 * k3)
    y1 = k1 / d1
    y2 = k2 / d2 if d2 > 0.0 else 0.0
    rest = y1 * y1 + y2 * y2  # |y|^2 at s = 0 without its unbounded term, and its slope
    slope = 2.0 * (y1 * y1 / d1 + (y2 * y2 / d2 if d2 > 0.0 else 0.0))
    above = rest - 1.0
    if k < SMALL or abs(above) < DOUBTFUL:
        y1, w1, _ = share(h.x, u.x, 0.0, 0.0, d1, r1)
        y2 = w2 = 0.0
        if d2 > 0.0:
            y2, w2, _ = share(h.y, u.y, 0.0, 0.0, d2, r2)
        above = norm_above_one(Vector(y1, y2, 0.0), Vector(w1, w2, 0.0))
        if k < SMALL and above <= 0.0:
            return Foot(True, 0.0, Vector(y1 + w1, y2 + w2, math.sqrt(-above)))
    s = max(k, k1 - d1, k2 - d2)
    if above > 0.0:
        s = max(s, above / slope)
    if k >= SMALL:
        s = max(s, lower_bound(k, max(-above, 0.0), slope))

    y = ZERO
    for _ in range(ROUNDS):
        y = Vector(k1 / (s + d1), k2 / (s + d2), k3 / s)
        square = dot(y, y)
        length = math.sqrt(square)
        if not length > 1.0 + RESOLVED:
            break
        s += (length - 1.0) * square / (y.x * y.x / (s + d1) + y.y * y.y / (s + d2) + y.z * y.z / s)
    if s > FAR:
        length = math.sqrt(dot(y, y))
        return Foot(True, s * length, y / length)
    r = 0.0
    w = ZERO
    for _ in range(ROUNDS):
        pairs = shares(h, u, s, r, Vector(d1, d2, 0.0), Vector(r1, r2, 0.0))
        y, w, t = pairs.y, pairs.w, pairs.t
        above = norm_above_one(y, w)
        slope = y.x * y.x / t.x + y.y * y.y / t.y + y.z * y.z / t.z
        step = above * (1.0 + above) / ((1.0 + math.sqrt(max(1.0 + above, 0.0))) * slope)
        if not abs(step) > CLOSE * s:
            w = Vector(w.x - y.x * (step / t.x), w.y - y.y * (step / t.y), w.z - y.z * (step / t.z))
            s += step
            break
        s, r = exact_sum(s, max(r + step, -0.5 * s))
    return Foot(True, s, y + w)


@kernel
def far_side(h: Vector, u: Vector) -> Foot:
    """Find the local minimum of the distance on the other side of the plane of the longer semi-axes, if it exists.

    The minimum has s < 0 and y3 < 0, with h, u and y as in `near_side`. The parameter s is the root of |y|^2 - 1 in the
    interval (h3^2 - h2^2, 0) that is nearest to 0. In this interval, |y|^2 - 1 is convex, so that Newton's method
    either decreases to the root or leaves the interval, in which case the minimum does not exist.
    """
    d1, r1 = squares_apart(h.x, h.z)
    d2, r2 = squares_apart(h.y, h.z)
    k1, k2, k3 = h.x * u.x, h.y * u.y, h.z * u.z
    if d2 <= 0.0 or k3 < SMALL:
        return Foot(False, 0.0, ZERO)
    y1, y2 = k1 / d1, k2 / d2
    left = 1.0 - y1 * y1 - y2 * y2
    if left <= 0.0:
        return Foot(False, 0.0, ZERO)
    s = -k3 / math.sqrt(left)
    for _ in range(ROUNDS):
        if not -d2 < s < 0.0:
            return Foot(False, 0.0, ZERO)
        y = Vector(k1 / (s + d1), k2 / (s + d2), k3 / s)
        slope = y.x * y.x / (s + d1) + y.y * y.y / (s + d2) + y.z * y.z / s
        if slope >= 0.0:
            return Foot(False, 0.0, ZERO)
        above = dot(y, y) - 1.0
        if not above > RESOLVED:
            break
        s += above / (2.0 * slope)
    r = 0.0
    y = w = ZERO
    for _ in range(ROUNDS):
        pairs = shares(h, u, s, r, Vector(d1, d2, 0.0), Vector(r1, r2, 0.0))
        y, w, t = pairs.y, pairs.w, pairs.t
        slope = y.x * y.x / t.x + y.y * y.y / t.y + y.z * y.z / t.z
        if slope >= 0.0:
            return Foot(False, 0.0, ZERO)
        step = norm_above_one(y, w) / (2.0 * slope)
        if not abs(step) > CLOSE * -s:
            w = Vector(w.x - y.x * (step / t.x), w.y - y.y * (step / t.y), w.z - y.z * (step / t.z))
            s += step
            break
        s, r = exact_sum(s, r + step)
        if not -d2 < s < 0.0:
            return Foot(False, 0.0, ZERO)
    return Foot(True, s, y + w)


def lower_bound(k: float, left: float, slope: float) -> float:
    """Return a lower bound of the root s of (k/s)^2 = left + slope s; the root is larger by at most a small factor."""
    bound = k / math.sqrt(2.0 * left) if left > 0.0 else math.inf
    if slope > 0.0:
        exponent = (2 * math.frexp(k)[1] - 3 - math.frexp(slope)[1]) // 3  # cube root of k^2/(2 slope), rounded down
        bound = min(bound, math.ldexp(1.0, exponent))
    return bound


def squares_apart(a: float, b: float) -> tuple[float, float]:
    """Compute a^2 - b^2 in double-double arithmetic."""
    p, pr = exact_product(a, a)
    q, qr = exact_product(b, b)
    s, sr = exact_sum(p, -q)
    return exact_sum(s, sr + (pr - qr))


@kernel
def shares(h: Vector, u: Vector, s: float, r: float, d: Vector, dr: Vector) -> Pairs:
    """Compute h_i u_i/((s + r) + (d_i + dr_i)) in double-double arithmetic, where r and dr_i are remainders."""
    y1, w1, t1 = share(h.x, u.x, s, r, d.x, dr.x)
    y2, w2, t2 = share(h.y, u.y, s, r, d.y, dr.y)
    y3, w3, t3 = share(h.z, u.z, s, r, d.z, dr.z)
    return Pairs(Vector(y1, y2, y3), Vector(w1, w2, w3), Vector(t1, t2, t3))


def share(h: float, u: float, s: float, r: float, d: float, dr: float) -> tuple[float, float, float]:
    """Compute h u/((s + r) + (d + dr)) in double-double arithmetic: leading part, remainder, and the divisor."""
    n, nr = exact_product(h, u)
    t, tr = exact_sum(s, d)
    t, tr = exact_sum(t, tr + (r + dr))
    y = n / t
    p, pr = exact_product(y, t)
    return y, ((n - p) - pr + nr - y * tr) / t, t


@kernel
def norm_above_one(y: Vector, w: Vector) -> float:
    """Compute |y + w|^2 - 1 in double-double arithmetic, where w is the remainder of y; return the rounded result."""
    a, ar = exact_product(y.x, y.x)
    b, br = exact_product(y.y, y.y)
    c, cr = exact_product(y.z, y.z)
    t, tr = exact_sum(a, b)
    s, sr = exact_sum(t, c)
    v, vr = exact_sum(s, -1.0)
    return v + (vr + (sr + tr) + (ar + br + cr) + 2.0 * dot(y, w))
