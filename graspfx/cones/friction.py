"""Forces in products of friction cones: point contact with friction on a flat buffer, by semismooth Newton.

The law is f = f0 + K (e + s), with f_i in the cone |f_t| <= mu f_n of finger i and s the displacement that slipping and
letting go take away. Both laws are one return map with a dilatancy theta: f = R(t), t = f - c s for any c > 0.
Associated (theta = 1): R projects on the cone; with f0 = 0 f minimises 1/2 (f - K e)' K^-1 (f - K e) over the cones,
and there is one answer. Coulomb (theta = 0): f_n = max(t_n, 0), and f_t is scaled back to mu f_n; large mu may leave
several answers.

A finger has d coordinates: its normal, up to two tangents, and as the fourth the torsion of a soft finger in units of
its patch length, for which the cone is the elliptic limit surface (Howe and Cutkosky 1996).

Where `limits` (0: none) says from where on n limits [N] stand, each cone is cut off at |f_i| <= L_i (`cones.cut`): the
associated force still minimises the same function. There a coefficient below zero means another cone (NO_CONE,
HALF_SPACE), which is no matter of friction.
The slip s that comes out is then the cone's alone, so that what sticks at its limit stays where it holds.

A problem stands in one piece of the buffer from `o` on, m = n d, vectors contact by contact, the normal first:

    o            weight w_i per finger (not read for a square)
    + n          coefficient mu_i per finger
    + n          in: -1 holds a finger's force at zero; out: FREE, STICK or SLIDE (-1 stays)
    + n          e, m entries [m]
    + m          f0, m entries [N], in the cones
    + m          out: f, m entries [N]
    + m          out: s, m entries [m], exactly zero in what sticks
    + m          work, m entries
    + m          in and out: the unknowns, `count` entries; any start will do, the last sample's answer is the best
    + count      work, count (count + 7) entries
    ...          modes: `count` times beta_k and the m entries of q_k in contact frames (not there for a square)
"""

from __future__ import annotations

import math
from typing import Any

from graspfx.cones.cone import (
    STICK,
    compliant_share,
    eliminate,
    equations_of_modes,
    equations_of_square,
    jacobian_of_modes,
    jacobian_of_square,
    modes_offset,
    turn_back,
)
from graspfx.cones.cut import limit_width, shorten

COULOMB, ASSOCIATED, UNRESOLVED = 0, 1, 2  # which law the answer satisfies; unresolved: all forces are zero
ROUNDING = 1e-15  # where Newton stops, relative to the forces at hand
CLOSE = 1e-13  # what is taken where rounding ends the descent earlier
LEAST = 1e-6  # of the larger gain: what any smaller one counts as
STEPS = 100  # evaluations before Coulomb's law starts from elsewhere
DESCENT = 1000  # the same for the associated law: 200 were enough for gains 10^6 apart, 45 for 10^3
SHORTEST = 1e-2  # fraction of a Newton step before Coulomb's law starts from elsewhere
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)  # its multiples fill an interval evenly: the starts are the same every time
RESTARTS = 16  # where time does not matter: at kip/kep = 1000 and mu = 1.5 they leave 1 problem in 40 to the other law


def problem_size(n: int, d: int, count: int, square: bool) -> int:
    """Entries of a problem's piece; `count` is six at most, n d for a square."""
    return modes_offset(0, n, d, count) + (0 if square else count * (1 + n * d))


def turn_modes(
    S: Any, rows: int, stride: int, frame: int, n: int, d: int, modes: int, count: int, out: int
) -> None:  # fmt: skip
    """Rigid modes in the axes of the contacts' rows as contact coordinates (1 + n d entries each).

    A mode has 1 + 3 n entries, or 1 + 4 n where d is 4: the fourth is the torsion about the normal.
    """
    width = 4 if d > 3 else 3
    for k in range(count):
        q = modes + k * (1 + width * n)
        to = out + k * (1 + n * d)
        S[to] = S[q]
        for i in range(n):
            m = q + 1 + width * i
            for a in range(min(d, 3)):
                f = rows + i * stride + frame + 3 * a
                S[to + 1 + i * d + a] = S[f] * S[m] + S[f + 1] * S[m + 1] + S[f + 2] * S[m + 2]
            if d > 3:
                S[to + 1 + i * d + 3] = S[m + 3]


