"""Matrix gains: K and D of eq. (4) in the object's axes, computed in the state block."""

from __future__ import annotations

import math

from graspfx.compile.kernel import inline, kernel
from graspfx.compile.records import Floats, Table
from graspfx.coupling.grasp_state import FingerState, Gain, GraspState
from graspfx.coupling.object_gains import add_object_gain
from graspfx.grasp.rigid_modes import motion_of
from graspfx.spatial import IDENTITY, Matrix, Vector

WEIGHT_FLOOR = 1e-12  # a metric must be positive; the cone removes the remaining force of a faded finger

ALONE, LITERAL, SYMMETRIC = 0, 1, 2  # rule that composes a pair of gains: equal gains, literal or symmetric form
KEP, KED, KIP, KID = 0, 1, 2, 3
OBJECT, WORLD, CONTACT = 0, 1, 2  # axes of the gains

# First rows of the groups in `mode_rows`, one row per mode: u_k = L^-1 q_k, w_k = L q_k, u_k'A and u_k'B.
U, W, V, Z = 0, 6, 12, 18


@kernel
def fill_gains(grasp: GraspState) -> None:
    """Recompute K and D if a contact point, weight, normal or rotation on which K or D depends has changed."""
    if is_up_to_date(grasp):
        return
    fill_pair(grasp, grasp.stiffness_rule, grasp.kep, grasp.kip, grasp.stiffness)
    if grasp.stiffness_rule == LITERAL:
        grasp.stiffness_skew = keep_skew(grasp.stiffness, grasp.stiffness_skew, grasp.skewest_stiffness)
    fill_pair(grasp, grasp.damping_rule, grasp.ked, grasp.kid, grasp.damping)
    if grasp.damping_rule == LITERAL:
        grasp.damping_skew = keep_skew(grasp.damping, grasp.damping_skew, grasp.skewest_damping)


@kernel
def is_up_to_date(grasp: GraspState) -> bool:
    """Return whether K and D are up to date, and store the present values on which K and D depend."""
    same = grasp.gains_known
    grasp.gains_known = True
    if grasp.axes_of_gains == WORLD or grasp.mixed:
        motion = grasp.motion
        for k in range(9):
            same = same and motion.rotation[k] == grasp.gains_rotation[k]
        grasp.gains_rotation = motion.rotation
    for finger in grasp.fingers:
        same = same and finger.weight == finger.gains_weight
        finger.gains_weight = finger.weight
        if not grasp.equal:
            for a in range(grasp.dimensions):
                same = same and finger.contact[a] == finger.gains_contact[a]
            finger.gains_contact = finger.contact
        if grasp.axes_of_gains == CONTACT or grasp.coordinates > grasp.dimensions:
            for a in range(grasp.dimensions):
                same = same and finger.normal[a] == finger.gains_normal[a]
            finger.gains_normal = finger.normal
    return same


@kernel
def fill_pair(grasp: GraspState, rule: int, external: Gain, internal: Gain, out: Table) -> None:
    """Compose an external gain A and an internal gain B: E A + (I - E) B (literal) or F A F' + H B H' (symmetric).

    E is the projector P on external forces.

    For modes q_k with blends b_k and weights L^2, let w_k = L q_k and u_k = L^-1 q_k. Then E = sum_k b_k w_k u_k', F =
    sum_k sqrt(b_k) w_k u_k' and H = I - sum_k (1 - sqrt(1 - b_k)) w_k u_k'. The square roots give scalar gains the same
    result in both forms: a mode with blend b has the gain b kep + (1 - b) kip. The computation needs only u_k'A and
    u_k'B, one row per mode; the projector is never formed. If A is a gain of the object, the gain at the contacts that
    follows from A is added to the internal part.
    """
    spread(grasp, internal, out)
    if rule == ALONE:
        return
    spread(grasp, external, grasp.square)  # work space of the projection, which runs later in the sample
    for k in range(grasp.mode_count):
        fill_rows(grasp, k, external.whole or internal.whole, grasp.square, out)
    if rule == LITERAL:
        for k in range(grasp.mode_count):
            add_literal(grasp, k, out)
    else:
        add_symmetric(grasp, out)
    if external.of_object:
        add_object_gain(grasp, external, W, V, out)


@kernel
def fill_rows(grasp: GraspState, k: int, whole: bool, A: Table, B: Table) -> None:
    """Compute the rows u_k, w_k, u_k'A and u_k'B of mode k (symbols: see `fill_pair`)."""
    d, c, rows, mode = grasp.dimensions, grasp.coordinates, grasp.mode_rows, grasp.modes[k]
    for i, finger in enumerate(grasp.fingers):
        root = metric_root(finger)
        motion = motion_of(mode, i, grasp.width)
        for a in range(c):
            own = motion.twist if a >= d else motion.shift[a]
            rows[U + k, i * c + a] = own / root
            rows[W + k, i * c + a] = own * root
    for i in range(grasp.count):
        first = 0 if whole else i * c
        last = grasp.components if whole else i * c + c
        for q in range(i * c, i * c + c):
            along = across = 0.0
            for p in range(first, last):
                along += rows[U + k, p] * A[p, q]
                across += rows[U + k, p] * B[p, q]
            rows[V + k, q], rows[Z + k, q] = along, across


@kernel
def add_literal(grasp: GraspState, k: int, out: Table) -> None:
    """Add b_k w_k u_k'(A - B) of mode k to B in `out` (symbols: see `fill_pair`)."""
    m, rows = grasp.components, grasp.mode_rows
    for q in range(m):
        rows[V + k, q] -= rows[Z + k, q]
    for p in range(m):
        w = grasp.modes[k, 0] * rows[W + k, p]
        for q in range(m):
            out[p, q] += w * rows[V + k, q]


