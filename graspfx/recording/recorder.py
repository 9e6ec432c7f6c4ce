"""Recorder of a run, which collects rows in blocks, passes them to sinks, and returns the recording at the end."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from queue import Queue
from types import TracebackType
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import message
from graspfx.loop.columns import Layout, RunFault, Selection
from graspfx.recording.header import Header, KeyChange, Outcome, as_stored
from graspfx.recording.record import Recording

FloatArray = NDArray[np.float64]

BLOCK = 1 << 20  # size of a block for the sinks [bytes]
WAITING = 2  # largest number of blocks that wait for the writing thread before ticks wait
SECOND = 1.0  # time after which an incomplete block is sent [s]; the clock affects the time of writing only


class Sink(Protocol):
    """Receiver of blocks of rows, such as a file."""

    def write(self, rows: FloatArray, faults: Sequence[RunFault], changes: Sequence[KeyChange]) -> None:
        """Write rows (r, width), and the faults and changes since the last call; the array `rows` is reused later."""

    def close(self, outcome: Outcome) -> None: ...


class Recorder:
    """Collector of the rows of a run in preallocated blocks, which a separate thread passes to the sinks.

    `space()` returns the block for the next ticks, `take(count)` accepts the rows of `count` ticks, and `drain()` sends
    blocks that are full or one second old. At the end of a `with` block, also after an error, the sinks are closed.

    Args:
        layout: Layout of the rows that the ticks write.
        header: Header of the recording.
        sinks: Receivers of the blocks.
        block: Number of rows per block. By default one block contains the whole run, if its length is known and there
            are no sinks; otherwise a block has about 1 MB.
        keep: Whether to keep the rows in memory, so that `finish` returns them. Otherwise only the sinks get the rows.
        ticks: Number of ticks of the run; None if unknown.
        selection: Selection of the recorded data from rows of all ticks with all columns. By default the ticks write
            only the recorded data, one row every `header.every` ticks.
        real_time: Whether ticks never wait for the sinks; blocks that wait for the sinks are then kept in memory.
    """

    def __init__(
        self,
        layout: Layout,
        header: Header,
        sinks: Sequence[Sink] = (),
        block: int | None = None,
        *,
        keep: bool = True,
        ticks: int | None = None,
        selection: Selection | None = None,
        real_time: bool = False,
    ) -> None:
        self.layout, self.header, self.ticks = layout, header, 0
        self.faults: list[RunFault] = []
        self.changes: list[KeyChange] = []
        self._selection = selection or Selection(layout, layout)
        self._every = header.every if selection is None or selection.is_whole else 1
        self._sinks, self._keep = tuple(sinks), keep
        self._courier = Courier(0 if real_time else WAITING)
        size = max(1, BLOCK // (8 * max(layout.width, 1)))
        if ticks is not None:
            rows = max(1, -(-ticks // self._every))
            size = rows if keep and not sinks and self._selection.is_whole else min(rows, size)
        self._size = block or size
        self._blocks: list[FloatArray] = []  # blocks kept in memory
        self._spares: list[FloatArray] = []
        self._faults_sent = self._changes_sent = 0
        self._block = np.empty((self._size, layout.width))
        self._first = self._sent = 0  # indices of the block's first row, and of the first unsent row
        self._time = time.monotonic()  # time of the last sending
        self._outcome: Outcome | None = None

    @property
    def recorded(self) -> Layout:
        """Layout of the recorded columns."""
        return self._selection.layout

    @property
    def used(self) -> int:
        """Number of rows of the present block that are written."""
        return -(-self.ticks // self._every) - self._first

    @property
    def row(self) -> FloatArray:
        """The last row that was written."""
        row: FloatArray = self._block[max(self.used, 1) - 1]
        return row

    @property
    def backlog(self) -> int:
        """Upper bound on the size of the rows that wait for the sinks, in bytes."""
        return 8 * self.layout.width * self._size * self._courier.waiting

    def space(self) -> tuple[FloatArray, int, int]:
        """Return a block (r, width), the index i of the next tick in the block, and the number of ticks that fit.

        The tick at index i writes row i of the block. If one of m ticks is recorded, the tick writes row i / m if m
        divides i, and no row otherwise.

        Raises:
            RecordingError: A sink could not write earlier rows.
        """
        if self.used == self._size:
            self._send()
            if self._keep:
                self._blocks.append(self._selection.cut(self._block, self._first))
            self._first += self._size
            self._block = self._spares.pop() if self._spares else np.empty((self._size, self.layout.width))
        place = self.ticks - self._first * self._every
        return self._block, place, self._size * self._every - place

    def take(self, count: int) -> None:
        """Accept the rows that the next `count` ticks have written to the block."""
        self.ticks += count

    def fault(self, k: int, message: str) -> None:
        self.faults.append(RunFault(k, message))

    def change(self, k: int, values: Mapping[str, Any]) -> None:
        """Record that keys of the scene have new values from tick k on."""
        self.changes += [KeyChange(k, key, as_stored(value)) for key, value in values.items()]

    def drain(self) -> None:
        """Send blocks that are full or one second old to the sinks. Call this method between ticks.

        Raises:
            RecordingError: A sink could not write earlier rows.
        """
        if self._sinks and (self.used == self._size or time.monotonic() - self._time >= SECOND):
            self._send()

    def flush(self) -> None:
        """Send all rows to the sinks, and wait until the sinks have written them."""
        try:
            self._send()
        finally:
            self._courier.end()

    def finish(
        self, wall_time: float | None = None, *, complete: bool = True, engine: str = "", **coupling: Any
    ) -> Recording:
        """Send the remaining rows, close the sinks, and return a recording of the rows that were kept in memory.

        Args:
            wall_time: Duration of the run in real time [s].
            complete: Whether the run reached its end.
            engine: Name of the engine that ran the ticks.
            coupling: Other fields of `Outcome`.
        """
        self._outcome = self._so_far(wall_time, complete=complete, engine=engine, **coupling)
        try:
            self.flush()
        finally:
            for sink in self._sinks:
                sink.close(self._outcome)
        return Recording(self._rows(), self.recorded, self.header, self._outcome)

    def recording(self, **outcome: Any) -> Recording:
        """Return a copy of the rows kept so far as a recording, during a run; the arguments are those of `finish`."""
        return Recording(self._rows().copy(), self.recorded, self.header, self._so_far(**outcome))

    def _so_far(self, wall_time: float | None = None, *, complete: bool = True, **outcome: Any) -> Outcome:
        ticks = self.ticks if self.header.every > 1 else 0
        return Outcome(
            tuple(self.faults), wall_time, complete, ticks=ticks, changes=tuple(self.changes), **outcome
        )  # fmt: skip

    def _rows(self) -> FloatArray:
        """Return the rows kept so far; if there is only one block, the result is a view of it."""
        if not self._keep:
            return np.empty((0, self.recorded.width))
        rest = self._selection.cut(self._block[: self.used], self._first)
        return np.concatenate([*self._blocks, rest]) if self._blocks else rest

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._outcome is None:
            self.finish(complete=False, cause="" if error is None else cause_text(error))

    def _send(self) -> None:
        """Pass the rows, faults and changes that have not been sent to the thread that calls the sinks."""
        block, tick, used = self._block, self._sent, self.used
        rows = block[tick - self._first : used]
        faults, changes = self.faults[self._faults_sent :], self.changes[self._changes_sent :]
        self._sent, self._time = self._first + used, time.monotonic()
        self._faults_sent, self._changes_sent = len(self.faults), len(self.changes)

        def job() -> None:
            part = self._selection.cut(rows, tick)
            for sink in self._sinks:
                sink.write(part, faults, changes)
            if used == self._size and not self._keep:
                self._spares.append(block)

        if self._sinks and (len(rows) or faults or changes):
            self._courier.give(job)


def cause_text(error: BaseException) -> str:
    """Return a description, in one line, of the exception that ended a run."""
    text = message(error)
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


class Courier:
    """Thread that runs jobs in the order in which they were given.

    Compiled ticks release Python's global lock, so that a block is written while ticks fill the next one. If a job
    raises an exception, no further job is run, and the next call of `give` or `end` raises this exception.

    Args:
        waiting: Largest number of jobs that wait before `give` blocks; 0 for no limit.
    """

    def __init__(self, waiting: int) -> None:
        self._jobs: Queue[Callable[[], None] | None] = Queue(waiting)
        self._thread: threading.Thread | None = None
        self._fault: BaseException | None = None

    @property
    def waiting(self) -> int:
        """Number of jobs that have not been started."""
        return self._jobs.qsize()

    def give(self, job: Callable[[], None]) -> None:
        """Add a job to those that the thread will run.

        Raises:
            BaseException: An earlier job raised this exception.
        """
        self._require()
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="graspfx-recording", daemon=True)
            self._thread.start()
        self._jobs.put(job)

    def end(self) -> None:
        """Wait until all jobs have ended, and end the thread.

        Raises:
            BaseException: A job raised this exception.
        """
        if self._thread is not None:
            self._jobs.put(None)
            self._thread.join()
            self._thread = None
        self._require()

    def _require(self) -> None:
        if self._fault is not None:
            fault, self._fault = self._fault, None
            raise fault

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            if self._fault is None:
                try:
                    job()
                except BaseException as fault:  # noqa: BLE001 - it is raised where the next job is given
                    self._fault = fault
