"""A run writes a part until it ends: it can be read at any instant, nobody else writes it, and no failure loses it."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recordings import header, layout, rows

import graspfx as gx
from graspfx.__main__ import main
from graspfx.errors import RecordingError
from graspfx.loop import journal as journals
from graspfx.loop.file import read
from graspfx.loop.header import Outcome, RunFault
from graspfx.loop.places import NAME, part_of
from graspfx.loop.record import Recording
from graspfx.loop.sink import FileSink
from graspfx.loop.stream import Stream
from tests.stress.ledger import efforts

ROOT = Path(__file__).parents[1]
POSIX = pytest.mark.skipif(os.name != "posix", reason="kills a process, limits its files or removes its folder")

made = layout(3, 2)
values = rows(made, 1500)


def script(code: str, folder: Path, *arguments: str) -> Any:
    """What a program of its own prints as JSON; it must come to its end by itself."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests")])}
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout.splitlines()[-1])


def abandon(sink: FileSink) -> None:
    """What the system does with the file of a process that ends."""
    sink._journal.file.close()


def write_part(path: Path, count: int = 1500, block: int = 200) -> FileSink:
    sink = FileSink(path, made, header())
    for first in range(0, count, block):
        faults = [RunFault(first, "unplugged")] if first == 400 else []
        sink.write(values[first : min(count, first + block)], faults)
    return sink


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
    first = whole.index(journals.ROWS)  # 32 bytes before the first row
    cut = tmp_path / "cut.h5.part"
    block = 200 * 8 * made.width
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
        with pytest.raises(RecordingError, match="holds nothing; its run ended before the first row"):
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
    sink = write_part(Path("a/recording.h5") if Path("a").mkdir() is None else Path())
    run = ["run", "reference-1dof", "--duration", "0.05", "--no-figure", "--out", "a"]
    assert main(run) == 2
    said = capsys.readouterr().err
    assert said.startswith("a/recording.h5.part: is there already, of a run that goes on or was killed; choose another")
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
from graspfx.loop.places import NAME
cases, rng = int(sys.argv[1]), np.random.default_rng(int(sys.argv[2]))
scene = gx.load("reference-1dof")
whole = gx.run(scene, out="whole")
began = time.monotonic()
gx.run(scene, out="whole", overwrite=True)
took = time.monotonic() - began
lengths, empty = [], 0
for case in range(cases):
    child = os.fork()
    if child == 0:
        try:
            gx.run(scene, out="killed", overwrite=True)
        finally:
            os._exit(0)
    time.sleep(float(rng.uniform(0.0, 1.1 * took)))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    if not os.path.isdir("killed") or not any(name.startswith(NAME) for name in os.listdir("killed")):
        continue
    part = os.path.join("killed", NAME + ".part")
    if os.path.isfile(part):
        try:
            rec = gx.Recording.load(part)
        except RecordingError as error:
            assert "holds nothing" in str(error), error
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
@efforts(short=30, full=500)
def test_a_run_that_is_killed_at_any_instant_can_be_read(cases: int, tmp_path: Path) -> None:
    found = script(KILLS, tmp_path, str(cases), "7")
    assert len(found["lengths"]) > cases / 4  # most kills meet a part
    assert found["empty"] < cases / 10  # between a file's making and its first block there is next to no time
    assert found["files"] == [NAME]


STEPS = """
import json, os, signal, sys
from pathlib import Path
import graspfx as gx
import graspfx.loop.lock, graspfx.loop.hdf5
scene = gx.load("reference-1dof")
whole = gx.run(scene).rows.tobytes()
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
    assert seen[0] == [["recording.h5.part"], 400, True]
    assert seen[-1] == [["recording.h5"], 400, True]
    assert len(seen) >= 5
    assert all(count == 400 and complete for _, count, complete in seen)
    assert ["recording.h5.part", "recording.h5.tmp"] in [files for files, _, _ in seen]


FULL = """
import json, os, resource, sys
import graspfx as gx
from graspfx.__main__ import main
from graspfx.loop.places import NAME
command = sys.argv[1] == "command"
scene = gx.load("reference-1dof")
whole = gx.run(scene, duration=5.0).rows
seen = []
for limit in json.loads(sys.argv[2]):
    out, said = f"full-{limit}", f"said-{limit}"
    child = os.fork()
    if child == 0:
        report = os.open(said, os.O_WRONLY | os.O_CREAT)
        os.dup2(report, 2)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
        if command:
            sys.exit(main(["run", "reference-1dof", "--duration", "5", "--no-figure", "--out", out]))
        try:
            gx.run(scene, duration=5.0, out=out)
        except gx.errors.RecordingError as error:
            print(error, file=sys.stderr)
        sys.exit(4)  # by way of all that Python and HDF5 do at their end
    _, status = os.waitpid(child, 0)
    files = sorted(os.listdir(out)) if os.path.isdir(out) else []
    rows = gx.Recording.load(out).rows if files else whole[:0]
    assert rows.tobytes() == whole[: len(rows)].tobytes()
    text = open(said).read()
    seen.append({"status": status, "said": text, "rows": len(rows), "files": files})
