"""Complementarity of forces and displacements at normals, by principal pivoting."""

from __future__ import annotations

from dataclasses import dataclass

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Table

ROUNDING = 1e-13  # relative to the largest force: smaller violations are rounding
SINGULAR = 1e-10  # relative to the coordinate's stiffness before releases: a smaller pivot is zero


@dataclass(frozen=True, slots=True)
class Contacts:
    """Size of a square matrix: the number of contacts, and the number of coordinates per contact, the normal first."""

    count: int  # number n of contacts
    coordinates: int  # number d of coordinates per contact
    whole: bool  # True if a contact releases its tangents together with its normal; otherwise only normals change


@kernel
def pivot(square: Table, vector: Floats, j: int) -> None:
    """Pivot on j of y = q + M x: exchange x_j and y_j (q in `vector`, M in `square`)."""
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
    """Pivot all marked coordinates (mark 1.0) among the first m, so that they carry no force, and clear their marks.

    The coordinate that retains the largest fraction of its stiffness is pivoted first. A singular stiffness then leads
    to pivots of rounding size. These are skipped, because coordinates without stiffness carry no force anyway.
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
    """Find f_n >= 0, s_n >= 0, f_n s_n = 0 at every normal by principal pivoting; return 0, or 1 if unresolved.

    Coordinates are ordered contact by contact, the normal first (index i d). `state` of a contact is 1 if it is
    engaged, 0 if released, and -1 if it must not change. If `contacts.whole`, a contact's tangents are released
    together with its normal. Without `back`, released contacts stay released. `vector` contains the force of an engaged
    normal, and the displacement s of a released normal. `scale` is the magnitude of the forces. Each pivot removes the
    worst violation or, after 3 n pivots, the first violation. The latter rule terminates for every matrix with positive
    principal minors (Murty 1974).
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
                value *= diagonal[j]  # a displacement, converted to a force for comparison
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
    """Write the forces to `vector`: f = K e over engaged contacts, with normal forces clamped at zero; else zero.

    Unless `contacts.whole`, forces act along normals only.

    The square matrix contains the stiffness of the engaged contacts with all other contacts released, so the position
    of a free finger causes no loss of digits.
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
