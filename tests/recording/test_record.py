"""Rows become recordings, and recordings become files that say the same, also when the run is killed."""

from __future__ import annotations

import copy
import os
import pickle
import signal
import subprocess
import sys
import time
import tracemalloc
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray as xr

import graspfx as gx
from graspfx.errors import RecordingError
from graspfx.loop.columns import Layout, RunFault
from graspfx.recording.header import Outcome, machine, versions
from graspfx.recording.record import Recording, from_bytes, to_bytes
from graspfx.recording.recorder import Recorder
from graspfx.recording.sink import FileSink
from tests.support.recordings import PERIOD, header, layout, put, recording, rows
from tests.support.waiting import wait_until

ROOT = Path(__file__).parents[2]


def recorded(made: Layout, values: Any, path: Path | None = None, block: int | None = None) -> Recording:
    sinks = [] if path is None else [FileSink(path, made, header())]
    with Recorder(made, header(), sinks, block) as recorder:
        for row in values:
            put(recorder, row)
            recorder.drain()
        return recorder.finish(0.5)


def datasets(path: Path) -> dict[str, bytes]:
    found: dict[str, bytes] = {}
    with h5py.File(path) as file:
        file.visititems(
            lambda name, item: (
                found.update({name: np.asarray(item[()]).tobytes()})
                if isinstance(item, h5py.Dataset) and item.dtype.kind in "fi"
                else None
            )
        )
    return found


@pytest.mark.parametrize("d", [1, 2, 3])
def test_shapes_are_the_promised_ones(d: int) -> None:
    N, n, w = 7, 4, {1: 1, 2: 3, 3: 6}[d]
    made = layout(d, n, objects=2)
    rec = Recording(rows(made, N), made, header())
    for name in ("finger_position", "finger_velocity", "contact_position", "finger_force", "true_position"):
        assert getattr(rec, name).shape == (N, n, d)
    assert rec.touching.shape == (N, n)
    assert rec.touching.dtype == np.bool_
    assert rec.gap is not None
    assert rec.gap.shape == rec.device_energy.shape == (N, n)
    assert rec.finger_moment is None
    assert np.array_equal(rec.time, np.arange(N) * PERIOD)
    second = rec.objects["object1"]
    assert second.position.shape == second.velocity.shape == (N, d)
    assert second.wrench.shape == (N, w)
    turned = {1: None, 2: (N,), 3: (N, 4)}[d]
    turning = {1: None, 2: (N,), 3: (N, 3)}[d]
    assert (None if second.orientation is None else second.orientation.shape) == turned
    assert (None if second.angular_velocity is None else second.angular_velocity.shape) == turning
    assert rec.object_position is rec.objects["object0"].position
    assert rec.wrench is rec.objects["object0"].wrench


def test_columns_fill_the_row_without_a_gap_or_overlap() -> None:
    made = layout(3, 5, objects=2, moments=True)
    taken = [i for column in made.columns.values() for i in range(made.width)[column.where]]
    # 5 fingers x (4 vectors, moment, true position, touching, gap, energy) and 2 objects x (3 + 3 + 4 + 3 + 6)
    assert taken == list(range(5 * (6 * 3 + 3) + 2 * 19)) == list(range(made.width))


def test_what_a_scene_does_not_have_is_none_and_takes_no_column() -> None:
    made = layout(2, 2, gaps=False, simulated=False, moments=True)
    rec = Recording(rows(made, 3), made, header())
    assert rec.gap is None
    assert rec.true_position is None
    assert rec.finger_moment is not None
    assert rec.finger_moment.shape == (3, 2, 3)


@pytest.mark.parametrize("N", [1, 9, 10, 11, 25])
def test_blocks_leave_no_seam(N: int, tmp_path: Path) -> None:
    made = layout()
    values = rows(made, N)
    rec = recorded(made, values, tmp_path / "r.h5", block=10)
    assert np.array_equal(rec.rows, values)
    assert np.array_equal(Recording.load(tmp_path / "r.h5").rows, values)


