"""Compliance of a body at its contacts with planes: W = T G' M^-1 G as orthogonal modes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Table
from graspfx.objects.body_state import EXACT, IMPLICIT, BodyState
from graspfx.objects.decay import coefficients
from graspfx.objects.floor.planes import FloorState
from graspfx.objects.rotation import multiply, spin_of
from graspfx.spatial import Vector, cross, orthogonalise, total

NO_MODE = 1e-20  # squared length, relative to the longest mode, below which a mode is zero


@dataclass(frozen=True, slots=True)
class Triangle:
    """A lower triangular matrix L, row by row."""

    xx: float
    yx: float
    yy: float
    zx: float
    zy: float
    zz: float

    def transposed_times(self, v: Vector) -> Vector:
        return Vector(
            self.xx * v.x + self.yx * v.y + self.zx * v.z,
            self.yy * v.y + self.zy * v.z,
            self.zz * v.z,
        )


@kernel
def contact_modes(body: BodyState, floor: FloorState, T: float, n: int, modes: Table) -> tuple[int, float]:
    """Compute orthogonal vectors whose outer products sum to W; store each as its squared length and a unit vector.

    W = T G' M^-1 G is the velocity of the contacts per contact force held over the sample.

    Returns:
        Number of modes, and the largest squared length.
    """
    d = body.dimensions
    m = body.mass
    c = coefficients(body.integrator, body.viscosity / m, T)
    root_mobility = math.sqrt(c.s / m)
    L = turning_root(body, T)
    for i in range(n):
        contact = floor.contacts[i]
        root = math.sqrt(contact.share)
        for a in range(d):
            e = root * floor.planes[contact.plane].frame.row(a)
            shift = multiply(root_mobility * e, body.free_translation)
            turn = L.transposed_times(cross(contact.arm, e))
            k = 1 + i * d + a
            modes[0, k], modes[1, k], modes[2, k] = shift.x, shift.y, shift.z
            modes[3, k], modes[4, k], modes[5, k] = turn.x, turn.y, turn.z
    orthogonalise(modes, 0, 6)
    return normalise_modes(modes)


@kernel
def normalise_modes(modes: Table) -> tuple[int, float]:
    """Write squared lengths before the modes, normalise the modes, and drop zero modes."""
    longest = 0.0
    for j in range(6):
        modes[j, 0] = 0.0
        for c in range(1, modes.columns):
            modes[j, 0] += modes[j, c] * modes[j, c]
        longest = max(longest, modes[j, 0])
    count = 0
    for j in range(6):
        if modes[j, 0] > NO_MODE * longest:
            square = modes[j, 0]
            root = 1.0 / math.sqrt(square)
            for c in range(1, modes.columns):
                modes[count, c] = root * modes[j, c]
            modes[count, 0] = square
            count += 1
    return count, longest


@kernel
def turning_root(body: BodyState, T: float) -> Triangle:
    """Compute L, where L L' is the angular velocity per moment that acts for T [s]; zero for locked rotations."""
    d, kind, b, free = body.dimensions, body.integrator, body.rotational_viscosity, body.free_rotation
    if d < 3:
        J = body.inertia.z
        if d == 1 or free.z == 0.0:
            return Triangle(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        c = coefficients(kind, b / J, T)
        return Triangle(0.0, 0.0, 0.0, 0.0, 0.0, math.sqrt(c.s / J))
    if total(free) == 0.0:
        return Triangle(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    extra = 0.0
    if kind == IMPLICIT:
        extra = T * b
    if kind == EXACT:
        extra = 0.5 * T * b  # (1 - exp(-z))/z = 1/(1 + z/2) to second order
    q = body.motion.quaternion
    x = spin_of(body, q, extra, Vector(T, 0.0, 0.0))
    y = spin_of(body, q, extra, Vector(0.0, T, 0.0))
    z = spin_of(body, q, extra, Vector(0.0, 0.0, T))
    xx = yx = yy = zx = zy = zz = 0.0
    if free.x != 0.0:
        xx = math.sqrt(x.x)
        yx, zx = x.y / xx, x.z / xx
    if free.y != 0.0:
        yy = math.sqrt(y.y - yx * yx)
        zy = (y.z - zx * yx) / yy
    if free.z != 0.0:
        zz = math.sqrt(z.z - zx * zx - zy * zy)
    return Triangle(xx, yx, yy, zx, zy, zz)
