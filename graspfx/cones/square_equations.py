"""Equations of a friction problem for any K > 0, a square matrix in contact frames: one unknown per coordinate."""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Table
from graspfx.cones.cone import turn_back
from graspfx.cones.cut import Face, cut_slope, is_plain, limit_width, shorten
from graspfx.cones.mode_equations import Merit, cut_value
from graspfx.cones.problem import SLIDE, STICK, ConeContact, FrictionProblem, tangent_of
from graspfx.spatial import Vector4, dot

SMALL = 1e-13  # relative to a square's largest row: regularises Newton's matrix if no contact touches


@kernel
def equations_of_square(problem: FrictionProblem, d: int, c: float, square: Table, theta: float) -> Merit:
    """Compute w = e + s, t = f0 + K w - c (w - e), g = f0 + K w - R(t); (c I - K) g is the gradient."""
    value = forces = worst = 0.0
    unknowns = problem.unknowns
    m = problem.count * d
    for i, contact in enumerate(problem.contacts):
        for a in range(d):
            p = i * d + a
            total = 0.0
            for q in range(m):
                total += square[p, q] * unknowns[q].value
            w, e, f0 = unknowns[p].value, contact.displacement[a], contact.base_force[a]
            right_side = f0 + total
            unknowns[p].gradient = right_side
            contact.trial[a] = right_side - c * (w - e)
            value += (0.5 * total + f0) * (c * w - total)
            forces += c * c * (w * w + e * e) + f0 * f0
    for contact in problem.contacts:
        turn_back(contact, d, theta, problem.limited)
        if problem.limited:
            contact.force, share = shorten(contact.force, limit_width(contact.coefficient, d), contact.limit)
            if share < 1.0:
                value += cut_value(contact, d)
    for i, contact in enumerate(problem.contacts):
        for a in range(d):
            unknown = unknowns[i * d + a]
            y = contact.force[a]
            unknown.gradient -= y
            value += 0.5 * y * y
            worst = max(worst, abs(unknown.gradient))
    return Merit(value, math.sqrt(forces), worst, worst)


@kernel
def jacobian_of_square(problem: FrictionProblem, d: int, c: float, square: Table, theta: float) -> None:
    """Compute K - R' (K - c I) of the last equations."""
    m = problem.count * d
    H = problem.jacobian
    for i, contact in enumerate(problem.contacts):
        face = turn_back(contact, d, theta, problem.limited)
        r = i * d
        if problem.limited and not is_plain(contact, d, contact.limit, face.status):
            add_cut_rows(problem, contact, r, d, c, square, theta, face)
            continue
        for a in range(r, r + d):
            for j in range(m):
                H[a, j] = 0.0 if face.status == STICK else square[a, j]
            H[a, a] += c if face.status == STICK else SMALL * c
        if face.status == SLIDE:
            subtract_edge(problem, contact, r, d, c, square, theta, face)


@kernel
def subtract_edge(
    problem: FrictionProblem, contact: ConeContact, r: int, d: int, c: float, square: Table, theta: float, face: Face
) -> None:
    """Subtract R' (K - c I) of a sliding contact from its rows, which begin with row r."""
    H = problem.jacobian
    mu = contact.coefficient
    share = 1.0 / (1.0 + theta * mu * mu)
    t = face.direction
    for j in range(problem.count * d):
        x = shifted_entries(square, r, d, j, c)
        along = dot(t, tangent_of(x))
        normal = share * (x.x + theta * mu * along)
        H[r, j] -= normal
        if d == 2:
            H[r + 1, j] -= mu * t.x * normal
        if d == 3:
            across = face.bend * (t.x * x.z - t.y * x.y)
            H[r + 1, j] -= mu * t.x * normal - t.y * across
            H[r + 2, j] -= mu * t.y * normal + t.x * across
        if d > 3:
            H[r + 1, j] -= mu * t.x * normal + face.bend * (x.y - t.x * along)
            H[r + 2, j] -= mu * t.y * normal + face.bend * (x.z - t.y * along)
            H[r + 3, j] -= mu * t.z * normal + face.bend * (x.t - t.z * along)


@kernel
def shifted_entries(square: Table, r: int, d: int, j: int, c: float) -> Vector4:
    """Read d entries of column j of K - c I from row r on, followed by zeros."""
    x1 = x2 = x3 = 0.0
    if d > 1:
        x1 = square[r + 1, j] - (c if j == r + 1 else 0.0)
    if d > 2:
        x2 = square[r + 2, j] - (c if j == r + 2 else 0.0)
    if d > 3:
        x3 = square[r + 3, j] - (c if j == r + 3 else 0.0)
    return Vector4(square[r, j] - (c if j == r else 0.0), x1, x2, x3)


@kernel
def add_cut_rows(
    problem: FrictionProblem, contact: ConeContact, r: int, d: int, c: float, square: Table, theta: float, face: Face
) -> None:
    """Write the rows of K - R' (K - c I) from row r on, for a contact whose force is at its limit."""
    H = problem.jacobian
    for j in range(problem.count * d):
        x = cut_slope(contact, d, theta, contact.limit, face, shifted_entries(square, r, d, j, c))
        H[r, j] = square[r, j] - x.x
        if d > 1:
            H[r + 1, j] = square[r + 1, j] - x.y
        if d > 2:
            H[r + 2, j] = square[r + 2, j] - x.z
        if d > 3:
            H[r + 3, j] = square[r + 3, j] - x.t
    for a in range(r, r + d):
        H[a, a] += SMALL * c
