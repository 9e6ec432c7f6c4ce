"""Time from a fault to zero force, measured: `python -m tests.support.fault_latency` prints a table.

A scene with one device runs with `gx.run(real_time=True)`, in Python's loop and in the one of machine code. The device
is a C library: it presses a finger into a ball, does what it should not, and notes when, and when its force was first
zero afterwards, on the clock that all processes share.
"""

from __future__ import annotations

import argparse
import ctypes
import mmap
import subprocess
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import graspfx as gx
from graspfx.errors import DeviceError
from graspfx.loop.device import Calls, Features
from graspfx.testing.wire import compiler

FAULTS = ("fails", "not finite", "far away", "hangs", "killed")
LOOPS = {"python": "process", "native": "native"}  # as a recording's header says it
PERIOD, DURATION = 0.002, 1.2  # [s]: the fault comes after some 0.7 s
# The device's notes are three numbers: when the fault came, when the force was zero [s], and the force before [N].
MARKS = (
    "-DPRESSED=200",
    "-DAT=300",
)  # readings after the first force is written: when it has pressed in, and the fault
SOURCE = """
#include <math.h>
#include <signal.h>
#include <stdint.h>
#include <time.h>
#include <unistd.h>
typedef struct { int64_t fault, readings, armed; double *notes; } Context;
static double now(void) { struct timespec t; clock_gettime(CLOCK_MONOTONIC, &t); return t.tv_sec + 1e-9 * t.tv_nsec; }
static void silent(Context *c) { if (c->notes[0] > 0.0 && c->notes[1] == 0.0) c->notes[1] = now(); }
int64_t read_(Context *c, double *block) {
  int64_t n = c->armed ? ++c->readings : 0;
  double in = n > PRESSED ? 1.0 : n / (double)PRESSED;
  for (int i = 0; i < 6; i++) block[i] = 0.0;
  block[0] = 0.031 - 0.004 * in * in * (3.0 - 2.0 * in);
  if (n < AT || c->notes[0] > 0.0 || c->notes[2] == 0.0) return 0;
  c->notes[0] = now();
  switch (c->fault) {
    case 0: return -5;
    case 1: block[0] = NAN; return 0;
    case 2: block[0] = 10.0; return 0;
    case 3: for (;;) sleep(1);
    default: kill(getpid(), SIGKILL); for (;;) pause();
  }
}
int64_t write_(Context *c, double *block) {
  c->armed = 1;
  double size = fabs(block[0]) + fabs(block[1]) + fabs(block[2]);
  if (size == 0.0) silent(c); else if (c->notes[0] == 0.0) c->notes[2] = size;
  return 0;
}
int64_t stop_(Context *c, double *block) { silent(c); return 0; }
"""
DRIVER = '''
"""A device that does what it should not."""
from tests.support.fault_latency import connect, quench
'''


class _Context(ctypes.Structure):
    _fields_ = (
        ("fault", ctypes.c_int64), ("readings", ctypes.c_int64), ("armed", ctypes.c_int64), ("notes", ctypes.c_void_p)
    )  # fmt: skip


class Faulty:
    """The device, by C functions; for Python's loop its methods call them.

    Args:
        folder: with the library and the notes.
        fault: number in `FAULTS`.
    """

    def __init__(self, folder: str, fault: int) -> None:
        self.features = Features(fingers=1, dimensions=3, peak_force=5.0)
        self._library = ctypes.CDLL(str(Path(folder, "device.so")))
        self._notes = notes(Path(folder))
        self._context = _Context(fault, 0, 0, self._notes.ctypes.data)
        self._block = np.zeros((2, 1, 3))
        self._open = False

    def open(self, period: float) -> None:
        self._open = True

    def read(self) -> tuple[Any, Any, float]:
        if self._call("read_", self._block) < 0:
            raise DeviceError("the cable is out")
        return self._block[0], self._block[1], time.monotonic()

    def write(self, forces: Any) -> None:
        self._call("write_", np.ascontiguousarray(forces, dtype=float))

    def stop(self) -> None:
        self._call("stop_", self._block)

    def close(self) -> None:
        self.stop()

    def _call(self, name: str, block: Any) -> int:
        function = getattr(self._library, name)
        return int(function(ctypes.byref(self._context), ctypes.c_void_p(block.ctypes.data)))

    def __enter__(self) -> Faulty:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


