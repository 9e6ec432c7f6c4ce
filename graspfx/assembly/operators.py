"""The operators of a scene's hands: what holds fingers besides springs and dampers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.operator import NOISE, Operator

if TYPE_CHECKING:
    from graspfx.scene.tables.hands import Moving

FloatArray = NDArray[np.float64]

PARTS = ("limb", "stiffening", "reaction", "noise")  # of a hand's table, that make an operator of it


def is_operated(table: object) -> bool:
    """Tell whether a hand's table has a part that is no spring and damper."""
    return any(getattr(table, name, None) is not None for name in PARTS)


def operator_of(table: Moving, fingers: Sequence[int], dimensions: int) -> Operator | None:
    """Make the operator of a hand; None where it is spring and damper alone.

    Args:
        table: of the hand.
        fingers: that it holds, by their numbers in the scene: the noise of each is its own.
        dimensions: d.
    """
    if not is_operated(table):
        return None
    operator = Operator(len(fingers))
    if table.limb is not None:
        springs = (_per_axis(each, dimensions) for each in (table.limb.stiffness, table.limb.damping))
        operator.set_limb(table.limb.mass, *springs)
    if table.stiffening is not None:
        operator.set_stiffening(table.stiffening.stiffness, table.stiffening.damping, table.stiffening.lag)
    if (own := table.reaction) is not None:
        operator.set_reaction(own.delay, own.stiffness, own.damping, own.force)
    if table.noise is not None:
        seeds = [(table.noise.seed, i, NOISE) for i in fingers]
        operator.set_noise(table.noise.share, table.noise.cutoff, table.noise.lag, seeds)
    return operator


def _per_axis(value: Any, dimensions: int) -> FloatArray:
    return np.array(np.broadcast_to(np.array(value, dtype=float), (dimensions,)))
