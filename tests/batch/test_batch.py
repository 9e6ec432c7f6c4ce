"""Batches against single runs, closed forms, and themselves with other threads and other ways."""

from __future__ import annotations

import json
import time
import tracemalloc
import warnings
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.batch import group_runs
from graspfx.batch.batch import grid
from graspfx.batch.measured_columns import empty, take
from graspfx.batch.variants import Variants
from graspfx.errors import InputError, MissingPackageError, SceneError, UnknownNameError
from graspfx.grasp.impedance import ActiveCouplingWarning
from tests.support.optional import require

KEP, KIP, BV = "coupling.external.stiffness", "coupling.internal.stiffness", "object.viscosity"


@pytest.fixture(scope="module")
def line():
    return gx.load("reference-1dof")


def single(scene, batch, index, duration):
    overrides = {key: values[index] for key, values in batch.values.items()}
    return gx.run(
        scene.replace({k: v.item() if isinstance(v, np.generic) else v for k, v in overrides.items()}),
        duration=duration,
    )


def numbers_of(values, half):
    """Statistics as a reader would write them, of (N, ...)."""
    magnitude = np.abs(values)
    return {
        "first": values[0],
        "last": values[-1],
        "mean": values.mean(axis=0),
        "rms": np.sqrt((values**2).mean(axis=0)),
        "min": values.min(axis=0),
        "max": values.max(axis=0),
        "peak": magnitude.max(axis=0),
        "growth": magnitude[half:].max(axis=0) / magnitude[:half].max(axis=0),
    }


def require_same(one, other):
    assert one.measures.keys() == other.measures.keys()
    for quantity, statistics in one.measures.items():
        for name, values in statistics.items():
            np.testing.assert_array_equal(values, other[quantity][name], err_msg=f"{quantity} {name}")
    np.testing.assert_array_equal(one.fault_tick, other.fault_tick)


