"""Blocks of rows on their way to the sinks, in a thread of their own while ticks go on."""

from __future__ import annotations

from collections.abc import Callable
from queue import Queue
from threading import Thread

WAITING = 2  # blocks that may wait for the thread: then the ticks wait


class Courier:
    """Does jobs one after another, in a thread that starts with the first; a fault is raised where the next is given.

    Compiled ticks release Python's lock, so that a block is written while they fill the next one. After a fault nothing
    more is done.

    Args:
        waiting: jobs that may wait before whoever gives one waits too; 0 for as many as there are.
    """

    def __init__(self, waiting: int = WAITING) -> None:
        self._jobs: Queue[Callable[[], None] | None] = Queue(waiting)
        self._thread: Thread | None = None
        self._fault: BaseException | None = None

    @property
    def waiting(self) -> int:
        """Jobs that have not begun."""
        return self._jobs.qsize()

    def give(self, job: Callable[[], None]) -> None:
        """Give a job to the thread.

        Raises:
            BaseException: that one before has raised.
        """
        self._require()
        if self._thread is None:
            self._thread = Thread(target=self._work, name="graspfx-recording", daemon=True)
            self._thread.start()
        self._jobs.put(job)

    def end(self) -> None:
        """Wait for all jobs.

        Raises:
            BaseException: that one of them has raised.
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
