"""Chunks handed out to a crew until all have come back; one that kills workers is narrowed down to a variant."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from functools import partial
from typing import Any

import numpy as np

from graspfx.sweeps.chunk import Chunk, ChunkResult, run_chunk
from graspfx.sweeps.crews import Crew
from graspfx.sweeps.scene_order import SceneOrder, SweepError

DEPTH = 2  # chunks for each worker that are handed out at a time
TRIES = 2  # of a chunk alone, before it is said to kill its worker
KILLS = "the process that ran it was killed or crashed, each time it was tried"
BORN_DEAD = (
    "worker processes die before they begin: a script that sweeps in processes must do so below "
    '`if __name__ == "__main__":`, as each of them reads the script again'
)


class ChunkLoop:
    """Runs chunks, and gives each whole result as it comes.

    Args:
        crew: that runs them.
        order: what they are chunks of.
        finish: takes a chunk and its result.
        note: takes a sentence on what went wrong on the way.
    """

    def __init__(
        self,
        crew: Crew,
        order: SceneOrder,
        finish: Callable[[Chunk, ChunkResult], None],
        note: Callable[[str], None],
    ) -> None:
        self.crew, self.order, self.finish, self.note = crew, order, finish, note
        self.content = order.bytes
        self.flying: dict[Future[Any], Chunk] = {}
        self.suspects: deque[Chunk] = deque()  # each runs with no other beside it
        self.deaths: dict[int, int] = {}  # of workers, by the number of the chunk that they had alone
        self.parts: dict[int, tuple[Chunk, ChunkResult, list[int]]] = {}  # of chunks that were split, and what is left
        self.alive = False  # whether workers have done anything yet

    def run(self, chunks: Iterable[Chunk]) -> None:
        """Run chunks until none is left.

        Raises:
            SweepError: workers cannot do it at all, or an executor that is not ours is broken.
        """
        left = deque(chunks)
        try:
            while left or self.flying or self.suspects:
                self._hand_out(left)
                ready, _ = wait(list(self.flying), return_when=FIRST_COMPLETED)
                dead: list[Chunk] = []
                for future in ready:
                    self._take(self.flying.pop(future), future, dead)
                if dead:
                    self._bury(dead)
        finally:
            for future in self.flying:
                future.cancel()

    def _hand_out(self, left: deque[Chunk]) -> None:
        if self.suspects:
            if not self.flying:
                self._submit(self.suspects.popleft())
            return
        most = 1 if self.crew.executor is None else DEPTH * self.crew.workers
        while left and len(self.flying) < most:
            self._submit(left.popleft())

    def _submit(self, chunk: Chunk) -> None:
        try:
            future = self.crew.submit(run_chunk, self.content, chunk, self.crew.threads)
        except BrokenExecutor as error:
            future = Future()
            future.set_exception(error)
        self.flying[future] = chunk

    def _take(self, chunk: Chunk, future: Future[Any], dead: list[Chunk]) -> None:
        try:
            result: ChunkResult = future.result()
        except BrokenExecutor as error:
            if not self.crew.mends:
                text = "a process of the executor died, which ends it: sweep again with another, or 'processes:N'"
                raise SweepError(f"{text}, which goes on by itself") from error
            dead.append(chunk)
        except CancelledError as error:
            raise SweepError("the executor or the cluster was closed before the sweep was over") from error
        except Exception as error:
            if type(error).__name__ != "KilledWorker":  # of dask, after some tries of its own
                raise
            self._narrow(chunk)
        else:
            self.alive = True
            self._collect(chunk, result)

    def _bury(self, dead: list[Chunk]) -> None:
        """Mend the crew; one of the chunks that ran killed a process, so that each of them is tried alone."""
        dead += self.flying.values()
        self.flying.clear()
        self.crew.mend()
        if not self.alive:
            self._require_life()
        if len(dead) > 1:
            self.suspects.extend(dead)
            return
        [chunk] = dead
        self.deaths[chunk.number] = self.deaths.get(chunk.number, 0) + 1
        if self.deaths[chunk.number] < TRIES:
            self.suspects.appendleft(chunk)
        else:
            self._narrow(chunk)

    def _require_life(self) -> None:
        """Tell a chunk that kills workers from workers that cannot begin.

        Raises:
            SweepError: they cannot.
        """
        try:
            self.crew.submit(partial(int, 1)).result()
        except BrokenExecutor as error:
            raise SweepError(BORN_DEAD) from error
        self.alive = True

    def _narrow(self, chunk: Chunk) -> None:
        """Split a chunk that killed its workers; a variant alone is a failure."""
        if chunk.number not in self.parts:
            self.parts[chunk.number] = (chunk, self._blank(chunk), [len(chunk)])
            self.note(f"a process died of one of {len(chunk)} variants: they are tried in parts")
        if len(chunk) > 1:
            self.suspects.extendleft(reversed(chunk.halves()))
            return
        result = self._blank(chunk)
        result.failures[0] = KILLS
        self.note(f"variant {chunk.members[0]}: {KILLS}")
        self._collect(chunk, result)

    def _collect(self, chunk: Chunk, result: ChunkResult) -> None:
        if chunk.number not in self.parts:
            self.finish(chunk, result)
            return
        whole, total, left = self.parts[chunk.number]
        total.include(np.searchsorted(whole.members, chunk.members), result)
        left[0] -= len(chunk)
        if not left[0]:
            del self.parts[chunk.number]
            self.finish(whole, total)

    def _blank(self, chunk: Chunk) -> ChunkResult:
        return ChunkResult.blank(len(chunk), self.order.shapes, self.order.statistics)
