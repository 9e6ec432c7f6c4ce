"""Data of a friction problem: contacts, unknowns, and workspace of the search.

The law is f = f0 + K (e + s). The force f_i of contact i lies in the cone |f_t| <= mu f_n, and s is the displacement
lost to slip and release. A contact has d coordinates: the normal and up to two tangents. For a soft finger, the fourth
coordinate is the torsion divided by the patch length. The cone of a soft finger is the elliptic limit surface (Howe and
Cutkosky 1996).
"""

from __future__ import annotations

from dataclasses import dataclass

from graspfx.compile.kernel import inline
from graspfx.compile.records import Floats, Many, Record, Table, floats, many, size_for, start_of, table
from graspfx.spatial import Vector, Vector4

MODES = 6  # largest number of modes of a rigid object
FREE, STICK, SLIDE = 0, 1, 2  # status of a contact
NO_FORCE = -1  # status: the contact is held at zero force


class ModePart(Record):
    """Motion of one contact in a mode."""

    motion: Vector4  # q_k in the contact's frame, orthonormal over all contacts


class ConeContact(Record):
    """Contact of a friction problem. Vectors are in the contact's frame; the first entry is along the normal."""

    weight: float  # w; not read by the square equations
    coefficient: float  # mu; a negative value selects another cone, if forces have limits (`cone`)
    status: int  # in: NO_FORCE or anything else; out: FREE, STICK or SLIDE, and NO_FORCE stays
    limit: float  # L, read if forces have limits [N]
    compliance: float  # C times w, read if compliances stand in series [m/N]
    displacement: Vector4  # e [m]
    base_force: Vector4  # f0, in the cone [N]
    force: Vector4  # f, out [N]
    slip: Vector4  # s, out, exactly zero if the contact sticks [m]
    trial: Vector4  # t, scratch
    lent: Vector4  # correction of f0 for a raised gain, scratch
    most: int  # number of modes for which there is space
    modes: Many[ModePart] = many("most")  # not read by the square equations


class Unknown(Record):
    """Unknown of a friction problem: z_k of a mode, or an entry of w = e + s for a square matrix."""

    value: float  # in and out; the best start is the last sample's solution
    share: float  # beta_k of a mode; the mode's sign if the problem is `flexible`
    gradient: float  # g, scratch
    start: float  # value at the start of a Newton step
    associated: float  # solution of the associated law
    pull: float  # correction of g while a zero gain is approached; else zero
    left: float  # u, v, b times the modes: a sliding contact has R' = u v' + bend b b'
    right: float
    across: float


class FrictionProblem(Record):
    """Friction problem: input, solution, and workspace of the search."""

    count: int  # number of contacts
    room: int  # number of unknowns for which there is space: MODES, or all coordinates of a square
    limited: bool  # each force is limited
    compliant: bool  # a compliance stands in series with each contact; not read by the square equations
    flexible: bool  # the modes define K^-1 (`equations`): vectors v_k of any length with signs, without shares
    modes: int  # number of modes in use; not read by the square equations
    started: int  # number of unknowns with a start value, from the last search or from the caller
    contact_entries: int  # number of entries of one contact
    unknowns: Many[Unknown] = many("room")
    step: Floats = floats("room")  # scratch
    jacobian: Table = table("room", "room")  # scratch
    contacts: Many[ConeContact] = many("count", "contact_entries")


@dataclass(frozen=True, slots=True)
class Gains:
    """Eigenvalues of K for scalar gains: k_e along the modes, and k_i orthogonal to the modes."""

    external: float  # k_e [N/m]
    internal: float  # k_i [N/m]


@dataclass(frozen=True, slots=True)
class Answer:
    """Law that a solution satisfies, its residual |f - f0 - K (e + s)| [N], and the number of evaluations."""

    law: int
    residual: float
    evaluations: int


def problem_size(contacts: int, room: int = MODES, most: int = MODES) -> int:
    """Return the number of entries of a problem.

    Arguments are the numbers of contacts and unknowns, and the largest number of modes.
    """
    return size_for(FrictionProblem, count=contacts, room=room, contact_entries=size_for(ConeContact, most=most))


def set_up(block: object, offset: int, contacts: int, room: int = MODES, most: int = MODES) -> FrictionProblem:
    """Set the sizes of a problem in a block of zeros, and return the problem."""
    problem = FrictionProblem(block, offset)
    problem.count, problem.room = contacts, room
    problem.contact_entries = size_for(ConeContact, most=most)
    for contact in problem.contacts:
        contact.most = most
    return problem


def choices(offset: int) -> list[int]:
    """List the entries of the problem at `offset` that are constant in a run: sizes and switches, but not the count."""
    names = ("room", "limited", "compliant", "flexible", "contact_entries")
    return [offset + start_of(FrictionProblem, name) for name in names]


@inline
def leading(v: Vector4, d: int) -> Vector4:
    """Return the first d entries of v, followed by zeros."""
    return Vector4(v.x, v.y if d > 1 else 0.0, v.z if d > 2 else 0.0, v.t if d > 3 else 0.0)


@inline
def tangent_of(v: Vector4) -> Vector:
    """Return the entries after the first, which is along the normal."""
    return Vector(v.y, v.z, v.t)


@inline
def with_tangent(normal: float, tangent: Vector) -> Vector4:
    """Join a normal entry and three tangential entries."""
    return Vector4(normal, tangent.x, tangent.y, tangent.z)


@inline
def dot4(a: Vector4, b: Vector4) -> float:
    """Compute the dot product of two vectors of four entries."""
    return a.x * b.x + a.y * b.y + a.z * b.z + a.t * b.t
