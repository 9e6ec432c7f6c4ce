"""Runs of variants as lanes against single runs, on every scene of the shelf, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

import graspfx as gx
from graspfx import plugins
from graspfx.assembly.live import value_of
from graspfx.batch import many
from graspfx.batch.batch import Batch
from graspfx.batch.lane_runs import LaneRuns

EVERY = sorted(name for name, origin in plugins.names("scenes").items() if origin.startswith("GraspFX"))
OTHERS = ("two-objects", "mug", "twenty-fingers", "carry-bar")  # by other software, or long to compile
QUANTITIES = ["finger_position", "finger_force", "object_position"]
STATISTICS = ["first", "last", "min", "max", "peak"]


@pytest.fixture
def lanes(monkeypatch: pytest.MonkeyPatch) -> list[LaneRuns]:
    """The programs for lanes that a batch makes, which it does however short it is."""
    made: list[LaneRuns] = []
    write = LaneRuns.__post_init__

    def noted(self: LaneRuns) -> None:
        write(self)
        made.append(self)

    monkeypatch.setattr(LaneRuns, "__post_init__", noted)
    monkeypatch.setattr(many, "LANES_LOOK", 0)
    monkeypatch.setattr(many, "LANES_WORTH", 0)
    return made


def stiffness(scene: gx.Scene, count: int) -> dict[str, np.ndarray]:
    """Some values of a gain, around the scene's own."""
    own = value_of(scene, "coupling.internal.stiffness")
    return {"coupling.internal.stiffness": own * np.linspace(0.8, 1.3, count)}


def require_single_runs(scene: gx.Scene, batch: Batch, ticks: int) -> None:
    for k in range(len(batch)):
        run = gx.run(
            scene.replace({key: float(values[k]) for key, values in batch.values.items()}),
            duration=ticks * scene.period,
        )
        for quantity in QUANTITIES:
            rows = np.asarray(getattr(run, quantity))
            expected = {"first": rows[0], "last": rows[-1], "min": rows.min(axis=0), "max": rows.max(axis=0)}
            expected["peak"] = np.abs(rows).max(axis=0)
            for name, values in expected.items():
                np.testing.assert_array_equal(batch[quantity][name][k], values, err_msg=f"{quantity} {name} of {k}")


@pytest.mark.parametrize("name", [name for name in EVERY if name not in OTHERS])
def test_lanes_are_single_runs(name: str, lanes: list[LaneRuns]) -> None:
    scene, ticks = gx.load(name), 40
    batch = gx.run_batch(scene, stiffness(scene, 3), ticks * scene.period, measure=QUANTITIES, statistics=STATISTICS)
    assert lanes
    require_single_runs(scene, batch, ticks)


@pytest.mark.parametrize(("name", "ticks"), [("paper-spring", 1500), ("knob", 700), ("soft-pinch", 300)])
def test_lanes_part_where_fingers_let_go_and_slip(name: str, ticks: int, lanes: list[LaneRuns]) -> None:
    """Different gains let go and slip at different ticks: each lane goes its own way, for long."""
    scene = gx.load(name)
    count = 11  # two blocks of lanes, the last of which is not full
    batch = gx.run_batch(
        scene, stiffness(scene, count), ticks * scene.period, measure=QUANTITIES, statistics=STATISTICS
    )
    assert lanes
    require_single_runs(scene, batch, ticks)


def test_what_follows_from_rows_is_measured_in_lanes(lanes: list[LaneRuns]) -> None:
    scene, ticks = gx.load("sphere-three-fingers"), 1500  # more than are recorded at a time
    names = ["internal_force", "external_force", "displayed_force", "finger_force", "internal_displacement"]
    batch = gx.run_batch(
        scene,
        {"coupling.friction": np.linspace(0.4, 0.8, 9)},
        ticks * scene.period,
        measure=names,
        statistics=STATISTICS,
    )
    assert lanes and not lanes[0].measuring
    for k in (0, 4, 8):
        friction = float(batch.values["coupling.friction"][k])
        run = gx.run(scene.replace({"coupling.friction": friction}), duration=ticks * scene.period)
        for name in names:
            rows = np.asarray(getattr(run, name))
            np.testing.assert_array_equal(batch[name]["last"][k], rows[-1])
            np.testing.assert_array_equal(batch[name]["peak"][k], np.abs(rows).max(axis=0))


@pytest.mark.parametrize("name", ["paper-spring", "pick-and-place"])
def test_recordings_of_lanes_are_single_runs(name: str, lanes: list[LaneRuns]) -> None:
    scene, ticks = gx.load(name), 60
    batch = gx.run_batch(scene, stiffness(scene, 5), ticks * scene.period, keep="recordings")
    assert lanes and not lanes[0].measuring and batch.recordings is not None
    for k, recording in enumerate(batch.recordings):
        key = "coupling.internal.stiffness"
        run = gx.run(scene.replace({key: float(batch.values[key][k])}), duration=ticks * scene.period)
        np.testing.assert_array_equal(recording.rows, run.rows)
        assert recording.header.split == run.header.split


def test_faults_are_those_of_single_runs(lanes: list[LaneRuns]) -> None:
    """Each lane of gains with which the grasp blows up stops at its own tick, and says why as its run does."""
    scene = gx.load("reference-1dof")
    values = {"coupling.external.stiffness": np.geomspace(30.0, 1e6, 9)}
    batch = gx.run_batch(scene, values, 3.0)
    kept = gx.run_batch(scene, values, 3.0, keep="recordings")
    assert lanes and (batch.fault_tick >= 0).any() and kept.recordings is not None
    assert len(set(batch.fault_tick.tolist())) > 2
    for k, recording in enumerate(kept.recordings):
        run = gx.run(scene.replace({key: float(each[k]) for key, each in values.items()}), duration=3.0)
        assert [fault.tick for fault in run.faults] == ([] if batch.fault_tick[k] < 0 else [batch.fault_tick[k]])
        assert [str(fault) for fault in recording.faults] == [str(fault) for fault in run.faults]
        np.testing.assert_array_equal(recording.rows, run.rows)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_lanes_are_the_same_with_any_number_of_threads(threads: int, lanes: list[LaneRuns]) -> None:
    scene = gx.load("paper-spring")
    values = stiffness(scene, 83)
    one = gx.run_batch(scene, values, 0.5, threads=1)
    other = gx.run_batch(scene, values, 0.5, threads=threads)
    assert lanes
    for quantity, statistics in one.measures.items():
        for name, each in statistics.items():
            assert other[quantity][name].tobytes() == each.tobytes()
