"""Tables of where hands in plain Python mean to be, for ticks that are computed by one call."""

from __future__ import annotations

from graspfx.loop.parts import PlantWiring
from graspfx.loop.tick.memory import CHUNK
from graspfx.loop.tick.script import Table


def fill_table(table: Table, wiring: PlantWiring, k: int, count: int, period: float) -> None:
    """Ask a hand for its targets in ticks k, ..., k + count - 1 and write them down.

    Args:
        table: of the targets.
        wiring: of the plant that the hand moves.
        k: the first tick.
        count: of ticks, CHUNK at most.
        period: T [s].
    """
    each = table.memory.reshape(CHUNK, -1, *wiring.plant.position.shape)
    for i in range(count):
        each[i, 0], each[i, 1] = wiring.hand.target((k + i + 1) * period)
        if table.middle:
            each[i, 2], each[i, 3] = wiring.hand.target(0.5 * ((k + i) * period + (k + i + 1) * period))
