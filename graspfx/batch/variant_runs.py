"""Runs of the variants of one group by the program of all scenes, as in `gx.run`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from threading import Lock
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from graspfx.batch.groups import Group
from graspfx.batch.statistics import FIRST, LATE_LOW, LOW, MEASURES, empty, take
from graspfx.compile.native import Native, compiled
from graspfx.compile.program import program_source
from graspfx.loop.arena import Arena
from graspfx.loop.engine import machine_codes, program
from graspfx.loop.world import ServoState

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]
More = Callable[[FloatArray], FloatArray]

APIECE = 8  # number of variants that a thread takes at a time
BLOCK = 1024  # number of rows that are written at a time


@dataclass
class Job:
    """Variants of one group to run.

    Args:
        arena: Arena of one variant.
        size: Number of entries of an arena.
        begin: Initial contents of the arenas.
        variants: Number of variants.
        width: Number of entries of a row.
        columns: Indices of the measured numbers of a row.
        ticks: Ticks of a run.
        look: Function that is called with the arena of every variant after its run.
        more: Function of the variants' arenas (v, arena) that returns another function. From the variants' rows (r,
            width, v), this function computes further numbers, which are appended to the rows.
    """

    arena: Arena
    size: int
    begin: Group
    variants: int
    width: int
    columns: Sequence[int]
    ticks: int
    look: Callable[[FloatArray], None] | None = None
    more: Callable[[FloatArray], More] | None = None
    looking: Lock = field(default_factory=Lock)
    spent: float = 0.0  # time spent on runs [s]
    done: int = 0  # number of variants that have run

    def measured(self, threads: int) -> tuple[FloatArray, Index]:
        """Return measures (V, columns, MEASURES), and the tick of each variant's fault, -1 for none."""
        measures = np.empty((self.variants, len(self.columns), MEASURES))
        faults = np.full(self.variants, -1)
        members, single = np.arange(self.variants), self._single
        began = perf_counter()

        def run(some: Index) -> None:
            single.measure(some, measures, faults)
            with self.looking:
                self.done += len(some)

        _shared(run, [members[k : k + APIECE] for k in range(0, self.variants, APIECE)], threads)
        self.spent += perf_counter() - began
        return measures, faults

    def recorded(self, threads: int) -> Iterator[Ended]:
        """Run as many variants at a time as there are threads; yield the results in the order of the variants."""
        single = self._single
        began = perf_counter()
        with ThreadPoolExecutor(threads) as pool:
            for k in range(0, self.variants, threads):  # at most one group of rows in advance of the consumer
                yield from pool.map(single.record, range(k, min(k + threads, self.variants)))
        self.spent += perf_counter() - began

    @cached_property
    def _single(self) -> SingleRuns:
        return SingleRuns(self)


@dataclass(frozen=True)
class Ended:
    """End of a recorded variant's run: rows, the tick of its fault or -1, and its buffers, (arena,).

    `arena_copy` contains the buffers after the tick of the fault; the fault's message quotes values from these buffers.
    """

    rows: FloatArray
    fault: int
    arena: FloatArray
    arena_copy: FloatArray


class SingleRuns:
    """Runs of one variant at a time; each thread has its own buffers."""

    def __init__(self, job: Job) -> None:
        self.job = job
        self.program: Native = program()
        self.taking = taking()
        self._kernels = machine_codes(job.arena)

    def measure(self, members: Index, measures: FloatArray, faults: Index) -> None:
        """Run variants and store their measures and faults."""
        job = self.job
        arena, run, rows = self._bound(min(BLOCK, job.ticks))
        begin = job.begin.arenas(members)
        columns = np.array(job.columns, dtype=float)
        sums = empty(len(columns))
        wide = rows if job.more is None else np.zeros((len(rows), max(job.width, *job.columns) + 1))
        buffers = {"rows": wide.reshape(-1), "columns": columns, "found": sums.reshape(-1)}
        taking = self.taking.bind(*(buffers[name] for name in self.taking.arrays)).long
        half = job.ticks // 2
        for variant, arrays in zip(members.tolist(), begin, strict=True):
            self._fill(arena, arrays)
            sums[...] = empty(len(columns))
            more = None if job.more is None else job.more(arena[None])
            k = 0
            for end, low in ((half, LOW), (job.ticks, LATE_LOW)):
                while k < end:
                    count = run(k, min(len(rows), end - k), 0)
                    if more is not None:
                        extra = more(rows[:count, :, None])
                        wide[:count, : job.width] = rows[:count]
                        wide[:count, job.width : job.width + extra.shape[1]] = extra[..., 0]
                    if k == 0:
                        sums[:, FIRST] = wide[0, list(job.columns)]
                    taking(count, wide.shape[1], len(columns), low)
                    k += count
            measures[variant] = sums
            faults[variant] = self._fault(arena)
            if job.look is not None:
                with job.looking:
                    job.look(arena)

    def record(self, variant: int) -> Ended:
        """Run one variant and record its rows."""
        arena, run, rows = self._bound(self.job.ticks)
        self._fill(arena, self.job.begin.arenas(slice(variant, variant + 1))[0])
        k, copy = 0, arena
        while k < self.job.ticks:
            k += run(k, min(BLOCK, self.job.ticks - k), k)
            if copy is arena and self._fault(arena) >= 0:
                copy = arena.copy()
        return Ended(rows, self._fault(arena), arena, copy)

    def _fill(self, arena: FloatArray, start: FloatArray) -> None:
        """Copy a variant's initial contents, and the addresses of third-party kernels, into an arena."""
        arena[:] = start
        for each, native in self._kernels:
            arena[list(each.entries)] = float(native.entry)

    def _fault(self, arena: FloatArray) -> int:
        servo = ServoState(arena, self.job.arena.place(self.job.arena.own))
        return servo.tick if servo.faulted else -1

    def _bound(self, count: int) -> tuple[FloatArray, Callable[..., int], FloatArray]:
        """Bind the program to an arena, and return the rows that it writes."""
        job = self.job
        arena, rows = np.zeros(job.size), np.zeros((count, job.width))
        arrays = {"arena": arena, "rows": rows.reshape(-1)}
        bound = self.program.bind(*(arrays[name] for name in self.program.arrays))
        return arena, partial(bound.long, job.arena.offset), rows


def _shared(run: Callable[[Index], None], jobs: Iterable[Index], threads: int) -> None:
    """Distribute jobs over threads; each idle thread takes the next job."""
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
        finally:  # after an error or an interruption, no thread starts another job
            with lock:
                left = iter(())


@cache
def taking() -> Native:
    """Compile the update of measures, once per process."""
    text = "def run(count, width, numbers, low):\n    take(rows, columns, found, count, width, numbers, low)"
    return compiled(program_source(text, {"take": take}, ["rows", "columns", "found"]))
