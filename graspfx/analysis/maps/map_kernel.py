"""The first limit of one point without delay and coupling dampers, in scalars that run interpreted and compiled."""

from __future__ import annotations

from collections.abc import Sequence
from math import acos, cos, cosh, exp, expm1, inf, sin, sinh, sqrt

WALL_WIDTH = 4  # numbers per point: m, b, T, k_s
EXTERNAL_WIDTH = 6  # m, b, T, k_s, m_v/n, b_v/n

TERMS = 20  # at most, of the series of `force_response`
DONE = 1e-18  # of the sum 1/2: terms of the series below it are nothing
WIDE = 0.5  # as in `discrete`
STIFF = 0.5
TRIM = 1e-12  # as in `critical`
REAL = 1e-4
LEAST = 1e-13
WIDTH = 1e-9
STEPS = 3
NEAR = 1e-9  # of a root: a step below it leaves an error of rounding, Newton's steps being quadratic
HALF_ROOT_3 = sqrt(0.75)


def wall_limits(points: Sequence[float], limits: list[float], start: int, stop: int) -> None:
    """Write limits[i] of points[4 i : 4 i + 4] = m, b, T, k_s for start <= i < stop; buffers of float64."""
    for i in range(start, stop):
        j = 4 * i
        limits[i] = wall_limit(points[j], points[j + 1], points[j + 2], points[j + 3])


def external_limits(points: Sequence[float], limits: list[float], start: int, stop: int, integrator: int) -> None:
    """Write limits[i] of points[6 i : 6 i + 6] = m, b, T, k_s, m_v/n, b_v/n; `integrator` counts `INTEGRATORS`."""
    m, b, T, k_s, rate = 0.0, 0.0, 0.0, 0.0, 0.0
    d0, d1, n0, n1 = 0.0, 0.0, 0.0, 0.0
    by_v, by_u, decay, response = 0.0, 0.0, 0.0, 0.0
    for i in range(start, stop):
        j = 6 * i
        M = points[j + 4]
        other_period = points[j + 2] != T
        T = points[j + 2]
        if other_period or points[j] != m or points[j + 1] != b or points[j + 3] != k_s:  # rows of a map share either
            m, b, k_s = points[j], points[j + 1], points[j + 3]
            d0, d1, n0, n1 = device(m, b, T, k_s)
        if other_period or points[j + 5] / M != rate:
            rate = points[j + 5] / M
            by_v, by_u, decay, response = object_step(integrator, rate, T)
        at, above = (by_u * decay + by_v * response) / M, by_u / M
        is_exact = integrator == 3
        limits[i] = external_limit(
            m / (T * T), d0, d1, n0, n1, decay, at, at + above if is_exact else above, above if is_exact else 0.0
        )


def wall_limit(m: float, b: float, T: float, k_s: float) -> float:
    """Find the end of the stable k from zero on, D + k N of degree 2 in s = z - 1 (`characteristic.wall`)."""
    D0, D1, N0, N1 = device(m, b, T, k_s)
    a0, a1, a2 = D0, 2.0 * (D1 - D0), D0 - 2.0 * D1 + 4.0
    b0, b1, b2 = N0, 2.0 * (N1 - N0), N0 - 2.0 * N1
    h0, h1 = b1 * a0 - b0 * a1, b2 * a1 - b1 * a2
    y = -h0 / h1 if abs(h1) > TRIM * abs(h0) else -1.0
    unit = m / (T * T)
    least = LEAST * unit
    even, odd = b0 - y * b2, b1
    k_1 = gain(-((a0 - y * a2) * even + y * a1 * odd), even * even + y * odd * odd) if y > 0.0 else inf
    k_2, k_3 = gain(-a0, b0), gain(-a2, b2)
    begin = 0.0
    while True:
        end = inf
        for k in (k_1, k_2, k_3):
            if k > least and k > begin and k < end:
                end = k
        middle = 0.5 * (begin + end) if end < inf else 2.0 * begin + unit
        c0, c1, c2 = a0 + middle * b0, a1 + middle * b1, a2 + middle * b2
        stable = (c0 > 0.0 and c1 > 0.0 and c2 > 0.0) or (c0 < 0.0 and c1 < 0.0 and c2 < 0.0)
        if not stable and not (end < inf and end - begin <= WIDTH * end):
            return begin
        if end == inf:
            return inf
        begin = end


