"""Runs of variants as lanes side by side, in blocks of as many as a processor computes with at once."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from graspfx.batch.program_text import ROWS, SUMS, folded, lane_text, taking_text
from graspfx.batch.statistics import LATE_LOW, LOW, MEASURES, empty
from graspfx.batch.task import More, Task
from graspfx.compile.emission import side_by_side
from graspfx.compile.native import Bound, Native, compiled
from graspfx.compile.records import start_of
from graspfx.loop.world import ServoState

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]

ALIGNED = 64  # bytes
BLOCK = 1024  # rows that are recorded at a time to compute what follows from them


@dataclass
class LaneRuns:
    """A job's program for lanes; None of its variants needs to be alike another in what it does.

    Args:
        job: the variants.
        measuring: whether measures are taken as ticks come; else whole rows are recorded.
        make: whether to compile what is not in the cache.

    Raises:
        LookupError: it is not in the cache, and not to be compiled.
        InputError: the program holds what lanes cannot do.
    """

    job: Task
    measuring: bool
    make: bool
    lanes: int = field(default_factory=side_by_side)

    def __post_init__(self) -> None:
        job, shared = self.job, tuple(sorted(self.shared.items()))
        about = tuple(job.columns), tuple(job.statistics), self.measuring, self.lanes, shared
        self.native: Native = job.memory.recall(("lanes", id(job.arena), *about), self._compiled)

    def _compiled(self) -> Native:
        job, columns = self.job, self.job.columns if self.measuring else None
        source = folded(job.arena, lane_text(job.arena, columns, job.statistics))
        return compiled(source, wide=True, lanes=self.lanes, shared=self.shared, make=self.make)

    @cached_property
    def shared(self) -> dict[str, tuple[int, int]]:
        """The entries that all variants have alike, and that nothing writes."""
        varying, (first, end) = self.job.varying, self.job.constant
        is_same = not ((varying >= first) & (varying < end)).any()
        return {"arena": (first, end)} if end > first and is_same else {}

    def bound(self, rows: int) -> LaneBuffers:
        """Make buffers for one block of lanes, with so many rows."""
        return LaneBuffers(self, rows)


class LaneBuffers:
    """Buffers of one block of lanes, an entry's lanes side by side; each thread has its own."""

    def __init__(self, runs: LaneRuns, rows: int) -> None:
        job, lanes = runs.job, runs.lanes
        self.job, self.lanes = job, lanes
        base = job.begin.arenas(slice(0, 1))[0]
        first, end = runs.shared.get("arena", (0, 0))
        self.entries = np.delete(np.arange(len(base)), slice(first, end))  # those that each lane has
        self.whole = base
        self.base = base[self.entries, None]
        self.arena = aligned(len(base) * lanes).reshape(len(base), lanes)
        width = len(dict.fromkeys(job.columns)) if runs.measuring else job.width
        self.rows = aligned(max(1, rows * width) * lanes).reshape(-1, lanes)
        self.measures = aligned(max(1, len(job.columns) * MEASURES) * lanes).reshape(-1, lanes)
        self.blank = np.repeat(empty(len(job.columns)).reshape(-1, 1), lanes, axis=1)
        buffers: dict[str, FloatArray] = {ROWS: self.rows.reshape(-1), SUMS: self.measures.reshape(-1)}
        buffers |= {"arena": self.arena.reshape(-1), "arena.shared": base[first:end].copy()}
        self.program: Bound = runs.native.bind(*(buffers[name] for name in runs.native.arrays))

    def begin(self, members: Index) -> None:
        """Fill in some variants, at most as many as there are lanes; further lanes repeat the last."""
        own = np.append(members, np.repeat(members[-1:], self.lanes - len(members)))
        self.arena[self.entries] = self.base
        self.job.begin.fill_lanes(self.arena, own)

    def measure(self, members: Index, measures: FloatArray, faults: Index) -> None:
        """Run some variants and note their measures and faults."""
        job, half = self.job, self.job.ticks // 2
        self.begin(members)
        if job.columns:
            self.measures[: len(self.blank)] = self.blank
        if job.more is None:
            self.program.long(0, half, LOW)
            self.program.long(half, job.ticks - half, LATE_LOW)
        else:
            self._measure_rows(job.more(self.arenas(self.lanes)))
        shape = (len(members), len(job.columns), MEASURES)
        measures[members] = self.measures[: len(self.blank)].T[: len(members)].reshape(shape)
        faults[members] = self.faults()[: len(members)]

    def _measure_rows(self, more: More) -> None:
        """Record some rows at a time, compute what follows from them, and take both into measures."""
        job, half, columns = self.job, self.job.ticks // 2, list(self.job.columns)
        rows = self.rows.reshape(-1, job.width, self.lanes)
        wide = aligned(len(rows) * len(columns) * self.lanes).reshape(len(rows), len(columns), self.lanes)
        text = taking_text(len(columns), job.statistics)
        taking = compiled(text, wide=True, lanes=self.lanes).bind(wide.reshape(-1), self.measures.reshape(-1)).long
        own = [(place, column) for place, column in enumerate(columns) if column < job.width]
        further = [(place, column - job.width) for place, column in enumerate(columns) if column >= job.width]
        k = 0
        for end, low in ((half, LOW), (job.ticks, LATE_LOW)):
            while k < end:
                count = min(len(rows), end - k)
                self.program.long(k, count, 0)
                extra = more(rows[:count])
                for place, column in own:
                    wide[:count, place] = rows[:count, column]
                for place, column in further:
                    wide[:count, place] = extra[:, column]
                taking(k, count, low)
                k += count

    def faults(self) -> Index:
        """List the tick of each lane's first fault, -1 for none."""
        first = self.job.arena.place(self.job.arena.own)
        faulted, tick = (self.arena[first + start_of(ServoState, name)] for name in ("faulted", "tick"))
        return np.where(faulted != 0.0, tick, -1.0).astype(np.intp)

    def arenas(self, count: int) -> FloatArray:
        """Give what the buffers of the first lanes hold, (count, arena)."""
        whole = np.repeat(self.whole[None], count, axis=0)
        whole[:, self.entries] = self.arena[self.entries, :count].T
        return whole


def aligned(size: int) -> FloatArray:
    """Make an array of zeros that begins where a line of the cache does."""
    spare = ALIGNED // 8
    memory = np.zeros(size + spare)
    first = (-memory.ctypes.data // 8) % spare
    return memory[first : first + size]
