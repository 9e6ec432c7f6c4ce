"""Forces scaled into limits: less squeezing first, then less of all, in the cones, along the same wrench.

With a = P f, the least force of the same wrench that the contacts carry, and b = f - a, which squeezes only, what comes
out is alpha (a + lambda b): the largest lambda in [lambda_c, 1] with every |a_i + lambda b_i| <= L_i and alpha = 1, or
where there is none the lambda at which the longest in its limits is shortest and then alpha < 1. From lambda_c on all
forces are in their cones; below it a finger would slip, or pull. P is that of the points where the forces act, over the
components that are carried: along the normal alone without friction.
"""

from __future__ import annotations

import math
from typing import Any

from graspfx.coupling import block as at
from graspfx.spatial import write_orthogonal as orthogonalise

ROUNDING = 1e-15  # of a finger's force: by so much a force counts as inside its cone
LEAST = 1e-14  # of the longest of the wrench's directions among the contacts: a shorter one is none
TOUCHING = 1.0 + 4e-15  # of a limit with its margin: what the projection shortened counts as within it
HALVINGS = 60  # of an interval: what is left is rounding
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
SECTIONS = 80  # of an interval by the golden section


def scale(S: Any, elastic: bool) -> None:
    """Scale the forces in LOCAL into the limits, and with `elastic` those in ELASTIC by the same two numbers."""
    if not overload(S, 1.0, -1) > TOUCHING:
        return
    count = wrench_modes(S)
    project(S, at.LOCAL, count)
    low = least_squeeze(S)
    best = lightest(S, low)
    squeeze = best
    if overload(S, best, at.scratch_limits(S)) <= 1.0:
        squeeze = most_squeeze(S, best)
    load = overload(S, squeeze, at.scratch_limits(S))
    alpha = 1.0 / load if load > 1.0 else 1.0
    rescale(S, at.LOCAL, alpha, squeeze)
    if elastic:
        project(S, at.ELASTIC, count)
        rescale(S, at.ELASTIC, alpha, squeeze)


def rescale(S: Any, what: int, alpha: float, squeeze: float) -> None:
    """Put alpha (a + lambda (f - a)) for the force at `what`, a in the scratch."""
    for i in range(int(S[at.FINGERS])):
        f, a = at.ROW + i * at.STRIDE + what, at.scratch_limits(S) + 4 * i
        for k in range(4):
            S[f + k] = alpha * (S[a + k] + squeeze * (S[f + k] - S[a + k]))


def overload(S: Any, squeeze: float, a: int) -> float:
    """Give max |a_i + lambda b_i|/L_i of LOCAL, with a at the offset `a`; of LOCAL itself where that is below zero."""
    most = 0.0
    for i in range(int(S[at.FINGERS])):
        f = at.ROW + i * at.STRIDE + at.LOCAL
        total = 0.0
        for k in range(3):
            x = S[f + k]
            if a >= 0:
                x = S[a + 4 * i + k] + squeeze * (x - S[a + 4 * i + k])
            total += x * x
        most = max(most, math.sqrt(total) / (at.LIMIT_MARGIN * S[at.device_limits(S) + i]))
    return most


def capacity(S: Any, r: int) -> int:
    """Tell what the contact in row r carries: 0 nothing, 1 along the normal, 2 in all directions."""
    if S[at.ATTACHED] != 0.0:
        return 2
    if S[r + at.TOUCHING] == 0.0:
        return 0
    return 2 if S[at.STICK] != 0.0 or S[r + at.COEFFICIENT] > 0.0 else 1


def wrench_modes(S: Any) -> int:
    """Write orthonormal directions of contact forces that have a wrench, over what is carried; returns how many.

    They span G' of the free freedoms, G with the arms of the points where forces act. What is carried along the normal
    alone has one coordinate, the first of the contact's four.
    """
    n = int(S[at.FINGERS])
    shifts, turns = int(S[at.SHIFTS]), int(S[at.TURNS])
    size, q = 1 + 4 * n, at.limit_modes(S)
    for k in range(shifts + turns):
        u = at.AXES + 3 * k
        for i in range(n):
            r, to = at.ROW + i * at.STRIDE, q + k * size + 1 + 4 * i
            kind = capacity(S, r)
            x, y, z, t = S[u], S[u + 1], S[u + 2], 0.0
            if k >= shifts:
                px, py, pz = S[r + at.CONTACT], S[r + at.CONTACT + 1], S[r + at.CONTACT + 2]
                if S[at.AT_CONTACT] == 0.0:
                    e = r + at.DISPLACEMENT
                    px, py, pz = px + S[e], py + S[e + 1], pz + S[e + 2]
                x, y, z = S[u + 1] * pz - S[u + 2] * py, S[u + 2] * px - S[u] * pz, S[u] * py - S[u + 1] * px
                if S[at.COORDINATES] > 3.0:
                    f = r + at.TWIST_AXIS
                    t = S[r + at.PATCH] * (S[u] * S[f] + S[u + 1] * S[f + 1] + S[u + 2] * S[f + 2])
            if kind == 1:
                m = r + at.NORMAL
                along = S[m] * x + S[m + 1] * y + S[m + 2] * z
                x, y, z, t = along, 0.0, 0.0, 0.0  # one coordinate: small directions have no rounding across it
            if kind == 0:
                x, y, z, t = 0.0, 0.0, 0.0, 0.0
            S[to], S[to + 1], S[to + 2], S[to + 3] = x, y, z, t
    orthogonalise(S, q, shifts + turns, size)
    return normalise(S, shifts + turns, size)


