"""Columns that only a real-time run records: times of ticks, new samples, and switches and raw values of devices."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.kernel import kernel, source_function
from graspfx.compile.memory import zeros
from graspfx.compile.records import Floats, Record, floats, size_for, size_of
from graspfx.errors import abbreviate
from graspfx.loop.columns import Layout
from graspfx.loop.device import Device, RawDevice, SwitchedDevice
from graspfx.loop.realtime.pacing import ClockState

FloatArray = NDArray[np.float64]


class LoopState(Record):
    """Block that a real-time loop fills in each tick before it is copied to the row of the tick.

    `switches` and `raw` are filled only with Python devices; a device without raw values has no entries in `raw`.
    `largest` remains infinite; the largest force that a device reports is copied to the row from the device's memory.
    """

    fingers: int  # n
    devices: int
    raws: int  # number of raw values of all devices, in the order of the devices
    wall: float  # time since the first tick [s]
    late: float  # time of the tick after its deadline [s]
    io_read: float  # duration of reading from all devices, including requests [s]
    io_write: float  # duration of writing to all devices [s]
    skipped: int  # number of periods skipped before the tick
    fresh: Floats = floats("fingers")  # 1 if the reading contained a new sample
    largest: Floats = floats("fingers")  # force limit without a report of the device: infinite [N]
    switches: Floats = floats("devices")  # switches as bits
    raw: Floats = floats("raws")


@kernel
def note_times(loop: LoopState, clock: ClockState) -> None:
    """Copy the times of a tick from the clock."""
    loop.wall = clock.wall
    loop.late = clock.late
    loop.skipped = clock.left_out
    loop.io_write = 0.0


def loop_memory(layout: Layout) -> FloatArray:
    """Allocate the memory of a loop whose rows have this layout."""
    whole = {"fingers": len(layout.fingers), "devices": len(layout.devices), "raws": sum(n for _, n, _ in layout.raw)}
    memory = zeros(size_for(LoopState, **whole))
    state = LoopState(memory)
    for name, number in whole.items():
        setattr(state, name, number)
    state.array(LoopState.largest)[:] = np.inf
    source_function(note_times)(memory.data, 0, np.zeros(size_of(ClockState)).data, 0)  # first call, before a run
    return memory


class PortLog:
    """Entries of one device in the memory of a loop.

    Args:
        memory: Memory of the loop, `LoopState`.
        layout: Layout of the recorded rows.
        device: Device whose values are recorded.
        number: Index of the device in the scene.
        fingers: Index of the finger that each channel moves; -1 if it moves none.
    """

    def __init__(
        self, memory: FloatArray, layout: Layout, device: Device, number: int, fingers: Sequence[int]
    ) -> None:  # fmt: skip
        loop = LoopState(memory)
        fresh = loop.array(LoopState.fresh)
        self._fresh = [fresh[f : f + 1] for f in fingers if f >= 0]
        self._switches = loop.array(LoopState.switches)[number : number + 1]
        self._count = device.features.switches
        self._raw: FloatArray | None = None
        first = 0
        for name, count, kind in layout.raw:
            if name == layout.devices[number]:
                self._raw, self._kind = loop.array(LoopState.raw)[first : first + count], np.dtype(kind)
            first += count

    def clear(self) -> None:
        """Record that there is no new sample."""
        for each in self._fresh:
            each[0] = 0.0

    def take(self, device: Device, *, is_fresh: bool) -> str:
        """Copy the switches and raw values of a reading; return an error message, which is empty on success."""
        for each in self._fresh:
            each[0] = float(is_fresh)
        if self._count:
            assert isinstance(device, SwitchedDevice)
            bits: object = device.switches
            if isinstance(bits, bool) or not isinstance(bits, int | np.integer) or not 0 <= bits < 1 << self._count:
                return f"returned {abbreviate(bits)} for its switches, expected an integer with {self._count} bits"
            self._switches[0] = bits
        if self._raw is not None:
            assert isinstance(device, RawDevice)
            raw = device.raw
            if not self._is_raw(raw):
                return f"reported {abbreviate(raw)} as raw values, expected an array {self._raw.shape} of {self._kind}"
            self._raw[...] = raw
        return ""

    def _is_raw(self, value: object) -> bool:
        assert self._raw is not None
        return isinstance(value, np.ndarray) and value.shape == self._raw.shape and value.dtype == self._kind
