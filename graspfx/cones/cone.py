"""A friction cone's frame and return map, and the equations whose zero puts every finger's force in its own."""

from __future__ import annotations

import math
from typing import Any

from graspfx.cones.cut import HALF_SPACE, LIFT, ball_slope, cone_slope, force_size, limit_width, shorten

FREE, STICK, SLIDE = 0, 1, 2
NIL = 1e-30  # of the internal gain: a mode that differs by less is like all others
SMALL = 1e-13  # of a square's largest row: keeps Newton's matrix regular where nothing touches


def contact_frame(S: Any, normal: int, d: int, o: int) -> None:
    """Writes d orthonormal directions at o: the unit normal, then the tangents."""
    x, y, z = S[normal], S[normal + 1], S[normal + 2]
    S[o], S[o + 1], S[o + 2] = x, y, z
    if d == 2:
        S[o + 3], S[o + 4], S[o + 5] = -y, x, 0.0
    if d == 3:
        # Duff et al. (2017): a basis without a branch that loses digits
        sign = 1.0 if z >= 0.0 else -1.0
        a = -1.0 / (sign + z)
        b = x * y * a
        S[o + 3], S[o + 4], S[o + 5] = 1.0 + sign * x * x * a, sign * b, -sign * x
        S[o + 6], S[o + 7], S[o + 8] = b, sign + y * y * a, -y


def modes_offset(o: int, n: int, d: int, count: int) -> int:
    """Where the modes of the problem at `o` stand."""
    return o + 3 * n + 5 * n * d + count * (count + 8)


def turn_back(
    S: Any, o: int, n: int, d: int, i: int, theta: float, limits: int = 0
) -> tuple[int, float, float, float, float]:
    """y_i = R(t_i) with its status; where it slides, the tangential direction and |y_t| / |t_t| for the Jacobian.

    The limit is not applied here. Only where there are `limits` a coefficient below zero means another cone than that
    of friction: none, or a half-space (`graspfx.cones.cut`).
    """
    m = n * d
    y, t = o + 3 * n + 2 * m + i * d, o + 3 * n + 4 * m + i * d
    mu = S[o + n + i]
    normal = S[t]
    t1 = S[t + 1] if d > 1 else 0.0
    t2 = S[t + 2] if d > 2 else 0.0
    t3 = S[t + 3] if d > 3 else 0.0
    tangent = math.sqrt(t1 * t1 + t2 * t2 + t3 * t3)
    held = S[o + 2 * n + i] < 0.0
    if limits > 0 and mu < 0.0 and not held:
        for a in range(d):
            S[y + a] = S[t + a]
        S[o + 2 * n + i] = STICK
        if mu == HALF_SPACE and normal < 0.0:
            S[y] = 0.0
            return LIFT, 0.0, 0.0, 0.0, 0.0
        return STICK, 0.0, 0.0, 0.0, 0.0
    if held or normal + theta * mu * tangent <= 0.0:
        for a in range(d):
            S[y + a] = 0.0
        if not held:
            S[o + 2 * n + i] = FREE
        return FREE, 0.0, 0.0, 0.0, 0.0
    if tangent <= mu * normal and mu > 0.0:
        for a in range(d):
            S[y + a] = S[t + a]
        S[o + 2 * n + i] = STICK
        return STICK, 0.0, 0.0, 0.0, 0.0
    S[o + 2 * n + i] = SLIDE
    S[y] = (normal + theta * mu * tangent) / (1.0 + theta * mu * mu)
    if tangent == 0.0 or mu == 0.0:
        for a in range(1, d):
            S[y + a] = 0.0
        return SLIDE, 0.0, 0.0, 0.0, 0.0
    bend = mu * S[y] / tangent
    for a in range(1, d):
        S[y + a] = bend * S[t + a]
    return SLIDE, t1 / tangent, t2 / tangent, t3 / tangent, bend


