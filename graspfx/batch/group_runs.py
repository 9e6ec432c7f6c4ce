"""Runs of all groups of variants, with their measures or recordings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx import plugins
from graspfx.assembly.provenance import header_of
from graspfx.assembly.resolve import resolve
from graspfx.assembly.run_scene import ticks_of
from graspfx.assembly.session import require_memory
from graspfx.batch.groups import Group
from graspfx.batch.measured_columns import columns_of, divider, split_of
from graspfx.batch.part_memory import PartMemory
from graspfx.batch.statistics import statistic
from graspfx.batch.variant_runs import Ended, Job
from graspfx.batch.variants import Variants
from graspfx.compile.records import start_of
from graspfx.coupling.grasp_state import GraspState
from graspfx.errors import InputError
from graspfx.loop.columns import RunFault, Selection, chosen_layout
from graspfx.progress import waiting
from graspfx.recording.header import Header, Outcome
from graspfx.recording.record import Recording
from graspfx.scene.overrides import overridden

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]
Measures = dict[str, dict[str, FloatArray]]  # values by quantity and statistic, (V, *quantity)

MOST_TICKS = 2**53  # larger numbers are not all floats


class Runs:
    """Runs of all groups of variants.

    Args:
        scene: Scene of the variants.
        variants: Variants of the scene.
        count: Number of variants.
        duration: Duration that replaces the scene's [s].
        threads: Number of threads.
    """

    def __init__(self, scene: Scene, variants: Variants, count: int, duration: float | None, threads: int) -> None:
        self.scene, self.variants, self.duration, self.threads = scene, variants, duration, threads
        self.faults = np.full(count, -1)
        self.run_time = 0.0

    def measured(self, groups: Sequence[Group], measure: Sequence[str], statistics: Sequence[str]) -> Measures:
        measures: Measures = {}
        for group in groups:
            layout = group.program.servo.layout
            columns, behind = columns_of(layout, measure)
            where = [k for column in columns.values() for k in range(column.where.start, column.where.stop)]
            job = self._job(group, where)
            job.more = partial(divider, group, behind) if behind else None
            with waiting("running variants", job.variants, "variants", partial(getattr, job, "done")):
                raw, faults = job.measured(self.threads)
            self.run_time += job.spent
            self.faults[group.members] = faults
            start = 0
            for quantity, column in columns.items():
                size = column.where.stop - column.where.start
                of = measures.setdefault(quantity, {})
                for name in statistics:
                    array = of.setdefault(name, np.full((len(self.faults), *column.shape), np.nan))
                    if array.shape[1:] != column.shape:
                        raise InputError("measure", quantity, "a quantity of the same shape in all variants")
                    each = statistic(name, raw[:, start : start + size], job.ticks)
                    array[group.members] = each.reshape(len(each), *column.shape)
                start += size
        return measures

    def recorded(self, groups: Sequence[Group], make: Callable[[Recording], Any], *, whole: bool) -> list[Any]:
        results: list[Any] = [None] * len(self.faults)
        header = header_of(resolve(self.scene))
        for group in groups:
            layout, record = group.program.servo.layout, self.scene.record
            selection = Selection(layout, chosen_layout(layout, record.columns), record.every)
            job = self._job(group, [])
            ticks = job.ticks if record.every > 1 else 0  # number of ticks, which the number of rows does not determine
            require_memory(job.ticks * (job.variants if whole else 1), 8 * job.width)
            for member, ended in zip(group.members.tolist(), job.recorded(self.threads), strict=True):
                self.faults[member] = ended.fault
                outcome = _outcome(group, ended)
                if job.look is not None:
                    job.look(ended.arena)
                own = replace(self._header(header, group, member), split=split_of(group, ended.arena))
                rows = selection.cut(ended.rows)
                results[member] = make(Recording(rows, selection.layout, own, replace(outcome, ticks=ticks)))
            self.run_time += job.spent
        return results

    def _job(self, group: Group, columns: Sequence[int]) -> Job:
        servo = group.program.servo
        duration = self.duration if self.duration is not None else self.scene.duration
        ticks = ticks_of(duration, servo.period)
        if ticks > MOST_TICKS:
            most = f"at most {MOST_TICKS:.3g} periods of {servo.period} s: more cannot be counted"
            raise InputError("duration", duration, most, "make the duration shorter or the period longer")
        width = servo.layout.width
        return Job(
            group.program.arena, group.program.size, group, len(group.members), width, columns, ticks,
            group.program.check_activity if any(part.grasped.matrices for part in servo.objects) else None,
        )  # fmt: skip

    def _header(self, header: Header, group: Group, member: int) -> Header:
        overrides = self.variants.overrides(self.variants.numbers[member])
        table, _, _ = overridden(header.scene_table, overrides)
        together = {**header.overrides, **overrides}
        return replace(header, period=group.program.servo.period, scene_table=table, overrides=together)


def _outcome(group: Group, ended: Ended) -> Outcome:
    """Return the outcome of a run from its buffers at the end."""
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


def measured_variants(
    scene: Scene,
    lists: Mapping[str, Sequence[Any]],
    numbers: IndexArray,
    duration: float | None,
    measure: Sequence[str],
    statistics: Sequence[str],
    threads: int,
    memory: PartMemory | None = None,
) -> tuple[Measures, IndexArray, tuple[str, ...]]:
    """Measure some variants of a scene.

    Args:
        scene: Scene that consists of kernels only.
        lists: Values by key.
        numbers: Index of each key's value in each variant, (V, keys).
        duration: Duration that replaces the scene's [s].
        measure, statistics: As for `run_batch`.
        threads: Number of threads, which does not affect results.
        memory: Memory of other variants of the scene that this thread has run.

    Returns:
        Measures, the tick of each variant's first fault or -1, and notes on long computing times.
    """
    with plugins.unchanged():
        variants = Variants(scene, lists, numbers, memory=memory)
        groups = variants.groups()
    runs = Runs(scene, variants, len(numbers), duration, threads)
    measures = runs.measured(groups, measure, statistics)
    return measures, runs.faults, tuple(variants.notes)
