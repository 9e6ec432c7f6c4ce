"""Recording of a run: rows are collected in blocks, written to a part, and converted to a file at the end."""

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
    """Receives blocks of rows."""

    def write(self, rows: FloatArray, faults: Sequence[RunFault], changes: Sequence[KeyChange]) -> None:
        """Write rows (r, width), and faults and changes since the last write; the array is reused afterwards."""

    def close(self, outcome: Outcome) -> None: ...


class Recorder:
    """Collects rows in preallocated blocks, which a separate thread passes to the sinks.

    `space()` returns the rows for the next ticks, `take(count)` accepts them, and `drain()` sends blocks that are full
    or a second old. As a context manager it also closes the sinks after an error.

    Args:
        layout: layout of the rows that ticks write.
        header: header of the recording.
        sinks: receivers of blocks.
        block: number of rows per block. By default a run of known length in memory has one block, and
            other runs have blocks of about 1 MB.
        keep: whether to keep rows in memory, so that `finish` can return a recording; otherwise only the sinks get the
            rows.
        ticks: number of ticks of the whole run, if known.
        real_time: whether ticks never wait for the sinks; pending blocks stay in memory.
        selection: selection of recorded data from complete rows of every tick. By default ticks write the recorded
            data, one row every `header.every` ticks.
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
        """Number of rows in the present block."""
        return -(-self.ticks // self._every) - self._first

    @property
    def row(self) -> FloatArray:
        """The last row that a tick wrote."""
        row: FloatArray = self._block[max(self.used, 1) - 1]
        return row

    @property
    def backlog(self) -> int:
        """Upper bound on the bytes that wait for the sinks."""
        return 8 * self.layout.width * self._size * self._courier.waiting

    def space(self) -> tuple[FloatArray, int, int]:
        """Return a block of rows (r, width), the next tick's index in the block, and the number of ticks that fit.

        The tick at index r writes row r. With one row every m ticks, that tick writes row r / m if m divides r.

        Raises:
            RecordingError: a sink cannot write earlier rows.
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
        """Accept the rows that the next `count` ticks have written."""
        self.ticks += count

    def fault(self, k: int, message: str) -> None:
        self.faults.append(RunFault(k, message))

    def change(self, k: int, values: Mapping[str, Any]) -> None:
        """Record that keys of the scene have these values from tick k on."""
        self.changes += [KeyChange(k, key, as_stored(value)) for key, value in values.items()]

    def drain(self) -> None:
        """Send blocks that are full or a second old; call it between ticks.

        Raises:
            RecordingError: a sink cannot write earlier rows.
        """
        if self._sinks and (self.used == self._size or time.monotonic() - self._time >= SECOND):
            self._send()

    def flush(self) -> None:
        """Write all rows so far, and wait until the operating system has received them."""
        try:
            self._send()
        finally:
            self._courier.end()

    def finish(
        self, wall_time: float | None = None, *, complete: bool = True, engine: str = "", **coupling: Any
    ) -> Recording:
        """Write the remaining rows, close the sinks and return the recording of the retained rows.

        Args:
            wall_time: time that the run took [s].
            complete: False for a run that ended early.
            engine: engine that ran the ticks.
            coupling: reports of the objects' couplings, as items of `Outcome`.
        """
        self._outcome = self._so_far(wall_time, complete=complete, engine=engine, **coupling)
        try:
            self.flush()
        finally:
            for sink in self._sinks:
                sink.close(self._outcome)
        return Recording(self._rows(), self.recorded, self.header, self._outcome)

    def recording(self, **outcome: Any) -> Recording:
        """Return a copy of the retained rows so far as a recording, during the run; `outcome` as for `finish`."""
        return Recording(self._rows().copy(), self.recorded, self.header, self._so_far(**outcome))

    def _so_far(self, wall_time: float | None = None, *, complete: bool = True, **outcome: Any) -> Outcome:
        ticks = self.ticks if self.header.every > 1 else 0
        return Outcome(
            tuple(self.faults), wall_time, complete, ticks=ticks, changes=tuple(self.changes), **outcome
        )  # fmt: skip

    def _rows(self) -> FloatArray:
        """Return the retained rows, as a view if there is one block."""
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
        """Send the block's unsent rows, faults and changes to the writing thread."""
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
    """Describe in one line the exception that ended a run."""
    text = message(error)
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


class Courier:
    """Runs jobs in order in a thread; an error is raised when the next job is given.

    Compiled ticks release Python's lock, so that a block is written while they fill the next one. After an error no
    further job is run.

    Args:
        waiting: largest number of pending jobs before `give` blocks; 0 for no limit.
    """

    def __init__(self, waiting: int) -> None:
        self._jobs: Queue[Callable[[], None] | None] = Queue(waiting)
        self._thread: threading.Thread | None = None
        self._fault: BaseException | None = None

    @property
    def waiting(self) -> int:
        """Number of jobs that have not started."""
        return self._jobs.qsize()

    def give(self, job: Callable[[], None]) -> None:
        """Pass a job to the thread.

        Raises:
            BaseException: error of an earlier job.
        """
        self._require()
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="graspfx-recording", daemon=True)
            self._thread.start()
        self._jobs.put(job)

    def end(self) -> None:
        """Wait for all jobs.

        Raises:
            BaseException: error of a job.
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
