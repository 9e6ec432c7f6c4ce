"""Calls of one system alone stand behind one module each; on another one GraspFX runs, and says what it cannot.

Windows itself is not tried: a process of Linux is, from which everything is taken that Python has on Linux only.
"""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.support import elsewhere

ROOT = Path(__file__).parents[2]
CODE = sorted([*(ROOT / "graspfx").rglob("*.py"), *(ROOT / "devices").rglob("*.py")])
EMULATORS = "graspfx/testing/", "emulator.py"  # of boards behind pseudo-terminals, with processes that are killed
SEAMS = {
    "fcntl": {"graspfx/system/file_lock.py", "graspfx/system/terminal.py", "graspfx/serial_port.py",
              "devices/_inputs.py"},
    "termios": {"graspfx/system/terminal.py", "graspfx/serial_port.py"},
    "tty": {"graspfx/system/terminal.py", "graspfx/serial_port.py"},
    "pty": {"graspfx/system/terminal.py"},
    "msvcrt": {"graspfx/system/file_lock.py"},
    "resource": {"graspfx/system/scheduling.py"},
    "os.nice": {"graspfx/system/scheduling.py"},
    "os.geteuid": {"graspfx/system/scheduling.py"},
    "os.memfd_create": {"graspfx/system/shared_memory.py"},
    "os.pidfd_open": {"graspfx/system/process_end.py"},
    "os.kill": {"graspfx/system/process_end.py"},
    "os.uname": {"graspfx/recording/header.py"},
    "signal.pidfd_send_signal": {"graspfx/system/process_end.py"},
    "os.getuid": {"graspfx/compile/cache.py", "graspfx/system/shared_memory.py"},
    "os.preadv": {"graspfx/recording/rows.py"},
    "select.poll": {"graspfx/serial_port.py", "graspfx/assembly/process/guard.py"},
    "time.CLOCK_MONOTONIC": {"graspfx/loop/realtime/beat.py"},
    "time.clock_gettime": {"graspfx/loop/realtime/beat.py"},
    "os.O_NOCTTY": {"graspfx/serial_port.py"},
    "os.O_NONBLOCK": {"graspfx/serial_port.py", "devices/_inputs.py"},
    "os.O_CLOEXEC": {"graspfx/serial_port.py", "devices/_inputs.py"},
    "pass_fds": {"graspfx/system/child_process.py"},
    "process_group": {"graspfx/system/child_process.py"},
    "os.name": {"graspfx/system/c_library.py", "graspfx/system/child_process.py"},
}  # fmt: skip
PLATFORM = {  # who asks which system this is, and why
    "graspfx/system/c_library.py": "functions of Linux",
    "graspfx/system/file_lock.py": "which lock",
    "graspfx/system/terminal.py": "lines and keys that can be waited for",
    "graspfx/compile/cache.py": "where caches are",
    "graspfx/compile/emission.py": "names of C libraries",
    "graspfx/loop/realtime/lifecycle.py": "the loop of machine code alone",
    "graspfx/recording/header.py": "its description",
    "graspfx/recording/files.py": "an open file stays",
    "graspfx/machine/plugged.py": "where libraries are",
    "graspfx/machine/system_checks.py": "what `graspfx doctor` looks at",
    "devices/_device.py": "names of makers' libraries",
}
RUN = """
import contextlib, importlib, io, json, sys, traceback
from pathlib import Path
from tests.support import elsewhere
elsewhere.be_windows()
import graspfx
failures, root = {}, Path(graspfx.__file__).parent
for file in sorted(root.rglob("*.py")):
    name = ".".join(("graspfx", *file.relative_to(root).with_suffix("").parts)).removesuffix(".__init__")
    try:
        importlib.import_module(name)
    except Exception:
        failures[name] = traceback.format_exc()
codes, texts, folder = {}, {}, Path(sys.argv[1])
from graspfx.__main__ import main
for words in (
    ["run", "paper-waving", "--duration", "0.1", "--out", str(folder / "waving")],
    ["check", "paper-waving"],
    ["replay", str(folder / "waving" / "recording.h5")],
    ["plot", str(folder / "waving"), "--out", str(folder / "figures")],
    ["run", "reference-1dof", "--duration", "0.05", "--real-time", "--no-figure", "--out", str(folder / "timed")],
    ["list"],
    ["devices"],
    ["doctor"],
):
    shown = io.StringIO()
    with contextlib.redirect_stdout(shown), contextlib.redirect_stderr(shown):
        try:
            codes[f"{words[0]} {words[1]}" if words[0] == "run" else words[0]] = main(words)
        except Exception:
            failures[words[0]] = traceback.format_exc()
    texts[words[0]] = shown.getvalue()
refusals = {}
from graspfx import plugins, protocols
from graspfx.errors import GraspFXError
from graspfx.testing.wire import DiyWire
EventPort = importlib.import_module("graspfx.devices._inputs").EventPort
for name, attempt in {
    "port": lambda: protocols.SerialPort("COM3").open(),
    "mouse": lambda: EventPort("/dev/input/event0", grab=False).open(),
    "emulator": DiyWire,
}.items():
    try:
        attempt()
    except GraspFXError as error:
        refusals[name] = str(error)
    except Exception:
        failures[name] = traceback.format_exc()
from graspfx.system.file_lock import ProgramLock
lock = ProgramLock("a test of another system")
lock.take()
lock.release()
json.dump([failures, codes, texts["doctor"], refusals], sys.__stdout__)
"""


