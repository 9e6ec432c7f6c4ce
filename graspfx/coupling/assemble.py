"""The law as a matrix in contact frames, normals first: what is pivoted to find who touches."""

from __future__ import annotations

from typing import Any

from graspfx.coupling import block as at
from graspfx.coupling.law import bilateral
from graspfx.grasp.rigid_modes import gain_matrix


def assemble(S: Any, elastic: bool) -> int:
    """K with K e, or D with D e', in contact frames as a square and a vector; returns how many rows."""
    n = int(S[at.FINGERS])
    c = int(S[at.COORDINATES])
    m = n * c
    A = at.square(n)
    for p in range(m * m):
        S[A + p] = 0.0
    bilateral(S, elastic, not elastic)
    into_frames(S, at.LOCAL, at.vector(n, c))
    if elastic:
        add_gains(S, A, m, S[at.EXTERNAL_STIFFNESS], S[at.INTERNAL_STIFFNESS], 1.0, 0.0)
    else:
        add_gains(S, A, m, S[at.EXTERNAL_DAMPING], S[at.INTERNAL_DAMPING], 0.0, 1.0)
    for p in range(m):
        S[at.diagonal(n, c) + p] = S[A + p * m + p]
    return m


def add_gains(S: Any, out: int, size: int, external: float, internal: float, elastic: float, damping: float) -> None:
    """Adds a gain matrix in contact frames to a square at `out`: scalar gains, or elastic K + damping D."""
    n = int(S[at.FINGERS])
    d = int(S[at.COORDINATES])  # matrices are for points only, where it is d
    if S[at.DENSE] == 0.0:
        count = 0 if S[at.EQUAL] != 0.0 else int(S[at.COUNT])
        gain_matrix(
            S, at.ROW, at.STRIDE, at.WEIGHT, at.FRAME, n, d,
            at.modes(n), count, external, internal, out, size, at.scratch(n, d),
        )  # fmt: skip
        return
    m = n * d
    K = at.dense(n, d)
    for i in range(n):
        for j in range(n):
            for a in range(d):
                f = at.ROW + i * at.STRIDE + at.FRAME + 3 * a
                for b in range(d):
                    g = at.ROW + j * at.STRIDE + at.FRAME + 3 * b
                    total = 0.0
                    for p in range(d):
                        for q in range(d):
                            k = (i * d + p) * m + j * d + q
                            value = elastic * S[K + k] + damping * S[K + m * m + k]
                            total += S[f + p] * value * S[g + q]
                    S[out + (i * d + a) * size + j * d + b] += total


def into_frames(S: Any, what: int, q: int, stride: int = 0) -> None:
    """A vector of every finger's row as contact coordinates (normal, tangents, torsion) at q, `stride` (c) apart."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    c = int(S[at.COORDINATES])
    lead = stride if stride > 0 else c
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        for a in range(d):
            total = 0.0
            for b in range(d):
                total += S[r + at.FRAME + 3 * a + b] * S[r + what + b]
            S[q + i * lead + a] = total
        if c > d:
            S[q + i * lead + d] = S[r + what + d]


def out_of_frames(S: Any, q: int, what: int, stride: int = 0) -> None:
    """Contact coordinates at q, `stride` (c) apart, as a vector of every finger's row."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    c = int(S[at.COORDINATES])
    lead = stride if stride > 0 else c
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        for b in range(d):
            total = 0.0
            for a in range(d):
                total += S[r + at.FRAME + 3 * a + b] * S[q + i * lead + a]
            S[r + what + b] = total
        if c > d:
            S[r + what + d] = S[q + i * lead + d]
