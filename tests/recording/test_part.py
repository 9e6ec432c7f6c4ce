"""A run writes a part until it ends: it can be read at any instant, and nobody else writes it."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import graspfx as gx
from graspfx.__main__ import main
from graspfx.errors import RecordingError
from graspfx.loop.columns import RunFault
from graspfx.recording import part as parts
from graspfx.recording.file import read
from graspfx.recording.files import NAME, part_of
from graspfx.recording.header import Outcome
from graspfx.recording.record import Recording
from graspfx.recording.sink import FileSink
from tests.support.families import efforts
from tests.support.parts import POSIX, ROOT, abandon, made, script, values, write_part
from tests.support.recordings import header


def test_a_run_is_a_part_until_it_ends_and_then_a_recording(tmp_path: Path) -> None:
    sink = write_part(tmp_path / NAME)
    assert [path.name for path in tmp_path.iterdir()] == ["recording.h5.part"]
    for path in (tmp_path, tmp_path / NAME, tmp_path / "recording.h5.part"):
        during = Recording.load(path)
        assert during.rows.tobytes() == values.tobytes()
        assert during.outcome == Outcome((RunFault(400, "unplugged"),), None, False)
        assert (during.layout, during.header) == (made, header())
    outcome = Outcome((RunFault(400, "unplugged"),), 0.25, True, 0.001, "compiled")
    sink.close(outcome)
    assert [path.name for path in tmp_path.iterdir()] == ["recording.h5"]
    after = Recording.load(tmp_path)
    assert after.rows.tobytes() == values.tobytes()
    assert after.outcome == outcome


def test_a_part_that_was_cut_anywhere_gives_the_rows_before(tmp_path: Path) -> None:
    """A kill in the middle of a write, or a disk that is full, leaves some first bytes of a block."""
    abandon(write_part(tmp_path / NAME))
    whole = (tmp_path / "recording.h5.part").read_bytes()
    first = whole.index(parts.ROWS)  # 32 bytes before the first row
    cut = tmp_path / "cut.h5.part"
    block = 201 * 8 * made.width  # the head takes the place of a row
    seen = set()
    for size in [*range(first, first + 60), *range(first, len(whole), 5003), len(whole) - 1]:
        cut.write_bytes(whole[:size])
        got = Recording.load(cut).rows
        assert len(got) % 200 == 0
        assert len(got) <= (size - first) / block * 200 < len(got) + 201
        assert got.tobytes() == values[: len(got)].tobytes()
        seen.add(len(got))
    assert seen == set(range(0, 1500, 200))
    for size in (0, 10, first // 2, first - 1 - len(header().scene_text)):
        cut.write_bytes(whole[:size])
        with pytest.raises(RecordingError, match="is empty; its run ended before the first row"):
            Recording.load(cut)


def test_zeros_that_a_loss_of_power_leaves_end_a_part(tmp_path: Path) -> None:
    abandon(write_part(tmp_path / NAME))
    part = tmp_path / "recording.h5.part"
    whole = part.read_bytes()
    part.write_bytes(whole + bytes(5000))
    assert len(Recording.load(part)) == 1500
    part.write_bytes(whole[:-3000] + bytes(3000))
    assert len(Recording.load(part)) == 1400
    part.write_bytes(whole + bytes(100))  # zeros too few to be a sector that was not written
    with pytest.raises(RecordingError, match="its bytes were changed after byte"):
        Recording.load(part)


def test_a_second_writer_is_kept_out_while_the_first_one_writes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a").mkdir()
    sink = write_part(Path("a/recording.h5"))
    run = ["run", "reference-1dof", "--duration", "0.05", "--no-figure", "--out", "a"]
    assert main(run) == 2
    said = capsys.readouterr().err
    assert said.startswith("a/recording.h5.part: exists already, from a run that is active or was killed")
    assert main([*run, "--overwrite"]) == 2
    assert capsys.readouterr().err.startswith("a/recording.h5.part: another run is writing there")
    with pytest.raises(RecordingError, match="another run is writing there"):
        gx.run(gx.load("reference-1dof"), duration=0.05, out="a", overwrite=True)
    with pytest.raises(RecordingError, match="another run is writing there"):
        Recording(values, made, header()).save("a/recording.h5", overwrite=True)
    assert len(Recording.load("a")) == 1500
    sink.close(Outcome())
    assert main([*run, "--overwrite"]) == 0
    assert len(Recording.load("a")) == 10


KILLS = """
import json, os, signal, sys, time
import numpy as np
import graspfx as gx
from graspfx.errors import RecordingError
from graspfx.recording import recorder
from graspfx.recording.files import NAME
recorder.BLOCK = 200 * 136  # bytes: of this scene half a run
cases, rng = int(sys.argv[1]), np.random.default_rng(int(sys.argv[2]))
scene = gx.load("reference-1dof", {"engine": "interpreted"})  # of which a tick is many calls
whole = gx.run(scene, out="whole")
def count_down(frame, event, argument):
    global left
    left -= 1
    if left == 0:
        time.sleep(nap)
        os.kill(os.getpid(), signal.SIGKILL)
