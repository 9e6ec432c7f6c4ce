"""Entries that a tick's program has folded in, watched: a program would not see that one of them is written to."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.tick.script import Script

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]


class FrozenEntries:
    """The frozen entries of a script and the bits that they have to hold.

    Args:
        script: whose arrays they are entries of.
    """

    def __init__(self, script: Script) -> None:
        entries: dict[str, list[int]] = {}
        for name, k in script.frozen:
            entries.setdefault(name, []).append(k)
        self._watched: list[tuple[str, FloatArray, Index, bytes]] = []
        for name, places in entries.items():
            index = np.array(sorted(places), dtype=np.intp)
            values = np.array([script.frozen[name, int(k)] for k in index])
            self._watched.append((name, script.arrays[name], index, values.tobytes()))

    def intrusion(self) -> tuple[str, int] | None:
        """Find an entry that no longer holds its value, bit by bit: its array's name and its number; None if all do."""
        for name, array, index, values in self._watched:
            if array[index].tobytes() != values:
                same = array[index].view(np.int64) == np.frombuffer(values, np.int64)
                return name, int(index[np.flatnonzero(~same)[0]])
        return None
