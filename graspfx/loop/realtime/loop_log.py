"""The log of a loop on the wall's clock: fills its memory around the reading and the writing of its devices."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.records import start_of
from graspfx.loop.device_exchange import DeviceExchange
from graspfx.loop.realtime.loop_state import LoopState
from graspfx.loop.realtime.pacing import Pacer
from graspfx.loop.realtime.port_log import PortLog
from graspfx.loop.recording.layout import Layout

FloatArray = NDArray[np.float64]

WALL, LATE, SKIPPED, READ, WRITE = (
    start_of(LoopState, name) for name in ("wall", "late", "skipped", "io_read", "io_write")
)


class LoopLog:
    """Notes each tick's time and how long its devices took, and reads and writes them.

    Args:
        memory: of the loop, `LoopState`.
        layout: of its rows.
        devices: in plain Python, whose ports note what else they tell.
        pacer: that each tick has waited for.
    """

    def __init__(self, memory: FloatArray, layout: Layout, devices: DeviceExchange, pacer: Pacer) -> None:
        self._numbers: Any = memory.data  # plain floats, where items of an array cost twice as much
        self._devices, self._pacer, self._clock = devices, pacer, pacer.clock
        LoopState(memory).array(LoopState.fresh)[:] = 1.0  # of simulated devices whose kernels read them
        for each in devices.ports:
            each.log = PortLog(memory, layout, each.device, each.port.station, each.channels)

    def begin(self) -> None:
        """Note the time of a tick that begins now."""
        numbers, pacer = self._numbers, self._pacer
        numbers[WALL], numbers[LATE], numbers[SKIPPED] = pacer.wall, pacer.late, float(pacer.left_out)
        numbers[WRITE] = 0.0

    def read(self, periods: int) -> list[str]:
        """Read the devices, as `DeviceExchange.read` does."""
        began = self._clock.now()
        faults = self._devices.read(periods)
        self._numbers[READ] = self._clock.now() - began
        return faults

    def write(self) -> str:
        """Write the devices, as `DeviceExchange.write` does."""
        began = self._clock.now()
        fault = self._devices.write()
        self._numbers[WRITE] = self._clock.now() - began
        return fault
