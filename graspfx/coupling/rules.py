"""Rules of contact between fingers and an object, and the gaps over which free fingers fade out of the grasp."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from graspfx.grasp.gain import block_diagonal
from graspfx.grasp.impedance import Coupling, per_finger
from graspfx.grasp.object_impedance import ObjectImpedance

FADE = (0.002, 0.01)  # default gaps of the fade, unless the forces require more [m]
BAND = FADE[1] - FADE[0]  # length of a fade [m]


@dataclass(frozen=True)
class Rules:
    """Contact rules of the coupling, with the names of the scene's keys.

    Attributes:
        attached: Whether contacts are bilateral, that is, fixed in the object and without cones.
        stick: Whether a touching finger sticks to its contact point. If False, a touching finger slips, freely or, with
            a coefficient of friction, by Coulomb's law.
        friction: Coefficient of friction, one for all fingers or one for each; 0 for none.
        patch: Lengths rho of the contact patches [m], one for all fingers or one for each; 0 for a hard finger. Soft
            fingers exist only in 3-D.
        share: Weight of each finger in the metric, such as its device's mass over the mean mass; None for equal
            weights.
        fade: Gaps (h1, h2) [m] between which a free finger fades out of the grasp. If None, every finger stays in the
            grasp ("follow").
        at_contact: Whether the reaction acts at the contact point; otherwise it acts at the fingertip.
        blend: Rms arms (l1, l2) [m] between which a rotation enters the external space. If None, a rotation with any
            arm is included.
        axes: Axes of matrix gains: "object", "world" or "contact"; the first axis of "contact" is the normal.
        damping_depth: Depth over which a touching finger's damping rises to its full value [m]; 0 for full damping at
            any depth.
        force_bound: Largest force that the law may compute for a finger [N]; a larger force is a fault.
        pad: Stiffness k of compliant fingertips, f_n = k depth^1.5 [N/m^1.5], one for all fingers or one for each; 0
            for a rigid fingertip.
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


def release_compliance(law: Coupling, fingers: int, dimensions: int) -> float:
    """Compute 1/2 |Kep^-1 - Kip^-1| [m/N], where the norm of a matrix is its largest singular value.

    Multiplied by the sum of the other fingers' forces, this compliance bounds the displacement of a free finger's
    contact, and therefore the gap below which the finger can touch again. The result is zero for equal gains and for a
    singular stiffness.
    """
    n, d = fingers, dimensions
    kep, kip = law.external.stiffness, law.internal.stiffness
    if isinstance(kep, float) and isinstance(kip, float):
        return compliance_of_numbers(kep, kip)
    if isinstance(law.external, ObjectImpedance):  # each of n fingers carries one nth of the translational stiffness
        kep = law.external.stiffness[:d, :d] / n
    inverse: list[NDArray[np.float64]] = []
    for gain in (per_finger(kep, n, d), per_finger(kip, n, d)):
        if np.linalg.eigvalsh(gain).min() <= 0.0:
            return 0.0
        inverse.append(np.asarray(np.linalg.inv(gain), dtype=np.float64))
    if inverse[0].ndim != inverse[1].ndim:
        inverse = [block_diagonal(each, n) if each.ndim > 2 else each for each in inverse]
    return 0.5 * float(np.linalg.norm(inverse[0] - inverse[1], 2, axis=(-2, -1)).max())


def compliance_of_numbers(kep: float, kip: float) -> float:
    """Compute 1/2 |1/kep - 1/kip| [m/N]; zero if kep or kip is zero."""
    if kep <= 0.0 or kip <= 0.0:
        return 0.0
    return 0.5 * abs(1.0 / kep - 1.0 / kip)


def gaps(needed: float) -> tuple[float, float]:
    """Choose the gaps of a fade [m]: the default gaps, unless `needed` is larger than the default start.

    In that case the fade starts at `needed` and has the default length.
    """
    return FADE if needed <= FADE[0] else (needed, needed + BAND)
