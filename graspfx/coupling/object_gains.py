"""Gains of the object in a state block: the object's stiffness K_o, distributed over the contacts."""

from __future__ import annotations

import math

from graspfx import elementary
from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Table
from graspfx.coupling.grasp_state import Gain, GraspState
from graspfx.grasp.rigid_modes import motion_of
from graspfx.spatial import Vector, cross, dot

NOTHING_HELD = 1e-13  # relative bound below which a stiffness pivot of unheld degrees of freedom is rounding
WIDE = 6  # entries per row of K_o, forces before moments; some entries are zero in the plane and on the line


@kernel
def add_object_gain(grasp: GraspState, gain: Gain, first: int, scratch: int, out: Table) -> None:
    """Add the matrix sum_jk A_jk w_j w_k' of an object gain on the contacts to `out`, exactly symmetric.

    The vectors w_k = L q_k are the modes' forces, in the rows of `mode_rows` from `first` on. Rows from `scratch` on
    are overwritten. A = T^+ K_c T^+' is the stiffness for unit motions of the modes (`modal_gain`). T contains the
    wrenches of the modes, and K_c is the gain K_o after elimination of the degrees of freedom that no mode holds.
    """
    fill_modal_gain(grasp, gain, first)
    count, rows, A = grasp.mode_count, grasp.mode_rows, grasp.modal_gain
    for k in range(count):
        for q in range(grasp.components):
            total = 0.0
            for j in range(count):
                total += A[k, j] * rows[first + j, q]
            rows[scratch + k, q] = total
    for p in range(grasp.components):
        for q in range(p + 1):
            total = 0.0
            for k in range(count):
                total += rows[first + k, p] * rows[scratch + k, q]
            out[p, q] += total
            if q < p:
                out[q, p] += total


@kernel
def fill_modal_gain(grasp: GraspState, gain: Gain, first: int) -> None:
    """Compute the matrix A of `add_object_gain` from the wrenches of the modes and K_o.

    Degrees of freedom that no mode holds are eliminated, and the stiffness of rotations with short arms is bounded.
    """
    free = grasp.freedom.shifts + grasp.freedom.turns
    fill_wrenches(grasp, first)
    fill_free_gain(grasp, gain)
    scale_freedoms(grasp, free)
    count = eliminate(grasp, free)
    fill_motions(grasp, free, count)
    transform(grasp, free)
    condense_unheld(grasp, free, count)
    soften_short_arms(grasp, count)


@kernel
def fill_wrenches(grasp: GraspState, first: int) -> None:
    """Write each mode's wrench about the object's centre, on the free degrees of freedom, then a unit matrix."""
    T, count, free = grasp.wrenches, grasp.mode_count, grasp.freedom.shifts + grasp.freedom.turns
    for k in range(count):
        for u in range(free):
            T[k, u] = 0.0
        for j in range(count):
            T[k, free + j] = 1.0 if j == k else 0.0
        for i, finger in enumerate(grasp.fingers):
            root = math.sqrt(finger.weight)
            motion = motion_of(grasp.modes[k], i, grasp.width)
            f = root * motion.shift
            for u in range(free):
                axis = grasp.freedom.axes[u].vector
                if u < grasp.freedom.shifts:
                    T[k, u] += dot(axis, f)
                else:
                    T[k, u] += dot(cross(axis, finger.contact), f)
                    if grasp.coordinates > grasp.dimensions:
                        T[k, u] += root * finger.patch * motion.twist * dot(axis, finger.normal)


@kernel
def fill_free_gain(grasp: GraspState, gain: Gain) -> None:
    """Compute the entries of K_o for motions along and about the free axes."""
    X = Floats(grasp.buffer, grasp.matrices.offset + gain.first)
    free, shifts = grasp.freedom.shifts + grasp.freedom.turns, grasp.freedom.shifts
    for u in range(free):
        a, row = grasp.freedom.axes[u].vector, 0 if u < shifts else 3
        for v in range(u + 1):
            b, column = grasp.freedom.axes[v].vector, 0 if v < shifts else 3
            total = a.x * inner_row(X, row, column, b)
            total += a.y * inner_row(X, row + 1, column, b)
            total += a.z * inner_row(X, row + 2, column, b)
            grasp.free_gain[u, v] = grasp.free_gain[v, u] = total


@kernel
def inner_row(X: Floats, row: int, column: int, b: Vector) -> float:
    """Compute the dot product of three entries of a row of K_o with a vector."""
    p = row * WIDE + column
    return X[p] * b.x + X[p + 1] * b.y + X[p + 2] * b.z


@kernel
def scale_freedoms(grasp: GraspState, free: int) -> None:
    """Scale translations and rotations so that pivots are comparable: by stiffness or, if it is zero, by the arms."""
    T, K, count, shifts = grasp.wrenches, grasp.free_gain, grasp.mode_count, grasp.freedom.shifts
    stiff = turning = square = total = 0.0
    for u in range(free):
        if u < shifts:
            stiff = max(stiff, K[u, u])
        else:
            turning = max(turning, K[u, u])
    for finger in grasp.fingers:
        square += finger.weight * (dot(finger.contact, finger.contact) + finger.patch * finger.patch)
        total += finger.weight
    if square > 0.0:
        if not turning > 0.0:
            turning = stiff * square / total
        if not stiff > 0.0:
            stiff = turning * total / square
    for u in range(free):
        size = stiff if u < shifts else turning
        if size > 0.0:
            unit = 1.0 / math.sqrt(size)
            for k in range(count):
                T[k, u] *= unit
            for v in range(free):
                K[u, v] *= unit
                K[v, u] *= unit


