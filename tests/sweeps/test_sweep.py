"""Sweeps in this process: the bits of a batch, files that stay, folders of others, and variants that fail."""

from __future__ import annotations

import json
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from matplotlib.text import Text

import graspfx as gx
from graspfx import installed
from graspfx.errors import InputError, SceneError, UnknownNameError
from graspfx.sweeps import run_sweep as sweeps
from graspfx.sweeps.chunk import SweepError
from graspfx.sweeps.crew import Crew
from graspfx.sweeps.run_sweep import SweepWarning, look_at
from graspfx.sweeps.sweep_folder import open_folder
from graspfx.sweeps.swept_values import make_grid, scattered
from tests.support.hand_of_its_own import HAND, SCENE
from tests.support.hardware import DRIVER
from tests.support.small_scenes import line

KEP, KIP, BV = "coupling.external.stiffness", "coupling.internal.stiffness", "object.viscosity"
VALUES = {KEP: [20.0, 35.0, 50.0, 65.0, 80.0], KIP: [40.0, 50.0, 60.0, 70.0], BV: [0.4, 1.0]}


@pytest.fixture(scope="module")
def scene() -> gx.Scene:
    return line(duration=0.15)


@pytest.fixture(scope="module")
def batch(scene: gx.Scene) -> gx.Batch:
    return gx.run_batch(scene, VALUES)


@pytest.fixture
def by_hand(tmp_path: Path) -> Path:
    (tmp_path / "steady.py").write_text(HAND)
    (tmp_path / "steady.toml").write_text(SCENE)
    return tmp_path / "steady.toml"


def same(one: gx.Batch, other: gx.Batch) -> bool:
    """Compare measures and faults to the bit; zeros of a batch may have a sign, and it looks at no run as a whole."""
    assert one.measures.keys() - {"run"} == other.measures.keys() - {"run"}
    return np.array_equal(one.fault_tick, other.fault_tick) and all(
        (one[quantity][name] + 0.0).tobytes() == (other[quantity][name] + 0.0).tobytes()
        for quantity in other.measures.keys() - {"run"}
        for name in other[quantity]
    )


@pytest.mark.parametrize("chunk", [1, 17, 40])
def test_bits_are_those_of_one_batch(scene: gx.Scene, batch: gx.Batch, chunk: int) -> None:
    result = gx.sweep(scene, VALUES, chunk=chunk)
    assert same(result, batch) and result.shape == batch.shape
    assert not result.failed.any()
    assert not any(
        np.signbit(each[each == 0.0]).any() for by_name in result.measures.values() for each in by_name.values()
    )


def test_the_verdict_on_a_run_is_that_of_its_summary() -> None:
    """Across a limit, where growth of the peak tells squeezing from stability no more than shaking that saturates."""
    values = {"coupling.internal.stiffness": [300.0, 440.0, 600.0, 1200.0], "object.mass": [0.1, 0.11]}
    result = gx.sweep("paper-waving", values, duration=5.0)
    runs = [gx.run(gx.load("paper-waving", result.overrides(k)), duration=5.0).summary() for k in range(len(result))]
    assert result.unstable is not None
    assert result.unstable.ravel().tolist() == [bool(run["growth"]) for run in runs]
    assert result.unstable.any() and not result.unstable.all()
    assert result["run"]["vibration"].ravel() == pytest.approx([run["force_vibration"] for run in runs], rel=1e-9)
    assert result.scalar()[0] == "run.vibration"
    assert gx.sweep("paper-waving", values, duration=0.1, measure=["finger_force"]).unstable is None


