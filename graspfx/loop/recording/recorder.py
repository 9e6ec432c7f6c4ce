"""The recorder of a run: rows taken tick by tick into blocks, which leave for the sinks between ticks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.recording.attributes import as_stored
from graspfx.loop.recording.header import Header, KeyChange, Outcome, RunFault
from graspfx.loop.recording.layout import Layout
from graspfx.loop.recording.record import Recording

FloatArray = NDArray[np.float64]

LARGEST_BLOCK = 1024  # rows


class Sink(Protocol):
    """Where full blocks of rows go."""

    def write(self, rows: FloatArray, faults: Sequence[RunFault]) -> None:
        """Write rows (r, width), and the faults since the last write."""

    def close(self, outcome: Outcome) -> None: ...


@runtime_checkable
class SinkOfChanges(Sink, Protocol):
    """One that also writes which keys of the scene changed in mid-run."""

    def note(self, changes: Sequence[KeyChange]) -> None:
        """Write the changes of keys since the last time, before the rows that they hold in."""


class Recorder:
    """Takes rows into blocks allocated beforehand; full blocks leave between ticks.

    `space()` tells where the next rows go; once they are written `take(count)` keeps them, and `drain()` hands a full
    block to the sinks and does nothing otherwise. Used as a context manager it closes the sinks also when the run
    breaks off.

    Args:
        layout: the columns of a row.
        header: of the recording.
        sinks: where blocks go besides memory.
        block: rows in a block; about one second of the run if not given.
        keep: the rows in memory too, for `finish` to make a recording of them; else only the sinks have them.
    """

    def __init__(
        self,
        layout: Layout,
        header: Header,
        sinks: Sequence[Sink] = (),
        block: int | None = None,
        *,
        keep: bool = True,
    ) -> None:
        self.layout, self.header = layout, header
        self.faults: list[RunFault] = []
        self.changes: list[KeyChange] = []
        self._sinks = tuple(sinks)
        self._size = block or max(1, min(LARGEST_BLOCK, round(1.0 / header.period)))
        self._keep = keep
        self._blocks: list[FloatArray] = []
        self._full: list[FloatArray] = []  # on their way to the sinks
        self._faults_written = self._changes_written = 0
        self._open()
        self._outcome: Outcome | None = None

    def space(self) -> tuple[FloatArray, int, int]:
        """Give a block of rows (r, width), the first free one and the count of free ones; one at least."""
        if self.used == self._size:
            self._turn()
        return self._block, self.used, self._size - self.used

    def take(self, count: int) -> None:
        """Keep that many rows more of the block."""
        self.used += count

    def fault(self, k: int, message: str) -> None:
        self.faults.append(RunFault(k, message))

    def change(self, k: int, values: Mapping[str, Any]) -> None:
        """Note that keys of the scene have these values from tick k on."""
        self.changes += [KeyChange(k, key, as_stored(value)) for key, value in values.items()]

    def drain(self) -> None:
        """Hand full blocks to the sinks; call it between ticks."""
        if self.used == self._size:
            self._turn()
        while self._full:
            block = self._full.pop(0)
            if self._keep:
                self._blocks.append(block)
            self._write(block)

    def finish(
        self, wall_time: float | None = None, *, complete: bool = True, engine: str = "", **coupling: Any
    ) -> Recording:
        """Write the rest, close the sinks and give the recording of the retained rows.

        Args:
            wall_time: that the run took [s].
            complete: False for a run that broke off.
            engine: that ran the ticks.
            coupling: what the objects' couplings tell, as `Outcome` has it.
        """
        self.drain()
        rest = self._block[: self.used]
        self._outcome = self._so_far(wall_time, complete=complete, engine=engine, **coupling)
        try:
            if self.used or len(self.faults) > self._faults_written or len(self.changes) > self._changes_written:
                self._write(rest)
        finally:
            for sink in self._sinks:
                sink.close(self._outcome)
        return Recording(self._rows(), self.layout, self.header, self._outcome)

    def recording(self, **outcome: Any) -> Recording:
        """Give the recording of the retained rows so far, a copy, while the run goes on; `outcome` as of `finish`."""
        return Recording(self._rows(), self.layout, self.header, self._so_far(**outcome))

    def _so_far(self, wall_time: float | None = None, *, complete: bool = True, **outcome: Any) -> Outcome:
        return Outcome(tuple(self.faults), wall_time, complete, changes=tuple(self.changes), **outcome)

    def _rows(self) -> FloatArray:
        rest = [*self._full, self._block[: self.used]] if self._keep else []
        return np.concatenate([np.empty((0, self.layout.width)), *self._blocks, *rest])

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._outcome is None:
            self.finish(complete=False)

    def _open(self) -> None:
        self._block = np.zeros((self._size, self.layout.width))
        self.used = 0

    def _turn(self) -> None:
        self._full.append(self._block)
        self._open()

    def _write(self, rows: FloatArray) -> None:
        faults, changes = self.faults[self._faults_written :], self.changes[self._changes_written :]
        self._faults_written, self._changes_written = len(self.faults), len(self.changes)
        for sink in self._sinks:
            if changes and isinstance(sink, SinkOfChanges):
                sink.note(changes)
            sink.write(rows, faults)
