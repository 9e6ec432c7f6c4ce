"""Gains that are matrices: K and D of eq. (4) in the object's axes, made on the state block."""

from __future__ import annotations

import math
from typing import Any

from graspfx.coupling import block as at
from graspfx.coupling.approach import pose

WEIGHT_FLOOR = 1e-12  # a metric has to be positive; the cone takes what is left of a faded finger's force

ALONE, LITERAL, SYMMETRIC = 0, 1, 2  # the rule of a pair of gains: they are equal, or the form of the coupling
KEP, KED, KIP, KID = 0, 1, 2, 3
OBJECT, WORLD, CONTACT = 0, 1, 2  # the axes in which gains stand


def fill_gains(S: Any) -> None:
    """K and D, anew when a contact, a weight or the rotation has changed that they were made from."""
    if is_made(S):
        return
    n, d = int(S[at.FINGERS]), int(S[at.DIMENSIONS])
    K = at.dense(n, d)
    fill_pair(S, 0, KEP, KIP, K)
    fill_pair(S, 1, KED, KID, K + (n * d) * (n * d))


def is_made(S: Any) -> bool:
    """Whether nothing has changed since the last time; remembers what there is now."""
    n, d = int(S[at.FINGERS]), int(S[at.DIMENSIONS])
    o = at.made(n, d)
    same = bool(S[o] != 0.0)
    S[o] = 1.0
    if S[at.AXES_OF_GAINS] == WORLD or S[at.MIXED] != 0.0:
        R = pose(S)[1]
        for k in range(9):
            same = same and S[R + k] == S[o + 1 + k]
            S[o + 1 + k] = S[R + k]
    split = S[at.EQUAL] == 0.0
    for i in range(n):
        r, k = at.ROW + i * at.STRIDE, o + 10 + at.MADE * i
        same = same and S[r + at.WEIGHT] == S[k]
        S[k] = S[r + at.WEIGHT]
        if split:
            for a in range(d):
                same = same and S[r + at.CONTACT + a] == S[k + 1 + a]
                S[k + 1 + a] = S[r + at.CONTACT + a]
        if S[at.AXES_OF_GAINS] == CONTACT:
            for a in range(d):
                same = same and S[r + at.NORMAL + a] == S[k + 4 + a]
                S[k + 4 + a] = S[r + at.NORMAL + a]
    return same


def fill_pair(S: Any, pair: int, outer: int, inner: int, out: int) -> None:
    """E A + (I - E) B, or F A F' + H B H', of the external gain A and the internal one B, E = P on forces.

    With q_k the modes, b_k their blend, L^2 the weights, w_k = L q_k and u_k = L^-1 q_k: E = sum_k b_k w_k u_k',
    F = sum_k sqrt(b_k) w_k u_k', H = I - sum_k (1 - sqrt(1 - b_k)) w_k u_k'. Roots share a mode of blend b between both
    gains as b kep + (1 - b) kip, as the literal form does for numbers. Only u_k'A and u_k'B are needed, a row per mode,
    never a projector.
    """
    n, d = int(S[at.FINGERS]), int(S[at.DIMENSIONS])
    m = n * d
    rule = int(S[at.RULE + pair])
    spread(S, inner, out)
    if rule == ALONE:
        return
    A = at.square(n)  # of the projection, which comes later in the sample
    spread(S, outer, A)
    count = int(S[at.COUNT])
    U = at.made(n, d) + 10 + at.MADE * n
    W, V, Z = U + 6 * m, U + 12 * m, U + 18 * m
    whole = S[at.WHOLE + outer] != 0.0 or S[at.WHOLE + inner] != 0.0
    for k in range(count):
        o = at.modes(n) + k * (1 + 3 * n)
        for i in range(n):
            root = metric_root(S, i)
            for a in range(d):
                S[U + k * m + i * d + a] = S[o + 1 + 3 * i + a] / root
                S[W + k * m + i * d + a] = S[o + 1 + 3 * i + a] * root
        for i in range(n):
            first = 0 if whole else i * d
            last = m if whole else i * d + d
            for q in range(i * d, i * d + d):
                along = across = 0.0
                for p in range(first, last):
                    u, x = S[U + k * m + p], p * m + q
                    along += u * S[A + x]
                    across += u * S[out + x]
                S[V + k * m + q], S[Z + k * m + q] = along, across
    if rule == LITERAL:
        for k in range(count):
            v, z = V + k * m, Z + k * m
            for q in range(m):
                S[v + q] -= S[z + q]
            for p in range(m):
                w, row = S[at.modes(n) + k * (1 + 3 * n)] * S[W + k * m + p], out + p * m
                for q in range(m):
                    S[row + q] += w * S[v + q]
        keep_skew(S, pair, out)
    else:
        add_symmetric(S, count, U, out)