print(json.dumps(seen))
"""


@POSIX
@pytest.mark.parametrize(("way", "code"), [("command", 2), ("python", 4)])
def test_a_disk_that_is_full_is_one_line_and_leaves_the_rows(way: str, code: int, tmp_path: Path) -> None:
    """A limit on the size of files is met as a full disk is; 1000 ticks of 136 bytes take 140 kB in a part."""
    limits = [1000, 20_000, 40_000, 100_000, 139_000] if way == "command" else [3000, 60_000, 120_000, 139_800]
    seen = script(FULL.replace("gx.errors", "__import__('graspfx.errors').errors"), tmp_path, way, json.dumps(limits))
    for limit, each in zip(limits, seen, strict=True):
        assert os.waitstatus_to_exitcode(each["status"]) == code, each
        assert each["said"].count("\n") == 1, each
        assert "cannot be written; File too large" in each["said"]
        blocks = max(0, limit - 4000) // (200 * 136 + 100)
        assert each["rows"] == 200 * blocks or (limit >= 139_000 and each["rows"] == 1000), each
        assert each["files"] == (["recording.h5.part"] if each["rows"] else []), each
    assert len({each["rows"] for each in seen}) > 3


ENOSPC = """
import errno, json, os
import numpy as np
from recordings import header, layout, rows
from graspfx.errors import RecordingError
from graspfx.loop.header import Outcome
from graspfx.loop.record import Recording
from graspfx.loop.sink import FileSink
from graspfx.loop.stream import Stream
made = layout(3, 2)
values = rows(made, 1100)
push = Stream._push
def full(self, data):
    global left
    left -= 1
    if left < 0:
        raise OSError(errno.ENOSPC, "No space left on device")
    push(self, data)
Stream._push = full
failures = 0
for step in [*range(20), *range(20, 1000, 3)]:
    left = step
    sink = FileSink("recording.h5", made, header())
    sink.write(values, [])
    try:
        sink.close(Outcome())
    except RecordingError as error:
        said = "recording.h5: cannot be written; No space left on device; the run is whole in recording.h5.part"
        assert str(error) == said, error
    else:
        break
    assert sorted(os.listdir()) == ["recording.h5.part"]
    if step % 10 == 0:
        rec = Recording.load("recording.h5.part")
        assert rec.rows.tobytes() == values.tobytes() and rec.outcome.complete
    os.unlink("recording.h5.part")
    failures += 1
print(json.dumps({"failures": failures, "rows": len(Recording.load("recording.h5"))}))
"""


def test_a_disk_that_is_full_at_the_end_leaves_the_part(tmp_path: Path) -> None:
    """Whichever of all writes of the HDF5 file fails: HDF5 does not come to know, and the process ends as it should."""
    found = script(ENOSPC, tmp_path)
    assert found["failures"] > 30
    assert found["rows"] == 1100


INTERRUPTS = """
import json, os, signal, sys
from recordings import header, layout, rows
from graspfx.loop.header import Outcome
from graspfx.loop.record import Recording
from graspfx.loop.sink import FileSink
from graspfx.loop.stream import Stream
signal.signal(signal.SIGINT, signal.default_int_handler)
made = layout(3, 2)
values = rows(made, 1100)
push = Stream._push
def interrupt(self, data):
    global left
    left -= 1
    if left == 0:
        os.kill(os.getpid(), signal.SIGINT)
    push(self, data)
Stream._push = interrupt
tally = []
for step in range(1, 40, 3):
    left = -1
    sink = FileSink("recording.h5", made, header(), overwrite=True)
    sink.write(values, [])
    left = step
    try:
        sink.close(Outcome())
    except KeyboardInterrupt:
        tally.append(sorted(os.listdir()))
    assert Recording.load("recording.h5").rows.tobytes() == values.tobytes()
    os.unlink("recording.h5")
print(json.dumps(tally))
"""


@POSIX
def test_ctrl_c_while_the_recording_is_written_waits_for_its_end(tmp_path: Path) -> None:
    """An exception within HDF5's writes would leave it as a failing write does."""
    seen = script(INTERRUPTS, tmp_path)
    assert len(seen) == 13
    assert seen == [["recording.h5"]] * 13


def test_a_text_that_hdf5_does_not_take_leaves_the_part(tmp_path: Path) -> None:
    sink = FileSink(tmp_path / NAME, made, header(title="nothing \0 here"))
    sink.write(values, [])
    said = r"recording\.h5: cannot be written; .*NULL.*; the run is whole in .*recording\.h5\.part"
    with pytest.raises(RecordingError, match=said):
        sink.close(Outcome())
    rec = Recording.load(tmp_path)
    assert len(rec) == 1500 and rec.outcome.complete
    with pytest.raises(RecordingError, match=r"again\.h5: cannot be written; .*NULL"):
        rec.save(tmp_path / "again.h5")
    assert [path.name for path in tmp_path.iterdir()] == ["recording.h5.part"]


