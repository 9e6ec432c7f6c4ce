"""Rehearsal of a tick, for what code does only the first time it is called: hardware cannot wait for that."""

from __future__ import annotations

import numpy as np

from graspfx.loop.tick.memory import FOREIGN, ServoState, latch
from graspfx.loop.tick.programs import Engine
from graspfx.loop.tick.script import Tick


def rehearse(engine: Engine, tick: Tick, width: int) -> None:
    """Run a tick of a scene once, and once after a fault, and put all memories back as they were.

    Args:
        engine: of the tick, whose rows are set anew before the run.
        tick: with devices in Python, which are not called.
        width: of a row.
    """
    arrays = list(tick.script.arrays.values())
    copies = [array.copy() for array in arrays]
    engine.write_to(np.empty((1, width)))
    try:
        for is_faulted in (False, True):
            if is_faulted:
                latch(ServoState(tick.own.data), 0, FOREIGN, 0, 0)
            engine.begin(0)
            engine.end(0, 0)
    finally:
        for array, copy in zip(arrays, copies, strict=True):
            array[...] = copy
