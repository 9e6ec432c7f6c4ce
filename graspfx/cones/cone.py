"""Friction cone: its frame, the return map of a trial force, and the limit of a contact's force.

A limit is the intersection of the cone and a ball, so the force remains a convex function's gradient. The ball is
centred at the apex of the cone. Therefore the nearest force in the intersection is the nearest force in the cone,
shortened to the limit. If friction bounds force and torsion together, the limit includes a soft finger's torsion, in
units of the patch length. Without friction the limit applies only to the force.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from graspfx.compile.kernel import kernel
from graspfx.cones.problem import FREE, NO_FORCE, SLIDE, STICK, ConeContact, dot4, leading, tangent_of, with_tangent
from graspfx.spatial import ZERO, Matrix, Vector, Vector4, dot

NO_CONE = -1.0  # coefficient of a bilateral contact
HALF_SPACE = -2.0  # coefficient of a contact that only pushes, and sticks under any tangential force
LIFT = 3  # status of a half-space contact whose normal force is zero


@dataclass(frozen=True, slots=True)
class Face:
    """Face of the friction cone onto which the return map has projected a force, with data for the derivative."""

    status: int
    direction: Vector  # direction of the tangential force, if the contact slides
    bend: float  # |y_t| / |t_t|, if the contact slides


@kernel
def contact_frame(normal: Vector, d: int) -> Matrix:
    """Return orthonormal rows: the unit normal, then d - 1 tangents; in 1-D then y and z, in 2-D then z."""
    x, y, z = normal.x, normal.y, normal.z
    if d == 1:
        return Matrix(x, y, z, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    if d == 2:
        return Matrix(x, y, z, -y, x, 0.0, 0.0, 0.0, 1.0)
    # Duff et al. (2017): a basis without branches and without loss of digits
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    return Matrix(x, y, z, 1.0 + sign * x * x * a, sign * b, -sign * x, b, sign + y * y * a, -y)


@kernel
def turn_back(contact: ConeContact, d: int, theta: float, limited: bool) -> Face:
    """Compute y_i = R(t_i) before the limit; return the face of the cone with the data for the derivative.

    theta = 1 returns the nearest force in the cone; theta = 0 keeps the normal force and scales the tangential force.
    If forces are `limited`, a negative coefficient means no cone (NO_CONE) or a half-space (HALF_SPACE).
    """
    mu = contact.coefficient
    trial = leading(contact.trial, d)
    tangent = math.sqrt(trial.y * trial.y + trial.z * trial.z + trial.t * trial.t)
    forceless = contact.status <= NO_FORCE
    if limited and mu < 0.0 and not forceless:
        for a in range(d):
            contact.force[a] = contact.trial[a]
        contact.status = STICK
        if mu == HALF_SPACE and trial.x < 0.0:
            contact.force[0] = 0.0
            return Face(LIFT, ZERO, 0.0)
        return Face(STICK, ZERO, 0.0)
    if forceless or trial.x + theta * mu * tangent <= 0.0:
        for a in range(d):
            contact.force[a] = 0.0
        if not forceless:
            contact.status = FREE
        return Face(FREE, ZERO, 0.0)
    if tangent <= mu * trial.x and mu > 0.0:
        for a in range(d):
            contact.force[a] = contact.trial[a]
        contact.status = STICK
        return Face(STICK, ZERO, 0.0)
    contact.status = SLIDE
    normal = (trial.x + theta * mu * tangent) / (1.0 + theta * mu * mu)
    contact.force[0] = normal
    if tangent == 0.0 or mu == 0.0:
        for a in range(1, d):
            contact.force[a] = 0.0
        return Face(SLIDE, ZERO, 0.0)
    bend = mu * normal / tangent
    for a in range(1, d):
        contact.force[a] = bend * contact.trial[a]
    return Face(SLIDE, tangent_of(trial) / tangent, bend)


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
    """Return the number of coordinates that the limit bounds: d in a friction cone, those of the force if mu < 0."""
    return d if coefficient >= 0.0 else min(d, 3)


@kernel
def shorten(force: Vector4, width: int, limit: float) -> tuple[Vector4, float]:
    """Shorten a force over its first `width` entries to the limit; return the force and the factor, at most 1."""
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
    """Return whether y_i from `turn_back` is within its limit and not on the edge of a half-space."""
    return status != LIFT and not force_size(contact.force, limit_width(contact.coefficient, d)) > limit


@kernel
def cut_slope(contact: ConeContact, d: int, theta: float, limit: float, face: Face, x: Vector4) -> Vector4:
    """Compute R'x, where R' is the derivative of the return map with the limit, for any status of a contact."""
    slope = cone_slope(face, contact.coefficient, theta, x)
    return ball_slope(contact.force, limit_width(contact.coefficient, d), limit, slope)


@kernel
def cone_slope(face: Face, mu: float, theta: float, x: Vector4) -> Vector4:
    """Compute R'x, where R' is the derivative of the return map without a limit."""
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
    """Compute the derivative of `shorten` at y, times x: limit/|y| (x - y y'x/|y|^2), or x if y is within the limit."""
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
