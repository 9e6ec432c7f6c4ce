"""The graspfx command: what each command prints and writes, and what it exits with."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import warnings
from pathlib import Path
from types import SimpleNamespace

import pytest

import graspfx
import graspfx.errors
from graspfx.__main__ import main
from graspfx.assembly import run_scene as whole_run
from graspfx.commands.arguments import override
from tests.support.hardware import VirtualClock
from tests.support.waiting import finish

ROOT = Path(__file__).parents[2]

WORN = """
from math import nan
import numpy as np
from graspfx.loop.device import Features

class Worn:
    features = Features(fingers=1, dimensions=1)
    reads = 0
    def open(self, period): self.period = period
    def read(self):
        self.reads += 1
        position = 0.001 if self.reads <= 51 else nan
        return np.array([[position]]), np.zeros((1, 1)), self.reads * self.period
    def write(self, forces): pass
    def stop(self): pass
    def close(self): pass
    def __enter__(self): return self
    def __exit__(self, *exc): self.close()

def connect(): return Worn()
"""


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands write into the current folder: here one of their own."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("object.mass=0.2", ("object.mass", 0.2)),
        ("object.free=[true, false]", ("object.free", [True, False])),
        ("object.dynamics=bullet", ("object.dynamics", "bullet")),
        ('object.dynamics="bullet"', ("object.dynamics", "bullet")),
        ("object.shape={ kind = 'box', size = [1.0] }", ("object.shape", {"kind": "box", "size": [1.0]})),
        ("finger.0.device.port=a=b", ("finger.0.device.port", "a=b")),
        ("title=", ("title", "")),
    ],
)
def test_a_value_is_toml_else_a_string(text: str, expected: tuple[str, object]) -> None:
    assert override(text) == expected


@pytest.mark.parametrize("text", ["object.mass", "=3"])
def test_an_override_needs_a_key_and_a_value(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["run", "reference-1dof", "--set", text])
    assert "is not of the form KEY=VALUE" in capsys.readouterr().err


@pytest.mark.parametrize(
    "value", ["0.2\nobject.viscosity=0.1", "0.2\n[finger]", "[0.1,\n 0.2]\nperiod = 0.1", '"""a\nb"""\nx=1']
)
def test_an_override_is_one_value(value: str, capsys: pytest.CaptureFixture[str]) -> None:
    """What stands on a line of its own after the value was lost in silence."""
    with pytest.raises(SystemExit, match="2"):
        main(["check", "reference-1dof", "--set", f"object.mass={value}"])
    assert "object.mass: expected one value; give each KEY=VALUE as a separate argument" in capsys.readouterr().err


def test_a_value_of_several_lines_is_whole() -> None:
    assert override("object.free=[true,\n false]") == ("object.free", [True, False])
    assert override("title=two\nlines") == ("title", "two\nlines")
    assert override("object.mass=0.2\n# [kg]\n") == ("object.mass", 0.2)


@pytest.mark.skipif(sys.platform != "linux", reason="limits as Linux has them")
@pytest.mark.parametrize(
    ("limit", "flag", "megabytes"), [("RLIMIT_AS", "-v", 300), ("RLIMIT_DATA", "-d", 50)], ids=["space", "data"]
)
def test_too_little_memory_is_a_sentence(limit: str, flag: str, megabytes: int) -> None:
    """A library that does not load for want of memory was a traceback of that library's."""
    resource = pytest.importorskip("resource")

    def restrict() -> None:
        resource.setrlimit(getattr(resource, limit), (megabytes * 10**6, megabytes * 10**6))

    command = [sys.executable, "-m", "graspfx", "check", "reference-1dof"]
    alone = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, preexec_fn=restrict, env=alone, capture_output=True, text=True)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert f"limited to {megabytes} MB ({limit}, `ulimit {flag}`), which is not enough" in done.stderr


def test_a_run_writes_what_it_names(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "reference-1dof", "--duration", "0.1", "--out", "here"]) == 0
    printed = capsys.readouterr().out
    for name in ("here/recording.h5", "here/figure.png"):
        assert name in printed
        assert Path(name).stat().st_size > 1000
    assert graspfx.Recording.load(Path("here/recording.h5")).time.shape == (20,)


