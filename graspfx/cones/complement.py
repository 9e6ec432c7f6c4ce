"""Who touches and who does not: complementarity at every normal by principal pivoting, on a flat buffer."""

from __future__ import annotations

from typing import Any

ROUNDING = 1e-13  # what counts as no violation, relative to the largest force
SINGULAR = 1e-10  # what counts as no stiffness left, relative to what the coordinate had before others were released


def pivot(S: Any, square: int, lead: int, vector: int, size: int, j: int) -> None:
    """Principal pivot on j of y = q + M x: x_j and y_j change places (q in `vector`, M in `square`)."""
    inverse = 1.0 / S[square + j * lead + j]
    q = S[vector + j] * inverse
    for i in range(size):
        if i == j:
            continue
        factor = S[square + i * lead + j]
        if factor != 0.0:
            S[vector + i] -= factor * q
            factor *= inverse
            for k in range(size):
                if k != j:
                    S[square + i * lead + k] -= factor * S[square + j * lead + k]
            S[square + i * lead + j] = factor
    for k in range(size):
        S[square + j * lead + k] *= -inverse
    S[square + j * lead + j] = inverse
    S[vector + j] = -q


def release(S: Any, square: int, lead: int, vector: int, size: int, m: int, marks: int, diagonal: int) -> None:
    """Pivots the marked ones (1.0) of m coordinates so that they carry no force; clears their marks.

    The stiffest first: a singular stiffness then shows as pivots of rounding size, and what no stiffness reaches
    carries no force already.
    """
    while True:
        best = SINGULAR
        chosen = -1
        for j in range(m):
            if S[marks + j] != 0.0 and S[diagonal + j] > 0.0:
                share = S[square + j * lead + j] / S[diagonal + j]
                if share > best:
                    best = share
                    chosen = j
        if chosen < 0:
            break
        pivot(S, square, lead, vector, size, chosen)
        S[marks + chosen] = 0.0
    for j in range(m):
        if S[marks + j] != 0.0:
            S[marks + j] = 0.0
            S[vector + j] = 0.0


def complement(
    S: Any, square: int, lead: int, vector: int, size: int, n: int, d: int, block: bool, back: bool,
    state: int, diagonal: int, scale: float,
) -> int:  # fmt: skip
    """Finds f_n >= 0, s_n >= 0, f_n s_n = 0 at every normal by principal pivoting; returns 0, or 1 if unresolved.

    Coordinates are contact by contact, the normal first (index i d). `state` has per finger 1 engaged, 0 released, -1
    not to be touched. `block` releases a finger's tangents with its normal; without `back` a released one stays so. In
    `vector` an engaged normal has its force and a released one its displacement s. `scale` is the size of the forces.
    The worst violation first; after 3 n pivots the first one, which ends for every matrix with positive principal
    minors (Murty 1974).
    """
    limit = 20 * n + 40
    for step in range(limit):
        worst = 0.0
        chosen = -1
        for i in range(n):
            j = i * d
            if S[state + i] < 0.0 or S[diagonal + j] <= 0.0 or (S[state + i] == 0.0 and not back):
                continue
            value = S[vector + j]
            if S[state + i] == 0.0:
                value *= S[diagonal + j]  # a displacement, compared as the force it would make
            if value < worst and value < -ROUNDING * scale:
                chosen = i
                if step >= 3 * n:
                    break
                worst = value
        if chosen < 0:
            return 0
        j = chosen * d
        if S[square + j * lead + j] == 0.0:
            return 1
        pivot(S, square, lead, vector, size, j)
        if block:
            for a in range(1, d):
                if S[square + (j + a) * lead + j + a] == 0.0:
                    return 1
                pivot(S, square, lead, vector, size, j + a)
        S[state + chosen] = 1.0 - S[state + chosen]
    return 1


def settle(
    S: Any, square: int, lead: int, vector: int, displacement: int, n: int, d: int, block: bool, state: int
) -> None:
    """Forces of the engaged fingers, f = K e over them alone, zero elsewhere, into `vector`.

    The square holds their stiffness with all others released, so that where a free finger is costs no digits.
    """
    for i in range(n):
        for a in range(d):
            p = i * d + a
            total = 0.0
            if S[state + i] > 0.0 and (block or a == 0):
                for j in range(n):
                    if S[state + j] > 0.0:
                        for b in range(d if block else 1):
                            q = j * d + b
                            total += S[square + p * lead + q] * S[displacement + q]
                if a == 0:
                    total = max(total, 0.0)
            S[vector + p] = total