def test_a_map_has_the_certificate_s_limit_where_certify_finds_it() -> None:
    spacing, values = 10.0, {KEP: [20.0, 30.0, 40.0, 50.0, 60.0, 70.0], BV: [0.4, 0.7, 1.0]}
    result = gx.sweep("paper-spring", values, duration=0.1, measure=["finger_force"], statistics=["peak"])
    drawing = result.plot("finger_force.peak")
    [line] = [each for each in drawing.figure.axes[0].collections if each.get_label() == "certificate: margin 1"]
    [path] = line.get_paths()
    judged = [(gain, viscosity) for gain, viscosity in np.asarray(path.vertices, float) if viscosity in values[BV]]
    assert sorted(viscosity for _, viscosity in judged) == values[BV]
    for gain, viscosity in judged:
        grasp = gx.certify(gx.load("paper-spring", {BV: viscosity}))[0]
        [limit] = [each.limit for each in grasp.limits if each.mode == "external"]
        assert abs(gain - limit) < spacing
    assert "certificate: margin 1" in [each.get_text() for each in drawing.figure.findobj(Text)]
    assert not drawing.notes


def test_where_the_certificate_cannot_be_judged_a_map_says_so(scene: gx.Scene) -> None:
    sizes = {"object.shape.size": [[0.05], [0.001]], KEP: [20.0, 40.0]}  # the fingers do not reach the small one
    drawing = gx.sweep(scene, sizes, measure=["finger_force"]).plot()
    assert "not judged at 2 of 4 points: " in drawing.notes[0] and "touches" in drawing.notes[0]
    assert "not judged by the certificate" in [each.get_text() for each in drawing.figure.findobj(Text)]
    assert not any(each.get_label() == "certificate: margin 1" for each in drawing.figure.axes[0].collections)


def test_threads_and_any_executor_give_the_same(scene: gx.Scene, batch: gx.Batch) -> None:
    assert same(gx.sweep(scene, VALUES, chunk=9, executor="threads:2"), batch)
    with ThreadPoolExecutor(2) as pool:
        assert same(gx.sweep(scene, VALUES, chunk=9, executor=pool), batch)
        assert pool.submit(int, 1).result() == 1  # it is its owner's to end


def test_values_that_go_together(scene: gx.Scene) -> None:
    pairs = {KEP: [20.0, 30.0, 40.0], BV: [0.4, 0.8, 1.2]}
    result = gx.sweep(scene, pairs, zip=True, chunk=2)
    assert same(result, gx.run_batch(scene, pairs, zip=True))
    assert result.to_xarray()["finger_force_peak"].dims == ("variant", "finger", "axis")
    assert result.overrides(1) == {KEP: 30.0, BV: 0.8}


def test_a_run_by_itself_is_measured_as_in_a_batch(scene: gx.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweeps, "look_at", lambda *given: look_at(*given)._replace(native=False))
    scene, few = scene.replace({"engine": "interpreted"}), {KEP: [20.0, 80.0], BV: [1.0]}
    assert same(gx.sweep(scene, few), gx.run_batch(scene, few))
    own = ["internal_force", "displayed_force", "touching"]
    assert same(gx.sweep(scene, {KEP: [20.0]}, measure=own), gx.run_batch(scene, {KEP: [20.0]}, measure=own))


