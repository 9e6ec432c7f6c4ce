"""Recordings and batches as xarray, pandas and comma-separated text: every number, name, unit and dimension."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import graspfx as gx
from graspfx.__main__ import main
from graspfx.errors import InputError, MissingPackageError, RecordingError
from graspfx.show.conversions import components, coordinates, quantities

SCENES = ["reference-1dof", "paper-waving", "two-objects"]  # on a line, in the plane, several objects


@pytest.fixture(scope="module", params=SCENES)
def recording(request: pytest.FixtureRequest) -> gx.Recording:
    return gx.run(request.param, duration=0.1)


def test_a_dataset_is_what_xarray_reads_from_the_file(recording: gx.Recording, tmp_path: Path) -> None:
    recording.save(tmp_path / "r.h5")
    data = recording.to_xarray()
    with xr.open_dataset(tmp_path / "r.h5", engine="h5netcdf", decode_timedelta=False) as file:
        assert set(file.variables) <= set(data.variables) and {"finger_force", "time"} <= set(file.variables)
        for name in file.variables:
            assert data[name].identical(file[name].load().reset_coords(drop=True)) or name in file.coords
            assert data[name].dims == file[name].dims and data[name].dtype.kind == file[name].dtype.kind
            assert np.array_equal(data[name].values, file[name].values)
        assert {**file.attrs}.items() <= {**data.attrs}.items()
    for name in recording.layout.objects:
        with xr.open_dataset(tmp_path / "r.h5", engine="h5netcdf", group=f"objects/{name}") as file:
            for part in file.data_vars:
                ours = data[f"object_{part}"].sel(object=name)
                assert ours.dims == file[part].dims and ours.attrs == file[part].attrs
                assert np.array_equal(ours.values, file[part].values)


def test_a_dataset_has_what_follows_from_the_columns(recording: gx.Recording) -> None:
    data = recording.to_xarray()
    assert np.array_equal(data["displayed_force"].values, recording.displayed_force)
    assert data["displayed_force"].dims == ("time", "finger", "axis")
    assert all(variable.attrs["units"] and variable.attrs["long_name"] for variable in data.data_vars.values())
    assert data.attrs["scene_text"] == recording.scene_text and data.attrs["faults"] == ""


def test_a_dataset_goes_to_netcdf_and_back(recording: gx.Recording, tmp_path: Path) -> None:
    data = recording.to_xarray()
    data.to_netcdf(tmp_path / "r.nc", engine="h5netcdf")
    with xr.open_dataset(tmp_path / "r.nc", engine="h5netcdf", decode_timedelta=False) as file:
        assert file.load().equals(data)


def test_energies_of_modes_stand_under_their_object() -> None:
    recording = gx.run("paper-spring", {"coupling.passivity": "observe"}, duration=0.1)
    data = recording.to_xarray()
    assert data["object_energy_work"].dims == ("time", "object", "mode")
    [books] = recording.energy.values()
    assert np.array_equal(data["object_energy_work"].values[:, 0], books["work"])
    assert "object_energy_work.object.translation" in recording.to_frame()


def test_a_frame_has_a_row_per_tick_and_a_column_per_component(recording: gx.Recording) -> None:
    frame, data = recording.to_frame(), recording.to_xarray()
    assert len(frame) == len(recording) and frame.index.name == "time" and frame.columns.is_unique
    assert np.array_equal(frame.index, recording.time)
    finger, axis = recording.layout.fingers[1], "x"
    column = frame[f"finger_force.{finger}.{axis}"]
    assert np.array_equal(column, data["finger_force"].sel(finger=finger, axis=axis))
    assert len(frame.columns) == sum(variable[0].size for variable in data.data_vars.values())
    assert frame[f"touching.{finger}"].dtype == bool
    assert frame.attrs["units"]["finger_force"] == "N" and frame.attrs["scene"] == recording.header.scene


def test_text_reads_back_the_same(recording: gx.Recording, tmp_path: Path) -> None:
    recording.to_csv(tmp_path / "r.csv")
    with (tmp_path / "r.csv").open(newline="") as file:
        head, *rows = csv.reader(file)
    ours = recording.to_frame()
    assert head == ["time", *ours]
    numbers = np.array([[float(each) for each in row] for row in rows])
    assert numbers.tobytes() == np.column_stack([ours.index, ours.to_numpy(float)]).tobytes()
    assert np.allclose(
        pd.read_csv(tmp_path / "r.csv", index_col="time").to_numpy(float), ours.to_numpy(float), equal_nan=True
    )
    with pytest.raises(RecordingError, match=r"r\.csv: exists already"):
        recording.to_csv(tmp_path / "r.csv")
    recording.to_csv(tmp_path / "r.csv", overwrite=True)
    assert [path.name for path in tmp_path.iterdir()] == ["r.csv"]


def test_text_that_cannot_be_written_is_an_error_of_ours(recording: gx.Recording, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot be written"):
        recording.to_csv(tmp_path / "nowhere" / "r.csv")
    with pytest.raises(InputError, match="path"):
        recording.to_csv(3)  # type: ignore[arg-type]


@pytest.mark.parametrize(("package", "export"), [("xarray", "to_xarray"), ("pandas", "to_frame")])
def test_a_package_that_is_missing_is_named_with_its_remedy(
    package: str, export: str, recording: gx.Recording, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, package, None)  # its import is a ModuleNotFoundError
    with pytest.raises(
        MissingPackageError,
        match=rf"Recording.{export} needs .*{package}.*graspfx\[data\]', or '\.\[data\]' in a checkout",
    ):
        getattr(recording, export)()
    recording.to_csv(tmp_path / "r.csv")  # needs neither


GRID: dict[str, list[float]] = {"coupling.internal.stiffness": [40.0, 50.0], "object.mass": [0.1, 0.2, 0.3]}


def test_a_batch_has_a_dimension_per_key() -> None:
    batch = gx.run_batch("paper-waving", GRID, 0.1, measure=["finger_force", "wrench"])
    data, frame = batch.to_xarray(), batch.to_frame()
    variable = data["finger_force_rms"]
    assert variable.dims == (*GRID, "finger", "axis") and variable.attrs["units"] == "N"
    assert np.array_equal(variable.values, batch["finger_force"]["rms"])
    assert data["wrench_mean"].dims == (*GRID, "component") and data["finger_force_growth"].attrs["units"] == "1"
    point = data.sel({"coupling.internal.stiffness": 50.0, "object.mass": 0.2})
    alone = gx.run("paper-waving", {"coupling.internal.stiffness": 50.0, "object.mass": 0.2}, duration=0.1)
    assert np.array_equal(point["finger_force_last"].values, alone.finger_force[-1])
    row = frame[(frame["coupling.internal.stiffness"] == 50.0) & (frame["object.mass"] == 0.2)]
    assert len(frame) == 6 and float(row["finger_force.last.thumb.x"].iloc[0]) == alone.finger_force[-1, 0, 0]
    assert data.attrs["scene"] == "paper-waving" and (data["fault_tick"] == -1).all()


def test_a_batch_of_recordings_has_their_variables() -> None:
    together = {"coupling.internal.stiffness": [40.0, 50.0], "object.mass": [0.1, 0.2]}
    batch = gx.run_batch("reference-1dof", together, 0.1, zip=True, keep="recordings")
    data = batch.to_xarray()
    assert data["finger_force"].dims == ("variant", "time", "finger", "axis")
    assert np.array_equal(data["finger_force"].values, batch.stacked("finger_force"))
    assert data["object.mass"].dims == ("variant",) and data["object.mass"].values.tolist() == [0.1, 0.2]


def test_a_batch_of_summaries_has_their_numbers() -> None:
    batch = gx.run_batch("reference-1dof", {"coupling.form": ["literal", "symmetric"]}, 0.1, keep="summary")
    data, frame = batch.to_xarray(), batch.to_frame()
    assert batch.summaries is not None
    expected = [each["internal_deformation_mean"] for each in batch.summaries]
    assert data["internal_deformation_mean"].values.tolist() == expected == frame["internal_deformation_mean"].tolist()
    assert data["coupling.form"].values.tolist() == ["literal", "symmetric"] == frame["coupling.form"].tolist()


def test_components_are_named_entry_by_entry(recording: gx.Recording) -> None:
    names = coordinates(recording.layout)
    for quantity in quantities(recording):
        listed = list(components(quantity, names))
        assert all(name.startswith(quantity.name) for name, _ in listed)
        own, nan = np.stack([each for _, each in listed], axis=1), quantity.values.dtype.kind == "f"
        assert np.array_equal(own.ravel(), quantity.values.ravel(), equal_nan=nan)


@pytest.mark.parametrize(("arguments", "name"), [([], "recording.csv"), (["--format", "nc"], "recording.nc")])
def test_the_command_writes_beside_the_recording(
    arguments: list[str], name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = gx.run("reference-1dof", duration=0.05, out=tmp_path)
    assert main(["export", str(tmp_path), *arguments]) == 0
    assert capsys.readouterr().out == f"wrote {tmp_path / name}\n"
    if name.endswith(".csv"):
        assert len((tmp_path / name).read_text().splitlines()) == len(recording) + 1
    else:
        with xr.open_dataset(tmp_path / name, engine="h5netcdf", decode_timedelta=False) as data:
            assert np.array_equal(data["finger_force"].values, recording.finger_force)
    assert main(["export", str(tmp_path), *arguments]) == 2
    assert "exists already; choose another --out, or overwrite it with --overwrite" in capsys.readouterr().err
    assert main(["export", str(tmp_path), *arguments, "--overwrite"]) == 0


def test_the_command_goes_by_the_ending_of_its_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gx.run("reference-1dof", duration=0.05, out=tmp_path)
    assert main(["export", str(tmp_path / "recording.h5"), "--out", str(tmp_path / "new" / "mine.nc")]) == 0
    with xr.open_dataset(tmp_path / "new" / "mine.nc", engine="h5netcdf", decode_timedelta=False) as data:
        assert "finger_force" in data
    assert main(["export", str(tmp_path), "--format", "xlsx"]) == 2
    assert "unknown format 'xlsx'" in capsys.readouterr().err


@pytest.mark.parametrize("out", ["a/recording.h5", "b.h5", "b.nc", "b.part"])
def test_text_is_not_written_under_anothers_ending(
    out: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A recording is never replaced by what was exported from it."""
    monkeypatch.chdir(tmp_path)
    Path("a").mkdir()
    gx.run("reference-1dof", duration=0.1).save("a/recording.h5")
    before = Path("a/recording.h5").read_bytes()
    assert main(["export", "a", "--out", out, "--format", "csv", "--overwrite"]) == 2
    assert "a file that ends in .csv" in capsys.readouterr().err
    assert Path("a/recording.h5").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_a_file_without_a_name_or_a_folder_is_an_error_of_ours(tmp_path: Path) -> None:
    rec = gx.run("reference-1dof", duration=0.1)
    with pytest.raises(InputError, match="path of a file"):
        rec.to_csv("", overwrite=True)
    with pytest.raises(InputError, match=r"create the folder .*none"):
        rec.plot().save(tmp_path / "none" / "figure.png")


@pytest.mark.parametrize("name", ["two-objects", "soft-pinch"])
def test_a_dataset_of_a_file_is_read_as_it_is_asked_for(name: str, tmp_path: Path) -> None:
    """The same numbers as of a recording in memory, in blocks of 7 rows, also backwards and of a single tick."""
    here = gx.run(name, {"engine": "interpreted"}, duration=0.1)
    here.save(tmp_path / "r.h5")
    stored = gx.Recording.load(tmp_path / "r.h5")
    stored.store.step = 7
    expected, data = here.to_xarray(), stored.to_xarray()
    assert list(data) == list(expected) and data.attrs == expected.attrs
    assert not any(each.variable._in_memory for each in data.values())
    for key, values in expected.items():
        own = data[key]
        assert (own.dims, own.attrs, own.dtype) == (values.dims, values.attrs, values.dtype)
        for rows in (slice(30, 2, -3), slice(0, 0), 5, slice(None)):
            some, same = own.isel(time=rows).values, values.isel(time=rows).values
            assert np.ascontiguousarray(some).tobytes() == np.ascontiguousarray(same).tobytes(), (key, rows)
