"""The face of a recorder that a servo's ticks see, wherever their rows go."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class RowTaker(Protocol):
    """A taker of rows tick by tick: `Recorder` in the servo's own process, `RingRecorder` where another one records."""

    @property
    def row(self) -> FloatArray:
        """The last row that a tick wrote."""
        ...

    def space(self) -> tuple[FloatArray, int, int]:
        """Give rows (r, width), the place in them of the next tick, and for how many ticks there is room.

        The tick at place r writes row r; with a row every m ticks, row r / m if m divides r.
        """
        ...

    def take(self, count: int) -> None:
        """Keep what that many ticks more have written."""

    def drain(self) -> None:
        """Pass on what is full; called between ticks."""

    def fault(self, k: int, message: str) -> None:
        """Note a fault of tick k."""

    def change(self, k: int, values: Mapping[str, Any]) -> None:
        """Note that keys of the scene have these values from tick k on."""