def normalise(S: Any, count: int, size: int) -> int:
    """Scale to unit length all directions that are not rounding; those come to stand first; returns their count."""
    q = at.limit_modes(S)
    longest = 0.0
    for k in range(count):
        S[q + k * size] = length(S, q + k * size, size)
        longest = max(longest, S[q + k * size])
    used = 0
    for k in range(count):
        norm = S[q + k * size]
        if norm > LEAST * longest:
            for j in range(1, size):
                S[q + used * size + j] = S[q + k * size + j] / norm
            used += 1
    return used


def length(S: Any, o: int, size: int) -> float:
    """Give the length of the direction at o, its first entry left out."""
    total = 0.0
    for j in range(1, size):
        total += S[o + j] * S[o + j]
    return math.sqrt(total)


def project(S: Any, what: int, count: int) -> None:
    """Put a = P f of the force at `what` into the scratch; twice, so that f - a has no wrench to rounding."""
    n = int(S[at.FINGERS])
    size, q, a = 1 + 4 * n, at.limit_modes(S), at.scratch_limits(S)
    for p in range(4 * n):
        S[a + p] = 0.0
    for _ in range(2):
        for k in range(count):
            o = q + k * size + 1
            along = 0.0
            for i in range(n):
                r = at.ROW + i * at.STRIDE
                f, m = r + what, r + at.NORMAL
                if capacity(S, r) == 1:
                    pushed = S[m] * S[f] + S[m + 1] * S[f + 1] + S[m + 2] * S[f + 2]
                    along += S[o + 4 * i] * (pushed - S[a + 4 * i])
                else:
                    for b in range(4):
                        along += S[o + 4 * i + b] * (S[f + b] - S[a + 4 * i + b])
            for p in range(4 * n):
                S[a + p] += along * S[o + p]
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        if capacity(S, r) == 1:
            m, pushed = r + at.NORMAL, S[a + 4 * i]
            for b in range(3):
                S[a + 4 * i + b] = pushed * S[m + b]


def depth_in_cone(S: Any, i: int, squeeze: float) -> float:
    """Give the depth of a_i + lambda b_i in its cone, and rounding [N]: mu f_n - |f_t|, or f_n; below zero outside."""
    r, a = at.ROW + i * at.STRIDE, at.scratch_limits(S) + 4 * i
    f, m = r + at.LOCAL, r + at.NORMAL
    x = S[a] + squeeze * (S[f] - S[a])
    y = S[a + 1] + squeeze * (S[f + 1] - S[a + 1])
    z = S[a + 2] + squeeze * (S[f + 2] - S[a + 2])
    t = S[a + 3] + squeeze * (S[f + 3] - S[a + 3])
    normal = x * S[m] + y * S[m + 1] + z * S[m + 2]
    slack = ROUNDING * math.sqrt(S[f] * S[f] + S[f + 1] * S[f + 1] + S[f + 2] * S[f + 2] + S[f + 3] * S[f + 3])
    mu = S[r + at.COEFFICIENT]
    if S[at.STICK] != 0.0 or mu == 0.0:
        return float(normal + slack)
    x, y, z = x - normal * S[m], y - normal * S[m + 1], z - normal * S[m + 2]
    return float(mu * normal - math.sqrt(x * x + y * y + z * z + t * t) + slack)


def least_squeeze(S: Any) -> float:
    """Find lambda_c, from which on every force is in its cone up to lambda = 1: it is a concave depth's zero."""
    least = 0.0
    if S[at.ATTACHED] != 0.0:
        return least
    for i in range(int(S[at.FINGERS])):
        if capacity(S, at.ROW + i * at.STRIDE) != 0 and depth_in_cone(S, i, least) < 0.0:
            low, high = least, 1.0
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                if depth_in_cone(S, i, middle) < 0.0:
                    low = middle
                else:
                    high = middle
            least = high
    return least


def lightest(S: Any, low: float) -> float:
    """Find the lambda in [low, 1] with the least overload, which is convex in it."""
    a = at.scratch_limits(S)
    high = 1.0
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_left, at_right = overload(S, left, a), overload(S, right, a)
    for _ in range(SECTIONS):
        if at_left <= at_right:
            high, right, at_right = right, left, at_left
            left = high - GOLDEN * (high - low)
            at_left = overload(S, left, a)
        else:
            low, left, at_left = left, right, at_right
            right = low + GOLDEN * (high - low)
            at_right = overload(S, right, a)
    return left if at_left <= at_right else right


def most_squeeze(S: Any, low: float) -> float:
    """Find the largest lambda in [low, 1] without overload, where there is none at `low`."""
    a, high = at.scratch_limits(S), 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if overload(S, middle, a) <= 1.0:
            low = middle
        else:
            high = middle
    return low