def equations_of_modes(
    S: Any, o: int, n: int, d: int, count: int, external: float, internal: float, theta: float, limits: int = 0,
    series: int = -1,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Trial, force and g for scalar gains; returns the convex function, the sizes of forces, g and residual.

    kappa < k_i: g = h z + Q'(f0 - y), h = kappa / (k_i - kappa). kappa > k_i: the same equation as
    g = h z + Q'(k_i e + y - t), h = k_i / (kappa - k_i). Both are gradients of strictly convex functions.

    With compliances in series finger i has 1/a_i = r_i k_i instead of k_i: t = f0 + r_i (k_i e - Q z), and for
    kappa > k_i g = h z + Q'(r_i k_i e + (1 - r_i) Q z + y - t).
    """
    m = n * d
    e, f0, f, t, z = o + 3 * n, o + 3 * n + m, o + 3 * n + 2 * m, o + 3 * n + 4 * m, o + 3 * n + 5 * m
    g = z + count
    Q = modes_offset(o, n, d, count) + 1
    soft = external < internal
    value = forces = worst = residual = 0.0
    for k in range(count):
        S[g + k] = 0.0
    for i in range(n):
        root = math.sqrt(S[o + i])
        part = compliant_share(S, series, i, internal)
        for p in range(i * d, i * d + d):
            trial = 0.0
            if root > 0.0:
                trial = internal * root * S[e + p] + S[f0 + p] / root
                for k in range(count):
                    trial -= S[Q + k * (m + 1) + p] * S[z + k]
                if series >= 0:
                    trial = S[f0 + p] / root + part * (trial - S[f0 + p] / root)
            S[t + p] = trial
        turn_back(S, o, n, d, i, theta, limits)
        if root == 0.0:
            continue
        if limits > 0:
            share = shorten(S, f + i * d, limit_width(S, o + n + i, d), S[limits + i] / root)
            if soft and share < 1.0:
                value += cut_value(S, f + i * d, t + i * d, d) / part
        for p in range(i * d, i * d + d):
            y, trial = S[f + p], S[t + p]
            forces += y * y + trial * trial
            if soft:
                known, y = S[f0 + p] / root, -y
            else:
                known, y = internal * root * S[e + p], y - trial
            value += 0.5 * y * y / part if series >= 0 else 0.5 * y * y
            if series >= 0 and not soft:
                turn = 0.0
                for k in range(count):
                    turn += S[Q + k * (m + 1) + p] * S[z + k]
                known = part * known + (1.0 - part) * turn
                value -= 0.5 * (1.0 - part) * turn * turn
            for k in range(count):
                q = S[Q + k * (m + 1) + p]
                S[g + k] += q * (known + y)
                value += q * known * S[z + k]
    for k in range(count):
        h, gap = stiffening(S[Q + k * (m + 1) - 1], external, internal)
        S[g + k] += h * S[z + k]
        value += 0.5 * h * S[z + k] * S[z + k]
        forces += S[z + k] * S[z + k]
        worst = max(worst, abs(S[g + k]))
        off = gap * S[g + k]
        residual += off * off
    return value, math.sqrt(forces), worst, math.sqrt(residual)


def compliant_share(S: Any, series: int, i: int, internal: float) -> float:
    """Give r_i = 1 / (1 + k_i C_i), what a compliance in series leaves of finger i's gain; 1 without any."""
    return 1.0 / (1.0 + internal * S[series + i]) if series >= 0 else 1.0


def entries(S: Any, o: int, d: int) -> tuple[float, float, float, float]:
    """Give d entries from o on, zeros behind them."""
    x1 = S[o + 1] if d > 1 else 0.0
    x2 = S[o + 2] if d > 2 else 0.0
    x3 = S[o + 3] if d > 3 else 0.0
    return S[o], x1, x2, x3


def cut_value(S: Any, y: int, t: int, d: int) -> float:
    """Give y'(t - y), what a limit adds to 1/2 |y|^2 for the sum to have the gradient y."""
    total = 0.0
    for a in range(d):
        total += S[y + a] * (S[t + a] - S[y + a])
    return total


def is_plain(S: Any, o: int, n: int, d: int, i: int, limit: float, status: int) -> bool:
    """Tell whether y_i, as `turn_back` gave it, is neither longer than its limit nor on a half-space's edge."""
    return status != LIFT and not force_size(S, o + 3 * n + 2 * n * d + i * d, limit_width(S, o + n + i, d)) > limit


def cut_slope(
    S: Any, o: int, n: int, d: int, i: int, theta: float, limit: float,
    status: int, c1: float, c2: float, c3: float, bend: float, x0: float, x1: float, x2: float, x3: float,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Give R'x for a finger of any status, its limit applied."""
    x0, x1, x2, x3 = cone_slope(status, S[o + n + i], theta, c1, c2, c3, bend, x0, x1, x2, x3)
    return ball_slope(S, o + 3 * n + 2 * n * d + i * d, limit_width(S, o + n + i, d), limit, x0, x1, x2, x3)


def stiffening(beta: float, external: float, internal: float) -> tuple[float, float]:
    """h of a mode, and |kappa / k_i - 1|."""
    gap = max(abs(external - internal) * beta, NIL * internal)
    kappa = internal + (external - internal) * beta
    return (kappa if external < internal else internal) / gap, gap / internal


def jacobian_of_modes(
    S: Any, o: int, n: int, d: int, count: int, external: float, internal: float, theta: float, limits: int = 0,
    series: int = -1,
) -> None:  # fmt: skip
    """h + Q'R' Q, or h + Q'(I - R') Q, of the last equations; R' = u v' + bend b b' where a finger slides.

    With compliances in series r_i R' stands for the R' of finger i.
    """
    z = o + 3 * n + 5 * n * d
    u, v, b, H = z + 5 * count, z + 6 * count, z + 7 * count, z + 8 * count
    lead = n * d + 1
    Q = modes_offset(o, n, d, count) + 1
    soft = external < internal
    sign = 1.0 if soft else -1.0
    for k in range(count):
        for j in range(count):
            S[H + k * count + j] = 0.0
        S[H + k * count + k], _ = stiffening(S[Q + k * lead - 1], external, internal)
    for i in range(n):
        if S[o + i] == 0.0:
            continue
        status, c1, c2, c3, bend = turn_back(S, o, n, d, i, theta, limits)
        r = Q + i * d
        part = compliant_share(S, series, i, internal)
        if limits > 0 and not is_plain(S, o, n, d, i, S[limits + i] / math.sqrt(S[o + i]), status):
            limit = S[limits + i] / math.sqrt(S[o + i])
            for j in range(count):
                x0, x1, x2, x3 = entries(S, r + j * lead, d)
                y0, y1, y2, y3 = cut_slope(S, o, n, d, i, theta, limit, status, c1, c2, c3, bend, x0, x1, x2, x3)
                if series >= 0:
                    y0, y1, y2, y3 = part * y0, part * y1, part * y2, part * y3
                if not soft:
                    y0, y1, y2, y3 = x0 - y0, x1 - y1, x2 - y2, x3 - y3
                for k in range(count):
                    q0, q1, q2, q3 = entries(S, r + k * lead, d)
                    S[H + k * count + j] += q0 * y0 + q1 * y1 + q2 * y2 + q3 * y3
            continue
        if (status == STICK) == soft or (series >= 0 and status == STICK):
            for k in range(count):
                for j in range(k + 1):
                    more = 0.0
                    for a in range(d):
                        more += S[r + k * lead + a] * S[r + j * lead + a]
                    if series >= 0 and status == STICK:
                        more *= part if soft else 1.0 - part
                    S[H + k * count + j] += more
                    if j < k:
                        S[H + j * count + k] += more
        if status == SLIDE:
            mu = S[o + n + i]
            share = 1.0 / (1.0 + theta * mu * mu)
            for k in range(count):
                q = r + k * lead
                along = across = 0.0
                if d > 1:
                    along = c1 * S[q + 1]
                if d > 2:
                    along += c2 * S[q + 2]
                    across = c1 * S[q + 2] - c2 * S[q + 1]
                if d > 3:
                    along += c3 * S[q + 3]
                    across = along
                S[u + k], S[v + k], S[b + k] = S[q] + mu * along, share * (S[q] + theta * mu * along), across
            for k in range(count):
                left, bent = sign * S[u + k], sign * bend * S[b + k]
                if series >= 0:
                    left, bent = part * left, part * bent
                if d > 3:  # two directions across: all tangents less the one along
                    bent = -bent
                    for j in range(count):
                        more = 0.0
                        for a in range(1, d):
                            more += S[r + k * lead + a] * S[r + j * lead + a]
                        if series >= 0:
                            more *= part
                        S[H + k * count + j] += sign * bend * more
                for j in range(count):
                    S[H + k * count + j] += left * S[v + j] + bent * S[b + j]


def equations_of_square(
    S: Any, o: int, n: int, d: int, c: float, square: int, lead: int, theta: float, limits: int = 0
) -> tuple[float, float, float, float]:
    """The same for a square: w = e + s, t = f0 + K w - c (w - e), g = f0 + K w - R(t); (c I - K) g is the gradient."""
    m = n * d
    e, f0, f, t, w = o + 3 * n, o + 3 * n + m, o + 3 * n + 2 * m, o + 3 * n + 4 * m, o + 3 * n + 5 * m
    g = w + m
    value = forces = worst = 0.0
    for p in range(m):
        total = 0.0
        for q in range(m):
            total += S[square + p * lead + q] * S[w + q]
        S[g + p] = S[f0 + p] + total
        S[t + p] = S[g + p] - c * (S[w + p] - S[e + p])
        value += (0.5 * total + S[f0 + p]) * (c * S[w + p] - total)
        forces += c * c * (S[w + p] * S[w + p] + S[e + p] * S[e + p]) + S[f0 + p] * S[f0 + p]
    for i in range(n):
        turn_back(S, o, n, d, i, theta, limits)
        if limits > 0 and shorten(S, f + i * d, limit_width(S, o + n + i, d), S[limits + i]) < 1.0:
            value += cut_value(S, f + i * d, t + i * d, d)
    for p in range(m):
        S[g + p] -= S[f + p]
        value += 0.5 * S[f + p] * S[f + p]
        worst = max(worst, abs(S[g + p]))
    return value, math.sqrt(forces), worst, worst


def jacobian_of_square(
    S: Any, o: int, n: int, d: int, c: float, square: int, lead: int, theta: float, limits: int = 0
) -> None:
    """K - R' (K - c I) of the last equations."""
    m = n * d
    H = o + 3 * n + 5 * m + 8 * m
    for i in range(n):
        status, c1, c2, c3, bend = turn_back(S, o, n, d, i, theta, limits)
        r = i * d
        if limits > 0 and not is_plain(S, o, n, d, i, S[limits + i], status):
            add_cut_rows(S, o, n, d, i, c, square, lead, theta, S[limits + i], status, c1, c2, c3, bend)
            continue
        for a in range(r, r + d):
            for j in range(m):
                S[H + a * m + j] = 0.0 if status == STICK else S[square + a * lead + j]
            S[H + a * m + a] += c if status == STICK else SMALL * c
        if status != SLIDE:
            continue
        mu = S[o + n + i]
        share = 1.0 / (1.0 + theta * mu * mu)
        for j in range(m):
            normal, t1, t2, t3 = shifted_entries(S, square, lead, r, d, j, c)
            along = c1 * t1 + c2 * t2 + c3 * t3
            normal = share * (normal + theta * mu * along)
            S[H + r * m + j] -= normal
            if d == 2:
                S[H + (r + 1) * m + j] -= mu * c1 * normal
            if d == 3:
                across = bend * (c1 * t2 - c2 * t1)
                S[H + (r + 1) * m + j] -= mu * c1 * normal - c2 * across
                S[H + (r + 2) * m + j] -= mu * c2 * normal + c1 * across
            if d > 3:
                S[H + (r + 1) * m + j] -= mu * c1 * normal + bend * (t1 - c1 * along)
                S[H + (r + 2) * m + j] -= mu * c2 * normal + bend * (t2 - c2 * along)
                S[H + (r + 3) * m + j] -= mu * c3 * normal + bend * (t3 - c3 * along)


def shifted_entries(
    S: Any, square: int, lead: int, r: int, d: int, j: int, c: float
) -> tuple[float, float, float, float]:
    """Read the d entries from row r on in column j of K - c I, zeros behind them."""
    x1 = x2 = x3 = 0.0
    if d > 1:
        x1 = S[square + (r + 1) * lead + j] - (c if j == r + 1 else 0.0)
    if d > 2:
        x2 = S[square + (r + 2) * lead + j] - (c if j == r + 2 else 0.0)
    if d > 3:
        x3 = S[square + (r + 3) * lead + j] - (c if j == r + 3 else 0.0)
    return S[square + r * lead + j] - (c if j == r else 0.0), x1, x2, x3


def add_cut_rows(
    S: Any, o: int, n: int, d: int, i: int, c: float, square: int, lead: int, theta: float, limit: float,
    status: int, c1: float, c2: float, c3: float, bend: float,
) -> None:  # fmt: skip
    """Write the rows of K - R' (K - c I) that belong to a finger whose force its limit cuts."""
    m, r = n * d, i * d
    H = o + 3 * n + 13 * m
    for j in range(m):
        x0, x1, x2, x3 = shifted_entries(S, square, lead, r, d, j, c)
        x0, x1, x2, x3 = cut_slope(S, o, n, d, i, theta, limit, status, c1, c2, c3, bend, x0, x1, x2, x3)
        S[H + r * m + j] = S[square + r * lead + j] - x0
        if d > 1:
            S[H + (r + 1) * m + j] = S[square + (r + 1) * lead + j] - x1
        if d > 2:
            S[H + (r + 2) * m + j] = S[square + (r + 2) * lead + j] - x2
        if d > 3:
            S[H + (r + 3) * m + j] = S[square + (r + 3) * lead + j] - x3
    for a in range(r, r + d):
        S[H + a * m + a] += SMALL * c


def eliminate(S: Any, square: int, vector: int, size: int) -> bool:
    """Solves H x = r in place (H at `square`, r at `vector`), with row exchanges; False where a pivot is zero."""
    for p in range(size):
        top = p
        for i in range(p + 1, size):
            if abs(S[square + i * size + p]) > abs(S[square + top * size + p]):
                top = i
        if top != p:
            for j in range(p, size):
                a, b = square + p * size + j, square + top * size + j
                S[a], S[b] = S[b], S[a]
            S[vector + p], S[vector + top] = S[vector + top], S[vector + p]
        if not abs(S[square + p * size + p]) > 0.0:
            return False
        inverse = 1.0 / S[square + p * size + p]
        for i in range(p + 1, size):
            factor = S[square + i * size + p] * inverse
            if factor != 0.0:
                for j in range(p + 1, size):
                    S[square + i * size + j] -= factor * S[square + p * size + j]
                S[vector + i] -= factor * S[vector + p]
    for p in range(size - 1, -1, -1):
        total = S[vector + p]
        for j in range(p + 1, size):
            total -= S[square + p * size + j] * S[vector + j]
        S[vector + p] = total / S[square + p * size + p]
    return True