def external_limit(
    unit: float, d0: float, d1: float, n0: float, n1: float, decay: float, x0: float, x1: float, x2: float
) -> float:
    """Find that end for a device (n0 + n1 s)/(d0 + d1 s + s^2) and its share of the object, of degree 4.

    The object's position per force is (x0 + x1 s + x2 s^2)/(decay s + s^2) (`characteristic.external`).
    """
    D0, D1, D2, D3, D4 = 0.0, d0 * decay, d0 + d1 * decay, d1 + decay, 1.0
    N0 = x0 * d0
    N1 = n0 * decay + x0 * d1 + x1 * d0
    N2 = n0 + n1 * decay + x0 + x1 * d1 + x2 * d0
    N3 = n1 + x1 + x2 * d1
    N4 = x2
    while D0 == 0.0 and N0 == 0.0:  # a drift that no force opposes, put at z = 0
        D0, D1, D2, D3 = D1, D1 + D2, D2 + D3, D3 + D4
        N0, N1, N2, N3 = N1, N1 + N2, N2 + N3, N3 + N4
    a0, a1, a2 = D0, 2.0 * D1 - 4.0 * D0, 6.0 * (D0 - D1) + 4.0 * D2
    a3, a4 = 6.0 * D1 - 4.0 * D0 + 8.0 * (D3 - D2), D0 - 2.0 * D1 + 4.0 * D2 - 8.0 * D3 + 16.0 * D4
    b0, b1, b2 = N0, 2.0 * N1 - 4.0 * N0, 6.0 * (N0 - N1) + 4.0 * N2
    b3, b4 = 6.0 * N1 - 4.0 * N0 + 8.0 * (N3 - N2), N0 - 2.0 * N1 + 4.0 * N2 - 8.0 * N3 + 16.0 * N4
    y_1, y_2, y_3 = positive_roots(
        b1 * a0 - b0 * a1,
        b0 * a3 + b2 * a1 - b1 * a2 - b3 * a0,
        b1 * a4 + b3 * a2 - b2 * a3 - b4 * a1,
        b4 * a3 - b3 * a4,
    )
    k_1 = gain_at(y_1, a0, a1, a2, a3, a4, b0, b1, b2, b3, b4)
    k_2 = gain_at(y_2, a0, a1, a2, a3, a4, b0, b1, b2, b3, b4)
    k_3 = gain_at(y_3, a0, a1, a2, a3, a4, b0, b1, b2, b3, b4)
    k_4, k_5 = gain(-a0, b0), gain(-a4, b4)
    least = LEAST * unit
    begin = 0.0
    while True:
        end = inf
        for k in (k_1, k_2, k_3, k_4, k_5):
            if k > least and k > begin and k < end:
                end = k
        middle = 0.5 * (begin + end) if end < inf else 2.0 * begin + unit
        stable = is_hurwitz(a0 + middle * b0, a1 + middle * b1, a2 + middle * b2, a3 + middle * b3, a4 + middle * b4)
        if not stable and not (end < inf and end - begin <= WIDTH * end):
            return begin
        if end == inf:
            return inf
        begin = end


def device(m: float, b: float, T: float, k_s: float) -> tuple[float, float, float, float]:
    """Compute the denominator (d0, d1, 1) and the numerator (n0, n1), as `discrete.device`."""
    p, kappa = b / m, k_s / m
    R, Q = force_response(p, kappa, T)
    low = Q * (kappa * Q + p * R) + R * R
    return kappa * low, 2.0 * kappa * Q + p * R, low / m, Q / m


def force_response(p: float, kappa: float, T: float) -> tuple[float, float]:
    """Compute R and Q of x'' + p x' + kappa x = u, as `discrete.force_response`."""
    alpha = 0.5 * p
    discriminant = alpha * alpha - kappa
    root = sqrt(abs(discriminant))
    turn = root * T
    gap, slow = 0.0, 0.0
    if discriminant >= 0.0:
        gap = 2.0 * root
        slow = -kappa / (alpha + root) if alpha + root > 0.0 else 0.0
        R = exp(slow * T) * T * mean_exponential(-gap * T)
    else:
        R = exp(-alpha * T) * T * (sin(turn) / turn if turn > 0.0 else 1.0)
    if gap * T > WIDE:
        return R, T * (mean_exponential(slow * T) - mean_exponential(-(alpha + root) * T)) / gap
    if kappa * T * T >= STIFF:
        wave, slope = 1.0, 1.0
        if turn > 0.0:
            if discriminant >= 0.0:
                wave, slope = cosh(turn), sinh(turn) / turn
            else:
                wave, slope = cos(turn), sin(turn) / turn
        return R, (1.0 - exp(-alpha * T) * (wave + alpha * T * slope)) / kappa
    x, y = p * T, kappa * T * T
    before, term, total = 0.0, 1.0, 0.5
    for j in range(2, TERMS):
        before, term = term, -(x * term + y * before / (j - 1)) / j
        total += term / (j + 1)
        if abs(term) + abs(before) < DONE:
            break
    return R, T * T * total


def mean_exponential(x: float) -> float:
    """Compute (exp(x) - 1)/x."""
    return expm1(x) / x if x != 0.0 else 1.0