@pytest.mark.parametrize("ticks", [7, 101])
def test_measures_are_those_of_single_runs(line, ticks):
    values = {KEP: np.linspace(5.0, 90.0, 7), BV: np.linspace(0.1, 1.5, 5)}
    batch = gx.run_batch(line, values, ticks * line.period)
    for index in [(0, 0), (3, 2), (6, 4)]:
        run = single(line, batch, index, ticks * line.period)
        for quantity in ("finger_position", "object_position", "finger_force"):
            for name, expected in numbers_of(getattr(run, quantity), ticks // 2).items():
                found = batch[quantity][name][index]
                if name in ("mean", "rms"):  # numpy adds in another order
                    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-17, err_msg=f"{quantity} {name}")
                else:
                    np.testing.assert_array_equal(found, expected, err_msg=f"{quantity} {name}")


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("paper-waving", {KEP: [30.0, 70.0], KIP: [70.0, 80.0]}),  # equal gains among them
        ("sphere-three-fingers", {"coupling.fade": [[0.002, 0.004], [0.007, 0.015]]}),
        ("soft-pinch", {"finger.*.patch": [0.003, 0.006]}),
    ],
)
def test_the_two_forces_are_measured_as_single_runs_have_them(name, values):
    scene = gx.load(name)
    quantities = ["internal_force", "finger_force", "external_force", "displayed_force"]
    quantities += ["external_displacement", "internal_displacement"]
    quantities += ["internal_moment"] if name == "soft-pinch" else []
    batch = gx.run_batch(scene, values, 0.4, measure=quantities)
    both = gx.run_batch(scene, values, 0.4, keep="recordings")
    recordings: Any = both.recordings
    for index in np.ndindex(batch.shape):
        run = single(scene, batch, index, 0.4)
        assert recordings[index].header.split == run.header.split
        for quantity in quantities:
            with np.errstate(invalid="ignore", divide="ignore"):  # growth of what is zero
                expected = numbers_of(getattr(run, quantity), len(run) // 2)
            for statistic in ("last", "min", "max", "peak"):
                np.testing.assert_array_equal(batch[quantity][statistic][index], expected[statistic])
            np.testing.assert_allclose(batch[quantity]["mean"][index], expected["mean"], rtol=1e-12, atol=1e-16)
            np.testing.assert_array_equal(both.stacked(quantity)[index], getattr(run, quantity))


def test_what_was_not_measured_is_told_from_what_there_is_not(line):
    batch = gx.run_batch(line, {BV: [0.5, 0.6]}, 0.1, measure=["finger_force"])
    with pytest.raises(
        UnknownNameError,
        match=r"'internal_force'; it was not measured: run .* measure=\['internal_force'\]",
    ) as error:
        batch["internal_force"]
    assert "did you mean" not in str(error.value)
    with pytest.raises(UnknownNameError, match=r"with measure=\['finger_position'\] \(measured: finger_force\)"):
        batch.growth()
    with pytest.raises(UnknownNameError, match=r"unknown measure 'finger_fore'; did you mean 'finger_force'"):
        batch["finger_fore"]
    with pytest.raises(UnknownNameError, match=r"unknown statistic 'maxi'; did you mean 'max'"):
        batch["finger_force"]["maxi"]
    assert "maxi" not in batch["finger_force"] and "max" in batch["finger_force"]


@pytest.mark.parametrize(("keep", "kept"), [("summary", "summaries"), ("recordings", "recordings")])
def test_a_batch_without_measures_says_what_it_kept(line, keep, kept):
    batch = gx.run_batch(line, {BV: [0.5, 0.6]}, 0.1, keep=keep)
    for ask in (lambda: batch["finger_force"], batch.growth):
        with pytest.raises(UnknownNameError, match=rf"this batch has only {kept}: use batch\.{kept}, .*'measures'"):
            ask()
    card = repr(batch)
    assert f".{kept}" in card and ".growth" not in card and "[statistic]" not in card
    assert (".stacked" in card) == (keep == "recordings")
    if keep == "summary":
        with pytest.raises(InputError, match="given 'summary', expected 'recordings'"):
            batch.stacked("finger_force")


def test_threads_do_not_matter(line):
    values = {KEP: np.linspace(5.0, 90.0, 20), BV: np.linspace(0.1, 1.5, 20)}
    require_same(gx.run_batch(line, values, 0.2, threads=1), gx.run_batch(line, values, 0.2, threads=3))


def test_object_slows_down_as_the_closed_form_has_it(line):
    """x = v m/b (1 - exp(-b t/m)) for an object that nobody holds; the exact integrator has no error of its own."""
    scene = line.replace({KEP: 0.0, KIP: 0.0, "object.velocity": [0.3]})
    mass, viscosity = np.linspace(0.05, 0.5, 6), np.linspace(0.1, 2.0, 6)
    batch = gx.run_batch(scene, {"object.mass": mass, BV: viscosity}, 1.0, statistics=["last"])
    m, b = batch.values["object.mass"], batch.values[BV]
    t = 199 * scene.period  # of the last row
    expected = 0.3 * m / b * -np.expm1(-b * t / m)
    np.testing.assert_allclose(batch["object_position"]["last"][..., 0], expected, rtol=1e-13)


def test_keys_of_one_part_are_built_together(line):
    values = {"finger.*.device.mass": np.linspace(0.1, 0.3, 5), "finger.*.device.damping": np.linspace(0.1, 0.5, 5)}
    batch = gx.run_batch(line, values, 0.1, keep="recordings")
    for index in np.ndindex(batch.shape):
        np.testing.assert_array_equal(require(batch.recordings).item(index).rows, single(line, batch, index, 0.1).rows)


@pytest.fixture
def by_values(monkeypatch):
    """Take no key for a plain one: a variant is built for each value of a key."""
    monkeypatch.setattr("graspfx.batch.variants.plain_keys", lambda *rest: [])


def test_few_variants_are_built(line, by_values):
    values = {"object.mass": np.linspace(0.05, 0.5, 20).tolist(), BV: np.linspace(0.61, 2.0, 20).tolist()}
    numbers = np.indices((20, 20)).reshape(2, -1).T
    variants = Variants(line, values, numbers)
    [group] = variants.groups()
    assert 39 <= variants.builds <= 39 + 4 + 8  # each value, the corners, some others
    for which in (17, 222, 399):
        whole = Variants(line, values, numbers).built(numbers[which])
        assert whole.arena.tobytes() == group.arenas(slice(which, which + 1))[0].tobytes()


def test_equal_gains_are_a_group_of_their_own(line):
    """On the diagonal kep = kip: the conventional method, which no value by itself shows."""
    gains = np.array([20.0, 35.0, 50.0, 65.0, 80.0])
    batch = gx.run_batch(line, {KEP: gains, KIP: gains + np.array([0.0, 0.0, 0.0, 0.0, 0.5])}, 0.1)
    for index in np.ndindex(batch.shape):
        run = single(line, batch, index, 0.1)
        np.testing.assert_array_equal(batch["finger_force"]["last"][index], run.finger_force[-1])
        np.testing.assert_array_equal(batch["object_position"]["last"][index], run.object_position[-1])


def test_what_does_not_add_up_is_built_whole(line, by_values, monkeypatch):
    values = {KEP: np.linspace(20.0, 60.0, 5), BV: np.linspace(0.5, 1.0, 4)}
    expected = gx.run_batch(line, values, 0.1)
    monkeypatch.setattr(Variants, "_holds", lambda self, group: False)
    found = gx.run_batch(line, values, 0.1)
    assert found.notes == ("20 variants were built one by one: the values of several keys interact",)
    assert not expected.notes
    require_same(found, expected)


def test_a_wrong_entry_is_found(line, by_values):
    values = {KEP: np.linspace(20.0, 60.0, 5).tolist(), BV: np.linspace(0.5, 1.0, 5).tolist()}
    variants = Variants(line, values, np.indices((5, 5)).reshape(2, -1).T)
    [group] = variants.groups()
    assert variants._holds(group)
    group.factors[0][1][0] *= 1.0 + 1e-15  # of the least value, which is in two corners
    assert not variants._holds(group)


@pytest.mark.parametrize("name", ["paper-spring", "sphere-three-fingers"])
def test_recordings_are_those_of_single_runs(name):
    scene = gx.load(name)
    batch = gx.run_batch(scene, {"coupling.internal.stiffness": [60.0, 90.0]}, 20 * scene.period, keep="recordings")
    for index in range(2):
        run, found = single(scene, batch, (index,), 20 * scene.period), require(batch.recordings)[index]
        np.testing.assert_array_equal(found.rows, run.rows)
        assert found.header.scene_table == run.header.scene_table
        assert found.layout == run.layout
        assert found.outcome.fade_shortfall == run.outcome.fade_shortfall
    assert batch.stacked("finger_force").shape == (2, 20, *require(batch.recordings)[0].finger_force.shape[1:])


def test_meshes_run_too():
    scene = gx.load("thin-plate")
    batch = gx.run_batch(scene, {KIP: [60.0, 90.0]}, 10 * scene.period, keep="recordings")
    for index in range(2):
        run = single(scene, batch, (index,), 10 * scene.period)
        np.testing.assert_array_equal(require(batch.recordings).item(index).rows, run.rows)


def test_faults_are_those_of_single_runs(line):
    values = {KEP: [30.0, 2e4, 3e4], BV: [0.5, 0.8, 1.0, 1.1, 1.2, 1.3]}
    batch = gx.run_batch(line, values, 3.0)
    assert (batch.fault_tick[0] == -1).all()
    for index in [(1, 0), (2, 5)]:
        run = single(line, batch, index, 3.0)
        assert batch.fault_tick[index] == run.faults[0].tick > 0
    kept = gx.run_batch(line, {KEP: [2e4]}, 3.0, keep="recordings")
    run = single(line, kept, (0,), 3.0)
    assert require(kept.recordings)[0].faults == run.faults


def test_values_that_differ_far_inside_a_long_array_differ():
    one = np.zeros(2000)
    other = one.copy()
    other[1000] = 1.0
    for values in ([{"points": one}, {"points": other}], [(one,), (other,)]):
        _, _, numbers = grid({"key": [*values, values[0]]}, zip=False)
        assert numbers.ravel().tolist() == [0, 1, 0]


def test_a_fault_is_told_as_things_stood_at_its_tick(line):
    device = {"name": "simulated", "mass": 0.15, "damping": 0.2, "workspace": [[-0.06], [0.06]]}
    hands = [{"stiffness": 60.0, "damping": 0.5, "rest": [rest]} for rest in (0.2, 0.0)]
    fingers = [{"start": [0.0], "device": device, "hand": hand} for hand in hands]
    leaving = line.replace({"finger": fingers})
    kept = gx.run_batch(leaving, {KEP: [30.0]}, 0.5, keep="recordings")
    assert require(kept.recordings)[0].faults == single(leaving, kept, (0,), 0.5).faults
    assert "outside its workspace" in require(kept.recordings)[0].faults[0].message


@pytest.mark.parametrize("block", [1, 3, 4, 9])
def test_measures_are_those_of_a_loop_over_the_rows(block):
    """Sums are added row by row, NaN and infinity included; no comparison selects NaN."""
    rows = np.random.default_rng(3).normal(size=(9, 4))
    rows[2, 1], rows[5, 2], rows[:, 3] = np.nan, np.inf, np.nan
    measures = empty(4)
    for k in range(0, 9, block):
        take(rows[k : k + block], measures, k, 9)
    for x, found in zip(rows.T.tolist(), measures.tolist(), strict=True):
        sums = [0.0, 0.0]
        for each in x:
            sums = [sums[0] + each, sums[1] + each * each]
        peaks = [of([each for each in part if each == each], default=end)
                 for part in (x[:4], x[4:]) for of, end in ((min, np.inf), (max, -np.inf))]  # fmt: skip
        np.testing.assert_array_equal(found, [x[0], x[-1], *sums, *peaks])


def test_measures_compile_nothing_beside_the_program_of_all_scenes(line, monkeypatch):
    """An installation with that program measures without LLVM."""
    values = {BV: [0.5, 0.8]}
    expected = gx.run_batch(line, values, 0.1)

    def missing(*given, **more):
        raise MissingPackageError("llvmlite", "a test", "")

    monkeypatch.setattr("graspfx.compile.native.compiled", missing)
    require_same(gx.run_batch(line, values, 0.1), expected)


def test_after_an_error_no_thread_begins_another_job():
    begun = []

    def run(which):
        begun.append(int(which[0]))
        if which[0] == 1:
            raise InputError("which", 1, "another one")
        time.sleep(0.01)

    with pytest.raises(InputError):
        group_runs._shared(run, [np.array([k]) for k in range(100)], 2)
    assert len(begun) < 50


def test_a_batch_records_what_its_scene_asks_for_and_measures_every_tick(line):
    sets = {"record.columns": ["finger_force", "touching"], "record.every": 7}
    some, values = line.replace(sets), {KIP: [60.0, 90.0]}
    batch = gx.run_batch(some, values, 0.5, keep="recordings")
    whole = gx.run_batch(line, values, 0.5, keep="recordings")
    for index in range(2):
        recording, run = require(batch.recordings)[index], single(some, batch, (index,), 0.5)
        assert [*recording.layout.columns] == [*run.layout.columns] == ["finger_force", "touching"]
        assert recording.rows.tobytes() == run.rows.tobytes()
        assert (recording.ticks, recording.end) == (run.ticks, run.end)
        every = require(whole.recordings)[index].finger_force[::7]
        assert recording.finger_force.tobytes() == every.tobytes()
    summaries = require(gx.run_batch(some, values, 0.5, keep="summary").summaries)
    assert "one per 7 ticks" in summaries[0]["recorded"]
    assert summaries[0]["peak_force"] == require(batch.recordings)[0].summary()["peak_force"]
    some_peak, whole_peak = (
        require(gx.run_batch(each, values, 0.5, measure=["finger_position"], statistics=["peak"]).measures)
        for each in (some, line)
    )
    np.testing.assert_array_equal(some_peak["finger_position"]["peak"], whole_peak["finger_position"]["peak"])


def test_summaries_are_those_of_recordings(line):
    batch = gx.run_batch(line, {BV: [0.5, 0.8]}, 0.5, keep="summary")
    expected = single(line, batch, (1,), 0.5).summary()
    timed = {"wall_time", "ticks_per_second", "tick_cost", "engine"}
    assert {k: v for k, v in require(batch.summaries)[1].items() if k not in timed} == {
        k: v for k, v in expected.items() if k not in timed
    }


def test_zip_takes_values_together(line):
    batch = gx.run_batch(line, {KEP: [20.0, 30.0, 40.0], KIP: [50.0, 60.0, 70.0]}, 0.1, zip=True)
    assert batch.shape == (3,) == batch.growth().shape
    run = single(line, batch, (1,), 0.1)
    assert (batch.values[KEP][1], batch.values[KIP][1]) == (30.0, 60.0)
    np.testing.assert_array_equal(batch["finger_position"]["last"][1], run.finger_position[-1])


def test_periods_have_programs_of_their_own(line):
    batch = gx.run_batch(line, {"period": [0.002, 0.005], BV: [0.5, 0.8]}, 0.1)
    for index in np.ndindex(batch.shape):
        run = single(line, batch, index, 0.1)
        np.testing.assert_array_equal(batch["finger_position"]["last"][index], run.finger_position[-1])


def test_to_dict_is_json(line):
    batch = gx.run_batch(line, {BV: [0.5, 0.8]}, 0.1)
    found = json.loads(json.dumps(batch.to_dict()))
    assert found["values"] == {BV: [0.5, 0.8]}
    assert np.shape(found["measures"]["finger_position"]["growth"]) == (2, 2, 1)
    assert len(batch) == 2


def test_memory_does_not_grow_with_buffers(line):
    """Buffers of all variants at once would be 110 MB; a thread holds those of one."""
    tracemalloc.start()
    batch = gx.run_batch(line, {BV: [0.5, 0.8] * 10_000}, 0.1, measure=["object_position"], statistics=["last"])
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 40e6
    assert len(np.unique(batch["object_position"]["last"])) == 2


@pytest.mark.parametrize(
    ("values", "options", "error", "said"),
    [
        ({BV: [0.5, -1.0]}, {}, SceneError, "object.viscosity = -1.0"),
        ({KEP: [30.0], "object.colour": [1]}, {}, SceneError, "object.colour"),
        ({KEP: [30.0, 40.0], KIP: [1.0]}, {"zip": True}, InputError, "lists of equal length"),
        ({}, {}, InputError, "at least one key"),
        ({BV: []}, {}, InputError, "at least one key"),
        ({"duration": [1.0]}, {}, InputError, "keys of the scene"),
        ({BV: [0.5]}, {"measure": ["finger_torque"]}, UnknownNameError, "finger_force"),
        ({BV: [0.5]}, {"statistics": ["median"]}, UnknownNameError, "median"),
        ({BV: [0.5]}, {"keep": "rows"}, UnknownNameError, "recordings"),
        ({BV: [0.5]}, {"threads": 0}, InputError, "1 or more"),
        ({BV: [0.5]}, {"duration": 0.0}, InputError, "at least one period"),
    ],
)
def test_what_cannot_be_run_says_so(line, values, options, error, said):
    with pytest.raises(error, match=said):
        gx.run_batch(line, values, **options)


def test_a_part_that_is_no_kernel_is_named():
    pytest.importorskip("pybullet")
    with pytest.raises(InputError, match=r"not kernels: the body of .* \(BulletWorld\)"):
        gx.run_batch(gx.load("two-objects"), {KIP: [50.0, 60.0]})


def test_a_variant_that_faults_at_once_leaves_the_others_alone(line):
    scene = line.replace({"object.mass": 1e-3, "object.integrator": "exact"})
    batch = gx.run_batch(scene, {KEP: [1e40, 30.0, 40.0]}, 0.5)
    assert batch.fault_tick.tolist() == [single(scene, batch, (0,), 0.5).faults[0].tick, -1, -1]


def test_equal_gains_per_finger_are_a_group_of_their_own(line):
    gains = [[20.0 + k, 30.0 + k] for k in range(5)]
    values = {KEP: gains, KIP: [*gains[:4], [24.0, 24.0]]}
    with pytest.warns(ActiveCouplingWarning):  # as a single run does
        batch = gx.run_batch(line, values, 0.05)
    for index in [(0, 0), (2, 2), (3, 1), (4, 4)]:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ActiveCouplingWarning)
            run = single(line, batch, index, 0.05)
        np.testing.assert_array_equal(batch["finger_force"]["last"][index], run.finger_force[-1])
