"""A run in a process of its own, of a device that logs with times what it is told, on a disk that may hang."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from tests.support.waiting import finish, wait_until

ROOT = Path(__file__).parents[2]
LONG = 600.0  # of a driver that hangs: nobody waits for its end [s]

DEVICE = f'''
"""A finger 4 mm inside a cart, whose device logs the time and the size of each force."""
import ctypes, os, time
import numpy as np
from graspfx.assembly.process import orders
from graspfx.loop.device import Features

class Logged:
    def __init__(self, file, how):
        self.features = Features(fingers=1, dimensions=1, peak_force=1.0, watchdog=0.1)
        self.x, self.v, self.how, self.reads = np.full((1, 1), -0.021), np.zeros((1, 1)), how, 0
        self.file = file
        self.log = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    def note(self, what, size=0.0):
        os.write(self.log, f"{{time.monotonic()}} {{what}} {{size}}\\n".encode())
    def open(self, period):
        self.note("open")
        while self.how in ("hangs in open", "deaf in open"):
            try:
                time.sleep({LONG})
            except BaseException:
                if self.how == "hangs in open":
                    raise
        with open(self.file + ".pid", "w") as number:
            number.write(str(os.getpid()))
    def read(self):
        self.reads += 1
        if self.reads == 60 and self.how == "hangs":
            self.note("hang")
            time.sleep({LONG})
        if self.reads == 60 and self.how == "swallows":
            self.note("hang")
            try:
                time.sleep({LONG})
            except BaseException:
                pass
        if self.reads == 60 and self.how == "deaf":
            self.note("hang")
            while True:
                try:
                    time.sleep({LONG})
                except BaseException:
                    pass
        if self.reads == 60 and self.how == "crashes":
            self.note("crash")
            ctypes.string_at(0)
        if self.reads == 60 and self.how == "exits":
            raise SystemExit(0)
        if self.reads == 60 and self.how == "raises":
            self.note("raise")
            raise OSError("unplugged")
        return self.x, self.v, time.monotonic()
    def write(self, forces):
        self.note("force", abs(forces[0, 0]))
    def stop(self):
        self.note("stop")
        if self.how == "unstoppable":
            raise OSError("no answer")
    def close(self):
        self.note("close")
    def __enter__(self):
        return self
    def __exit__(self, *exc):
        self.close()

def connect(*, file, how=""):
    if how != "watched":  # a busy machine may be away for as long as it likes
        orders.SILENCE = 60 * 10**9
    return Logged(file, how)

def quench(*, file, how=""):
    Logged(file, how).note("quench")
'''

PROGRAM = """
import os, signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell ignores for what it starts beside itself
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # and this one under `nohup`
import graspfx.recording.recorder as recorders
import graspfx.recording.sink as sinks
from graspfx.__main__ import main

folder = sys.argv[1]
log = os.open(os.path.join(folder, "log"), os.O_WRONLY | os.O_CREAT | os.O_APPEND)

def wait_for_the_disk():
    while not os.path.exists(os.path.join(folder, "disk")):
        time.sleep(0.002)

class Sink(sinks.FileSink):
    def write(self, *arguments):
        wait_for_the_disk()
        super().write(*arguments)
    def close(self, outcome):
        os.write(log, f"{time.monotonic()} files 0\\n".encode())
        wait_for_the_disk()
        super().close(outcome)
        os.write(log, f"{time.monotonic()} whole 0\\n".encode())

recorders.SECOND, sinks.FileSink = 0.0, Sink
sys.exit(main(["run", os.path.join(folder, "cart.toml"), "--real-time", "--no-figure", *sys.argv[2:]]))
"""

SCENE = """
dimensions = 1
period = 0.02
duration = 60.0
engine = "interpreted"
safety = {{ watchdog = 30.0 }}  # a busy machine may be away for as long as it likes

[object]
mass = 0.1
viscosity = 0.8
shape = {{ kind = "box", size = [0.05] }}

[coupling]
external = {{ stiffness = 30.0 }}
internal = {{ stiffness = 70.0 }}
absent = "follow"
enter = "ramp"

[[finger]]
device = {{ name = "logged.py", file = {file!r}, how = {how!r} }}
start = [-0.025]

[[finger]]
device = {{ name = "simulated", mass = 0.15, damping = 0.2 }}
hand = {{ stiffness = 60.0, damping = 0.5 }}
start = [0.025]
"""


class Entry(NamedTuple):
    """A line of the log."""

    time: float
    what: str
    size: float


def write_logged(folder: Path, how: str) -> Path:
    """Write the driver and a scene with it; give the scene's path."""
    (folder / "logged.py").write_text(DEVICE)
    scene = folder / "cart.toml"
    scene.write_text(SCENE.format(file=str(folder / "log"), how=how))
    return scene


class LoggedRun:
    """A run in a process of its own.

    Args:
        folder: for its files.
        how: its device behaves; nothing for a sound one.
        hangs: whether the disk does, from the first row on, until `free_disk`.
        options: of `graspfx run`.
    """

    def __init__(self, folder: Path, how: str = "", *, hangs: bool = False, options: Sequence[str] = ()) -> None:
        self.folder, self.out = folder, folder / "out"
        write_logged(folder, how)
        if not hangs:
            self.free_disk()
        self.process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, str(folder), "--out", str(self.out), *options], cwd=ROOT,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": str(ROOT)},
        )  # fmt: skip

    def free_disk(self) -> None:
        """Let the disk go on."""
        (self.folder / "disk").touch()

    @property
    def log(self) -> list[Entry]:
        """Lines of the log so far."""
        file = self.folder / "log"
        lines = file.read_text().splitlines(keepends=True) if file.exists() else []
        words = [line.split() for line in lines if line.endswith("\n")]
        return [Entry(float(time), what, float(size)) for time, what, size in words]

    @property
    def servo(self) -> int:
        """Number of the process in which its device was opened."""
        return int((self.folder / "log.pid").read_text())

    def press(self, size: float = 0.03) -> None:
        """Wait until its finger feels a force [N]."""
        wait_until(lambda: any(each.size > size for each in self.log) or self._has_ended)
        assert not self._has_ended, self.end()

    @property
    def _has_ended(self) -> bool:
        return self.process.poll() is not None

    def await_entry(self, what: str) -> None:
        """Wait until it logs something."""
        wait_until(lambda: any(each.what == what for each in self.log))

    def signal(self, *numbers: int, pause: float = 0.005, to: int | None = None) -> float:
        """Send signals to the run, or to another process; return when the first was sent."""
        sent = time.monotonic()
        for number in numbers:
            os.kill(to or self.process.pid, number)
            time.sleep(pause)
        return sent

    def end(self) -> tuple[int, str]:
        """Wait for its end; give its exit code and its messages."""
        _, messages = finish(self.process, 120.0)
        return self.process.returncode, messages

    def time_to_zero(self, since: float) -> float:
        """Measure how long the last force is there after a time [s]; all that comes after it is zero."""
        after = [each for each in self.log if each.time >= since and each.what in ("force", "stop")]
        last = max((i for i, each in enumerate(after) if each.size > 0.0), default=-1)
        return after[last + 1].time - since

    def __enter__(self) -> LoggedRun:
        return self

    def __exit__(self, *exc: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
            with suppress(OSError, ValueError):  # there may be none
                os.kill(self.servo, signal.SIGKILL)  # a deaf one has its pipes
            self.process.communicate()
