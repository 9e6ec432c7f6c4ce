"""Gates of batches: ratios within one run, with a margin of two, never a time by itself."""

from __future__ import annotations

from time import perf_counter

import numpy as np
import pytest

import graspfx as gx
from graspfx.batch.group_runs import Runs
from graspfx.batch.lane_runs import LaneRuns
from graspfx.batch.lanes import LATE_LOW, LOW
from graspfx.batch.single_runs import SingleRuns
from graspfx.batch.variants import Variants
from graspfx.bench.cases.batches import MASS, QUANTITIES, RANGES, STIFFNESS, VISCOSITY

pytestmark = [pytest.mark.alone, pytest.mark.optimised]
ROUNDS, TICKS = 7, 400


def test_a_lane_takes_a_part_of_a_single_tick() -> None:
    """Friction and moving hands, per core: of a single tick 0.33 was measured with eight lanes, 0.75 with four."""
    pytest.importorskip("llvmlite")
    scene = gx.load("sphere-three-fingers")
    friction = np.linspace(0.4, 0.8, 16)
    variants = Variants(scene, {"coupling.friction": friction.tolist()}, np.arange(16)[:, None])
    [group] = variants.groups()
    runs = Runs(scene, variants, 16, TICKS * scene.period, 1)
    job = runs._job(group, [0, 1, 2], ["last", "peak"])
    job.ticks = 10**9  # then single runs have the best code, too
    lanes, single = LaneRuns(job, measuring=True, make=True), SingleRuns(job)
    buffers = lanes.bound(1)
    arena, run, _ = single._bound(TICKS)
    times: list[tuple[float, float]] = []
    for _ in range(ROUNDS):
        buffers.begin(np.arange(lanes.lanes))
        began = perf_counter()
        buffers.program.long(0, TICKS // 2, LOW)
        buffers.program.long(TICKS // 2, TICKS // 2, LATE_LOW)
        between = perf_counter()
        arena[:] = group.arenas(slice(0, 1))[0]
        middle = perf_counter()
        run(0, TICKS, 0)
        times.append(((between - began) / lanes.lanes, perf_counter() - middle))
    ratio = min(lane for lane, _ in times) / min(one for _, one in times)
    assert ratio <= (0.7 if lanes.lanes > 4 else 0.9)


def test_random_points_are_much_quicker_than_runs_one_by_one() -> None:
    """Whole calls, from scene and values to the last positions: 0.1 ms a point and less, beside 10 ms."""
    pytest.importorskip("llvmlite")
    scene, rng = gx.load("reference-1dof"), np.random.default_rng(7)
    values = {key: rng.uniform(*RANGES[key], 400) for key in (STIFFNESS, VISCOSITY, MASS)}
    duration = 200 * scene.period

    def whole() -> float:
        began = perf_counter()
        gx.run_batch(scene, values, duration, zip=True, **QUANTITIES)
        return (perf_counter() - began) / 400

    def alone() -> float:
        began = perf_counter()
        for k in range(4):
            gx.run(scene.replace({key: float(each[k]) for key, each in values.items()}), duration=duration)
        return (perf_counter() - began) / 4

    whole(), alone()  # compiled and read once
    pairs = [(whole(), alone()) for _ in range(3)]
    assert min(one for _, one in pairs) >= 10.0 * min(each for each, _ in pairs)
