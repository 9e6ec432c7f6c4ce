"""Runs of the variants of a batch, which compute measures or recordings."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from functools import partial
from threading import Lock
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx import plugins
from graspfx.assembly.provenance import header_of
from graspfx.assembly.resolve import resolve
from graspfx.assembly.run_scene import ticks_of
from graspfx.assembly.session import require_memory
from graspfx.batch.measured_columns import columns_of, divider, empty, split_of, statistic, take
from graspfx.batch.variants import Group, PartMemory, Variants
from graspfx.compile.records import start_of
from graspfx.coupling.grasp_state import GraspState
from graspfx.errors import InputError
from graspfx.loop.columns import RunFault, Selection, chosen_layout
from graspfx.loop.engine import machine_codes, program
from graspfx.loop.world import ServoState
from graspfx.progress import waiting
from graspfx.recording.header import Header, Outcome
from graspfx.recording.record import Recording
from graspfx.scene.overrides import overridden

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]
Measures = dict[str, dict[str, FloatArray]]  # values by quantity and statistic, (V, *quantity)

APIECE = 8  # number of variants that a thread takes at a time
BLOCK = 1024  # number of rows that are written at a time
MOST_TICKS = 2**53  # larger numbers are not all floats


class Runs:
    """Runs of variants of a scene.

    Args:
        scene: Scene whose parts are all kernels.
        lists: List of values of each key.
        numbers: Index of each variant's value in the list of each key, (V, keys).
        duration: Duration [s]; the scene's duration if None.
        threads: Number of threads, which does not affect results.
        memory: Programs and built variants of the same scene from previous `Runs` in this thread; None without any.

    Attributes:
        variants: Variants, with notes on long computing times.
        groups: Groups of variants that run by the same program.
        faults: Tick of each variant's first fault, -1 for a variant without a fault, (V,).
        run_time: Time spent on runs [s].

    Raises:
        SceneError: If a variant is not a valid scene; the message states the values of the variant.
        InputError: If a part of the scene is not a kernel.
    """

    def __init__(
        self,
        scene: Scene,
        lists: Mapping[str, Sequence[Any]],
        numbers: IndexArray,
        duration: float | None,
        threads: int,
        memory: PartMemory | None = None,
    ) -> None:
        self.scene, self.duration, self.threads = scene, duration, threads
        self.faults, self.run_time = np.full(len(numbers), -1), 0.0
        with plugins.unchanged():
            self.variants = Variants(scene, lists, numbers, memory=memory)
            with waiting("building variants", unit="built", count=lambda: self.variants.builds):
                self.groups = self.variants.groups()

    def measured(self, measure: Sequence[str], statistics: Sequence[str]) -> Measures:
        """Run the variants, and return statistics of quantities; the arguments are those of `run_batch`."""
        measures: Measures = {}
        for group in self.groups:
            columns, derived = columns_of(group.program.servo.layout, measure)
            where = [k for column in columns.values() for k in range(column.where.start, column.where.stop)]
            runs, began = self._of(group), perf_counter()
            with waiting("running variants", len(group.members), "variants", partial(getattr, runs, "done")):
                raw, faults = runs.measured(where, derived, self.threads)
            self.run_time += perf_counter() - began
            self.faults[group.members] = faults
            start = 0
            for quantity, column in columns.items():
                size = column.where.stop - column.where.start
                of = measures.setdefault(quantity, {})
                for name in statistics:
                    array = of.setdefault(name, np.full((len(self.faults), *column.shape), np.nan))
                    if array.shape[1:] != column.shape:
                        shapes = f"{array.shape[1:]} and {column.shape}"
                        raise InputError("measure", quantity, f"a quantity of one shape in all variants, not {shapes}")
                    each = statistic(name, raw[:, start : start + size], runs.ticks)
                    array[group.members] = each.reshape(len(each), *column.shape)
                start += size
        return measures

    def recorded(self, make: Callable[[Recording], Any], *, whole: bool) -> list[Any]:
        """Run the variants, and return the result of `make` for each recording.

        If `whole`, the results contain the rows, so that the rows of all variants must fit into memory.
        """
        results: list[Any] = [None] * len(self.faults)
        header = header_of(resolve(self.scene))
        for group in self.groups:
            layout, record = group.program.servo.layout, self.scene.record
            selection = Selection(layout, chosen_layout(layout, record.columns), record.every)
            runs, began = self._of(group), perf_counter()
            ticks = (
                runs.ticks if record.every > 1 else 0
            )  # number of ticks, which the number of rows does not determine
            require_memory(runs.ticks * (len(group.members) if whole else 1), 8 * layout.width)
            for member, ended in zip(group.members.tolist(), runs.recorded(self.threads), strict=True):
                self.faults[member] = ended.fault
                outcome = replace(_outcome(group, ended), ticks=ticks)
                group.program.check_activity(ended.arena)
                own = replace(self._header(header, group, member), split=split_of(group, ended.arena))
                results[member] = make(Recording(selection.cut(ended.rows), selection.layout, own, outcome))
            self.run_time += perf_counter() - began
        return results

    def _of(self, group: Group) -> GroupRuns:
        period = group.program.servo.period
        duration = self.duration if self.duration is not None else self.scene.duration
        ticks = ticks_of(duration, period)
        if ticks > MOST_TICKS:
            most = f"at most {MOST_TICKS:.3g} periods of {period} s, the largest number of ticks"
            raise InputError("duration", duration, most, "use a shorter duration or a longer period")
        return GroupRuns(group, ticks)

    def _header(self, header: Header, group: Group, member: int) -> Header:
        overrides = self.variants.overrides(self.variants.numbers[member])
        table, _, _ = overridden(header.scene_table, overrides)
        together = {**header.overrides, **overrides}
        return replace(header, period=group.program.servo.period, scene_table=table, overrides=together)


@dataclass(frozen=True)
class Ended:
    """Result of the run of a recorded variant.

    Attributes:
        rows: Rows of all ticks, (ticks, width).
        fault: Tick of the fault; -1 without a fault.
        arena: Buffers at the end of the run, (arena,).
        arena_copy: Buffers after the tick of the fault, with the values in the fault's message; `arena` without a
            fault.
    """

    rows: FloatArray
    fault: int
    arena: FloatArray
    arena_copy: FloatArray


class GroupRuns:
    """Runs of the variants of a group; each thread has its own buffers, and runs one variant at a time.

    Args:
        group: Group of variants.
        ticks: Number of ticks of a run.

    Attributes:
        done: Number of variants that have been run.
    """

    def __init__(self, group: Group, ticks: int) -> None:
        self.group, self.ticks, self.done = group, ticks, 0
        self._arena, self._width = group.program.arena, group.program.servo.layout.width
        self._program, self._kernels = program(), machine_codes(self._arena)
        self._lock = Lock()

    def measured(self, columns: Sequence[int], derived: Sequence[str], threads: int) -> tuple[FloatArray, IndexArray]:
        """Run all variants, and compute measures of some columns.

        Args:
            columns: Indices of the measured columns in a row to which the derived variables are appended.
            derived: Names of the derived variables.
            threads: Number of threads.

        Returns:
            Measures (V, columns, MEASURES), and the tick of each variant's fault, -1 for a variant without a fault.
        """
        count, where = len(self.group.members), np.array(columns, dtype=np.intp)
        measures, faults = empty(count, len(where)), np.full(count, -1)

        def run(members: IndexArray) -> None:
            arena, steps, rows = self._bound(min(BLOCK, self.ticks))
            for member, start in zip(members.tolist(), self.group.arenas(members), strict=True):
                self._fill(arena, start)
                divide = divider(self.group, derived, arena) if derived else None
                k = 0
                while k < self.ticks:
                    some = rows[: steps(k, min(len(rows), self.ticks - k), 0)]
                    numbers = some if divide is None else np.concatenate([some, divide(some)], axis=1)
                    take(numbers[:, where], measures[member], k, self.ticks)
                    k += len(some)
                faults[member] = self._fault(arena)
                with self._lock:
                    self.group.program.check_activity(arena)
                    self.done += 1

        members = np.arange(count)
        _shared(run, [members[k : k + APIECE] for k in range(0, count, APIECE)], threads)
        return measures, faults

    def recorded(self, threads: int) -> Iterator[Ended]:
        """Run all variants, as many at a time as there are threads, and yield their results in order."""
        count = len(self.group.members)
        with ThreadPoolExecutor(threads) as pool:
            for k in range(0, count, threads):  # at most one group of rows in advance of the consumer
                yield from pool.map(self._record, range(k, min(k + threads, count)))

    def _record(self, variant: int) -> Ended:
        """Run a variant, given by its position in the group, and return its rows and buffers."""
        arena, steps, rows = self._bound(self.ticks)
        self._fill(arena, self.group.arenas(slice(variant, variant + 1))[0])
        k, copy = 0, arena
        while k < self.ticks:
            k += steps(k, min(BLOCK, self.ticks - k), k)
            if copy is arena and self._fault(arena) >= 0:
                copy = arena.copy()
        return Ended(rows, self._fault(arena), arena, copy)

    def _bound(self, count: int) -> tuple[FloatArray, Callable[..., int], FloatArray]:
        """Return a new arena, a function that runs ticks in this arena, and the `count` rows that it writes."""
        arena, rows = np.zeros(self.group.program.size), np.zeros((count, self._width))
        arrays = {"arena": arena, "rows": rows.reshape(-1)}
        bound = self._program.bind(*(arrays[name] for name in self._program.arrays))
        return arena, partial(bound.long, self._arena.offset), rows

    def _fill(self, arena: FloatArray, start: FloatArray) -> None:
        """Copy the initial buffers of a variant, and the addresses of plug-ins' kernels, into an arena."""
        arena[:] = start
        for each, native in self._kernels:
            arena[list(each.entries)] = float(native.entry)

    def _fault(self, arena: FloatArray) -> int:
        servo = ServoState(arena, self._arena.place(self._arena.own))
        return servo.tick if servo.faulted else -1


def _shared(run: Callable[[IndexArray], None], jobs: Iterable[IndexArray], threads: int) -> None:
    """Run jobs in threads; after an error or an interruption, no further job is started."""
    with ThreadPoolExecutor(threads) as pool:
        try:
            for future in as_completed([pool.submit(run, job) for job in jobs]):
                future.result()
        finally:
            pool.shutdown(cancel_futures=True)


def _outcome(group: Group, ended: Ended) -> Outcome:
    """Return the outcome of a variant's run from its buffers."""
    program, servo = group.program, group.program.servo
    for part in servo.objects:
        block, first = part.grasped.block, program.arena.place(part.grasped.block)
        end = start_of(GraspState, "fingers")  # the rest, such as a mesh, is large and unchanged
        block[:end] = ended.arena[first : first + end]
    coupling = servo.coupling
    if ended.fault < 0:
        return Outcome(engine="compiled", **coupling)
    program.fill(ended.arena_copy)  # the values in a fault's message come from its parts' buffers
    return Outcome((RunFault(ended.fault, servo.why(program.arena.own)),), engine="compiled", **coupling)
