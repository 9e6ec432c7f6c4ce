"""Damping that grows with depth: each finger has a compliant damper in series with the split one.

D_s = (D^-1 + C)^-1, C_i = (1 - s_i) / (s_i w_i b) on every coordinate of finger i, where s_i is the depth that the
elastic force stands for over the length `coupling.damping_depth`, at most 1, and b the larger of the two dampings. In
the second projection D_s stands for D: passive in every state, s_min D <= D_s <= D, and no step where a finger touches.
"""

from __future__ import annotations

from typing import Any

from graspfx.coupling import block as at
from graspfx.coupling.law import push

SMALLEST = 1e-200  # of s: its square is nothing


def damping_share(S: Any, i: int, normal: float) -> float:
    """Give s_i = min(1, n.f0_i / (w_i kip delta)) of finger i, from its elastic normal force [N]; 1 without a depth."""
    if S[at.GRADUAL] == 0.0:
        return 1.0
    kip = S[at.STIFFEST] if S[at.DENSE] != 0.0 else S[at.INTERNAL_STIFFNESS]
    whole = S[at.ROW + i * at.STRIDE + at.WEIGHT] * kip * S[at.DEPTH]
    return 1.0 if normal >= whole else max(float(normal / whole), SMALLEST)


def compliance(S: Any, i: int, normal: float) -> float:
    """Give w_i C_i = (1 - s_i) / (s_i b) of finger i, from its elastic normal force [m/(N s)]."""
    s = damping_share(S, i, normal)
    if S[at.DENSE] != 0.0:
        return float((1.0 - s) / (s * max(S[at.STIFFEST + 1], S[at.STIFFEST + 2])))
    return float((1.0 - s) / (s * max(S[at.EXTERNAL_DAMPING], S[at.INTERNAL_DAMPING])))


def is_whole(S: Any) -> bool:
    """Tell whether every finger is so deep that D_s is D, with the elastic forces in LOCAL."""
    if S[at.GRADUAL] == 0.0:
        return True
    least = 1.0
    for i in range(int(S[at.FINGERS])):
        least = min(least, damping_share(S, i, push(S, i, int(S[at.DIMENSIONS]))))
    return least >= 1.0


def pose_compliances(S: Any, o: int) -> None:
    """Put the compliances in series, where there are any, into the friction problem at o.

    The problem's elastic force f0 has to be there, and which fingers have no force.
    """
    if S[at.GRADUAL] == 0.0:
        return
    first = at.cones(S, o)
    for i in range(int(S[at.FINGERS])):
        r = first + i * at.CONE
        S[r + at.CONE_COMPLIANCE] = 0.0 if S[r + at.CONE_STATUS] < 0.0 else compliance(S, i, S[r + at.CONE_BASE])


def soften(S: Any, square: int, m: int, vector: int, per: float, start: int, stride: int = 0) -> None:
    """Change D to D_s and D e' to D_s e' in place, `per` times both, in contact frames; f0 stands at `start`,
    its fingers `stride` (c) apart.

    A compliance 1/g in series with coordinate p takes D e_p e_p'D / (g + D_pp) from D: one coordinate after another,
    of fingers that touch. What pivots are measured by becomes D_s's diagonal. Without a vector, `vector` is -1.
    """
    if S[at.GRADUAL] == 0.0:
        return
    n, c = int(S[at.FINGERS]), int(S[at.COORDINATES])
    lead = stride if stride > 0 else c
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        C = compliance(S, i, S[start + i * lead]) if S[r + at.TOUCHING] != 0.0 else 0.0
        if C > 0.0:
            g = per * S[r + at.WEIGHT] / C
            for p in range(i * c, i * c + c):
                add_compliance(S, square, m, vector, g, p)
    for p in range(m):
        S[at.diagonal(n, c) + p] = S[square + p * m + p]


def add_compliance(S: Any, square: int, m: int, vector: int, g: float, p: int) -> None:
    """Take M e_p e_p'M / (g + M_pp) from M at `square`, m x m, and the same from its product with a vector."""
    own = S[square + p * m + p]
    if not g + own > 0.0:
        return
    inverse = 1.0 / (g + own)
    share = g * inverse
    for j in range(m):
        factor = S[square + j * m + p]
        if j != p and factor != 0.0:
            scaled = factor * inverse
            for k in range(m):
                S[square + j * m + k] -= scaled * S[square + p * m + k]
            S[square + j * m + p] = share * factor
            if vector >= 0:
                S[vector + j] -= scaled * S[vector + p]
    for k in range(m):
        S[square + p * m + k] *= share
    if vector >= 0:
        S[vector + p] *= share
