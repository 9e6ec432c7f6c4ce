"""Scenes with boards on emulated wires, whose servo runs in a process of its own, and that process seen from here."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

import graspfx as gx
from graspfx.devices.haply_2diy.emulator import DiyWire
from graspfx.errors import DeviceError, InputError

PRESSED = (165.0, 15.0)  # links of a 2DIY whose handle is in its object [deg]
T = TypeVar("T")

HOME = [0.0, 0.036]  # of the handle [m]
PATIENT = 0.02  # period at which a board answers in time also on a busy machine [s]
BUSY = {"safety.watchdog": 30.0, "safety.hold": 300}  # a machine may be away where time is not tried
TRIES = 5
PRIORITY = 70  # of a board's thread
SMALL = 2e-3  # a torque that is there [N m]
BALL: dict[str, Any] = {
    "mass": 0.1, "viscosity": 0.8, "rotational_viscosity": 0.001, "shape": {"kind": "sphere", "radius": 0.02},
    "position": [0.0, 0.057], "free": [False] * 3,
}  # fmt: skip


def board() -> DiyWire:
    """Make a board whose thread comes before others where this system lets it, as a real one has its own processor."""
    wire = DiyWire()
    with suppress(OSError, AttributeError):
        os.sched_setscheduler(wire._thread.native_id or 0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    return wire


def boards_scene(wires: Sequence[DiyWire], period: float = 0.005, **changes: Any) -> gx.Scene:
    """Put a ball before the handle of each board, which has nine tenths of the period [s] to answer."""
    names = [f"ball{i}" for i in range(len(wires))]
    scene = gx.Scene(
        dimensions=2,
        period=period,
        duration=15.0,
        object=[{**BALL, "name": name} for name in names],
        coupling={"external": {"stiffness": 100.0}, "internal": {"stiffness": 70.0}, "absent": "follow"},
        finger=[
            {"device": {"name": "haply-2diy", "port": p.port, "timeout": 0.9 * period}, "start": HOME, "object": name}
            for p, name in zip(wires, names, strict=True)
        ],
    )  # fmt: skip
    return scene.replace(changes)


def settled(begin: Callable[[], T]) -> T:
    """Begin a run of boards, again where the machine was too busy for a board to answer before the run."""
    for _ in range(TRIES):
        try:
            return begin()
        except DeviceError as error:
            if "new sample in" not in str(error) and "did not answer" not in str(error):
                raise
    return begin()


def undisturbed(go: Callable[[int], T]) -> T:
    """Go through runs of boards, again where a run ended since the machine was too busy for its board to answer."""
    for k in range(TRIES):
        try:
            return go(k)
        except InputError as error:
            if "no new " not in str(error):
                raise
    return go(TRIES)


def servo_of(parent: int) -> int:
    """Find the servo's process that a process has begun; 0 if there is none."""
    for entry in Path("/proc").iterdir():
        with suppress(OSError, ValueError, IndexError):
            if int((entry / "stat").read_text().rpartition(")")[2].split()[1]) != parent:
                continue
            if b"graspfx.assembly.process.servo_child" in (entry / "cmdline").read_bytes():
                return int(entry.name)
    return 0


class Assault:
    """A `stop` for a run with boards: presses all handles into their balls, waits for forces, then strikes once.

    Args:
        wires: of the boards.
        strike: told the number of the servo's process.
        patience: from the strike on, until the run is stopped [s].
    """

    def __init__(self, wires: Sequence[DiyWire], strike: Callable[[int], object], patience: float = 1e9) -> None:
        self._wires, self._strike, self._patience = wires, strike, patience
        self._servo = 0
        self.time = 0.0  # of the strike [s]

    def __call__(self) -> bool:
        if self.time:
            return time.monotonic() > self.time + self._patience
        if not self._servo:
            self._servo = servo_of(os.getpid())
            for wire in self._wires:
                wire.place(np.array(PRESSED))
        elif all(np.abs(wire.torque).max() > SMALL for wire in self._wires):
            self.time = time.monotonic()
            self._strike(self._servo)
        return False

    def silence(self, wire: DiyWire) -> float:
        """Give the time from the strike to the first of the zeros that a board has kept to since [s]."""
        frames = list(wire.frames)
        last = max(i for i, (_, torques) in enumerate(frames) if any(torques))
        return frames[last + 1][0] - self.time
