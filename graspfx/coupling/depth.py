"""Damping that grows with depth: each finger's damper acts in series with a second damper.

The damping matrix is D_s = (D^-1 + C)^-1, where C has the entry C_i = (1 - s_i) / (s_i w_i b) for every coordinate of
finger i, and w_i is the finger's weight. The fraction s_i is the depth that corresponds to the elastic force, divided
by the length `coupling.damping_depth`, and at most 1. The gain b is the larger of ked and kid. D_s replaces D in the
second projection, which adds damping to the elastic force. D_s is passive in every state, because s_min D <= D_s <= D,
where s_min is the smallest s_i. The force is continuous at first touch.
"""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Table
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.law import normal_force

SMALLEST = 1e-200  # lower bound of s, whose square underflows


@kernel
def damping_share(grasp: GraspState, finger: FingerState, normal: float) -> float:
    """Compute s_i = min(1, n.f0_i / (w_i kip delta)) from the normal elastic force n.f0_i [N] (`normal`).

    Without a damping depth delta, the result is 1.
    """
    if not grasp.gradual:
        return 1.0
    kip = grasp.stiffest.x if grasp.dense else grasp.internal_stiffness
    whole = finger.weight * kip * grasp.damping_depth
    return 1.0 if normal >= whole else max(normal / whole, SMALLEST)


@kernel
def compliance(grasp: GraspState, finger: FingerState, normal: float) -> float:
    """Compute w_i C_i = (1 - s_i) / (s_i b) of a finger with the normal elastic force `normal` [N], in [m/(N s)]."""
    s = damping_share(grasp, finger, normal)
    if grasp.dense:
        return (1.0 - s) / (s * max(grasp.stiffest.y, grasp.stiffest.z))
    return (1.0 - s) / (s * max(grasp.external_damping, grasp.internal_damping))


@kernel
def is_whole(grasp: GraspState) -> bool:
    """Return whether D_s = D, which holds if s_i = 1 for every finger."""
    if not grasp.gradual:
        return True
    least = 1.0
    for finger in grasp.fingers:
        least = min(least, damping_share(grasp, finger, normal_force(finger)))
    return least >= 1.0


@kernel
def soften(grasp: GraspState, square: Table, vector: Floats | None, per: float) -> None:
    """Replace D in `square` by D_s, and D e' in `vector` by D_s e', in contact frames.

    Both may contain the factor `per`. The elastic forces are read from the block's array `start`. For each coordinate p
    of each touching finger in turn, a series compliance 1/g subtracts D e_p e_p'D / (g + D_pp) from D, where e_p is a
    unit vector. `diagonal` is set to the diagonal of the result.
    """
    if not grasp.gradual:
        return
    for i, finger in enumerate(grasp.fingers):
        C = 0.0
        if finger.touching:
            C = compliance(grasp, finger, grasp.start[i * grasp.coordinates])
        if C > 0.0:
            g = per * finger.weight / C
            for p in range(i * grasp.coordinates, (i + 1) * grasp.coordinates):
                add_compliance(square, vector, g, p)
    for p in range(square.columns):
        grasp.diagonal[p] = square[p, p]


@kernel
def add_compliance(square: Table, vector: Floats | None, g: float, p: int) -> None:
    """Subtract M e_p e_p'M / (g + M_pp) from M = `square`, with the unit vector e_p; update `vector` = M x likewise."""
    own = square[p, p]
    if not g + own > 0.0:
        return
    inverse = 1.0 / (g + own)
    share = g * inverse
    for j in range(square.columns):
        factor = square[j, p]
        if j != p and factor != 0.0:
            scaled = factor * inverse
            for k in range(square.columns):
                square[j, k] -= scaled * square[p, k]
            square[j, p] = share * factor
            if vector is not None:
                vector[j] -= scaled * vector[p]
    for k in range(square.columns):
        square[p, k] *= share
    if vector is not None:
        vector[p] *= share
