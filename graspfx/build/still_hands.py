"""Hands that neither move nor turn: how far they close, and the forces that they can exert at most."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from graspfx.build.holdings import Holding, hold, holdings
from graspfx.loop.plant import Hand
from graspfx.scene.tables.reading import listed

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Held:
    """A hand without its motion and turns: the fingers that it holds, and when it is closed most [s]."""

    hand: Hand
    fingers: list[int]
    closed: float


def still_hands(scene: Scene, start: FloatArray, inward: FloatArray) -> Iterator[Held]:
    """The hands of a scene as they would close if they neither moved nor turned."""
    for holding in holdings(scene):
        yield _still(scene, holding, start, inward)


def most_forces(scene: Scene, start: FloatArray, inward: FloatArray, contacts: FloatArray) -> FloatArray:
    """The forces with which hands squeeze at most, K (r - p), (n,) [N].

    r is where a hand closes to, and p the finger's start, or its contact if it starts inside of the object: a finger
    that is squeezed in is nearer to r.

    Args:
        start: of the fingers (n, d) [m].
        inward: unit normals of their contacts (n, d).
        contacts: contact points (n, d) [m].
    """
    inside = ((start - contacts) * inward).sum(axis=1) > 0.0
    p = np.where(inside[:, None], contacts, start)
    force = np.zeros_like(start)
    for held in still_hands(scene, start, inward):
        away = held.hand.target(held.closed)[0] - p[held.fingers]
        for a in range(start.shape[1]):
            force[held.fingers, a] = held.hand.stiffness[a] @ away[:, a]
    return np.asarray(np.linalg.norm(force, axis=1))


class StillTable:
    """A hand's table without its motion and its turn."""

    motion = ()
    turn = None

    def __init__(self, table: Any) -> None:
        self._table = table

    def __getattr__(self, name: str) -> Any:
        return getattr(self._table, name)


def _still(scene: Scene, holding: Holding, start: FloatArray, inward: FloatArray) -> Held:
    table, closed = holding.table, 0.0
    if table is not None and table.form != "made":
        if isinstance(table.squeeze, int | float):
            closed = table.squeeze_ramp
        else:
            most = max(listed(table.squeeze), key=lambda step: step.to)
            closed = most.begin + most.duration if most.to > 0.0 else 0.0  # they begin with none
        holding = replace(holding, table=cast(Any, StillTable(table)))
    return Held(hold(scene, scene.source.folder, holding, start, inward), holding.fingers, closed)
