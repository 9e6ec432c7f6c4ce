"""Eq. (4) on a state block: from displacements and rates to forces, no cone."""

from __future__ import annotations

import math
from typing import Any

from graspfx.coupling import block as at


def combine(S: Any, kep: float, ked: float, kip: float, kid: float) -> None:
    """f = P (kep e + ked e') + (I - P) (kip e + kid e') (eq. 4), as kip e + kid e' and one projection of one vector.

    Where there is a coefficient, what each mode adds to the internal force stays in the scratch.
    """
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    soft = S[at.COORDINATES] > 3.0
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        w = S[r + at.WEIGHT]
        if S[at.EQUAL] == 0.0:
            S[r + at.ROOT] = math.sqrt(w)
        for a in range(4 if soft else d):
            f = kip * S[r + at.DISPLACEMENT + a]
            if kid != 0.0:
                f += kid * S[r + at.RATE + a]
            S[r + at.LOCAL + a] = w * f
    if S[at.EQUAL] != 0.0:
        return
    width = 4 if soft else 3
    size = 1 + width * n
    ke, kd = kep - kip, ked - kid
    keep = at.scratch(n, int(S[at.COORDINATES])) if S[at.FRICTION] != 0.0 else -1
    # where nothing turns, the modes are the free translations: known before the program runs
    for k in range(int(S[at.COUNT]) if S[at.TURNS] != 0.0 else int(S[at.SHIFTS])):
        q = at.modes(n) + k * size + 1
        z = 0.0
        for i in range(n):
            r = at.ROW + i * at.STRIDE
            inner = 0.0
            for a in range(4 if soft else d):
                g = ke * S[r + at.DISPLACEMENT + a]
                if kd != 0.0:
                    g += kd * S[r + at.RATE + a]
                inner += S[q + width * i + a] * g
            z += S[r + at.ROOT] * inner
        z *= S[q - 1]
        if keep >= 0:
            S[keep + k] = z
        for i in range(n):
            r = at.ROW + i * at.STRIDE
            share = z * S[r + at.ROOT]
            for a in range(4 if soft else d):
                S[r + at.LOCAL + a] += share * S[q + width * i + a]


def keep_elastic(S: Any) -> None:
    """Keeps the forces in LOCAL, to which damping has not been added yet."""
    for i in range(int(S[at.FINGERS])):
        r = at.ROW + i * at.STRIDE
        for a in range(4):
            S[r + at.ELASTIC + a] = S[r + at.LOCAL + a]


def combine_matrices(S: Any, elastic: bool, damping: bool) -> None:
    """f = K e + D e' with the squares that stand in the block."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    m = n * d
    K = at.dense(n, int(S[at.COORDINATES]))
    for i in range(n):
        for a in range(d):
            p = i * d + a
            f = 0.0
            for j in range(n):
                r = at.ROW + j * at.STRIDE
                for b in range(d):
                    q = p * m + j * d + b
                    if elastic:
                        f += S[K + q] * S[r + at.DISPLACEMENT + b]
                    if damping:
                        f += S[K + m * m + q] * S[r + at.RATE + b]
            S[at.ROW + i * at.STRIDE + at.LOCAL + a] = f


def bilateral(S: Any, elastic: bool, damping: bool) -> None:
    """The law without cones into LOCAL: its elastic part, its damping part or both."""
    if S[at.DENSE] != 0.0:
        combine_matrices(S, elastic, damping)
        return
    e = 1.0 if elastic else 0.0
    r = 1.0 if damping else 0.0
    combine(
        S,
        e * S[at.EXTERNAL_STIFFNESS],
        r * S[at.EXTERNAL_DAMPING],
        e * S[at.INTERNAL_STIFFNESS],
        r * S[at.INTERNAL_DAMPING],
    )


def push(S: Any, i: int, d: int) -> float:
    """The normal force of finger i on the object [N]."""
    r = at.ROW + i * at.STRIDE
    total = 0.0
    for a in range(d):
        total += S[r + at.NORMAL + a] * S[r + at.LOCAL + a]
    return total