def test_files_stay_and_xarray_reads_them(scene: gx.Scene, batch: gx.Batch, tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    first = gx.sweep(scene, VALUES, out=tmp_path, chunk=11)
    assert same(first, batch)
    with xarray.open_dataset(tmp_path / "sweep.nc", engine="h5netcdf") as file:
        data = file.load()
    assert data.equals(first.to_xarray())
    assert data["finger_force_peak"].attrs["units"] == "N" and data[KEP].attrs["units"] == "N/m"
    assert data["finger_force_peak"].dims == (KEP, KIP, BV, "finger", "axis")
    assert data.sel({KEP: 35.0, KIP: 60.0, BV: 1.0})["finger_force_peak"].shape == (2, 1)
    assert json.loads(data.attrs["scene_table"]) == scene.to_dict() and data.attrs["identity"]
    (tmp_path / "chunks" / "000002.nc").unlink()
    again = gx.sweep(scene, VALUES, out=tmp_path, executor="threads:2")  # its chunks are those that it began with
    assert (again.resumed, first.resumed) == (29, 0) and same(again, batch)
    assert len(list((tmp_path / "chunks").iterdir())) == 4
    (tmp_path / "sweep.nc").write_bytes(b"broken")
    assert gx.sweep(scene, VALUES, out=tmp_path).resumed == 40
    with xarray.open_dataset(tmp_path / "sweep.nc", engine="h5netcdf") as file:
        assert file.load().equals(data)


def test_values_together_have_coordinates_in_the_file(scene: gx.Scene, tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    result = gx.sweep(scene, {KEP: "20:60", BV: "0.1:10:log"}, sample="lhs:5", seed=3, out=tmp_path)
    with xarray.open_dataset(tmp_path / "sweep.nc", engine="h5netcdf") as file:
        data = file.load()
    assert set(data.coords) == {KEP, BV, "finger", "axis"} and data.attrs["seed"] == 3
    assert data.equals(result.to_xarray())
    assert len(result.to_frame()) == 5 and "finger_force.peak.finger0.x" in result.to_frame()


@pytest.mark.parametrize("harm", ["cut", "changed", "empty", "another's"])
def test_damaged_chunks_are_computed_again(scene: gx.Scene, tmp_path: Path, harm: str) -> None:
    first = gx.sweep(scene, {KEP: [20.0, 30.0, 40.0]}, out=tmp_path, chunk=1)
    place = tmp_path / "chunks" / "000001.nc"
    content = place.read_bytes()
    harmed = {
        "cut": content[:-20],
        "changed": content[:200] + bytes([content[200] ^ 1]) + content[201:],
        "empty": b"",
        "another's": (tmp_path / "chunks" / "000000.nc").read_bytes(),
    }[harm]
    place.write_bytes(harmed)
    with pytest.warns(SweepWarning, match="damaged chunks, which are computed again: 000001.nc"):
        again = gx.sweep(scene, {KEP: [20.0, 30.0, 40.0]}, out=tmp_path)
    assert again.resumed == 2 and same(first, again)
    assert place.read_bytes() == content or len(place.read_bytes()) > 1000


@pytest.mark.parametrize("harm", ["cut", "changed"])
def test_a_damaged_file_of_results_is_written_again(scene: gx.Scene, tmp_path: Path, harm: str) -> None:
    first = gx.sweep(scene, {KEP: [20.0, 30.0, 40.0]}, out=tmp_path)
    place = tmp_path / "sweep.nc"
    content = place.read_bytes()
    at = content.index(first["finger_force"]["rms"].tobytes()[:8])
    place.write_bytes(content[:-20] if harm == "cut" else content[:at] + bytes([content[at] ^ 64]) + content[at + 1 :])
    again = gx.sweep(scene, {KEP: [20.0, 30.0, 40.0]}, out=tmp_path)
    assert again.resumed == 3 and same(first, again)
    with h5py.File(place) as file:
        assert np.array_equal(file["finger_force_rms"][...], first["finger_force"]["rms"])


def test_a_finished_sweep_is_read_and_not_written(
    scene: gx.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = gx.sweep(scene, {KEP: [20.0, 30.0]}, out=tmp_path)

    def write(place: Path, content: bytes) -> None:
        raise AssertionError(f"{place} is written")

    monkeypatch.setattr("graspfx.sweeps.sweep_folder.write_whole", write)
    again = gx.sweep(scene, {KEP: [20.0, 30.0]}, out=tmp_path)
    assert again.resumed == 2 and same(first, again)


def test_results_of_another_release_of_an_engine_are_another_sweep_s(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mujoco")
    scene, values = gx.load("reference-1dof", {"object.dynamics": "mujoco"}), {"object.0.mass": [0.1, 0.2]}
    gx.sweep(scene, values, out=tmp_path, duration=0.1)
    own = installed.version
    monkeypatch.setattr(installed, "version", lambda name: "9.9" if name == "mujoco-core" else own(name))
    with pytest.raises(SweepError, match=r"mujoco-core 9\.9"):
        gx.sweep(scene, values, out=tmp_path, duration=0.1)


@pytest.mark.parametrize("seed", [-1, 1.5, "a", None])
def test_a_seed_is_a_whole_number(scene: gx.Scene, seed: Any) -> None:
    with pytest.raises(InputError, match="seed"):
        gx.sweep(scene, {KEP: "20:60"}, sample="lhs:2", seed=seed)


def test_a_folder_of_another_sweep_is_refused(scene: gx.Scene, tmp_path: Path) -> None:
    values = {KEP: [20.0, 30.0]}
    gx.sweep(scene, values, out=tmp_path)

    def text(scene: gx.Scene = scene, values: Any = values, **more: Any) -> str:
        with pytest.raises(SweepError, match="another") as error:
            gx.sweep(scene, values, out=tmp_path, **more)
        return str(error.value)

    assert f"{KEP}: 20.0, 30.0 there, 20.0, 31.0 here" in text(values={KEP: [20.0, 31.0]})
    assert "object.0.mass is 0.1 there, 0.2 here" in text(line(duration=0.15, object__mass=0.2)).replace(
        "object.mass", "object.0.mass"
    )
    assert "duration: 0.15 there, 0.1 here" in text(duration=0.1)
    assert "statistics" in text(statistics=["peak"])
    assert f"{BV}: not swept there" in text(values={**values, BV: [1.0]})
    with pytest.raises(SweepError, match="this sweep; continue with --resume"):
        gx.sweep(scene, values, out=tmp_path, resume=False)
    with pytest.warns(SweepWarning, match=r"the sweep of 2.* was removed to start again, with 1 chunk and sweep\.nc"):
        assert len(gx.sweep(scene, {KEP: [1.0]}, out=tmp_path, overwrite=True)) == 1


@pytest.mark.parametrize("harm", ["damaged", "of a later format", "gone"])
def test_a_folder_that_does_not_say_what_it_is_is_written_over_on_request_alone(
    scene: gx.Scene, tmp_path: Path, harm: str
) -> None:
    gx.sweep(scene, {KEP: [20.0, 30.0]}, out=tmp_path, chunk=1)
    (tmp_path / "chunks" / "mine.nc").write_bytes(b"another's")
    manifest = tmp_path / "sweep.json"
    if harm == "gone":
        manifest.unlink()
    else:
        manifest.write_text("{" if harm == "damaged" else manifest.read_text().replace('"format": 2', '"format": 99'))
    before = (tmp_path / "sweep.nc").read_bytes()
    said = "of format 99" if "later" in harm else r"2 chunks .* but no readable sweep\.json.*--overwrite"
    with pytest.raises(SweepError, match=said):
        gx.sweep(scene, {KEP: [40.0]}, out=tmp_path)
    assert (tmp_path / "sweep.nc").read_bytes() == before
    said = "a sweep of another format" if "later" in harm else r"a sweep with an unreadable sweep\.json"
    with pytest.warns(SweepWarning, match=rf"{said} was removed to start again, with 2 chunks and sweep\.nc"):
        assert gx.sweep(scene, {KEP: [40.0]}, out=tmp_path, overwrite=True).resumed == 0
    assert (tmp_path / "chunks" / "mine.nc").exists()
    assert gx.sweep(scene, {KEP: [40.0]}, out=tmp_path).resumed == 1


def test_a_final_file_alone_is_not_written_over_without_a_word(scene: gx.Scene, tmp_path: Path) -> None:
    (tmp_path / "sweep.nc").write_bytes(b"results")
    with pytest.raises(SweepError, match=r"has sweep\.nc of a sweep, but no readable sweep\.json"):
        gx.sweep(scene, {KEP: [40.0]}, out=tmp_path)


def test_files_that_a_scene_names_are_part_of_it(by_hand: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    first = gx.sweep(by_hand, {"object.mass": [0.1, 0.2]}, out=out)
    assert not first.failed.any() and np.isfinite(first["finger_force"]["peak"]).all()
    (tmp_path / "steady.py").write_text(HAND.replace("0.8", "0.7"))
    with pytest.raises(SweepError, match=r"another sweep: the file steady\.py has changed"):
        gx.sweep(by_hand, {"object.mass": [0.1, 0.2]}, out=out)


def test_python_that_a_swept_value_names_and_imports_is_part_of_it(by_hand: Path, tmp_path: Path) -> None:
    values = {"hand.own.kind": ["steady.py", "firm.py"], "object.mass": [0.1]}
    (tmp_path / "firm.py").write_text("def later():\n    from grip import force\n" + HAND.replace("60.0", "90.0"))
    (tmp_path / "grip.py").write_text("force = 1.0\n")
    out = tmp_path / "out"
    assert not gx.sweep(by_hand, values, out=out).failed.any()
    (tmp_path / "grip.py").write_text("force = 2.0\n")
    with pytest.raises(SweepError, match=r"another sweep: the file grip\.py has changed"):
        gx.sweep(by_hand, values, out=out)


def test_a_folder_has_one_sweep_at_a_time(scene: gx.Scene, tmp_path: Path) -> None:
    with (
        open_folder(tmp_path, {"scene": {}}, 1, resume=True, overwrite=False),
        pytest.raises(SweepError, match="another process is running a sweep in this folder"),
    ):
        gx.sweep(scene, {KEP: [20.0]}, out=tmp_path)
    with pytest.raises(SweepError, match="another sweep"):
        gx.sweep(scene, {KEP: [20.0]}, out=tmp_path)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="a process is not forked here")
def test_a_process_that_is_forked_does_not_keep_the_folder(tmp_path: Path) -> None:
    (read, write), (ready, started) = os.pipe(), os.pipe()
    with open_folder(tmp_path, {"scene": {}}, 1, resume=True, overwrite=False):
        child = os.fork()
        if not child:
            os.write(started, b"x")
            os.read(read, 1)
            os._exit(0)
        os.read(ready, 1)
    try:
        with open_folder(tmp_path, {"scene": {}}, 1, resume=True, overwrite=False):
            pass
    finally:
        os.write(write, b"x")
        os.waitpid(child, 0)


def test_what_is_no_scene_is_a_failure(scene: gx.Scene) -> None:
    values = {"object.mass": [0.1, -1.0, 0.2], KEP: [30.0, 40.0]}
    result = gx.sweep(scene, values)
    assert result.failed.tolist() == [[False, False], [True, True], [False, False]]
    assert "expected more than 0" in result.failure[1, 0] and np.isnan(result["finger_force"]["peak"][1]).all()
    sound = gx.run_batch(scene, {"object.mass": [0.1, 0.2], KEP: [30.0, 40.0]})
    assert (result["finger_force"]["peak"][::2] == sound["finger_force"]["peak"]).all()
    assert "in 2 variants" in repr(result) and "2 x object" in repr(result)
    assert result.ranking().tolist() and not {2, 3} & set(result.ranking().tolist())
    with pytest.raises(SceneError, match="expected more than 0"):
        gx.sweep(scene, {"object.mass": [-1.0, -2.0]})
    with pytest.raises(SceneError, match="did you mean"):
        gx.sweep(scene, {"object.mas": [1.0, 2.0]})


def test_code_that_raises_is_a_failure_of_its_variant(by_hand: Path) -> None:
    result = gx.sweep(by_hand, {"hand.own.broken": [0, 1], "object.mass": [0.1, 0.2]}, measure=["finger_force"])
    assert result.failed.tolist() == [[False, False], [True, True]]
    assert "a broken wrist" in result.failure[1, 0]
    alone = gx.run(gx.load(by_hand, {"hand.own.broken": 0, "object.mass": 0.2}))
    assert (result["finger_force"]["peak"][0, 1] == np.abs(alone.finger_force).max(axis=0)).all()


def test_values_of_any_kind(scene: gx.Scene) -> None:
    values: dict[str, list[Any]] = {
        "finger.0.start": [[-0.0251], [-0.0260]],
        "coupling.internal": [{"stiffness": 70.0}, {"stiffness": 50.0, "damping": 0.1}],
        "coupling.contact": ["unilateral", "attached"],
    }
    result = gx.sweep(scene, values, chunk=3)
    assert same(result, gx.run_batch(scene, values))
    assert not result.failed.any() and len(result.to_frame()) == 8
    assert json.dumps(result.to_dict())


def test_a_sweep_moves_no_hardware(tmp_path: Path) -> None:
    (tmp_path / "fake.py").write_text(DRIVER)
    head, _, _ = SCENE.partition("hand = [")
    fingers = (f'{{ start = [{x}], device = {{ name = "fake.py", position = [[{x}]] }} }}' for x in (-0.03, 0.03))
    (tmp_path / "scene.toml").write_text(f"{head}finger = [{', '.join(fingers)}]")
    with pytest.raises(InputError, match="cannot run hardware"):
        gx.sweep(tmp_path / "scene.toml", {"object.mass": [0.1]})


def test_ctrl_c_keeps_what_is_done(scene: gx.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    submit, calls = Crew.submit, []

    def interrupted(self: Crew, *given: Any) -> Any:
        calls.append(given)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return submit(self, *given)

    monkeypatch.setattr(Crew, "submit", interrupted)
    with pytest.raises(KeyboardInterrupt, match="2 of 5 variants are done in"):
        gx.sweep(scene, {KEP: VALUES[KEP]}, out=tmp_path, chunk=1)
    monkeypatch.setattr(Crew, "submit", submit)
    assert gx.sweep(scene, {KEP: VALUES[KEP]}, out=tmp_path).resumed == 2


def test_wrong_arguments_are_said(scene: gx.Scene, tmp_path: Path) -> None:
    for more, text in (
        ({"executor": "fibres:2"}, "expected none, 'threads:N'"),
        ({"executor": 3}, "an executor of concurrent.futures"),
        ({"chunk": 0}, "chunk"),
        ({"sample": "sobol:3"}, "lhs:N"),
        ({"out": tmp_path / "file"}, "a file of that name exists"),
        ({"measure": []}, "at least one name"),
        ({"zip": True, "sample": "lhs:3"}, "False, because a sample"),
    ):
        (tmp_path / "file").touch()
        with pytest.raises(InputError, match=text):
            gx.sweep(scene, {KEP: [20.0]}, **more)
    with pytest.raises(UnknownNameError, match="did you mean 'finger_force'"):
        gx.sweep(scene, {KEP: [20.0]}, measure=["finger_forces"])
    with pytest.raises(InputError, match="at least one key"):
        gx.sweep(scene, {})


def test_samples_fill_their_ranges() -> None:
    grid = make_grid({"a": "0:8", "b": "1:10000:log", "c": ["x", "y"]}, zip=False, sample="lhs:8", seed=1)
    again = make_grid({"a": "0:8", "b": "1:10000:log", "c": ["x", "y"]}, zip=False, sample="lhs:8", seed=1)
    assert grid.lists == again.lists and grid.shape == (8,)
    assert sorted(int(value) for value in grid.lists["a"]) == list(range(8))
    assert sorted(int(2 * np.log10(value)) for value in grid.lists["b"]) == list(range(8))
    assert sorted(grid.lists["c"]) == ["x"] * 4 + ["y"] * 4


def test_chunks_are_from_all_over() -> None:
    grid = make_grid({"a": "0:1:20", "b": "0:1:10"}, zip=False, sample="", seed=0)
    parts = scattered(200, 40)
    assert sorted(np.concatenate(parts).tolist()) == list(range(200)) and [len(part) for part in parts] == [40] * 5
    for part in parts:
        lists, numbers = grid.part(part)
        assert len(lists["a"]) > 15 and len(lists["b"]) == 10 and len(numbers) == 40