def test_a_recorder_that_is_never_drained_loses_nothing(tmp_path: Path) -> None:
    made = layout()
    values = rows(made, 35)
    with Recorder(made, header(), [FileSink(tmp_path / "r.h5", made, header())], 10) as recorder:
        for row in values:
            put(recorder, row)
        rec = recorder.finish()
    assert np.array_equal(rec.rows, values)
    assert np.array_equal(Recording.load(tmp_path / "r.h5").rows, values)


def test_full_blocks_go_out_and_the_rest_when_flushed() -> None:
    counts: list[int] = []

    class Counter:
        def write(self, values: Any, *news: Any) -> None:
            counts.append(len(values))

        def close(self, outcome: Outcome) -> None:
            counts.append(-1)

    made = layout()
    with Recorder(made, header(), [Counter()], 4) as recorder:
        for _ in range(10):
            put(recorder, 0.0)
        recorder.flush()
        assert counts == [4, 4, 2]
        put(recorder, 0.0)
        recorder.finish()
    assert counts == [4, 4, 2, 1, -1]


def test_a_block_is_full_or_about_a_second_old(monkeypatch: pytest.MonkeyPatch) -> None:
    """A MB holds 5041 rows of 26 numbers; a clock that the test sets says when fewer go out."""
    clock = 0.0
    monkeypatch.setattr(time, "monotonic", lambda: clock)
    counts: list[int] = []

    class Counter:
        def write(self, values: Any, *news: Any) -> None:
            counts.append(len(values))

        def close(self, outcome: Outcome) -> None: ...

    made = layout()
    with Recorder(made, header(period=0.005), [Counter()]) as recorder:
        for k in range(6000):
            clock = 2.5 if k == 100 else clock
            put(recorder, 0.0)
            recorder.drain()
        recorder.finish()
    size = (1 << 20) // (8 * made.width)
    assert counts == [101, size - 101, 6000 - size]


@pytest.mark.parametrize("d", [1, 2, 3])
def test_save_and_load_are_bit_identical(d: int, tmp_path: Path) -> None:
    made = layout(d, 3, objects=2)
    outcome = Outcome((RunFault(3, "thumb: ünreadable"), RunFault(5, "again")), 0.25, True)
    rec = Recording(rows(made, 50), made, header(), outcome)
    rec.save(tmp_path / "r.h5")
    back = Recording.load(tmp_path / "r.h5")
    assert back.rows.tobytes() == rec.rows.tobytes()
    assert (back.layout, back.header, back.outcome) == (rec.layout, rec.header, rec.outcome)
    assert back.scene_text == "# ünïcode\ndimensions = 2\n"
    assert str(back.faults[0]) == "tick 3: thumb: ünreadable"


def test_live_and_saved_files_are_written_by_one_writer(tmp_path: Path) -> None:
    made = layout()
    rec = recorded(made, rows(made, 300), tmp_path / "live.h5")
    rec.save(tmp_path / "saved.h5")
    live, saved = datasets(tmp_path / "live.h5"), datasets(tmp_path / "saved.h5")
    own = {name for name in live | saved if name.startswith("rows/")}  # where the rows are, which is another place
    assert {*live} - own == {*saved} - own and len({*live} - own) > 10
    assert all(live[name] == saved[name] for name in {*live} - own)


def test_two_runs_are_the_same_data(tmp_path: Path) -> None:
    made = layout()
    for name in ("a.h5", "b.h5"):
        recorded(made, rows(made, 300), tmp_path / name)
    found = datasets(tmp_path / "a.h5")
    assert found == datasets(tmp_path / "b.h5")
    assert {"time", "finger_force", "objects/object0/position"} <= found.keys()


def test_the_file_opens_in_xarray(tmp_path: Path) -> None:
    made = layout(2, 2)
    rec = recorded(made, rows(made, 30), tmp_path / "r.h5")
    with xr.open_dataset(tmp_path / "r.h5", engine="h5netcdf") as data:
        assert data["finger_force"].dims == ("time", "finger", "axis")
        assert data["finger_force"].attrs["units"] == "N"
        assert np.array_equal(data["finger_force"].values, rec.finger_force)
        assert np.array_equal(data["time"].values, rec.time)
        assert list(data["finger"].values) == ["finger0", "finger1"]
        assert list(data["axis"].values) == ["x", "y"]
        assert data["touching"].dtype == bool
        assert np.array_equal(data["touching"].values, rec.touching)
        assert data.attrs["scene_text"] == "# ünïcode\ndimensions = 2\n"
    with xr.open_dataset(tmp_path / "r.h5", engine="h5netcdf", group="objects/object0") as data:
        assert data["wrench"].dims == ("time", "component")
        assert np.array_equal(data["wrench"].values, rec.wrench)
        assert data["orientation"].attrs["units"] == "rad"


