"""Run many variants of one program: as lanes side by side where that is worth a program of its own, else one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cached_property, partial
from threading import Lock, local
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from graspfx.batch.lane_runs import BLOCK, LaneBuffers, LaneRuns
from graspfx.batch.single_runs import Ended, SingleRuns
from graspfx.batch.statistics import MEASURES
from graspfx.batch.task import Task
from graspfx.errors import InputError

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]

MOST = 64  # blocks of lanes that a thread takes at a time, at most
APIECE = 8  # variants that it takes at a time to run one by one
LANES_WORTH = 10_000_000  # ticks of all variants for which a program for lanes is compiled
LANES_LOOK = 1_000_000  # and for which one is sought in the cache: its text has to be written for that
MOST_ROWS = 2**28  # bytes of the rows of a block of lanes that are recorded whole
MOST_LANES = 8  # of a block


@dataclass
class Job(Task):
    """Variants of one program, run by the way that suits them."""

    def measured(self, threads: int) -> tuple[FloatArray, Index]:
        """Give measures (V, columns, MEASURES), and the tick of each variant's fault, -1 if it has none."""
        measures = np.empty((self.variants, len(self.columns), MEASURES))
        faults = np.full(self.variants, -1)
        members = np.arange(self.variants)
        lanes = self._lane_runs(self.work, measuring=True)
        single = self._single if lanes is None else None
        began = perf_counter()
        if lanes is not None:
            self._in_lanes(lanes, members, measures, faults, threads)
        if single is not None:

            def alone(members: Index) -> None:
                single.measure(members, measures, faults)
                self.count(members)

            _shared(alone, [members[k : k + APIECE] for k in range(0, self.variants, APIECE)], threads)
        self.spent += perf_counter() - began
        return measures, faults

    def recorded(self, threads: int) -> Iterator[Ended]:
        """Run every variant in turn, with its rows."""
        lanes = self._lane_runs(self.work, measuring=False)
        if lanes is None:
            self._single  # noqa: B018 (compiled before threads ask for it)
        began = perf_counter()
        with ThreadPoolExecutor(threads) as pool:
            count = 8 if lanes is None else lanes.lanes
            groups = [np.arange(k, min(k + count, self.variants)) for k in range(0, self.variants, count)]
            for k in range(0, len(groups), threads):  # not more rows at a time than are taken away
                for ended in pool.map(partial(self._recorded, lanes), groups[k : k + threads]):
                    yield from ended
        self.spent += perf_counter() - began

    def _recorded(self, lanes: LaneRuns | None, members: Index) -> list[Ended]:
        if lanes is None:
            return [self._single.record(variant) for variant in members.tolist()]
        buffers = lanes.bound(self.ticks)
        buffers.begin(members)
        buffers.program.long(0, self.ticks, 0)
        faults, arenas = buffers.faults(), buffers.arenas(len(members))
        rows = buffers.rows.reshape(self.ticks, self.width, lanes.lanes)
        return [
            # of a fault the figures as they were then are wanted, too
            self._single.record(variant) if faults[lane] >= 0
            else Ended(np.ascontiguousarray(rows[:, :, lane]), -1, arenas[lane], arenas[lane])
            for lane, variant in enumerate(members.tolist())
        ]  # fmt: skip

    @cached_property
    def _single(self) -> SingleRuns:
        return SingleRuns(self)

    # Lanes under masks --------------------------------------------------------------------------------------------

    def _lane_runs(self, work: float, *, measuring: bool) -> LaneRuns | None:
        """Make the program for lanes, if so many ticks are worth it."""
        whole = not measuring and self.ticks * self.width * 8 * MOST_LANES > MOST_ROWS
        if self.variants < 2 or work < LANES_LOOK or whole:
            return None
        try:
            return LaneRuns(self, measuring and self.more is None, make=work >= LANES_WORTH)
        except (LookupError, InputError):
            return None

    def _in_lanes(self, lanes: LaneRuns, members: Index, measures: FloatArray, faults: Index, threads: int) -> None:
        """Run variants in blocks of lanes; each thread has buffers of its own."""
        buffers = local()

        def run(some: Index) -> None:
            if not hasattr(buffers, "own"):
                buffers.own = lanes.bound(1 if self.more is None else min(BLOCK, self.ticks))
            own: LaneBuffers = buffers.own
            for k in range(0, len(some), lanes.lanes):
                own.measure(some[k : k + lanes.lanes], measures, faults)
                self.count(some[k : k + lanes.lanes])
                if self.look is not None:
                    with self.looking:
                        for arena in own.arenas(len(some[k : k + lanes.lanes])):
                            self.look(arena)

        span = lanes.lanes * min(MOST, max(1, len(members) // (4 * threads * lanes.lanes)))
        _shared(run, [members[k : k + span] for k in range(0, len(members), span)], threads)


def _shared(run: Callable[[Index], None], jobs: Iterable[Index], threads: int) -> None:
    """Share jobs among some threads, each taking the next one."""
    left = iter(jobs)
    lock = Lock()

    def work() -> None:
        while True:
            with lock:
                job = next(left, None)
            if job is None:
                return
            run(job)

    if threads == 1:
        work()
        return
    with ThreadPoolExecutor(threads) as pool:
        try:
            for future in as_completed([pool.submit(work) for _ in range(threads)]):
                future.result()
        finally:  # after an error, or if the user breaks off, no thread begins another
            with lock:
                left = iter(())
