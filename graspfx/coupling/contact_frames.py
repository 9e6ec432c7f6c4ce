"""Gains as matrices in contact frames, for principal pivoting; the first coordinate of a contact is its normal."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Table
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.law import bilateral
from graspfx.grasp.rigid_modes import gain_matrix
from graspfx.spatial import Vector, Vector4, inner, with_torsion


@kernel
def assemble(grasp: GraspState, elastic: bool) -> None:
    """Compute K and K e if `elastic` is true, otherwise D and D e', in contact frames.

    The matrix is written to `square` and the vector to `vector`.
    """
    size = grasp.count * grasp.coordinates
    for p in range(size):
        for q in range(size):
            grasp.square[p, q] = 0.0
    bilateral(grasp, elastic, not elastic)
    for i, finger in enumerate(grasp.fingers):
        write_coordinates(grasp, grasp.vector, i, in_frame(grasp, finger, finger.local))
    if elastic:
        add_gains(grasp, grasp.square, grasp.external_stiffness, grasp.internal_stiffness, 1.0, 0.0)
    else:
        add_gains(grasp, grasp.square, grasp.external_damping, grasp.internal_damping, 0.0, 1.0)
    for p in range(size):
        grasp.diagonal[p] = grasp.square[p, p]


@kernel
def add_gains(grasp: GraspState, out: Table, external: float, internal: float, elastic: float, damping: float) -> None:
    """Add a gain matrix in contact frames to the matrix `out`.

    The matrix is that of the scalar gains `external` and `internal` or, with matrix gains, `elastic` K + `damping` D.
    """
    if grasp.dense:
        for i, finger in enumerate(grasp.fingers):
            for j, other in enumerate(grasp.fingers):
                add_block(grasp, finger, other, i, j, elastic, damping, out)
        return
    count = 0 if grasp.equal else grasp.mode_count
    gain_matrix(grasp.fingers, grasp.modes, count, external, internal, grasp.coordinates, out, grasp.mode_force)


@kernel
def add_block(
    grasp: GraspState, finger: FingerState, other: FingerState, i: int, j: int, elastic: float, damping: float,
    out: Table,
) -> None:  # fmt: skip
    """Add F_i (elastic K_ij + damping D_ij) F_j' of fingers i and j.

    The contact frames F_i do not change torsion.
    """
    d, c = grasp.dimensions, grasp.coordinates
    for a in range(c):
        for b in range(c):
            total = 0.0
            for p in range(a if a == d else 0, c if a == d else d):
                for q in range(b if b == d else 0, c if b == d else d):
                    value = elastic * grasp.stiffness[i * c + p, j * c + q]
                    value += damping * grasp.damping[i * c + p, j * c + q]
                    along = 1.0 if a == d else finger.frame[3 * a + p]
                    total += along * value * (1.0 if b == d else other.frame[3 * b + q])
            out[i * c + a, j * c + b] += total


@kernel
def in_frame(grasp: GraspState, finger: FingerState, v: Vector4) -> Vector4:
    """Convert a vector from object axes to the contact frame of a finger: normal, tangents, torsion."""
    y = z = 0.0
    if grasp.dimensions > 1:
        y = inner(finger.frame.second, v.vector)
    if grasp.dimensions > 2:
        z = inner(finger.frame.third, v.vector)
    return Vector4(inner(finger.frame.first, v.vector), y, z, v.t)


@kernel
def out_of_frame(grasp: GraspState, finger: FingerState, v: Vector4) -> Vector4:
    """Convert a vector from the contact frame of a finger to object axes; torsion is unchanged."""
    F = finger.frame.transpose
    return with_torsion(Vector(inner(F.first, v.vector), inner(F.second, v.vector), inner(F.third, v.vector)), v.t)


@kernel
def write_coordinates(grasp: GraspState, out: Floats, i: int, v: Vector4) -> None:
    """Write a vector in the contact frame of finger i to this finger's entries of `out`."""
    p = i * grasp.coordinates
    out[p] = v.x
    if grasp.dimensions > 1:
        out[p + 1] = v.y
    if grasp.dimensions > 2:
        out[p + 2] = v.z
    if grasp.coordinates > grasp.dimensions:
        out[p + grasp.dimensions] = v.t


@kernel
def coordinates_of(grasp: GraspState, numbers: Floats, i: int) -> Vector4:
    """Read a vector in the contact frame of finger i from `numbers`; entries of missing coordinates are zero."""
    p = i * grasp.coordinates
    y = z = t = 0.0
    if grasp.dimensions > 1:
        y = numbers[p + 1]
    if grasp.dimensions > 2:
        z = numbers[p + 2]
    if grasp.coordinates > grasp.dimensions:
        t = numbers[p + grasp.dimensions]
    return Vector4(numbers[p], y, z, t)