def friction_force(
    S: Any, o: int, n: int, d: int, count: int, external: float, internal: float, coulomb: bool, restarts: int,
    limits: int = 0, series: int = -1,
) -> tuple[int, float, int]:  # fmt: skip
    """Scalar gains: K = sqrt(W) [k_i I + (k_e - k_i) sum_k beta_k q_k q_k'] sqrt(W) (eq. 4), q_k orthonormal.

    f = sqrt(W) y, y = R(t), t = k_i sqrt(W) e + f0 / sqrt(W) - sum_k z_k q_k: at most six unknowns,
    kappa_k z_k = (k_i - kappa_k) q_k'(y - f0 / sqrt(W)) with kappa_k = k_i + (k_e - k_i) beta_k. A finger of weight 0
    has no force; a gain below 1e-6 of the other one counts as that. Coulomb's law is sought from the unknowns as they
    are, then from the associated answer, then `restarts` times from around that.

    `series` >= 0 is where one compliance C_i per finger stands: then (K^-1 + C)^-1 is in the place of K, C_i / w_i on
    each of finger i's coordinates.

    Returns the law of the answer, its residual |f - f0 - K (e + s)| [N] (f and s fulfil the law exactly), evaluations.
    """
    high = max(external, internal)
    if high <= 0.0:
        add_nothing(S, o, n, d, limits)
        return COULOMB if coulomb else ASSOCIATED, 0.0, 0
    used = count if external != internal else 0  # equal gains: no finger knows of another
    ke, ki = max(external, LEAST * high), max(internal, LEAST * high)
    return solve(S, o, n, d, used, ke, ki, -1, 0, True, coulomb, restarts, limits, series)


def friction_force_square(
    S: Any, o: int, n: int, d: int, square: int, lead: int, symmetric: bool, coulomb: bool, restarts: int,
    limits: int = 0,
) -> tuple[int, float, int]:  # fmt: skip
    """The same for any K > 0 in contact frames at `square`, `lead` entries per row; the n d unknowns are e + s.

    An asymmetric K has one associated answer too, but no convex function leads there: it can end unresolved.
    """
    m = n * d
    c = 0.0  # above every eigenvalue of K: there the associated problem is convex
    for p in range(m):
        total = 0.0
        for q in range(m):
            total += abs(S[square + p * lead + q])
        c = max(c, total)
    if c <= 0.0:
        add_nothing(S, o, n, d, limits)
        return COULOMB if coulomb else ASSOCIATED, 0.0, 0
    return solve(S, o, n, d, m, c, c, square, lead, symmetric, coulomb, restarts, limits, -1)


def solve(
    S: Any, o: int, n: int, d: int, count: int, external: float, internal: float, square: int, lead: int,
    symmetric: bool, coulomb: bool, restarts: int, limits: int, series: int,
) -> tuple[int, float, int]:  # fmt: skip
    """Coulomb from the unknowns as they are, from the associated answer, from around it; else the associated answer."""
    z = o + 3 * n + 5 * n * d
    kept = z + 4 * count
    total = 0.0
    for k in range(count):
        total += S[z + k]
    if not abs(total) <= 1e300:
        for k in range(count):
            S[z + k] = 0.0
    taken = 0
    if coulomb:
        found, residual, steps = newton(S, o, n, d, count, external, internal, square, lead, 0.0, False, limits, series)
        taken += steps
        if found:
            finish(S, o, n, d, internal, square, 0.0, limits, series)
            return COULOMB, residual, taken
        for k in range(count):
            S[z + k] = 0.0
    found, residual, steps = newton(S, o, n, d, count, external, internal, square, lead, 1.0, symmetric, limits, series)
    taken += steps
    if not found:
        clear(S, o, n, d)
        for k in range(count):
            S[z + k] = 0.0
        return UNRESOLVED, residual, taken
    if coulomb:
        far = 0.0
        for k in range(count):
            S[kept + k] = S[z + k]
            far = max(far, abs(S[z + k]))
        for start in range(restarts + 1):
            if start > 0:
                for k in range(count):
                    turn = ((start - 1) * count + k + 1) * GOLDEN
                    S[z + k] = far * (2.0 * (turn - math.floor(turn)) - 1.0)
                    if start % 2:
                        S[z + k] += S[kept + k]
            found, residual, steps = newton(
                S, o, n, d, count, external, internal, square, lead, 0.0, False, limits, series
            )
            taken += steps
            if found:
                finish(S, o, n, d, internal, square, 0.0, limits, series)
                return COULOMB, residual, taken
        for k in range(count):
            S[z + k] = S[kept + k]
        _, residual, steps = newton(S, o, n, d, count, external, internal, square, lead, 1.0, symmetric, limits, series)
        taken += steps
    finish(S, o, n, d, internal, square, 1.0, limits, series)
    return ASSOCIATED, residual, taken


