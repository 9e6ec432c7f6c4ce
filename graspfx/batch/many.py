"""Runs many variants of one program: side by side where its ticks are all alike, one by one where they are not."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from hashlib import sha256
from threading import Lock, local
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from graspfx.batch.family import family_key, is_compiled, note_compiled
from graspfx.batch.lane_runs import BLOCK, LaneBuffers, LaneRuns
from graspfx.batch.lanes import LANES, MEASURES, LanesText, lanes_text
from graspfx.batch.single_runs import Ended, SingleRuns
from graspfx.batch.task import Task
from graspfx.compile.native import Native, compiled
from graspfx.compile.records import start_of
from graspfx.compile.straight.bounds import LARGEST_TICK
from graspfx.compile.straight.straight import NotSteadyError, written_down
from graspfx.compile.straight.trace import Node, Slot, Traceable
from graspfx.errors import InputError
from graspfx.loop.world import ServoState

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]

MOST = 64  # blocks of lanes that a thread takes at a time, at most
APIECE = 8  # variants that it takes at a time to run one by one
WORTH = 3_000_000  # ticks of all variants for which straight lines are compiled
LOOK = 200_000  # and for which they are looked for
LARGEST = 1000  # operations of a tick as a straight line: longer ones are rarely the same for long
LANES_WORTH = 10_000_000  # ticks of all variants for which a program for lanes is compiled
LANES_LOOK = 50_000  # and for which one is taken from the cache
MOST_ROWS = 2**28  # bytes of the rows of a block of lanes that are recorded whole
MOST_LANES = 8  # of a block


@dataclass
class Job(Task):
    """Variants of one program, run by the way that suits them."""

    def measured(self, threads: int) -> tuple[FloatArray, Index]:
        """Give measures (V, columns, MEASURES), and the tick of each variant's fault, -1 if it has none."""
        measures = np.empty((self.variants, len(self.columns), MEASURES))
        faults = np.full(self.variants, -1)
        rest = np.arange(self.variants)
        lines = self._lines()
        began = perf_counter()
        if lines is not None:
            rest = self._in_lines(*lines, measures, threads)
            self.side_by_side = self.variants - len(rest)
        self.spent += perf_counter() - began
        if len(rest):
            lanes = self._lane_runs(len(rest) * self.ticks / self.share, measuring=True)
            single = self._single if lanes is None else None
            began = perf_counter()
            if lanes is not None:
                self._in_lanes(lanes, rest, measures, faults, threads)
            if single is not None:

                def alone(members: Index) -> None:
                    single.measure(members, measures, faults)
                    self.count(members)

                _shared(
                    alone,
                    [rest[k : k + APIECE] for k in range(0, len(rest), APIECE)],
                    threads,
                )
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
        if self.variants < 2 or work < LANES_LOOK or self.ticks > LARGEST_TICK or whole:
            return None
        try:
            return LaneRuns(self, measuring and self.more is None, make=work >= LANES_WORTH)
        except (LookupError, InputError):
            return None

    def _in_lanes(self, lanes: LaneRuns, rest: Index, measures: FloatArray, faults: Index, threads: int) -> None:
        """Run variants in blocks of lanes; each thread has buffers of its own."""
        buffers = local()

        def run(members: Index) -> None:
            if not hasattr(buffers, "own"):
                buffers.own = lanes.bound(1 if self.more is None else min(BLOCK, self.ticks))
            own: LaneBuffers = buffers.own
            for k in range(0, len(members), lanes.lanes):
                own.measure(members[k : k + lanes.lanes], measures, faults)
                self.count(members[k : k + lanes.lanes])
                if self.look is not None:
                    with self.looking:
                        for arena in own.arenas(len(members[k : k + lanes.lanes])):
                            self.look(arena)

        span = lanes.lanes * min(MOST, max(1, len(rest) // (4 * threads * lanes.lanes)))
        _shared(run, [rest[k : k + span] for k in range(0, len(rest), span)], threads)

    # Straight lines -----------------------------------------------------------------------------------------------

    def _lines(self) -> tuple[LanesText, Native] | None:
        """Give the program of a straight line for lanes, if there is one and it is worth it."""
        if self.work < LOOK or self.look is not None or self.more is not None or self.ticks > LARGEST_TICK:
            return None
        base = self.begin.arenas(slice(0, 1))[0]
        common = base.copy()  # which each lane is checked to agree with, whichever is the first
        common[self.varying] = 0.0
        about = tuple(self.columns), tuple(self.statistics), self.varying.tobytes(), sha256(common).digest()
        return self.memory.recall(("lines", id(self.arena), self.ticks, *about), lambda: self._written_lines(base))

    def _written_lines(self, base: FloatArray) -> tuple[LanesText, Native] | None:
        work, source = self.work, self.source
        varying = set(self.varying.tolist())

        def same(slot: Slot) -> bool:
            return slot[1] not in varying

        family = family_key("lines", source, self.columns, self.statistics, self.varying.tobytes())
        before = is_compiled(family)
        if work < WORTH and not before:
            return None
        arrays = {"arena": base}
        try:
            program = _traceable(source)
            turns = written_down(program, arrays, same, self.columns)
            faulted = turns.begin(("arena", self.arena.place(self.arena.own) + start_of(ServoState, "faulted")))
            if len(turns.body.nodes) > LARGEST or isinstance(faulted, Node) or faulted:
                return None
            text = lanes_text(program, turns, len(self.columns), self.statistics)
            if self.ticks // 2 < text.head:
                return None
            native = compiled(text.source, wide=True, make=work >= WORTH)
            if not before:
                note_compiled(family)
            return text, native
        except (NotSteadyError, LookupError, InputError):
            return None

    def _in_lines(self, text: LanesText, native: Native, measures: FloatArray, threads: int) -> Index:
        """Run all variants in lanes; list those that are not as was taken for granted."""
        early = self.ticks // 2
        late = self.ticks - early
        entries = [k for _, k in text.inputs]
        common = self.begin.arenas(slice(0, 1))[0, entries, None]
        own = [(k, entry) for k, entry in enumerate(entries) if entry in set(self.varying.tolist())]
        left: list[Index] = []
        count = [0, 0]

        def run(members: Index) -> None:
            if 2 * count[1] > count[0] > 0:  # most are not: then none need to be tried
                left.append(members)
                return
            blocks = -(-len(members) // LANES)
            padded = np.append(members, np.repeat(members[-1:], blocks * LANES - len(members)))
            entries_ = np.empty((blocks, len(entries), LANES))
            entries_[...] = common
            for k, entry in own:
                entries_[:, k] = self.begin.entry(entry, padded).reshape(blocks, LANES)
            out = np.full((blocks, text.outputs, LANES), np.nan)
            native.bind(entries_.reshape(-1), np.zeros(text.scratch), out.reshape(-1)).long(blocks, early, late)
            out = out.swapaxes(1, 2).reshape(blocks * LANES, text.outputs)[: len(members)]
            measures[members] = out[:, :-1].reshape(len(members), len(self.columns), MEASURES)
            bad = members[out[:, -1] != 0.0]
            left.append(bad)
            count[0] += len(members)
            count[1] += len(bad)
            self.count(members)

        numbers = np.arange(self.variants)
        span = LANES * min(MOST, max(1, self.variants // (4 * threads * LANES)))
        _shared(run, [numbers[k : k + span] for k in range(0, self.variants, span)], threads)
        return np.sort(np.concatenate(left))


@lru_cache(8)
def _traceable(source: str) -> Traceable:
    return Traceable(source)


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
