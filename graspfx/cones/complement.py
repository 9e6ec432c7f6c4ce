"""Complementarity of contact forces and displacements along the normals, solved by principal pivoting."""

from __future__ import annotations

from dataclasses import dataclass

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Table

ROUNDING = 1e-13  # relative to the largest force: smaller violations are rounding
SINGULAR = 1e-10  # relative to the coordinate's stiffness before releases: a smaller pivot is zero


@dataclass(frozen=True, slots=True)
class Contacts:
    """Numbers of contacts and of coordinates per contact in a square matrix.

    The normal is the first coordinate of a contact.
    """

    count: int  # number n of contacts
    coordinates: int  # number d of coordinates per contact
    whole: bool  # True if a contact releases its tangents together with its normal; otherwise only normals change


@kernel
def pivot(square: Table, vector: Floats, j: int) -> None:
    """Exchange x_j and y_j in y = q + M x by a principal pivot; `vector` contains q, and `square` contains M."""
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
    """Pivot the marked coordinates among the first m, so that these coordinates carry no force, and clear their marks.

    A coordinate is marked if its entry of `marks` is not zero. The coordinate with the largest ratio of the current to
    the initial diagonal entry (`diagonal`) is pivoted first. If the stiffness is singular, the last pivots are
    therefore zero up to rounding errors. These pivots are skipped, because coordinates without stiffness carry no
    force.
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
    """Find normal forces f_n and displacements s_n with f_n >= 0, s_n >= 0, f_n s_n = 0; return 0, or 1 on failure.

    The method is principal pivoting.

    Coordinates are ordered contact by contact; the normal of contact i has the index i d. The entry of `state` is 1 for
    an engaged contact, 0 for a released contact, and -1 for a contact that must not change. If `contacts.whole` is
    true, a contact's tangents are released together with its normal. If `back` is false, released contacts stay
    released. The entry of `vector` is the force of an engaged normal or the displacement of a released normal. `scale`
    is the magnitude of the forces, relative to which violations are rounding errors. Each of the first 3 n pivots (n
    contacts) removes the worst violation, and each later pivot the first violation. Choosing the first violation
    terminates for every matrix with positive principal minors (Murty 1974).
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
    """Write the contact forces to `vector`: K e for engaged contacts, zero for all other contacts.

    K is `square` and e is `displacement`. Negative normal forces are set to zero.

    If `contacts.whole` is false, forces act only along normals.

    K is the stiffness of the engaged contacts after the release of all other contacts, so the displacements of free
    fingers do not enter the sums and cause no loss of digits.
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
