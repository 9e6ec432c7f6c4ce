"""Friction cone: its frame, and the return map of a trial force."""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.cones.cut import HALF_SPACE, LIFT, Face
from graspfx.cones.problem import FREE, NO_FORCE, SLIDE, STICK, ConeContact, leading, tangent_of
from graspfx.spatial import ZERO, Matrix, Vector


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
