"""Friction cone of a contact: contact frame, return map of a trial force, and limit on the magnitude of the force.

A limit replaces the cone by its intersection with a ball centred at the apex, so the force remains the gradient of a
convex function. The nearest force in the intersection is the nearest force in the cone, shortened to the limit. For a
soft finger with friction, the limit bounds the norm of the force and the torsion together, where the torsion is divided
by the patch length. If the coefficient is negative (no friction cone), the limit bounds only the force.
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
    """Face of the friction cone onto which the return map has projected a force, and data for the map's derivative."""

    status: int
    direction: Vector  # direction of the tangential force, if the contact slides
    bend: float  # |y_t| / |t_t|, if the contact slides


@kernel
def contact_frame(normal: Vector, d: int) -> Matrix:
    """Return orthonormal rows: the unit normal, then tangents.

    If d < 3, the rows after the first d are coordinate axes.
    """
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
    """Write R(t), before the limit, to the force of a contact with the trial force t; return the face of the cone.

    For theta = 1, R(t) is the nearest force in the cone. For theta = 0, R(t) has the normal force of t, if positive,
    and the tangential force is scaled into the cone. If `limited` is true, a negative coefficient selects the whole
    space (NO_CONE) or a half-space (HALF_SPACE) instead of a cone.
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
    """Compute the norm of the first `width` entries of a force."""
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
    """Return the number of coordinates that a limit bounds: d, or without torsion at most 3 if `coefficient` < 0."""
    return d if coefficient >= 0.0 else min(d, 3)


@kernel
def shorten(force: Vector4, width: int, limit: float) -> tuple[Vector4, float]:
    """Scale the first `width` entries of a force so that their norm is at most `limit`.

    Return the force and the factor.
    """
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
    """Return whether the force from `turn_back` is within the limit and not at the boundary of a half-space."""
    return status != LIFT and not force_size(contact.force, limit_width(contact.coefficient, d)) > limit


@kernel
def cut_slope(contact: ConeContact, d: int, theta: float, limit: float, face: Face, x: Vector4) -> Vector4:
    """Compute R'x, where R' is the derivative of the return map followed by the limit, for any status of a contact."""
    slope = cone_slope(face, contact.coefficient, theta, x)
    return ball_slope(contact.force, limit_width(contact.coefficient, d), limit, slope)


@kernel
def cone_slope(face: Face, mu: float, theta: float, x: Vector4) -> Vector4:
    """Compute R'x, where R' is the derivative of the return map in `turn_back`, without a limit."""
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
    """Compute the derivative of `shorten` at the force y, times x.

    The result is limit/|y| (x - y y'x/|y|^2), or x if |y| <= limit.
    """
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
