"""The log of one device besides its motion: whether its sample is new, its switches, its raw numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import abbreviate
from graspfx.loop.device import Device, RawDevice, SwitchedDevice
from graspfx.loop.realtime.loop_state import LoopState
from graspfx.loop.recording.layout import Layout

FloatArray = NDArray[np.float64]

EXACT = 1 << 53  # whole numbers up to it are exact in a row


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
                return f"told {abbreviate(bits)} for its switches, expected the bits of {self._count}"
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