class FaultyCalls(Faulty):
    """The device with its functions for the loop of machine code."""

    @property
    def calls(self) -> Calls | None:
        if not self._open:
            return None
        read, write, stop = (
            ctypes.cast(getattr(self._library, name), ctypes.c_void_p).value or 0
            for name in ("read_", "write_", "stop_")
        )
        return Calls(0, read, write, stop, ctypes.addressof(self._context), self)


def connect(native: bool, **settings: Any) -> Faulty:
    """Connect the device."""
    return (FaultyCalls if native else Faulty)(**settings)


def quench(**settings: Any) -> None:
    """Take the force away in another process than the one that had the device."""
    connect(**settings).stop()


def notes(folder: Path) -> Any:
    """Share the notes of a device with whoever has them."""
    with Path(folder, "notes").open("r+b") as file:
        return np.frombuffer(mmap.mmap(file.fileno(), 0), dtype=float)


def latency(loop: str, fault: str) -> tuple[float, str]:
    """Run until a fault; give the time from it to zero force [s] and how the run tells of it.

    The time is NaN where something else, as a tick that was late, ended the run before.
    """
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "device.c").write_text(SOURCE)
        (folder / "notes").write_bytes(bytes(8 * 3))
        (folder / "driver.py").write_text(DRIVER)
        words = [
            str(compiler()),
            "-O2",
            *MARKS,
            "-shared",
            "-fPIC",
            "-o",
            str(folder / "device.so"),
            str(folder / "device.c"),
        ]
        subprocess.run([*words, "-lm"], check=True)
        settings = {"folder": name, "fault": FAULTS.index(fault), "native": loop == "native"}
        finger = {"start": [0.031, 0.0, 0.0], "device": {"name": str(folder / "driver.py"), **settings}}
        ball = {
            "mass": 0.1, "viscosity": 0.8, "rotational_viscosity": 2e-4, "shape": {"kind": "sphere", "radius": 0.03},
            "free": [False] * 6,
        }  # fmt: skip
        coupling = {"external": {"stiffness": 100.0, "damping": 0.2}, "internal": {"stiffness": 200.0}}
        scene = gx.Scene(
            dimensions=3, period=PERIOD, duration=DURATION, object=ball, coupling={**coupling, "absent": "follow"},
            finger=[finger],
        )  # fmt: skip
        run = gx.run(scene, real_time=True, out=folder / "out")
        told = run.faults[0].message if run.faults else "no fault"
        if run.header.scheduling["loop"] != LOOPS[loop]:
            raise RuntimeError(f"the loop was {run.header.scheduling['loop']}, not {loop}: {told}")
        began, ended, force = notes(folder)
        if not began:
            return float("nan"), told
        if not ended > began or not force > 0.0:
            raise RuntimeError(f"{loop}, {fault}: the force of {force} N was not taken away: {told}")
        return float(ended - began), told


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100, help="faults of a kind in a loop")
    parser.add_argument("--fault", action="append", choices=FAULTS, help="kinds (default: all)")
    options = parser.parse_args()
    print(f"{'loop':<8} {'fault':<12} {'count':>5} {'p50 [ms]':>10} {'max [ms]':>10}  ended before")
    for loop in LOOPS:
        for fault in options.fault or FAULTS:
            times = np.array([latency(loop, fault)[0] for _ in range(options.count)])
            seen = 1e3 * times[np.isfinite(times)]
            figures = f"{np.median(seen):>10.4f} {seen.max():>10.4f}" if len(seen) else f"{'-':>10} {'-':>10}"
            print(f"{loop:<8} {fault:<12} {len(seen):>5} {figures}  {len(times) - len(seen)}", flush=True)
