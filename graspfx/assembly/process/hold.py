"""Numbers of a simulated plant and of the hand that holds it, as memories that a letter may write to."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.plant import FusedHand
from graspfx.loop.update import CarriedPlant, Steerable

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]


class Hold:
    """A plant with its hand: three memories, of the hand's block, of its gains and of the plant's mechanics.

    Args:
        hand: that holds the plant.
        plant: itself.

    Attributes:
        memories: the block; K and B, one after the other; masses and dampings. Empty where they do not change.
    """

    def __init__(self, hand: Any, plant: Any) -> None:
        self._plant, self._hand = plant, hand
        block, gains, mechanics = np.zeros(0), np.zeros(0), np.zeros(0)
        if is_carried(hand):
            block, gains = hand.state, np.concatenate([hand.stiffness.ravel(), hand.damping.ravel()])
        if isinstance(plant, CarriedPlant):
            mechanics = plant.mechanics.ravel().copy()
        self.memories: list[FloatArray] = [block, gains, mechanics]

    def numbers(self) -> Iterator[tuple[int, Index, FloatArray]]:
        """Give all that another hold of the same structure takes over: which memory, entries of it, and numbers.

        A follower of a guided hand goes on where it is, and goals come by themselves.
        """
        block, _, _ = self.memories
        if len(block):
            hand: Any = self._hand
            own = [*hand.followers, *(entry for goals in hand.goals for entry in goals.tolist())]
            places = np.setdiff1d(np.arange(len(block)), np.array(own, dtype=np.intp))
            yield 0, places, block[places]
            gains = np.concatenate([hand.stiffness.ravel(), hand.damping.ravel()])
            yield 1, np.arange(len(gains)), gains
        if isinstance(self._plant, CarriedPlant):
            mechanics = self._plant.mechanics.ravel()
            yield 2, np.arange(len(mechanics)), mechanics

    def adopt(self, other: Any) -> None:
        """Take over gains and mechanics that were written to the memories; the plant takes hold next."""
        _, gains, mechanics = self.memories
        if len(gains):
            hand: Any = self._hand
            hand.regain(*gains.copy().reshape(2, *hand.stiffness.shape))
        if isinstance(self._plant, CarriedPlant):
            self._plant.mechanics = mechanics.copy().reshape(2, -1)


def is_carried(hand: Any) -> bool:
    """Tell whether the numbers of a hand may change in another process."""
    return isinstance(hand, Steerable) and isinstance(hand, FusedHand) and hasattr(hand, "regain")
