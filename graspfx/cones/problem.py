"""A problem of friction cones as it stands in a block: contacts, the unknowns that are sought, room for the search.

The law is f = f0 + K (e + s), with f_i in the cone |f_t| <= mu f_n of contact i and s the displacement that slipping
and letting go take away. A contact has d coordinates: its normal, up to two tangents, and as the fourth the torsion of
a soft finger in units of its patch length, for which the cone is the elliptic limit surface (Howe and Cutkosky 1996).
"""

from __future__ import annotations

from dataclasses import dataclass

from graspfx.compile.kernel import inline
from graspfx.compile.records import Floats, Many, Record, Table, floats, many, size_for, start_of, table
from graspfx.spatial import Vector, Vector4

MODES = 6  # at most, of a rigid object
FREE, STICK, SLIDE = 0, 1, 2  # status of a contact
NO_FORCE = -1  # status: the contact is kept at zero force, whatever it would take


class ModePart(Record):
    """A mode's part at one contact."""

    motion: Vector4  # q_k in the contact's frame, orthonormal over all contacts


class ConeContact(Record):
    """A contact of a friction problem, vectors in its own frame, the normal first."""

    weight: float  # w; not read for a square
    coefficient: float  # mu; below zero another cone than that of friction, where forces have limits (`cut`)
    status: int  # in: NO_FORCE or anything else; out: FREE, STICK or SLIDE, and NO_FORCE stays
    limit: float  # L, read where forces have limits [N]
    compliance: float  # C times w, read where compliances stand in series [m/N]
    displacement: Vector4  # e [m]
    base_force: Vector4  # f0, in the cone [N]
    force: Vector4  # f, out [N]
    slip: Vector4  # s, out, exactly zero in what sticks [m]
    trial: Vector4  # t, work
    lent: Vector4  # what a raised gain has been taken off f0 for, work
    most: int  # modes that there is space for
    modes: Many[ModePart] = many("most")  # not read for a square


class Unknown(Record):
    """An unknown of a friction problem: a mode's z_k, or for a square an entry of w = e + s."""

    value: float  # in and out: any start will do, the last sample's answer is the best
    share: float  # beta_k of a mode; where modes carry their flexibility, its sign
    gradient: float  # g, work
    start: float  # of a Newton step
    associated: float  # answer of the associated law
    pull: float  # what is taken off g where a gain of zero is approached; zero else
    left: float  # u, v, b: a sliding contact's R' = u v' + bend b b', times the modes
    right: float
    across: float


class FrictionProblem(Record):
    """A friction problem: what is asked for, the answer, and room for the search."""

    count: int  # contacts
    room: int  # unknowns that there is space for: MODES, or all coordinates of a square
    limited: bool  # each force is cut off at its limit
    compliant: bool  # a compliance stands in series with each contact; not read for a square
    flexible: bool  # modes carry their flexibility (`mode_equations`): no share of theirs, and of any length
    modes: int  # that are in use; not read for a square
    started: int  # unknowns that have a start: those of the last search, or those that its caller has set
    contact_entries: int  # of one contact
    unknowns: Many[Unknown] = many("room")
    step: Floats = floats("room")  # work
    jacobian: Table = table("room", "room")  # work
    contacts: Many[ConeContact] = many("count", "contact_entries")


@dataclass(frozen=True, slots=True)
class Gains:
    """The eigenvalues of K that scalar gains have: along the modes, and across."""

    external: float  # k_e [N/m]
    internal: float  # k_i [N/m]


@dataclass(frozen=True, slots=True)
class Answer:
    """Law of an answer, its residual |f - f0 - K (e + s)| [N], and how often the equations were evaluated."""

    law: int
    residual: float
    evaluations: int


def problem_size(contacts: int, room: int = MODES, most: int = MODES) -> int:
    """Count the entries of a problem for so many contacts, unknowns and modes."""
    return size_for(FrictionProblem, count=contacts, room=room, contact_entries=size_for(ConeContact, most=most))


def set_up(block: object, offset: int, contacts: int, room: int = MODES, most: int = MODES) -> FrictionProblem:
    """Set the sizes of the problem that stands in a block of zeros, and give it."""
    problem = FrictionProblem(block, offset)
    problem.count, problem.room = contacts, room
    problem.contact_entries = size_for(ConeContact, most=most)
    for contact in problem.contacts:
        contact.most = most
    return problem


def choices(offset: int) -> list[int]:
    """List the entries of the problem at an offset that never change in a run but for its count: sizes and switches."""
    names = ("room", "limited", "compliant", "flexible", "contact_entries")
    return [offset + start_of(FrictionProblem, name) for name in names]


@inline
def leading(v: Vector4, d: int) -> Vector4:
    """Give the first d entries of v, zeros behind them."""
    return Vector4(v.x, v.y if d > 1 else 0.0, v.z if d > 2 else 0.0, v.t if d > 3 else 0.0)


@inline
def tangent_of(v: Vector4) -> Vector:
    """Give what is not along the normal."""
    return Vector(v.y, v.z, v.t)


@inline
def with_tangent(normal: float, tangent: Vector) -> Vector4:
    """Put a normal entry and the others together."""
    return Vector4(normal, tangent.x, tangent.y, tangent.z)


@inline
def dot4(a: Vector4, b: Vector4) -> float:
    """Compute a . b of four entries."""
    return a.x * b.x + a.y * b.y + a.z * b.z + a.t * b.t