def test_no_rows_follow_those_whose_write_broke_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A block that was lost must not be followed by the next one, as if no time had passed."""
    sink = write_part(tmp_path / NAME, 400)
    write = journals.Journal._append

    def break_off(self: journals.Journal, blocks: Any) -> None:
        write(self, blocks)
        raise MemoryError

    with monkeypatch.context() as once:
        once.setattr(journals.Journal, "_append", break_off)
        with pytest.raises(MemoryError):
            sink.write(values[400:600], [])
    with pytest.raises(RecordingError, match="could not be written; the 400 rows before that can be read there"):
        sink.write(values[600:700], [])
    sink.close(Outcome())
    rec = Recording.load(tmp_path)
    assert rec.rows.tobytes() == values[: len(rec)].tobytes()
    assert len(rec) >= 400 and not rec.outcome.complete


def test_what_stays_in_memory_after_a_failure_is_read_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    stream = Stream(tmp_path / "x")
    stream.write(b"0123456789")
    monkeypatch.setattr(Stream, "_push", full)
    stream.seek(8)
    stream.write(b"abcd")
    stream.seek(3)
    stream.write(b"XY")
    stream.seek(2)
    assert stream.read(20) == b"2XY567abcd"
    assert stream.seek(0, os.SEEK_END) == 12
    with pytest.raises(OSError, match="No space"):
        stream.finish()
    stream.close()


@POSIX
@pytest.mark.parametrize("way", ["removed", "moved", "replaced"])
def test_a_folder_that_goes_away_in_mid_run_is_said_at_once(way: str, tmp_path: Path) -> None:
    """The rows so far, which live as long as the file is open, are saved in the nearest folder that is there."""
    scene, asked = gx.load("reference-1dof", {"duration": 20.0}), 0
    whole = gx.run(scene).rows

    def stop() -> bool:
        nonlocal asked
        asked += 1
        if asked == 10:
            shutil.move(tmp_path / "runs", tmp_path / "moved")
            if way == "removed":
                shutil.rmtree(tmp_path / "moved")
            if way == "replaced":
                (tmp_path / "runs" / "a").mkdir(parents=True)
        return False

    with pytest.raises(RecordingError, match=r"runs/a: was removed or moved .* rows so far are in "):
        gx.run(scene, out=tmp_path / "runs" / "a", stop=stop)
    [saved] = [path for path in tmp_path.glob("**/recording.h5") if "moved" not in path.parts]
    assert saved.parent.name.startswith("a-")
    rec = Recording.load(saved)
    assert 0 < len(rec) < 4000 and not rec.outcome.complete
    assert rec.rows.tobytes() == whole[: len(rec)].tobytes()


@POSIX
def test_a_folder_that_goes_away_is_one_line_of_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write = FileSink.write

    def remove(self: FileSink, *arguments: Any) -> None:
        shutil.rmtree("out/reference-1dof")
        write(self, *arguments)

    monkeypatch.setattr(FileSink, "write", remove)
    assert main(["run", "reference-1dof", "--no-figure"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert len(Recording.load(said.rpartition(" are in ")[2].strip())) == 200


def test_the_disk_is_told_to_keep_the_rows_about_once_a_second(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock, syncs = 0.0, []
    monkeypatch.setattr(journals.time, "monotonic", lambda: clock)
    monkeypatch.setattr(journals.os, "fsync", lambda _: syncs.append(clock))
    monkeypatch.setattr(journals, "sync_folder", lambda _: None)
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
    gx.run(gx.load("reference-1dof"), duration=2.0, out="whole")
    rec = Recording.load("whole")
    Path("killed").mkdir()
    sink = FileSink("killed/recording.h5", rec.layout, rec.header)
    sink.write(rec.rows[:300], [])
    said = "note: killed/recording.h5.part is read, of a run that goes on or was killed: 1.5 s of it"
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
    said = "recording.h5.part beside it is of a later run, which goes on or was killed"
    assert capsys.readouterr().err == f"note: killed/recording.h5 is read; {said}\n"
    assert len(read("killed")[0]) == 400


@POSIX
def test_the_lock_of_a_process_that_was_killed_is_gone(tmp_path: Path) -> None:
    code = f"""
import sys, time
sys.path[:0] = [{str(ROOT)!r}, {str(ROOT / "tests")!r}]
from recordings import header, layout, rows
from graspfx.loop.sink import FileSink
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
    with pytest.raises(RecordingError, match="is there already, of a run that goes on or was killed"):
        FileSink(tmp_path / NAME, made, header())
    FileSink(tmp_path / NAME, made, header(), overwrite=True).close(Outcome())
    assert not part_of(tmp_path / NAME).exists()
