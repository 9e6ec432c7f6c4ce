"""What a run on the wall's clock records of each tick besides its motion: its time, its devices and their samples."""

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
    """The block that a loop fills in each tick between its reading and the row, into which it is copied.

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


@kernel
def note_times(loop: LoopState, clock: ClockState) -> None:
    """Note when a tick is."""
    loop.wall = clock.wall
    loop.late = clock.late
    loop.skipped = clock.left_out
    loop.io_write = 0.0


def loop_memory(layout: Layout) -> FloatArray:
    """Make the memory of a loop whose ticks are recorded in rows of a layout."""
    whole = {"fingers": len(layout.fingers), "devices": len(layout.devices), "raws": sum(n for _, n, _ in layout.raw)}
    memory = zeros(size_for(LoopState, **whole))
    state = LoopState(memory)
    for name, number in whole.items():
        setattr(state, name, number)
    state.array(LoopState.largest)[:] = np.inf
    source_function(note_times)(memory.data, 0, np.zeros(size_of(ClockState)).data, 0)  # called first before a run
    return memory


class PortLog:
    """The pieces of a loop's memory that belong to one device.

    Args:
        memory: of the loop, `LoopState`.
        layout: of its rows.
        device: that is read.
        number: of the device, in the scene's order.
        fingers: of its channels, -1 for none.
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
        """Note that there is no new sample, as long as none has come."""
        for each in self._fresh:
            each[0] = 0.0

    def take(self, device: Device, *, is_fresh: bool) -> str:
        """Take over what a device tells beside a reading; return what is wrong with it, or nothing."""
        for each in self._fresh:
            each[0] = float(is_fresh)
        if self._count:
            assert isinstance(device, SwitchedDevice)
            bits: object = device.switches
            if isinstance(bits, bool) or not isinstance(bits, int | np.integer) or not 0 <= bits < 1 << self._count:
                return f"returned {abbreviate(bits)} for its switches, expected the bits of {self._count}"
            self._switches[0] = bits
        if self._raw is not None:
            assert isinstance(device, RawDevice)
            raw = device.raw
            if not self._is_raw(raw):
                return f"told {abbreviate(raw)} for raw numbers, expected an array {self._raw.shape} of {self._kind}"
            self._raw[...] = raw
        return ""

    def _is_raw(self, value: object) -> bool:
        assert self._raw is not None
        return isinstance(value, np.ndarray) and value.shape == self._raw.shape and value.dtype == self._kind
