"""Largest gap from which the other fingers' forces can bring a free finger back into contact."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspfx.grasp.impedance import Coupling, per_finger
from graspfx.grasp.object_impedance import ObjectImpedance

FADE = (0.002, 0.01)  # default gaps of the fade, unless the forces require more [m]
BAND = FADE[1] - FADE[0]  # [m]


def release_compliance(law: Coupling, fingers: int, dimensions: int) -> float:
    """Compute 1/2 |Kep^-1 - Kip^-1| [m/N], the largest singular value for matrices.

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
        inverse = [_whole(each) for each in inverse]
    return 0.5 * float(np.linalg.norm(inverse[0] - inverse[1], 2, axis=(-2, -1)).max())


def compliance_of_numbers(kep: float, kip: float) -> float:
    """Compute 1/2 |1/kep - 1/kip| [m/N]; zero if kep or kip is zero."""
    if kep <= 0.0 or kip <= 0.0:
        return 0.0
    return 0.5 * abs(1.0 / kep - 1.0 / kip)


def gaps(needed: float) -> tuple[float, float]:
    """Choose the gaps of a fade [m]: the fade starts at `needed` or farther away, and extends over the default 8 mm."""
    return FADE if needed <= FADE[0] else (needed, needed + BAND)


def _whole(blocks: NDArray[np.float64]) -> NDArray[np.float64]:
    """Assemble the fingers' matrices (n, d, d) into one block-diagonal matrix (n d, n d)."""
    if blocks.ndim == 2:
        return blocks
    n, d, _ = blocks.shape
    whole = np.zeros((n * d, n * d))
    whole.reshape(n, d, n, d)[np.arange(n), :, np.arange(n), :] = blocks
    return whole