def test_an_unknown_scene_is_one_line_on_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "reference-1dfo"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "did you mean 'reference-1dof'" in printed.err
    assert "Traceback" not in printed.err


def test_check_shows_a_plan_with_reasons(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "reference-1dof", "-v"]) == 0
    lines = capsys.readouterr().out.splitlines()
    end = next(i for i, line in enumerate(lines) if line.split()[0] in ("runs", "skipped"))
    certificate, plan = lines[:end], lines[end:]
    assert {line.split()[0] for line in plan} == {"runs", "skipped"}
    assert any(line.startswith("  internal 70 N/m: limit ") for line in certificate)


def test_check_shows_every_fault_with_its_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (ROOT / "scenes" / "reference-1dof.toml").read_text()
    broken = text.replace("viscosity", "viscosty").replace("period = 0.005", "period = -1")
    Path("broken.toml").write_text(broken)
    assert main(["check", "broken.toml"]) == 2
    faults = capsys.readouterr().err.splitlines()
    at = 1 + next(row for row, line in enumerate(broken.splitlines()) if "viscosty" in line)
    assert any(f"broken.toml:{at}: object.viscosty" in fault and "'viscosity'" in fault for fault in faults)
    assert any("period" in fault for fault in faults)


def test_schema_is_a_json_schema(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema"]) == 0
    assert {"period", "object", "coupling", "finger"} <= json.loads(capsys.readouterr().out)["properties"].keys()


def test_a_reader_that_leaves_early_is_no_error() -> None:
    command = [sys.executable, "-m", "graspfx", "schema"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""


def test_plot_draws_one_recording_or_several_compared(capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("a", "b"):
        assert main(["run", "reference-1dof", "--duration", "0.1", "--no-figure", "--out", name]) == 0
    assert main(["plot", "a"]) == 0
    assert main(["plot", "a/recording.h5", "b/recording.h5", "--out", "both"]) == 0
    assert Path("a/figure.png").is_file()
    assert Path("both/comparison.png").is_file()
    assert "both/comparison.png" in capsys.readouterr().out
    assert main(["plot", "a", "b", "a", "--out", "three", "--format", "svg", "--width", "page"]) == 0
    assert 'width="518.4pt"' in Path("three/comparison.svg").read_text("utf-8")  # 7.2 inches
    table = capsys.readouterr().out
    assert "change" not in table and "peak force per finger" in table  # a change is of two
    with pytest.raises(SystemExit):
        main(["plot", "a", "--format", "gif"])


def test_a_recording_that_is_none_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    """A folder is the recording in it: that is what was looked for."""
    Path("notes.h5").write_text("not HDF5")
    assert main(["plot", "notes.h5"]) == 2
    assert "notes.h5" in capsys.readouterr().err
    Path("empty").mkdir()
    for words, place in (("plot missing.h5", "missing.h5"), ("plot empty", "empty/recording.h5"),
                         ("picture out/nowhere", "out/nowhere/recording.h5")):  # fmt: skip
        assert main(words.split()) == 2
        assert capsys.readouterr().err == f"{place}: the file does not exist\n"


def test_a_run_says_what_its_author_may_not_have_meant(capsys: pytest.CaptureFixture[str]) -> None:
    far = "finger.0.start=[-0.4]", "finger.0.hand.rest=[-0.4]", "coupling.internal.stiffness=9000.0"
    main(["run", "paper-spring", "--set", *far, "--duration", "0.3", "--no-figure"])
    before, after = capsys.readouterr().err.splitlines()
    assert "is unstable under kip = 9000 N/m" in before
    assert after.startswith("note: finger0 never touches object: smallest gap 3")  # it sets out 375 mm from the cube


def test_check_notes_what_may_not_be_meant(capsys: pytest.CaptureFixture[str]) -> None:
    changes = ["finger.0.hand.squeeze=3.0", "coupling.internal.stiffness=9000.0"]
    assert main(["check", "paper-spring", "--set", *changes]) == 0
    unit, settle = (line for line in capsys.readouterr().out.splitlines() if line.startswith("note: "))
    assert unit == "note: finger.0.hand.squeeze = 3 m: check the unit (3 mm would be 0.003)"
    assert settle.startswith("note: at a period of 5 ms finger0 is unstable under kip = 9000 N/m")


def test_a_run_with_a_fault_writes_its_files_and_exits_with_3(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A device whose reading becomes NaN after 10 samples: zero force from there on, and a fault that is said.

    It is hardware: without the wall's clock it is refused before anything is written.
    """
    monkeypatch.setattr(whole_run, "WallClock", VirtualClock)
    Path("worn.py").write_text(WORN)
    lines = (ROOT / "scenes" / "reference-1dof.toml").read_text().splitlines()
    without_hands = (line for line in lines if not line.startswith("hand"))
    scene = ['device = { name = "worn.py" }' if line.startswith("device") else line for line in without_hands]
    Path("worn.toml").write_text("\n".join(scene))
    assert main(["run", "worn.toml", "--duration", "0.1", "--no-figure"]) == 2
    assert "this scene has hardware, which needs real time" in capsys.readouterr().err
    assert not Path("out").exists()
    assert main(["run", "worn.toml", "--duration", "0.1", "--no-figure", "--real-time"]) == 3
    assert "tick 10" in capsys.readouterr().err
    recording = graspfx.Recording.load(Path("out/worn/recording.h5"))
    assert recording.time.size == 20
    assert not recording.finger_force[0].any()
    assert (recording.finger_force[1:10] != 0.0).all()
    assert (recording.finger_force[10:] == 0.0).all()


INTERRUPTED = """
import os, signal, sys, time, weakref
import graspfx.recording.sink as file
from graspfx.__main__ import main

class Sink(file.FileSink):
    count = rows = 0
    def write(self, *arguments):  # the third block: Ctrl-C comes while a weak reference is called back
        super().write(*arguments)
        Sink.count += 1
        Sink.rows += len(arguments[0])
        if Sink.count == 3:
            with open("written", "w") as count:
                count.write(str(Sink.rows))
            class Thing: pass
            thing = Thing()
            watched = weakref.ref(thing, lambda _: [interrupt() for _ in range({times})])
            del thing

def interrupt():
    os.kill(os.getpid(), signal.SIGINT)  # to the process, as from a terminal, not to this thread alone
    end = time.monotonic() + 30.0
    while signal.getsignal(signal.SIGINT) is not signal.SIG_DFL and time.monotonic() < end:
        time.sleep(0.01)  # until the main thread has heard it: two that wait are one
    time.sleep(0.1)  # while the run goes on, or waits for this block

file.FileSink = Sink
signal.signal(signal.SIGINT, signal.default_int_handler)  # whatever the shell that runs the tests has set
sys.exit(main(["run", "reference-1dof", "--duration", "100000", "--no-figure", "--out", "cut"]))
"""


def interrupted(times: int) -> tuple[int, str, int]:
    """Exit code and standard error of a run of 100 000 s that sends itself SIGINT, and the rows of its first blocks."""
    process = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED.format(times=times)], env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    _, said = finish(process)
    rows = int(Path("written").read_text())
    assert rows > 100
    return process.returncode, said.strip(), rows


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
def test_an_interrupted_run_says_how_far_it_came_and_leaves_a_readable_recording() -> None:
    """The run ends between two ticks, and all rows up to there are in the file."""
    code, said, written = interrupted(1)
    read = graspfx.Recording.load(Path("cut/recording.h5"))
    assert (code, said) == (130, f"interrupted after {read.end:g} of 100000 s; the recording is cut/recording.h5")
    assert len(read) >= written and not Path("cut/recording.h5.part").exists()
    assert (read.outcome.complete, read.wall_time) == (False, None)
    assert read.finger_force.shape == (len(read), 2, 1)
    assert read.rows.tobytes() == graspfx.run("reference-1dof", duration=len(read) * 0.005).rows.tobytes()


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
def test_a_second_interrupt_ends_the_process_and_what_was_written_can_be_read() -> None:
    code, _, written = interrupted(2)
    assert code == -signal.SIGINT
    assert len(graspfx.Recording.load(Path("cut"))) >= written


@pytest.mark.parametrize(("key", "value"), [("period", 1e-40), ("period", 1e-59), ("duration", 1e12)])
@pytest.mark.parametrize("out", [None, "here"])
def test_more_ticks_than_there_is_room_for(key: str, value: float, out: str | None) -> None:
    scene = graspfx.load("reference-1dof", {key: value})
    place = "this machine's memory" if out is None else "the disk of here"
    with pytest.raises(graspfx.errors.InputError, match=rf"{place} has room for .* GB.*shorter"):
        graspfx.run(scene, out=out)
    assert not Path("here").exists()


@pytest.mark.parametrize("compression", ["none", "gzip"])
def test_more_ticks_than_the_disk_has_room_for(compression: str, monkeypatch: pytest.MonkeyPatch) -> None:
    row, forces, time = 17 * 8, 2 * 2 * 8, 8  # 17 columns; internal and external force of two fingers on a line
    each = row + (row + forces + time)  # the recording is written beside the part
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(total=1, free=400 * each - 1))
    scene = graspfx.load("reference-1dof", {"record.compression": compression})
    rec = graspfx.run(scene)
    assert len(rec) == 400 and rec.rows.nbytes == 400 * row
    with pytest.raises(graspfx.errors.InputError, match=rf"given 400, .*a row takes {each} bytes.*disk of here"):
        graspfx.run(scene, out="here")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(total=1, free=400 * each))
    assert len(graspfx.run(scene, out="there")) == 400


@pytest.mark.parametrize("command", ["run", "plot"])
def test_an_out_that_cannot_be_made_is_one_line(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("file").write_text("")
    graspfx.run(graspfx.load("reference-1dof"), duration=0.05, out="done")
    given = "reference-1dof" if command == "run" else "done"
    places = {"file": "a file is in its way", "file/sub": "a file is in its way"}
    if sys.platform == "linux":
        places |= {"/proc/x": "No such file or directory", "/dev/full": "a file is in its way"}
    for place, why in places.items():
        assert main([command, given, "--out", place]) == 2
        assert capsys.readouterr().err == f"{place}: no folder can be made there; {why}\n"


def test_a_folder_where_the_picture_goes_is_said_before_the_run(capsys: pytest.CaptureFixture[str]) -> None:
    Path("here/figure.png").mkdir(parents=True)
    assert main(["run", "reference-1dof", "--out", "here"]) == 2
    assert capsys.readouterr().err.startswith("cannot write here/figure.png, because it is a folder")
    assert not Path("here/recording.h5").exists()
    assert main(["run", "reference-1dof", "--out", "here", "--no-figure", "--duration", "0.05"]) == 0
    assert main(["plot", "here"]) == 2


def test_a_picture_that_cannot_be_written_leaves_the_recording(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("graspfx.show.style.save", full)
    assert main(["run", "reference-1dof", "--out", "here", "--duration", "0.05"]) == 2
    said = "here/figure.png: cannot be written; No space left on device; the recording is in here/recording.h5\n"
    assert capsys.readouterr().err == said
    assert len(graspfx.Recording.load("here")) == 10


def test_the_summary_comes_before_matplotlib_is_loaded(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    before: list[str] = []
    monkeypatch.setattr("graspfx.commands.run.draw", lambda *_, **__: before.append(capsys.readouterr().out))
    assert main(["run", "reference-1dof", "--duration", "0.05", "--out", "here"]) == 0
    assert "wall time" in before[0] and before[0].endswith("wrote here/recording.h5\n")
    assert capsys.readouterr().out == "wrote here/figure.png\n"


def test_check_refuses_what_a_run_would(capsys: pytest.CaptureFixture[str]) -> None:
    text = (ROOT / "scenes" / "paper-waving.toml").read_text().replace("start = [-0.025,", "start = [-0.5,")
    Path("far.toml").write_text(text)
    line = 1 + next(row for row, each in enumerate(text.splitlines()) if "-0.5," in each)
    for command in ("check", "run"):
        assert main([command, "far.toml"]) == 2
        assert capsys.readouterr().err.startswith(f"far.toml:{line}: finger.0.start: finger at (-0.5000, 0.0000) m")
    assert not Path("out").exists()


def test_a_warning_is_one_line_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    Path("loud.py").write_text(
        "import warnings\nimport graspfx as gx\n"
        "def scene():\n"
        "    for _ in range(3):\n        warnings.warn('makes\\nenergy', stacklevel=1)\n"
        "    return gx.load('reference-1dof')\n"
    )
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert main(["check", "loud.py"]) == 0
    assert capsys.readouterr().err == "warning: makes energy\n"


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        main(["--version"])
    assert capsys.readouterr().out == f"graspfx {graspfx.__version__}\n"