@kernel
def add_symmetric(grasp: GraspState, out: Table) -> None:
    """Replace B in `out` by F A F' + H B H', symmetric to the last bit (symbols: see `fill_pair`)."""
    count, m, rows, C = grasp.mode_count, grasp.components, grasp.mode_rows, grasp.mode_products
    for k in range(count):
        outer, inner = roots(grasp.modes[k, 0])
        for j in range(count):
            also, less = roots(grasp.modes[j, 0])
            along = across = 0.0
            for q in range(m):
                along += rows[V + k, q] * rows[U + j, q]
                across += rows[Z + k, q] * rows[U + j, q]
            C[k, j] = outer * also * along + inner * less * across
    for k in range(count):
        _, inner = roots(grasp.modes[k, 0])
        for q in range(m):
            total = 0.0
            for j in range(count):
                total += C[k, j] * rows[W + j, q]
            rows[V + k, q] = 0.5 * total - inner * rows[Z + k, q]
    for p in range(m):
        for q in range(p + 1):
            total = out[p, q]
            for k in range(count):
                total += rows[W + k, p] * rows[V + k, q] + rows[W + k, q] * rows[V + k, p]
            out[p, q] = out[q, p] = total


def roots(blend: float) -> tuple[float, float]:
    """Compute the factors of a mode with the blend b: sqrt(b) in F, and 1 - sqrt(1 - b) in I - H (see `fill_pair`)."""
    return math.sqrt(blend), 1.0 - math.sqrt(1.0 - blend)


@kernel
def spread(grasp: GraspState, gain: Gain, out: Table) -> None:
    """Write a gain X to `out` as a square matrix in the object's axes.

    The matrix has the blocks L R'X R L for gains per finger. It is R'X R for one gain of all fingers (`whole`), and
    zero for a gain of the object (`of_object`). L is the square root of a finger's weight.

    R rotates from the object's axes to the axes of the gain, which are the world's axes or a finger's contact frame.
    The gain of a soft finger must be a scalar, which applies to the torsional coordinate too.
    """
    n, d, c, m = grasp.count, grasp.dimensions, grasp.coordinates, grasp.components
    if gain.of_object:
        for p in range(m):
            for q in range(m):
                out[p, q] = 0.0
        return
    X = Floats(grasp.buffer, grasp.matrices.offset + gain.first)
    motion = grasp.motion
    for i, finger in enumerate(grasp.fingers):
        R = IDENTITY
        if grasp.axes_of_gains == WORLD:
            R = motion.rotation
        elif grasp.axes_of_gains == CONTACT:
            R = finger.frame
        for j in range(n):
            block = Table(out.buffer, out.offset + (i * c * out.columns + j * c), out.columns)
            if gain.whole:
                turn_block(grasp, Table(X.buffer, X.offset + (i * d * m + j * d), m), R, 1.0, block)
                continue
            if i != j or c > d:
                for a in range(c):
                    for b in range(c):
                        block[a, b] = 0.0
            if i == j:
                weight = max(finger.weight, WEIGHT_FLOOR)
                turn_block(grasp, Table(X.buffer, X.offset + i * d * d, d), R, weight, block)
                if c > d:
                    block[d, d] = weight * X[i * d * d]


@kernel
def turn_block(grasp: GraspState, X: Table, R: Matrix, weight: float, out: Table) -> None:
    """Write weight * R'X R, d x d, to `out`; R is not applied to gains in the object's axes or without axes."""
    d = grasp.dimensions
    if grasp.axes_of_gains == OBJECT:
        for a in range(d):
            for b in range(d):
                out[a, b] = weight * X[a, b]
        return
    turn_column(X, R, weight * R.transpose.first, 0, d, out)
    turn_column(X, R, weight * R.transpose.second, 1, d, out)
    if d > 2:
        turn_column(X, R, weight * R.transpose.third, 2, d, out)


@kernel
def turn_column(X: Table, R: Matrix, c: Vector, b: int, d: int, out: Table) -> None:
    """Write column b of weight * R'X R to `out`, where c is the weight times column b of R."""
    x = 0.0 + X[0, 0] * c.x + X[0, 1] * c.y
    y = 0.0 + X[1, 0] * c.x + X[1, 1] * c.y
    z = 0.0
    if d > 2:
        x += X[0, 2] * c.z
        y += X[1, 2] * c.z
        z = 0.0 + X[2, 0] * c.x + X[2, 1] * c.y + X[2, 2] * c.z
    turned = R.transpose @ Vector(x, y, z)
    out[0, b], out[1, b] = turned.x, turned.y
    if d > 2:
        out[2, b] = turned.z


@kernel
def keep_skew(square: Table, largest: float, out: Table) -> float:
    """Copy a matrix if its skew part, which generates energy, is the largest so far.

    Return the largest sum of squares of the skew part.
    """
    skew = 0.0
    for p in range(square.columns):
        for q in range(p):
            apart = square[p, q] - square[q, p]
            skew += apart * apart
    if not skew > largest:
        return largest
    for p in range(square.columns):
        for q in range(square.columns):
            out[p, q] = square[p, q]
    return skew


@inline
def metric_root(finger: FingerState) -> float:
    """Compute the square root of a finger's weight, which counts as at least WEIGHT_FLOOR."""
    return math.sqrt(max(finger.weight, WEIGHT_FLOOR))
