"""Limit of a contact's force: the cone intersected with a ball, which keeps the projection a convex gradient.

The cone and the ball share the origin, so that the nearest force in both is the nearest force in the cone, shortened
to the limit. The limit includes a soft finger's torsion, in units of the patch length, if friction bounds both;
without friction only the force is shortened.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from graspfx.compile.kernel import kernel
from graspfx.cones.problem import FREE, STICK, ConeContact, dot4, tangent_of, with_tangent
from graspfx.spatial import Vector, Vector4, dot

NO_CONE = -1.0  # coefficient of a bilateral contact
HALF_SPACE = -2.0  # coefficient of a contact that sticks tangentially with any force, and only pushes
LIFT = 3  # status of a half-space contact whose normal force is zero


@dataclass(frozen=True, slots=True)
class Face:
    """Face of its cone onto which the return map has put a force, with the data of the slope."""

    status: int
    direction: Vector  # direction of the tangential force, if it slides
    bend: float  # |y_t| / |t_t|, if it slides


@kernel
def force_size(force: Vector4, width: int) -> float:
    """Compute |f| over the first `width` entries."""
    square = force.x * force.x
    if width > 1:
        square += force.y * force.y
    if width > 2:
        square += force.z * force.z
    if width > 3:
        square += force.t * force.t
    return math.sqrt(square)


@kernel
def limit_width(coefficient: float, d: int) -> int:
    """Return the number of coordinates that the limit bounds: d in a friction cone, else (mu < 0) the force alone."""
    return d if coefficient >= 0.0 else min(d, 3)


@kernel
def shorten(force: Vector4, width: int, limit: float) -> tuple[Vector4, float]:
    """Shorten a force over its first `width` entries to the limit; return it and the factor, 1 if it was shorter."""
    size = force_size(force, width)
    if not size > limit:
        return force, 1.0
    share = limit / size
    return Vector4(
        force.x * share,
        force.y * share if width > 1 else force.y,
        force.z * share if width > 2 else force.z,
        force.t * share if width > 3 else force.t,
    ), share  # fmt: skip


@kernel
def is_plain(contact: ConeContact, d: int, limit: float, status: int) -> bool:
    """True if y_i from `turn_back` is neither longer than its limit nor on a half-space's edge."""
    return status != LIFT and not force_size(contact.force, limit_width(contact.coefficient, d)) > limit


@kernel
def cut_slope(contact: ConeContact, d: int, theta: float, limit: float, face: Face, x: Vector4) -> Vector4:
    """Compute R'x for a contact of any status, with its limit."""
    slope = cone_slope(face, contact.coefficient, theta, x)
    return ball_slope(contact.force, limit_width(contact.coefficient, d), limit, slope)


@kernel
def cone_slope(face: Face, mu: float, theta: float, x: Vector4) -> Vector4:
    """Compute R'x of the return map without a limit."""
    tangent = tangent_of(x)
    if face.status == LIFT:
        return with_tangent(0.0, tangent)
    if face.status == STICK:
        return x
    if face.status == FREE:
        return Vector4(0.0, 0.0, 0.0, 0.0)
    along = dot(face.direction, tangent)
    normal = (x.x + theta * mu * along) / (1.0 + theta * mu * mu)
    return with_tangent(normal, mu * face.direction * normal + face.bend * (tangent - face.direction * along))


@kernel
def ball_slope(force: Vector4, width: int, limit: float, x: Vector4) -> Vector4:
    """Compute the slope of `shorten` at a force y, times x: limit/|y| (x - y y'x/|y|^2), or x if y is short."""
    size = force_size(force, width)
    if not size > limit:
        return x
    share = limit / size
    y = Vector4(
        force.x / size,
        force.y / size if width > 1 else 0.0,
        force.z / size if width > 2 else 0.0,
        force.t / size if width > 3 else 0.0,
    )
    along = dot4(y, x)
    last = share * (x.t - along * y.t) if width > 3 else x.t
    return Vector4(share * (x.x - along * y.x), share * (x.y - along * y.y), share * (x.z - along * y.z), last)