@pytest.fixture(scope="module")
def windows(tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    """Failures, codes of commands, the words of the doctor, and refusals."""
    folder = tmp_path_factory.mktemp("windows")
    done = subprocess.run(
        [sys.executable, "-c", RUN, str(folder)], capture_output=True, text=True, cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    answer: list[Any] = json.loads(done.stdout)
    return answer


def test_every_module_is_imported_and_nothing_breaks(windows: list[Any]) -> None:
    assert windows[0] == {}


def test_scenes_run_and_are_judged(windows: list[Any]) -> None:
    codes = {name: code for name, code in windows[1].items() if name != "doctor"}
    assert codes == dict.fromkeys(codes, 0) and len(codes) == 7


def test_the_doctor_says_what_is_not_looked_at(windows: list[Any]) -> None:
    assert "are checked on Linux only" in windows[2]


def test_hardware_is_refused_in_plain_text(windows: list[Any]) -> None:
    assert windows[3] == {
        "port": "COM3: serial ports are supported on Linux and macOS only",
        "mouse": "/dev/input/event0: input events are available on Linux only",
        "emulator": "a board on a serial line is emulated on Linux and macOS only",
    }


def uses(file: Path) -> Iterator[str]:
    """Name what a file imports, which attributes of the system's modules it reads, and how it starts processes."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        match node:
            case ast.Import():
                yield from (each.name for each in node.names)
            case ast.ImportFrom(module=str() as module):
                yield module
                yield from (f"{module}.{each.name}" for each in node.names)
            case ast.Attribute(value=ast.Name(id="os" | "signal" | "select" | "time" | "sys" as module), attr=name):
                yield f"{module}.{name}"
            case ast.keyword(arg="pass_fds" | "process_group" | "start_new_session" | "preexec_fn" as name):
                yield name


def test_what_is_one_systems_own_stands_behind_one_module_each() -> None:
    gone = {*elsewhere.POSIX, "msvcrt", "pass_fds", "process_group", "start_new_session", "preexec_fn", "os.name"}
    gone |= {f"os.{name}" for name in (*elsewhere.OF_OS, "kill")} | {f"signal.{name}" for name in elsewhere.OF_SIGNAL}
    gone |= {f"time.{name}" for name in elsewhere.OF_TIME} | {"select.poll", "select.epoll"}
    places, platform = defaultdict(set), set()
    for file in CODE:
        name = file.relative_to(ROOT).as_posix()
        for use in uses(file):
            if use in gone and not name.startswith(EMULATORS[0]) and not name.endswith(EMULATORS[1]):
                places[use].add(name)
            if use.startswith(("os.sched_", "os.SCHED_")):
                assert name == "graspfx/system/scheduling.py", f"{name}: {use}"
            if use == "sys.platform":
                platform.add(name)
    assert places == SEAMS
    assert platform == {*PLATFORM}


def test_no_two_files_have_names_that_differ_by_case_alone_and_none_is_a_device_of_windows() -> None:
    listed = subprocess.run(["git", "ls-files", "-z"], capture_output=True, text=True, cwd=ROOT)
    names = [name for name in listed.stdout.split("\0") if name]
    if listed.returncode or not names:
        pytest.skip("no checkout of git's")
    assert len({name.lower() for name in names}) == len(names)
    devices = {"con", "prn", "aux", "nul", *(f"{name}{k}" for name in ("com", "lpt") for k in range(1, 10))}
    for name in names:
        assert not {part.partition(".")[0].lower() for part in Path(name).parts} & devices, name
        assert not set(name) & set('<>:"|?*\\') and not name.endswith((" ", ".")), name
