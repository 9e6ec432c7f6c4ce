"""Full disks, folders that go away, Ctrl-C: one error, no rows lost, and a process that ends as it should."""

from __future__ import annotations

import errno
import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.__main__ import main
from graspfx.errors import RecordingError
from graspfx.recording import recorder as recorders
from graspfx.recording.file import Stream
from graspfx.recording.files import NAME
from graspfx.recording.header import Outcome
from graspfx.recording.part import PartWriter
from graspfx.recording.record import Recording
from graspfx.recording.sink import FileSink
from tests.support.families import efforts
from tests.support.parts import POSIX, made, script, values, write_part
from tests.support.recordings import header

FULL = """
import json, os, resource, sys
import graspfx as gx
from graspfx.__main__ import main
from graspfx.recording import recorder
from graspfx.recording.files import NAME
recorder.BLOCK = 200 * 136
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
        sys.dont_write_bytecode = True  # Python would cut short a module's bytecode, and read it ever after
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
@efforts(short=5, full=60, asked="faults")
@pytest.mark.parametrize(("way", "code"), [("command", 2), ("python", 4)])
def test_a_disk_that_is_full_is_one_line_and_leaves_the_rows(way: str, code: int, cases: int, tmp_path: Path) -> None:
    """A limit on the size of files is met as a full disk is; 1000 ticks take 148 kB in a part, and 180 kB in HDF5."""
    limits = [1000, *np.linspace(20_000, 165_000, cases - 1).astype(int).tolist()]
    seen = script(FULL.replace("gx.errors", "__import__('graspfx.errors').errors"), tmp_path, way, json.dumps(limits))
    for limit, each in zip(limits, seen, strict=True):
        assert os.waitstatus_to_exitcode(each["status"]) == code, each
        assert each["said"].count("\n") == 1, each
        assert "cannot be written; File too large" in each["said"]
        blocks = max(0, limit - 12_000) // (201 * 136)  # the header is within 12 kB
        assert 200 * blocks <= each["rows"] <= limit // 136, each
        assert each["rows"] % 200 in (0, 100, 50, 25, 12, 6, 3, 1), each  # as much of the last block as fits
        assert each["files"] == (["recording.h5.part"] if each["rows"] else []), each
    assert len({each["rows"] for each in seen}) >= 3


ENOSPC = """
import errno, json, os
import numpy as np
from tests.support.recordings import header, layout, rows
from graspfx.errors import RecordingError
from graspfx.recording.header import Outcome
from graspfx.recording.record import Recording
from graspfx.recording.sink import FileSink
from graspfx.recording.file import Stream
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
for step in [*range(10), *range(10, 1000, 7)]:
    left = step
    sink = FileSink("recording.h5", made, header())
    sink.write(values, [])
    try:
        sink.close(Outcome())
    except RecordingError as error:
        said = "recording.h5: cannot be written; No space left on device; the run is complete in recording.h5.part"
        assert str(error) == said, error
    else:
        break
    assert sorted(os.listdir()) == ["recording.h5.part"]
    if step % 3 == 0:
        rec = Recording.load("recording.h5.part")
        assert rec.rows.tobytes() == values.tobytes() and rec.outcome.complete
    os.unlink("recording.h5.part")
    failures += 1
print(json.dumps({"failures": failures, "rows": len(Recording.load("recording.h5"))}))
"""


def test_a_disk_that_is_full_at_the_end_leaves_the_part(tmp_path: Path) -> None:
    """Whichever of all writes of the HDF5 file fails: HDF5 does not come to know, and the process ends as it should."""
    found = script(ENOSPC, tmp_path)
    assert found["failures"] > 15
    assert found["rows"] == 1100


INTERRUPTS = """
import json, os, signal, sys
from tests.support.recordings import header, layout, rows
from graspfx.recording.header import Outcome
from graspfx.recording.record import Recording
from graspfx.recording.sink import FileSink
from graspfx.recording.file import Stream
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
for step in range(1, 40, 6):
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
    assert seen == [["recording.h5"]] * 7


def test_a_text_that_hdf5_does_not_take_leaves_the_part(tmp_path: Path) -> None:
    sink = FileSink(tmp_path / NAME, made, header(title="nothing \0 here"))
    sink.write(values, [])
    said = r"recording\.h5: cannot be written; .*NULL.*; the run is complete in .*recording\.h5\.part"
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
    write = PartWriter._put

    def break_off(self: PartWriter, parts: Any) -> None:
        write(self, parts)
        raise MemoryError

    with monkeypatch.context() as once:
        once.setattr(PartWriter, "_put", break_off)
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
def test_a_folder_that_goes_away_in_mid_run_is_said_at_once(
    way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The rows so far, which live as long as the file is open, are saved in the nearest folder that is there."""
    monkeypatch.setattr(recorders, "BLOCK", 200 * 136)
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
    assert len(Recording.load(said.rpartition(" are in ")[2].strip())) == 400