def clear(S: Any, o: int, n: int, d: int) -> None:
    """No force and no slip."""
    for p in range(o + 3 * n + 2 * n * d, o + 3 * n + 4 * n * d):
        S[p] = 0.0
    for i in range(o + 2 * n, o + 3 * n):
        S[i] = min(S[i], 0.0)


def add_nothing(S: Any, o: int, n: int, d: int, limits: int) -> None:
    """No stiffness: f = f0, no slip."""
    clear(S, o, n, d)
    for i in range(n):
        r = o + 3 * n + n * d + i * d
        if S[o + 2 * n + i] >= 0.0 and (S[r] > 0.0 or (limits > 0 and S[o + n + i] < 0.0)):
            S[o + 2 * n + i] = STICK
            for p in range(r, r + d):
                S[p + n * d] = S[p]


def finish(S: Any, o: int, n: int, d: int, c: float, square: int, theta: float, limits: int, series: int) -> None:
    """Write f = sqrt(W) y and s = (y - t) / (c sqrt(W)), y before its limit, r_i c with compliances in series."""
    f, s, t = o + 3 * n + 2 * n * d, o + 3 * n + 3 * n * d, o + 3 * n + 4 * n * d
    for i in range(n):
        root = 1.0 if square >= 0 else math.sqrt(S[o + i])
        if limits > 0:
            turn_back(S, o, n, d, i, theta, limits)
        for p in range(i * d, i * d + d):
            S[s + p] = (S[f + p] - S[t + p]) / (c * root) if root > 0.0 else 0.0
            if series >= 0:
                S[s + p] /= compliant_share(S, series, i, c)
            S[f + p] *= root
        if limits > 0:
            shorten(S, f + i * d, limit_width(S, o + n + i, d), S[limits + i])


def newton(
    S: Any, o: int, n: int, d: int, count: int, external: float, internal: float, square: int, lead: int,
    theta: float, convex: bool, limits: int, series: int,
) -> tuple[bool, float, int]:  # fmt: skip
    """Semismooth Newton on g = 0 with a line search; returns whether it got there, the residual and the evaluations.

    With `convex` g belongs to the gradient of a convex function, which falls until it gets there; else |g| has to fall.
    """
    z = o + 3 * n + 5 * n * d
    g, dz, start, H = z + count, z + 2 * count, z + 3 * count, z + 8 * count
    merit = slope = residual = 0.0
    best = length = math.inf
    t = 1.0
    limit = DESCENT if convex else STEPS
    for step in range(limit):
        if square < 0:
            value, size, worst, residual = equations_of_modes(
                S, o, n, d, count, external, internal, theta, limits, series
            )
        else:
            value, size, worst, residual = equations_of_square(S, o, n, d, internal, square, lead, theta, limits)
        if worst <= ROUNDING * size or 0.5 * best < worst <= CLOSE * size:
            return True, residual, step + 1
        if convex:
            # halving the least |g| so far is no cycle, and not blind where the function's digits end
            better = worst <= 0.5 * best or value <= merit + 1e-4 * t * slope
        else:
            better = worst <= (1.0 - 1e-4 * t) * length
        if step > 0 and not better:
            t *= 0.5
            if t < (1e-9 if convex else SHORTEST):
                return False, residual, step + 1
            for k in range(count):
                S[z + k] = S[start + k] + t * S[dz + k]
            continue
        best = min(best, worst)
        merit, length, t = value, worst, 1.0
        for k in range(count):
            S[dz + k] = -S[g + k]
            S[start + k] = S[z + k]
        if square < 0:
            jacobian_of_modes(S, o, n, d, count, external, internal, theta, limits, series)
        else:
            jacobian_of_square(S, o, n, d, internal, square, lead, theta, limits)
        if not eliminate(S, H, dz, count):
            return False, residual, step + 1
        slope = 0.0
        for k in range(count):
            along = S[dz + k]
            if square >= 0:
                along *= internal  # the gradient is (c I - K) g
                for j in range(count):
                    along -= S[square + k * lead + j] * S[dz + j]
            slope += S[g + k] * along
        for k in range(count):
            S[z + k] += S[dz + k]
    return False, residual, limit