def run(out, calls):
    global left
    left = calls
    sys.setprofile(count_down)
    try:
        gx.run(scene, out=out, overwrite=True)
    finally:
        sys.setprofile(None)
    return calls - left
began = time.monotonic()
calls = run("whole", -1)
took = time.monotonic() - began
lengths, empty = [], 0
for case in range(cases):
    # every third time by the clock, at any instant; else after a number of calls, which no load of the machine moves,
    # half of them once the thread that writes rows has had time for those that it has
    nap = 0.1 if case % 3 == 1 else 0.0
    instant, delay = int(rng.integers(1, calls)), float(rng.uniform(0.0, took))
    child = os.fork()
    if child == 0:
        try:
            run("killed", -1 if case % 3 == 0 else instant)
        finally:
            os._exit(0)
    if case % 3 == 0:
        time.sleep(delay)
        os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    if not os.path.isdir("killed") or not any(name.startswith(NAME) for name in os.listdir("killed")):
        continue
    part = os.path.join("killed", NAME + ".part")
    if os.path.isfile(part):
        try:
            rec = gx.Recording.load(part)
        except RecordingError as error:
            assert "is empty" in str(error), error
            empty += 1
            continue
        lengths.append(len(rec))
        assert rec.rows.tobytes() == whole.rows[:len(rec)].tobytes(), len(rec)
    if os.path.isfile(os.path.join("killed", NAME)):
        assert gx.Recording.load(os.path.join("killed", NAME)).rows.tobytes() == whole.rows.tobytes()
gx.run(scene, out="killed", overwrite=True)
print(json.dumps({"lengths": lengths, "empty": empty, "files": sorted(os.listdir("killed"))}))
"""


@POSIX
@efforts(short=72, full=500, asked="faults")
def test_a_run_that_is_killed_at_any_instant_can_be_read(cases: int, tmp_path: Path) -> None:
    found = script(KILLS, tmp_path, str(cases), "7")
    assert len(found["lengths"]) >= cases / 3  # of those that were killed after a number of calls, half at least
    assert {0, 200, 400} <= set(found["lengths"])
    assert found["empty"] <= cases / 3  # those killed by the clock may all meet the making of the file
    assert found["files"] == [NAME]


STEPS = """
import json, os, signal, sys
from pathlib import Path
import graspfx as gx
import graspfx.recording.file, graspfx.recording.part
graspfx.recording.part.SYNC = 0.0  # the disk is told to keep each block
scene = gx.load("reference-1dof")
whole = gx.run(scene, out="whole").rows.tobytes()  # what it compiles is in the cache from here on
seen = []
for step in range(100):
    child = os.fork()
    if child == 0:
        count = 0
        def fatal(call):
            def instead(*arguments, **keywords):
                global count
                count += 1
                if count > step:
                    os.kill(os.getpid(), signal.SIGKILL)
                return call(*arguments, **keywords)
            return instead
        os.fsync, Path.replace, Path.unlink = fatal(os.fsync), fatal(Path.replace), fatal(Path.unlink)
        gx.run(scene, out="steps", overwrite=True)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    files = sorted(os.listdir("steps"))
    rec = gx.Recording.load("steps")
    assert rec.rows.tobytes() == whole[: len(rec.rows.tobytes())]
    seen.append([files, len(rec), rec.outcome.complete])
    if status == 0:
        break
    for name in os.listdir("steps"):
        os.unlink(os.path.join("steps", name))
