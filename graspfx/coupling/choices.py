"""Choices that follow from the gains of a grasp's block: do they still fit the numbers that stand there?"""

from __future__ import annotations

from graspfx.coupling.grasp_state import GraspState


def contradiction(grasp: GraspState) -> str:
    """Name a switch that does not follow from the gains in the block; nothing where all do, or gains are matrices.

    A gain that is written into a block by itself leaves the switches as they were: forces would be those of neither.
    """
    if grasp.dense:
        return ""
    kep, ked = grasp.external_stiffness, grasp.external_damping
    kip, kid = grasp.internal_stiffness, grasp.internal_damping
    if grasp.equal != (kep == kip and ked == kid):
        return "equal"
    if grasp.damped != (ked != 0.0 or kid != 0.0):
        return "damped"
    return "singular" if grasp.singular != (ked == 0.0 or kid == 0.0) else ""
