"""External force of a grasp's last sample, read from its block."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.two_forces import Samples, SplitRule, divide, torsion_over_patch

FloatArray = NDArray[np.float64]


def external_part(
    rule: SplitRule, samples: Samples, whole: FloatArray, torsion: FloatArray | None = None, *, dual: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Divide forces or displacements (N, n, d) of samples whose arrays have them first, too: parts, and of torsions."""
    many = Samples(*(None if each is None else np.moveaxis(each, 0, -1) for each in samples))  # type: ignore[arg-type]
    turning = None if torsion is None else torsion.T
    both = np.moveaxis(divide(rule, many, np.moveaxis(whole, 0, -1), turning, dual=dual), -1, 0)
    d = whole.shape[2]
    return both[..., :d], both[..., d] if rule.soft else np.zeros(whole.shape[:2])


def external_force(grasp: GraspState, rule: SplitRule | None = None) -> NDArray[np.float64]:
    """Compute P f on the object in world axes, (n, d) [N].

    Args:
        grasp: whose contacts and forces are those of the last sample.
        rule: of that sample, if the block has the numbers of another one by now.
    """
    rule, fingers, d = rule or SplitRule.of(grasp), grasp.fingers, grasp.dimensions
    contact = fingers.array(FingerState.contact_world)[None, :, :d]
    if rule.is_local:
        centre = grasp.centre if grasp.mixed else grasp.motion.position
        contact = contact - np.array([centre[a] for a in range(d)])
    gap = None if rule.fade is None else fingers.array(FingerState.gap)[None]
    normal = fingers.array(FingerState.normal_world)[None] if rule.soft else None
    moment, axis = (fingers.array(field)[None] for field in (FingerState.moment, FingerState.twist_axis_world))
    torsion = torsion_over_patch(rule, moment, axis) if rule.soft else None
    force = fingers.array(FingerState.force)[None, :, :d]
    external, _ = external_part(rule, Samples(contact, gap, normal), force, torsion)
    return np.asarray(external[0])
