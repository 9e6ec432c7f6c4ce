"""Rules of contact between fingers and an object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from graspfx.coupling.fade import FADE


@dataclass(frozen=True)
class Rules:
    """Contact rules of the coupling, named after a scene's keys.

    Attributes:
        attached: Whether contacts are bilateral, that is, fixed in the object and without cones.
        stick: Whether a touching finger sticks to its contact point; otherwise it slips, with the coefficient
            `friction`.
        friction: Coefficient of friction, one for all fingers or one for each.
        patch: Lengths rho of the contact patches [m], one for all fingers or one for each; 0 is a hard finger. Soft
            fingers exist only in space.
        share: Weight of each finger in the metric: its device's mass over the mean mass; equal weights by default.
        fade: Gaps (h1, h2) [m] over which a free finger fades out of the grasp; None keeps every finger in the grasp
            ("follow").
        at_contact: Whether the reaction acts at the contact point; otherwise it acts at the fingertip.
        blend: Rms arms (l1, l2) [m] over which a rotation enters the external space; None includes it at any arm.
        axes: Axes of matrix gains: "object", "world", or "contact", whose first axis is the normal.
        damping_depth: Depth over which a touching finger's damping rises to its full value [m]; 0 for full damping at
            any depth.
        force_bound: Largest force that the law may compute for a finger [N]; a larger force is a fault.
        pad: Stiffness k of compliant fingertips, f_n = k depth^1.5 [N/m^1.5], one for all fingers or one for each; 0 is
            a rigid fingertip.
    """

    attached: bool = False
    stick: bool = False
    friction: float | Sequence[float] = 0.0
    patch: float | Sequence[float] = 0.0
    share: Sequence[float] | None = None
    fade: tuple[float, float] | None = FADE
    at_contact: bool = False
    blend: tuple[float, float] | None = (0.00025, 0.001)
    axes: Literal["object", "world", "contact"] = "object"
    damping_depth: float = 0.0
    pad: float | Sequence[float] = 0.0
    force_bound: float = 1e4