def test_a_run_that_breaks_off_keeps_its_rows_and_faults(tmp_path: Path) -> None:
    made = layout()
    values = rows(made, 15)

    def run() -> None:
        with Recorder(made, header(), [FileSink(tmp_path / "r.h5", made, header())], 10) as recorder:
            for row in values:
                put(recorder, row)
                recorder.drain()
            recorder.fault(14, "unplugged")
            raise RuntimeError("the loop broke")

    with pytest.raises(RuntimeError, match="the loop broke"):
        run()
    back = Recording.load(tmp_path / "r.h5")
    assert np.array_equal(back.rows, values)
    assert back.outcome == Outcome((RunFault(14, "unplugged"),), None, False, cause="RuntimeError: the loop broke")


KILLED = """
import sys, time
sys.path.insert(0, {root!r})
from tests.support.recordings import header, layout, put, rows
from graspfx.recording.sink import FileSink
from graspfx.recording.recorder import Recorder
made = layout()
values = rows(made, 1000)
recorder = Recorder(made, header(), [FileSink({path!r}, made, header())], 100)
for k in range(250):
    put(recorder, values[k])
    if k == 120:
        recorder.fault(k, "unplugged")
    recorder.drain()
print("ready", flush=True)
time.sleep(60)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no such signal here")
def test_a_killed_run_can_be_read_as_far_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "r.h5"
    code = KILLED.format(root=str(ROOT), path=str(path))
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        wait_until(lambda: len(Recording.load(path)) == 200)  # a thread of the run writes its blocks
        during = Recording.load(path)  # while it is being written
        os.kill(process.pid, signal.SIGKILL)
    back = Recording.load(path)
    # 250 ticks in blocks of 100: two blocks were on the disk, the rest is lost
    made = layout()
    assert during.rows.tobytes() == back.rows.tobytes() == rows(made, 1000)[:200].tobytes()
    assert back.outcome == Outcome((RunFault(120, "unplugged"),), None, False)
    back.save(tmp_path / "repaired.h5")
    with xr.open_dataset(tmp_path / "repaired.h5", engine="h5netcdf") as data:
        assert data.sizes["time"] == 200


def test_rows_that_are_not_kept_are_in_the_file_alone(tmp_path: Path) -> None:
    made, path = layout(), tmp_path / "r.h5"
    values = rows(made, 10_005)
    with Recorder(made, header(), [FileSink(path, made, header())], 100, keep=False) as recorder:
        tracemalloc.start()
        for row in values:
            put(recorder, row)
            recorder.drain()
        held, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert len(recorder.finish(0.5)) == 0
    assert np.array_equal(Recording.load(path).rows, values)
    assert held < 0.1 * values.nbytes


TRUNCATED = """
import sys
sys.path.insert(0, {root!r})
from pathlib import Path
from graspfx.errors import RecordingError
from graspfx.recording.record import Recording
for name in ("closed.h5", {first!r}):
    whole = Path(name).read_bytes()
    assert len(Recording.load(name)) > 0
    near, end = range(0, 1000, 100), range(len(whole) - 200, len(whole))
    for size in [*near, *range(1000, len(whole) - 200, len(whole) // 150), *end]:
        Path("cut.h5").write_bytes(whole[:size])
        try:
            Recording.load("cut.h5")
        except RecordingError:
            continue
        raise AssertionError(f"{{name}} cut to {{size}} bytes was read")
"""


def test_a_file_that_was_cut_short_is_an_error_and_never_waited_for(tmp_path: Path) -> None:
    """Files of today's format, and of the first one as a killed run left it, with a writer's marks in HDF5."""
    made = layout(3, 3)
    Recording(rows(made, 1500), made, header()).save(tmp_path / "closed.h5")
    code = TRUNCATED.format(root=str(ROOT), first=str(ROOT / "tests" / "recording" / "formats" / "1-open.h5"))
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path, timeout=60)


def test_nothing_is_written_over(tmp_path: Path) -> None:
    made, path = layout(), tmp_path / "r.h5"
    rec = recorded(made, rows(made, 20), path)
    before = path.read_bytes()
    with pytest.raises(RecordingError, match=r"r\.h5: exists already; choose another place, or pass overwrite=True"):
        rec.save(path)
    with pytest.raises(RecordingError, match="exists already"):
        FileSink(path, made, header())
    assert path.read_bytes() == before
    other = Recording(rows(made, 10, seed=3), made, header())
    other.save(path, overwrite=True)
    assert np.array_equal(Recording.load(path).rows, other.rows)
    assert [each.name for each in tmp_path.iterdir()] == ["r.h5"]
    recorded(made, rows(made, 20), tmp_path / "s.h5")
    sink = FileSink(tmp_path / "s.h5", made, header(), overwrite=True)
    sink.write(other.rows, [])
    assert len(Recording.load(tmp_path / "s.h5")) == 20  # the recording stays until the other is whole
    sink.close(Outcome())
    assert len(Recording.load(tmp_path / "s.h5")) == 10


def test_a_folder_stands_for_the_recording_in_it(tmp_path: Path) -> None:
    made = layout()
    rec = recorded(made, rows(made, 5), tmp_path / "recording.h5")
    assert np.array_equal(Recording.load(tmp_path).rows, rec.rows)
    (tmp_path / "empty").mkdir()
    with pytest.raises(RecordingError, match=r"empty.recording\.h5: the file does not exist"):
        Recording.load(tmp_path / "empty")


def test_what_is_no_recording_says_so(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="the file does not exist"):
        Recording.load(tmp_path / "none.h5")
    (tmp_path / "text.h5").write_text("hello")
    with pytest.raises(RecordingError, match="cannot be read as a recording"):
        Recording.load(tmp_path / "text.h5")
    with h5py.File(tmp_path / "other.h5", "w", libver="latest") as file:
        file["x"] = 1.0
    with pytest.raises(RecordingError, match="not a GraspFX recording"):
        Recording.load(tmp_path / "other.h5")
    with pytest.raises(RecordingError, match="cannot be written"):
        recording({"gap": np.zeros((3, 2))}, layout()).save(tmp_path / "nowhere" / "r.h5")
    with pytest.raises(RecordingError, match="do not fit"):
        Recording(np.zeros((3, 4)), layout(), header())


def test_rows_cannot_be_changed_afterwards() -> None:
    made = layout()
    rec = recorded(made, rows(made, 5))
    with pytest.raises(ValueError, match="read-only"):
        rec.finger_force[0] = 1.0


def test_versions_and_machine_are_of_here() -> None:
    found = versions("h5py", "no-such-package")
    assert found["numpy"] == np.__version__
    assert found["h5py"] == h5py.__version__
    assert "no-such-package" not in found
    assert machine()["implementation"].endswith(sys.version.split()[0])


@pytest.mark.parametrize("place", ["memory", "disk"])
def test_a_recording_goes_to_another_process_and_is_copied(place: str, tmp_path: Path) -> None:
    run = gx.run("paper-waving", duration=0.5, out=tmp_path / "run" if place == "disk" else None)
    for other in (pickle.loads(pickle.dumps(run)), copy.deepcopy(run), copy.copy(run)):
        assert type(other) is Recording and other is not run
        assert other.rows.tobytes() == run.rows.tobytes() and not other.rows.flags.writeable
        assert (other.header, other.outcome, other.layout) == (run.header, run.outcome, run.layout)
        assert other.summary() == run.summary()
    part = run.part(20, 60)
    other = pickle.loads(pickle.dumps(part))
    assert other.rows.tobytes() == part.rows.tobytes() and np.array_equal(other.time, part.time)


def test_bytes_of_a_recording_that_were_changed_are_refused() -> None:
    content = bytearray(to_bytes(gx.run("reference-1dof", duration=0.5).save))
    content[len(content) // 2] ^= 1
    with pytest.raises(RecordingError):
        _ = from_bytes(Recording, bytes(content)).rows
