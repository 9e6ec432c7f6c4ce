"""Attached contacts: eq. (4) without cones."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.coupling.contact_frames import coordinates_of, out_of_frame
from graspfx.coupling.grasp_state import GraspState
from graspfx.coupling.implicit import assemble_implicitly
from graspfx.coupling.law import bilateral, keep_elastic
from graspfx.coupling.recoil import recoil


@kernel
def attached(grasp: GraspState) -> int:
    """Compute bilateral forces, with the implicit integrator for the object's new state; return 0."""
    apart = grasp.observed or grasp.limited
    if apart:
        attach(grasp, False)
        keep_elastic(grasp)
    if grasp.damped or not apart:
        attach(grasp, grasp.damped)
    return 0


@kernel
def attach(grasp: GraspState, damped: bool) -> None:
    """Compute eq. (4) with or without its damping."""
    if grasp.recoils:
        recoil(grasp, damped, False)
        return
    if not grasp.implicit:
        bilateral(grasp, True, damped)
        return
    assemble_implicitly(grasp, True, damped, False)
    for i, finger in enumerate(grasp.fingers):
        finger.local = out_of_frame(grasp, finger, coordinates_of(grasp, grasp.vector, i))