def add_symmetric(S: Any, count: int, U: int, out: int) -> None:
    """Adds F A F' + H B H' - B to B at `out`, symmetric to the last bit, from the rows that start at U."""
    n, d = int(S[at.FINGERS]), int(S[at.DIMENSIONS])
    m = n * d
    W, V, Z, C = U + 6 * m, U + 12 * m, U + 18 * m, U + 24 * m
    for k in range(count):
        outer, inner = roots(S[at.modes(n) + k * (1 + 3 * n)])
        for j in range(count):
            also, less = roots(S[at.modes(n) + j * (1 + 3 * n)])
            along = across = 0.0
            for q in range(m):
                along += S[V + k * m + q] * S[U + j * m + q]
                across += S[Z + k * m + q] * S[U + j * m + q]
            S[C + 6 * k + j] = outer * also * along + inner * less * across
    for k in range(count):
        _, inner = roots(S[at.modes(n) + k * (1 + 3 * n)])
        for q in range(m):
            total = 0.0
            for j in range(count):
                total += S[C + 6 * k + j] * S[W + j * m + q]
            S[V + k * m + q] = 0.5 * total - inner * S[Z + k * m + q]
    for p in range(m):
        for q in range(p + 1):
            total = S[out + p * m + q]
            for k in range(count):
                total += S[W + k * m + p] * S[V + k * m + q] + S[W + k * m + q] * S[V + k * m + p]
            S[out + p * m + q] = S[out + q * m + p] = total


def roots(blend: float) -> tuple[float, float]:
    """The factors of a mode in F and in I - H: the root of its blend, and what the root of the rest leaves of one."""
    return math.sqrt(blend), 1.0 - math.sqrt(1.0 - blend)


def spread(S: Any, gain: int, out: int) -> None:
    """Write a gain X as a square at `out` in the object's axes: L R'X R L of each finger, or R'X R if whole.

    R turns from the object's axes to those of the gain: the world's, or a finger's contact frame.
    """
    n, d = int(S[at.FINGERS]), int(S[at.DIMENSIONS])
    m = n * d
    X, whole = int(S[at.GAINS + gain]), S[at.WHOLE + gain] != 0.0
    R = pose(S)[1]
    for i in range(n):
        if S[at.AXES_OF_GAINS] == CONTACT:
            R = at.ROW + i * at.STRIDE + at.FRAME
        for j in range(n):
            if whole:
                turn_block(S, X + i * d * m + j * d, m, d, R, 1.0, out + i * d * m + j * d, m)
            elif i == j:
                weight = max(S[at.ROW + i * at.STRIDE + at.WEIGHT], WEIGHT_FLOOR)
                turn_block(S, X + i * d * d, d, d, R, weight, out + i * d * m + j * d, m)
            else:
                for a in range(d):
                    for b in range(d):
                        S[out + (i * d + a) * m + j * d + b] = 0.0


def turn_block(S: Any, X: int, lead: int, d: int, R: int, weight: float, out: int, row: int) -> None:
    """Write weight R'X R, d x d, at `out`; R is left out where gains stand in the object's axes or have none."""
    if S[at.AXES_OF_GAINS] == OBJECT:
        for a in range(d):
            for b in range(d):
                S[out + a * row + b] = weight * S[X + a * lead + b]
        return
    for b in range(d):
        x = y = z = 0.0
        for v in range(d):
            c = weight * S[R + 3 * v + b]
            x += S[X + v] * c
            y += S[X + lead + v] * c
            if d > 2:
                z += S[X + 2 * lead + v] * c
        for a in range(d):
            S[out + a * row + b] = S[R + a] * x + S[R + 3 + a] * y + S[R + 6 + a] * z


def keep_skew(S: Any, pair: int, square: int) -> None:
    """Keeps a square whose skew part, which creates energy on closed motions, is the largest so far."""
    n, d = int(S[at.FINGERS]), int(S[at.DIMENSIONS])
    m = n * d
    skew = 0.0
    for p in range(m):
        for q in range(p):
            apart = S[square + p * m + q] - S[square + q * m + p]
            skew += apart * apart
    if skew > S[at.SKEW + pair]:
        S[at.SKEW + pair] = skew
        kept = at.skewest(n, d) + pair * m * m
        for k in range(m * m):
            S[kept + k] = S[square + k]


def metric_root(S: Any, i: int) -> float:
    """The square root of finger i's weight."""
    return math.sqrt(max(S[at.ROW + i * at.STRIDE + at.WEIGHT], WEIGHT_FLOOR))
