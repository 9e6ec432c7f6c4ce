"""The conventional method for equal gains (eqs. 1 and 7-8): each finger separately, without projector or matrices."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.coupling.depth import damping_share
from graspfx.coupling.grasp_state import GraspState
from graspfx.coupling.law import normal_force
from graspfx.spatial import inner, with_torsion


@kernel
def separate(grasp: GraspState) -> None:
    """Compute f_i = w_i k e_i of every finger inside the object; the force is normal unless the finger sticks."""
    for finger in grasp.fingers:
        depth = inner(finger.normal, finger.displacement.vector)
        k = finger.weight * grasp.internal_stiffness
        for a in range(grasp.dimensions):
            e = 0.0
            if depth > 0.0:
                e = finger.displacement[a] if grasp.stick else depth * finger.normal[a]
            finger.local[a] = k * e
        if grasp.coordinates > 3:
            torsion = k * finger.displacement.t if depth > 0.0 else 0.0
            finger.local = with_torsion(finger.local.vector, torsion)


@kernel
def damp_alone(grasp: GraspState) -> None:
    """Add b_i e_i' to every touching finger's force, only along the normal unless it sticks; the sum never pulls."""
    for finger in grasp.fingers:
        if not finger.touching:
            continue
        b = finger.weight * grasp.internal_damping
        if grasp.gradual:
            b *= damping_share(grasp, finger, normal_force(finger))
        speed = inner(finger.normal, finger.rate.vector)
        f = max(b * speed, -normal_force(finger)) * finger.normal
        if grasp.stick:
            f += b * (finger.rate.vector - speed * finger.normal)
        finger.local += with_torsion(f, b * finger.rate.t)
