"""The law as a matrix in contact frames, with the object's give in it under the implicit integrator."""

from __future__ import annotations

from typing import Any

from graspfx.coupling import block as at
from graspfx.coupling.law import bilateral
from graspfx.grasp.kernels import gain_matrix, pivot
from graspfx.objects import kernels as body


def assemble(S: Any, elastic: bool, damping: bool) -> int:
    """The square and the vector of the law (elastic, damping or both) in contact frames; returns how many rows.

    Under the implicit integrator the object's displacement u over the sample is unknown too: f = K (e - G'u) +
    D (e' - G'u / T) and G f = u / compliance; u is eliminated here, so that what remains has the object's give in it.
    """
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    implicit = S[at.IMPLICIT] != 0.0
    m = n * d
    shifts, turns = int(S[at.SHIFTS]), int(S[at.TURNS])
    size = m + (shifts + turns if implicit else 0)
    A, q = at.square(n), at.vector(n, d)
    for p in range(size * size):
        S[A + p] = 0.0
    bilateral(S, elastic, damping)
    into_frames(S, at.LOCAL, q)
    if elastic:
        add_gains(S, size, S[at.EXTERNAL_STIFFNESS], S[at.INTERNAL_STIFFNESS], 1.0, 0.0)
    if damping:
        per = 1.0 / S[at.PERIOD] if implicit else 1.0
        add_gains(S, size, per * S[at.EXTERNAL_DAMPING], per * S[at.INTERNAL_DAMPING], 0.0, per)
    if implicit:
        add_object(S, size, m, shifts, turns)
        for p in range(m, size):
            pivot(S, A, size, q, size, p)
    for p in range(m):
        S[at.diagonal(n, d) + p] = S[A + p * size + p]
    return size


def add_gains(S: Any, size: int, external: float, internal: float, elastic: float, damping: float) -> None:
    """Adds a gain matrix in contact frames to the square: scalar gains, or elastic K + damping D of the block."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    out = at.square(n)
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


def add_object(S: Any, size: int, m: int, shifts: int, turns: int) -> None:
    """The rows and columns of the object's displacement: -B G', G B and -(G B G' + 1/compliance)."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    T = S[at.PERIOD]
    A, q = at.square(n), at.vector(n, d)
    for u in range(shifts + turns):
        for p in range(m):
            along = 0.0
            across = 0.0
            for k in range(m):
                g = lever(S, u, shifts, k, d)
                along += S[A + p * size + k] * g
                across += g * S[A + k * size + p]
            S[A + p * size + m + u] = -along
            S[A + (m + u) * size + p] = across
    for u in range(shifts + turns):
        force = 0.0
        for k in range(m):
            force += lever(S, u, shifts, k, d) * S[q + k]
        S[q + m + u] = force
        for v in range(shifts + turns):
            total = 0.0
            for k in range(m):
                total += S[A + (m + u) * size + k] * lever(S, v, shifts, k, d)
            if u == v and u < shifts:
                total += (S[at.BODY + body.MASS] + T * S[at.BODY + body.VISCOSITY]) / (T * T)
            if u >= shifts and v >= shifts:
                for a in range(3):
                    inertia = S[at.BODY + body.INERTIA + a] + T * S[at.BODY + body.ROTATIONAL_VISCOSITY]
                    total += S[at.AXES + 3 * u + a] * S[at.AXES + 3 * v + a] * inertia / (T * T)
            S[A + (m + u) * size + m + v] = -total


def lever(S: Any, u: int, shifts: int, k: int, d: int) -> float:
    """One entry of G in contact frames: what force coordinate k does along the object's free direction u."""
    r = at.ROW + (k // d) * at.STRIDE
    f = r + at.FRAME + 3 * (k % d)
    o = at.AXES + 3 * u
    if u < shifts:
        return float(S[o] * S[f] + S[o + 1] * S[f + 1] + S[o + 2] * S[f + 2])
    c = r + at.CONTACT
    mx = S[c + 1] * S[f + 2] - S[c + 2] * S[f + 1]
    my = S[c + 2] * S[f] - S[c] * S[f + 2]
    mz = S[c] * S[f + 1] - S[c + 1] * S[f]
    return float(S[o] * mx + S[o + 1] * my + S[o + 2] * mz)


def into_frames(S: Any, what: int, q: int) -> None:
    """A vector of every finger's row as contact coordinates (normal, tangents) at q."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        for a in range(d):
            total = 0.0
            for b in range(d):
                total += S[r + at.FRAME + 3 * a + b] * S[r + what + b]
            S[q + i * d + a] = total


def out_of_frames(S: Any, q: int) -> None:
    """Contact coordinates at q as LOCAL forces."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        for b in range(d):
            total = 0.0
            for a in range(d):
                total += S[r + at.FRAME + 3 * a + b] * S[q + i * d + a]
            S[r + at.LOCAL + b] = total
