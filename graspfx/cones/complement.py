"""Who touches and who does not: complementarity at every normal by principal pivoting."""

from __future__ import annotations

from dataclasses import dataclass

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Table

ROUNDING = 1e-13  # what counts as no violation, relative to the largest force
SINGULAR = 1e-10  # what counts as no stiffness left, relative to what the coordinate had before others were released


@dataclass(frozen=True, slots=True)
class Contacts:
    """How many contacts a square is about, of how many coordinates each, the normal first."""

    count: int  # n
    coordinates: int  # d
    whole: bool  # a contact is released with its tangents; else only normals count


@kernel
def pivot(square: Table, vector: Floats, j: int) -> None:
    """Pivot on j of y = q + M x: x_j and y_j change places (q in `vector`, M in `square`)."""
    size = square.columns
    inverse = 1.0 / square[j, j]
    q = vector[j] * inverse
    for i in range(size):
        if i == j:
            continue
        factor = square[i, j]
        if factor != 0.0:
            vector[i] -= factor * q
            factor *= inverse
            for k in range(size):
                if k != j:
                    square[i, k] -= factor * square[j, k]
            square[i, j] = factor
    for k in range(size):
        square[j, k] *= -inverse
    square[j, j] = inverse
    vector[j] = -q


@kernel
def release(square: Table, vector: Floats, m: int, marks: Floats, diagonal: Floats) -> None:
    """Pivot the marked ones (1.0) of m coordinates so that they carry no force; clear their marks.

    The stiffest first: a singular stiffness then shows as pivots of rounding size, and what no stiffness reaches
    carries no force already.
    """
    while True:
        best = SINGULAR
        pick = -1
        for j in range(m):
            if marks[j] != 0.0 and diagonal[j] > 0.0:
                share = square[j, j] / diagonal[j]
                if share > best:
                    best = share
                    pick = j
        if pick < 0:
            break
        pivot(square, vector, pick)
        marks[pick] = 0.0
    for j in range(m):
        if marks[j] != 0.0:
            marks[j] = 0.0
            vector[j] = 0.0


@kernel
def complement(
    square: Table, vector: Floats, diagonal: Floats, state: Floats, contacts: Contacts, back: bool, scale: float
) -> int:
    """Find f_n >= 0, s_n >= 0, f_n s_n = 0 at every normal by principal pivoting; give 0, or 1 if unresolved.

    Coordinates are contact by contact, the normal first (index i d). `state` has per contact 1 engaged, 0 released, -1
    not to be touched. Whole contacts release tangents with their normal; without `back` a released one stays so. In
    `vector` an engaged normal has its force and a released one its displacement s. `scale` is the size of the forces.
    The worst violation first; after 3 n pivots the first one, which ends for every matrix with positive principal
    minors (Murty 1974).
    """
    n, d = contacts.count, contacts.coordinates
    limit = 20 * n + 40
    for step in range(limit):
        worst = 0.0
        pick = -1
        for i in range(n):
            j = i * d
            if state[i] < 0.0 or diagonal[j] <= 0.0 or (state[i] == 0.0 and not back):
                continue
            value = vector[j]
            if state[i] == 0.0:
                value *= diagonal[j]  # a displacement, compared as the force it would make
            if value < worst and value < -ROUNDING * scale:
                pick = i
                if step >= 3 * n:
                    break
                worst = value
        if pick < 0:
            return 0
        j = pick * d
        if square[j, j] == 0.0:
            return 1
        pivot(square, vector, j)
        if contacts.whole:
            for a in range(1, d):
                if square[j + a, j + a] == 0.0:
                    return 1
                pivot(square, vector, j + a)
        state[pick] = 1.0 - state[pick]
    return 1


@kernel
def settle(square: Table, vector: Floats, displacement: Floats, state: Floats, contacts: Contacts) -> None:
    """Compute the forces of the engaged contacts, f = K e over them alone, zero elsewhere, into `vector`.

    The square holds their stiffness with all others released, so that where a free finger is costs no digits.
    """
    n, d = contacts.count, contacts.coordinates
    for i in range(n):
        for a in range(d):
            p = i * d + a
            total = 0.0
            if state[i] > 0.0 and (contacts.whole or a == 0):
                for j in range(n):
                    if state[j] > 0.0:
                        for b in range(d if contacts.whole else 1):
                            q = j * d + b
                            total += square[p, q] * displacement[q]
                if a == 0:
                    total = max(total, 0.0)
            vector[p] = total