@kernel
def eliminate(grasp: GraspState, free: int) -> int:
    """Reduce T to the unit matrix on its pivot columns by Gauss-Jordan elimination; return the number of pivots."""
    T, count = grasp.wrenches, grasp.mode_count
    for u in range(free):
        grasp.held[u] = -1.0
    for k in range(count):
        best, column, row = 0.0, 0, k
        for j in range(k, count):
            for u in range(free):
                if abs(T[j, u]) > best:
                    best, column, row = abs(T[j, u]), u, j
        if best == 0.0:
            return k
        for u in range(free + count):
            T[k, u], T[row, u] = T[row, u], T[k, u]
        inverse = 1.0 / T[k, column]
        for u in range(free + count):
            T[k, u] *= inverse
        for j in range(count):
            factor = T[j, column]
            if j != k and factor != 0.0:
                for u in range(free + count):
                    T[j, u] -= factor * T[k, u]
        grasp.held[column] = k
    return count


@kernel
def fill_motions(grasp: GraspState, free: int, count: int) -> None:
    """Write the object's motion for a unit motion of each mode, then of each degree of freedom that no mode holds.

    After the elimination, the object's motion is x_B = E y - R z in the pivot columns B, and z in the other columns.
    Here y contains the motions of the modes, R the other columns of T, and E the columns beside T, which were a unit
    matrix before the elimination.
    """
    T, W = grasp.wrenches, grasp.motions
    z = count
    for v in range(free):
        if grasp.held[v] < 0.0:
            for u in range(free):
                k = int(grasp.held[u])
                W[u, z] = -T[k, v] if k >= 0 else 0.0
            W[v, z] = 1.0
            z += 1
    for u in range(free):
        k = int(grasp.held[u])
        for j in range(count):
            W[u, j] = T[k, free + j] if k >= 0 else 0.0


@kernel
def transform(grasp: GraspState, free: int) -> None:
    """Compute A = W'K W from the motions W and the gain K; A is exactly symmetric."""
    W, K, A, KW = grasp.motions, grasp.free_gain, grasp.modal_gain, grasp.mode_products
    for u in range(free):
        for j in range(free):
            total = 0.0
            for v in range(free):
                total += K[u, v] * W[v, j]
            KW[u, j] = total
    for j in range(free):
        for k in range(j + 1):
            total = 0.0
            for u in range(free):
                total += W[u, j] * KW[u, k]
            A[j, k] = A[k, j] = total


@kernel
def condense_unheld(grasp: GraspState, free: int, count: int) -> None:
    """Eliminate the degrees of freedom that no mode holds, along which the object moves until the force is zero."""
    A = grasp.modal_gain
    least = 0.0
    for z in range(count, free):
        least = max(least, NOTHING_HELD * A[z, z])
    for z in range(count, free):
        if A[z, z] > least:
            release_mode(A, z, free, 1.0 / A[z, z])
        for j in range(free):
            A[j, z] = A[z, j] = 0.0


@kernel
def soften_short_arms(grasp: GraspState, count: int) -> None:
    """Keep the stiffness at the fingertips bounded and continuous if a rotation's arm lies within the blend.

    The upper arm l2 of the blend replaces the rotation's arm. The stiffness at a fingertip is therefore at most K_o /
    (W l2^2), where W is the sum of weights. A series compliance (1 - beta) / (beta tr A) moves the rotation to the
    internal part as the rotation's arm approaches the lower arm of the blend.
    """
    A, shifts = grasp.modal_gain, grasp.freedom.shifts
    trace = 0.0
    for k in range(shifts, count):
        beta = grasp.modes[k, 0]
        if beta < 1.0:
            part = arm_of_blend(beta, grasp.arm_low, grasp.arm_high) / grasp.arm_high
            for j in range(count):
                A[k, j] *= part
                A[j, k] *= part
    for k in range(count):
        trace += A[k, k]
    for k in range(shifts, count):
        rest = 1.0 - grasp.modes[k, 0]
        if rest > 0.0 and trace > 0.0:
            release_mode(A, k, count, rest / (grasp.modes[k, 0] * trace + rest * A[k, k]))


@kernel
def release_mode(A: Table, k: int, size: int, factor: float) -> None:
    """Subtract `factor` a a' from A, where a is column k of A."""
    for p in range(size):
        if p != k:
            scaled = factor * A[p, k]
            for q in range(p + 1):
                if q != k:
                    A[p, q] -= scaled * A[q, k]
                    if q < p:
                        A[q, p] = A[p, q]
    rest = 1.0 - factor * A[k, k]
    for p in range(size):
        if p != k:
            A[p, k] *= rest
            A[k, p] = A[p, k]
    A[k, k] *= rest


@kernel
def arm_of_blend(beta: float, low: float, high: float) -> float:
    """Compute the arm between `low` and `high` at which the smoothstep 3 t^2 - 2 t^3 equals `beta`."""
    t = 0.5 - elementary.sin(elementary.asin(1.0 - 2.0 * beta) / 3.0)
    return low + t * (high - low)