print(json.dumps(seen))
"""


@POSIX
def test_a_kill_between_two_steps_of_the_end_loses_nothing(tmp_path: Path) -> None:
    """Just before each call that makes the disk keep a file, gives it its name or removes one."""
    seen = script(STEPS, tmp_path)
    assert seen[0] == [["recording.h5.part"], seen[0][1], False]  # before the disk was told of the first block
    assert seen[-1] == [["recording.h5"], 400, True]
    assert all(0 < count <= 400 for _, count, _ in seen)  # the system has a block before the disk is told to keep it
    done = [complete for *_, complete in seen]
    assert done == sorted(done) and done.count(True) >= 6
    assert all(count == 400 for _, count, complete in seen if complete)
    places = [files for files, *_ in seen]
    order = [["recording.h5.part"], ["recording.h5.part", "recording.h5.tmp"], ["recording.h5", "recording.h5.part"],
             ["recording.h5"]]  # fmt: skip
    assert all(files in order for files in places)
    numbers = [order.index(files) for files in places]
    assert numbers == sorted(numbers) and set(numbers) == {0, 1, 2, 3}  # the part goes last
    assert len(seen) >= 8


def test_the_disk_is_told_to_keep_the_rows_about_once_a_second(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock, syncs = 0.0, []
    monkeypatch.setattr(time, "monotonic", lambda: clock)
    monkeypatch.setattr(os, "fsync", lambda _: syncs.append(clock))
    monkeypatch.setattr(parts, "sync_folder", lambda _: None)
    sink = FileSink(tmp_path / NAME, made, header())
    for k in range(1, 17):
        clock = 0.3 * k
        sink.write(values[:10], [])
    abandon(sink)
    assert len(syncs) == 4  # the first block after each second
    assert (np.diff([0.0, *syncs]) >= 1.0).all()


@POSIX
def test_plot_says_which_file_it_reads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)

    monkeypatch.setattr("graspfx.show.style.save", lambda _, path, *more: path.write_bytes(b"a picture"))
    gx.run(gx.load("reference-1dof"), duration=2.0, out="whole")
    rec = Recording.load("whole")
    Path("killed").mkdir()
    sink = FileSink("killed/recording.h5", rec.layout, rec.header)
    sink.write(rec.rows[:300], [])
    said = "note: read 1.5 s from killed/recording.h5.part; the run has not finished or was killed"
    for command, given in (
        ("plot", "killed/recording.h5.part"),
        ("plot", "killed"),
        ("picture", "killed/recording.h5"),
    ):
        assert main([command, given, "--overwrite"]) == 0
        printed = capsys.readouterr()
        assert printed.err.startswith(said), printed.err
        assert "wrote killed/" in printed.out
    abandon(sink)
    rec.save("killed/recording2.h5")
    shutil.move("killed/recording2.h5", "killed/recording.h5")
    assert main(["plot", "killed", "--overwrite"]) == 0
    said = "recording.h5.part beside it is from a later run that has not finished or was killed"
    assert capsys.readouterr().err == f"note: read killed/recording.h5; {said}\n"
    assert len(read("killed")[0]) == 400


@POSIX
def test_the_lock_of_a_process_that_was_killed_is_gone(tmp_path: Path) -> None:
    code = f"""
import sys, time
sys.path.insert(0, {str(ROOT)!r})
from tests.support.recordings import header, layout, rows
from graspfx.recording.sink import FileSink
sink = FileSink({str(tmp_path / NAME)!r}, layout(), header())
sink.write(rows(layout(), 100), [])
print("ready", flush=True)
time.sleep(60)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        with pytest.raises(RecordingError, match="another run is writing there"):
            FileSink(tmp_path / NAME, made, header(), overwrite=True)
        os.kill(process.pid, signal.SIGKILL)
    assert len(Recording.load(tmp_path)) == 100
    with pytest.raises(RecordingError, match="exists already, from a run that is active or was killed"):
        FileSink(tmp_path / NAME, made, header())
    FileSink(tmp_path / NAME, made, header(), overwrite=True).close(Outcome())
    assert not part_of(tmp_path / NAME).exists()
