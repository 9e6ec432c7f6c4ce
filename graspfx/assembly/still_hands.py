"""Hands that neither move nor turn: how far they close, and the forces that they can exert at most."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.plant import Hand
from graspfx.scene.tables.reading import listed

if TYPE_CHECKING:
    from graspfx.assembly.hand_parts import HandPart
    from graspfx.assembly.resolve import Parts

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StillHand:
    """A hand without its motion and turns: the fingers that it holds, and when it is closed most [s]."""

    hand: Hand
    fingers: list[int]
    closed: float

    def stiffness(self, force: FloatArray) -> FloatArray:
        """Give K (d, n, n) with which it holds its fingers at rest [N/m]: r - p = K^-1 f.

        Args:
            force: f of its fingers at rest (n, d) [N], for a hand that grip makes stiffer.
        """
        operator = getattr(self.hand, "operator", None)
        return self.hand.stiffness if operator is None else np.asarray(operator.at_rest(self.hand.stiffness, force))


def still_hands(parts: Parts, inward: FloatArray, *, guided: bool = True) -> Iterator[StillHand]:
    """Make the hands of a scene as they would close if they neither moved nor turned.

    Args:
        parts: of the scene.
        inward: unit normals of the fingers' contacts (n, d).
        guided: whether their guides have led them to their goals; else they have none.
    """
    for hand in parts.hands:
        yield StillHand(hand.still(guided=guided).hold(parts.start, inward), hand.fingers, _closing_time(hand))


def most_forces(parts: Parts, inward: FloatArray, contacts: FloatArray) -> FloatArray:
    """Give the forces with which hands squeeze at most, K (r - p), (n,) [N].

    r is where a hand closes to, without its guide, and p the finger's start, or its contact if it starts inside of the
    object: a finger that is squeezed in is nearer to r.

    Args:
        parts: of the scene.
        inward: unit normals of the fingers' contacts (n, d).
        contacts: contact points (n, d) [m].
    """
    start = parts.start
    inside = ((start - contacts) * inward).sum(axis=1) > 0.0
    p = np.where(inside[:, None], contacts, start)
    force = np.zeros_like(start)
    for still in still_hands(parts, inward, guided=False):
        away = still.hand.target(still.closed)[0] - p[still.fingers]
        K = still.stiffness(np.zeros_like(away))
        for a in range(start.shape[1]):
            force[still.fingers, a] = K[a] @ away[:, a]
    return np.asarray(np.linalg.norm(force, axis=1))


def _closing_time(hand: HandPart) -> float:
    """Give when a hand is closed most [s]."""
    table = hand.holding.table
    if table is None or table.form == "made":
        return 0.0
    if isinstance(table.squeeze, int | float):
        return table.squeeze_ramp
    most = max(listed(table.squeeze), key=lambda step: step.to)
    return float(most.begin + most.duration) if most.to > 0.0 else 0.0  # hands begin with none
