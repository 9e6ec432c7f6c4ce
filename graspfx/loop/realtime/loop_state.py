"""The memory of a loop on the wall's clock: what each tick records of its time, its devices and their samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.memory import zeros
from graspfx.compile.records import Floats, Record, floats, size_for
from graspfx.loop.recording.layout import Layout

FloatArray = NDArray[np.float64]


class LoopState(Record):
    """The block that a loop fills in each tick between its reading and `end`, which copies it into the row.

    `largest` and `raw` are filled by whoever reads the devices; a device without raw numbers has none of `raws`.
    """

    fingers: int  # n
    devices: int
    raws: int  # raw numbers of all devices, one device after another in their order
    wall: float  # time of the tick since that of the first [s]
    late: float  # after its deadline [s]
    io_read: float  # to ask and to read all devices [s]
    io_write: float  # to write all of them [s]
    skipped: int  # periods left out before it
    fresh: Floats = floats("fingers")  # 1 if the reading brought a new sample
    largest: Floats = floats("fingers")  # force that the device told it could display there, infinite without [N]
    switches: Floats = floats("devices")  # bits
    raw: Floats = floats("raws")


def loop_memory(layout: Layout) -> FloatArray:
    """Make the memory of a loop whose ticks are recorded in rows of a layout."""
    whole = {"fingers": len(layout.fingers), "devices": len(layout.devices), "raws": sum(n for _, n, _ in layout.raw)}
    memory = zeros(size_for(LoopState, **whole))
    state = LoopState(memory)
    for name, number in whole.items():
        setattr(state, name, number)
    state.array(LoopState.largest)[:] = np.inf
    return memory
