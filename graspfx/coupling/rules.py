"""The rules by which fingers touch an object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from graspfx.coupling.fade import FADE


@dataclass(frozen=True)
class Rules:
    """How fingers touch: the switches of the coupling, under the names of a scene's keys.

    Attributes:
        attached: bilateral contact at points fixed in the object, no cone.
        stick: a touching finger holds where it touched; else it slips freely, unless `friction` says otherwise.
        friction: a coefficient of friction, for all fingers or one for each.
        patch: the lengths rho of the fingers' contact patches [m], all or one each; 0 is a hard finger. In space.
        share: of each finger in the metric, its device's mass over the mean of all; equal if not given.
        fade: gaps (h1, h2) [m] between which a free finger leaves the split; None keeps every finger in it ("follow").
        at_contact: the reaction acts at the contact point, else at the fingertip.
        blend: rms arms (l1, l2) [m] between which a rotation joins the external space; None: as soon as it has any.
        axes: in which gains that are matrices stand: "object", "world", or "contact", the normal first.
        damping_depth: over which a touching finger's damping grows up to its value [m]; 0: it has all of it at once.
        force_bound: largest force of a finger that the law may give [N]: more is a fault.
        pad: k of compliant fingertips, f_n = k depth^1.5 [N/m^1.5], for all fingers or one for each; 0 is a hard one.
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