def object_step(integrator: int, rate: float, T: float) -> tuple[float, float, float, float]:
    """Compute (p, q, 1 - r, s) of an object's step, as `discrete.object_step`."""
    if integrator == 0:
        return T, 0.0, T * rate, T
    if integrator == 1:
        return T * (1.0 - T * rate), T * T, T * rate, T
    if integrator == 3:
        r = 1.0 / (1.0 + T * rate)
        return T * r, T * T * r, T * rate * r, T * r
    R, Q = force_response(rate, 0.0, T)
    if integrator == 4:
        return T * (1.0 - rate * R), T * R, rate * R, R
    return R, Q, rate * R, R


def gain(above: float, below: float) -> float:
    """Compute above/below, infinite where below is zero."""
    return above / below if below != 0.0 else inf


def gain_at(
    y: float,
    a0: float,
    a1: float,
    a2: float,
    a3: float,
    a4: float,
    b0: float,
    b1: float,
    b2: float,
    b3: float,
    b4: float,
) -> float:
    """Compute the gain whose root is on the circle at tan^2(theta/2) = y, infinite unless y is positive."""
    if not y > 0.0:
        return inf
    A, C = a0 + y * (y * a4 - a2), b0 + y * (y * b4 - b2)
    F, E = a1 - y * a3, b1 - y * b3
    return gain(-(A * C + y * F * E), C * C + y * E * E)


def is_hurwitz(c0: float, c1: float, c2: float, c3: float, c4: float) -> bool:
    """Test a quartic by Routh's array."""
    if c4 < 0.0:
        c0, c1, c2, c3, c4 = -c0, -c1, -c2, -c3, -c4
    if not (c0 > 0.0 and c1 > 0.0 and c2 > 0.0 and c3 > 0.0 and c4 > 0.0):
        return False
    below = c2 - c4 / c3 * c1
    return below > 0.0 and c1 - c3 / below * c0 > 0.0


def positive_roots(h0: float, h1: float, h2: float, h3: float) -> tuple[float, float, float]:
    """Find the positive real roots of a cubic, ascending coefficients, -1 for others; as `critical.positive_roots`."""
    least = TRIM * max(abs(h0), abs(h1), abs(h2), abs(h3))
    if abs(h3) > least:
        c, b, a = h0 / h3, h1 / h3, h2 / h3
        y_1, y_2, y_3 = cubic_roots(c, b, a)
        return polish_root(y_1, c, b, a, 1.0), polish_root(y_2, c, b, a, 1.0), polish_root(y_3, c, b, a, 1.0)
    if abs(h2) > least:
        c, b = h0 / h2, h1 / h2
        D = 0.25 * b * b - c
        if D < 0.0:
            y = -0.5 * b if REAL * REAL * c + D >= 0.0 else -1.0
            return polish_root(y, c, b, 1.0, 0.0), -1.0, -1.0
        q = -0.5 * b - sqrt(D) if b > 0.0 else -0.5 * b + sqrt(D)
        other = c / q if q != 0.0 else 0.0
        return polish_root(q, c, b, 1.0, 0.0), polish_root(other, c, b, 1.0, 0.0), -1.0
    if abs(h1) > least:
        return -h0 / h1, -1.0, -1.0
    return -1.0, -1.0, -1.0


def cubic_roots(c: float, b: float, a: float) -> tuple[float, float, float]:
    """Estimate the roots by Cardano's formula, -1 where a root is complex."""
    shift = a / 3.0
    p, q = b / 3.0 - shift * shift, shift * shift * shift + 0.5 * (c - shift * b)
    D = q * q + p * p * p
    if D <= 0.0:
        size = sqrt(max(-p, 0.0))
        cube = size * size * size
        angle = acos(min(max(-q / cube, -1.0), 1.0)) / 3.0 if cube > 0.0 else 0.0
        along, across = size * cos(angle), 2.0 * HALF_ROOT_3 * size * sin(angle)
        return 2.0 * along - shift, across - along - shift, -across - along - shift
    u = (abs(q) + sqrt(D)) ** (1.0 / 3.0)
    if q >= 0.0:
        u = -u
    v = -p / u if u != 0.0 else 0.0
    pair, imaginary = -0.5 * (u + v) - shift, HALF_ROOT_3 * (u - v)
    if imaginary * imaginary <= REAL * REAL * (pair * pair + imaginary * imaginary):
        return u + v - shift, pair, -1.0
    return u + v - shift, -1.0, -1.0


def polish_root(y: float, h0: float, h1: float, h2: float, h3: float) -> float:
    """Improve a positive root by Newton's steps as long as they lower |h|."""
    if not y > 0.0:
        return -1.0
    value = h0 + y * (h1 + y * (h2 + y * h3))
    for _ in range(STEPS):
        slope = h1 + y * (2.0 * h2 + y * 3.0 * h3)
        if slope == 0.0:
            break
        new = y - value / slope
        after = h0 + new * (h1 + new * (h2 + new * h3))
        if not (new > 0.0 and abs(after) < abs(value)):
            break
        step = abs(new - y)
        y, value = new, after
        if step <= NEAR * y:
            break
    return y
