"""Detection of direct writes to numbers on which a recording depends; only an update may change these numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.records import name_of
from graspfx.coupling.grasp_state import GraspState
from graspfx.errors import InputError
from graspfx.loop.servo_parts import GraspedPart

FloatArray = NDArray[np.float64]

DO = "list the key of this number in gx.open(scene, live=[...]) and use session.set"


class Watch:
    """Entries of a run's memory that must not be written directly, and copies of their bits.

    These entries are the gains, the numbers that determine how forces are split, and the numbers that select the
    computation. Comparing all entries takes one or two microseconds.

    Args:
        objects: Objects whose grasps are watched.
    """

    def __init__(self, objects: Sequence[GraspedPart]) -> None:
        self._objects = objects
        self._stretches: list[tuple[FloatArray, int, int]] = []  # memory, first entry and end of each stretch
        self._views: list[memoryview] = []  # views of the stretches
        self._bits = b""
        self._seen: set[tuple[int, int]] = set()
        self._free = {(id(part.grasped.block), k) for part in objects for k in part.grasped.gain_entries}
        for part in objects:
            free = {k for _, k in self._free}
            structure = [int(k) for k in part.grasped.structure if int(k) not in free]
            self._add(part.grasped.block, [*part.grasped.watched_entries, *structure])

    def note(self) -> None:
        """Copy the present bits of all entries."""
        self._bits = b"".join(self._views)

    def require(self) -> None:
        """Require that all entries are unchanged, except for gains that agree with the switches in their block.

        Raises:
            InputError: If another entry has changed; the message names the entry.
        """
        if b"".join(self._views) == self._bits:
            return
        for part in self._objects:
            switch = part.grasped.contradiction()
            if switch:
                raise InputError(
                    f"{part.name}: {switch}", getattr(part.grasped.state, switch),
                    "a switch that agrees with the gains in the block",
                    "a gain was written directly; list the key of the gain in gx.open(scene, live=[...]) and use "
                    "session.set",
                )  # fmt: skip
        for array, k, value in self._intrusions():
            self._require_free(array, k, value)
        self.note()

    def _add(self, array: FloatArray, entries: Sequence[int]) -> None:
        """Add entries with their present bits."""
        left = sorted({k for k in map(int, entries) if (id(array), k) not in self._seen})
        if not left:
            return
        self._seen |= {(id(array), k) for k in left}
        memory = memoryview(array).cast("B")
        for first, end in _stretches(left):
            self._stretches.append((array, first, end))
            self._views.append(memory[8 * first : 8 * end])
            self._bits += bytes(self._views[-1])

    def _intrusions(self) -> Iterator[tuple[FloatArray, int, float]]:
        """Yield memory, index and former value of each entry that has changed."""
        at = 0
        for array, first, end in self._stretches:
            values = np.frombuffer(self._bits, np.float64, end - first, at)
            at += values.nbytes
            same = array[first:end].view(np.int64) == values.view(np.int64)
            yield from ((array, first + int(i), float(values[i])) for i in np.flatnonzero(~same))

    def _require_free(self, array: FloatArray, k: int, value: float) -> None:
        """Raise InputError if an entry must not have changed from its former value."""
        if (id(array), k) not in self._free:
            part = next(part for part in self._objects if part.grasped.block is array)
            name = f"{part.name}: {name_of(GraspState, k, array)}"
            raise InputError(name, float(array[k]), f"{value}, on which the run and its recording depend", DO)


def _stretches(entries: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Yield the first entry and the end of each contiguous range of sorted entries."""
    numbers = np.array(entries)
    breaks = np.flatnonzero(np.diff(numbers) > 1)
    firsts, lasts = [entries[0], *numbers[breaks + 1].tolist()], [*numbers[breaks].tolist(), entries[-1]]
    yield from ((first, last + 1) for first, last in zip(firsts, lasts, strict=True))
