"""Runs of scripted devices in Python's loop and in the one without Python, on the same input."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import graspfx as gx
from graspfx.assembly.build import build
from graspfx.compile.kernel import source_function
from graspfx.loop.realtime.beat import Reach, beat
from graspfx.loop.realtime.native_loop import NativeLoop
from graspfx.loop.realtime.pacing import FREE, Pacer
from graspfx.loop.servo import Servo
from graspfx.recording.header import Header
from graspfx.recording.record import Recording
from graspfx.recording.recorder import Recorder
from tests.support.hardware import VirtualClock
from tests.support.scripted_devices import DRIVER

FloatArray = NDArray[np.float64]

PERIOD = 0.002
HALF = 0.025  # of the box between two fingers [m]


def driver(folder: Path) -> Path:
    """Write a driver of scripted devices."""
    file = folder / "scripted_driver.py"
    file.write_text(DRIVER)
    return file


def squeeze(ticks: int, side: float, dimensions: int = 1) -> FloatArray:
    """Positions and velocities of a finger that comes to a box from one side and goes in by 3 mm, (ticks, 2, 1, d)."""
    t = PERIOD * np.arange(ticks)
    way = 0.008 * np.sin(0.5 * np.pi * np.minimum(t / 0.3, 1.0))
    readings = np.zeros((ticks, 2, 1, dimensions))
    readings[:, 0, 0, 0] = side * (HALF + 0.005 - way)
    readings[:, 1, 0, 0] = np.gradient(readings[:, 0, 0, 0], PERIOD)
    if dimensions > 1:
        readings[:, 0, 0, 1] = 1e-3 * np.sin(40.0 * t + side)
        readings[:, 1, 0, 1] = np.gradient(readings[:, 0, 0, 1], PERIOD)
    readings[0, 1] = 0.0
    return readings


def scene(file: Path, ticks: int, *, native: bool, dimensions: int = 1, **changes: Any) -> gx.Scene:
    """Put a box between two scripted fingers.

    Args:
        file: of the driver.
        ticks: of the script.
        native: whether the devices offer C functions.
        dimensions: d.
        changes: `rest` of both devices, settings of the first one, as `codes`; or of the scene by dotted key.
    """
    rest = changes.pop("rest", 0)
    own: dict[str, Any] = {key: changes.pop(key) for key in ("codes", "refusals", "peak") if key in changes}
    fingers = []
    for i, side in enumerate((-1.0, 1.0)):
        readings = squeeze(ticks, side, dimensions)
        device: dict[str, Any] = {"name": str(file), "native": native, "readings": readings.tolist(), "rest": rest}
        if i == 0:
            device |= own
        fingers.append({"start": readings[0, 0, 0].tolist(), "device": device})
    coupling: dict[str, Any] = {
        "external": {"stiffness": 30.0, "damping": 0.3},
        "internal": {"stiffness": 70.0, "damping": 0.2},
    }
    thing: dict[str, Any] = {"mass": 0.1, "viscosity": 0.8, "shape": {"kind": "box", "size": [2 * HALF] * dimensions}}
    if dimensions > 1:
        thing |= {"free": [True] * dimensions + [False] * (1 if dimensions == 2 else 3)}
        coupling["friction"] = 0.6
    whole = {"dimensions": dimensions, "period": PERIOD, "duration": ticks * PERIOD, "object": thing}
    made = gx.Scene(**whole, coupling=coupling, finger=fingers)
    return made.replace(changes) if changes else made


class Session:
    """A scene's servo with its devices open, which runs as often as it is told.

    Args:
        scene: of scripted devices.
        selected: Whether rows contain only what the scene's `record` selects.
    """

    def __init__(self, scene: gx.Scene, *, selected: bool = False) -> None:
        self._stack = ExitStack()
        self.servo: Servo = self._stack.enter_context(build(scene, real_time=True, selected=selected))
        self.devices = self.servo.prepare()
        for each in self.devices.ports:
            assert not each.open(scene.period)
        self.stations: list[Any] = [each.device for each in self.servo.stations]
        self.recorder = Recorder(self.servo.layout, Header(scene.period, every=self.servo.every), real_time=True)
        self._stack.enter_context(self.recorder)
        self.pacer = Pacer(scene.period, VirtualClock())

    @property
    def native(self) -> NativeLoop:
        """The loop without Python."""
        assert self.servo.native is not None
        return self.servo.native

    def run(self, ticks: int) -> None:
        """Run ticks: in Python on a clock without a wall, or in machine code at once."""
        servo, native = self.servo, self.servo.native
        if native is None:
            servo.run(ticks, self.recorder, None, self.pacer)
            return

        vars(native)["run"] = partial(NativeLoop.run, native, mode=FREE)
        servo._run_native(native, ticks, self.recorder, None, self.pacer)

    def interpret(self) -> None:
        """Let the loop without Python run its source in Python from now on."""
        native: Any = self.native

        def run(place: int) -> int:
            native._code.write_to(native._running.rows)
            memory = native._arena.memory
            own = [native.beat.buffer, native.words, native._running.words, native._pacer.buffer, native._end.buffer]
            own += [each.readings.memory for each in self.devices.ports]
            arrays = [np.asarray(each).view(np.float64) for each in [*native._arena.arrays, *own]]
            function: Callable[..., int] = source_function(beat)
            return function(Reach(memory, arrays, native._code.run), place)

        native._bound = SimpleNamespace(long=run)

    def finish(self) -> Recording:
        """End the run; give its recording."""
        recording = self.recorder.finish(1.0, complete=True, engine="")
        self._stack.close()
        return recording


def both(
    file: Path, ticks: int, spoil: tuple[int, Any] | None = None, **changes: Any
) -> tuple[Session, Recording, Session, Recording]:  # fmt: skip
    """Run a script in Python's loop and in the one without Python; give sessions and recordings.

    Args:
        file: of the driver.
        ticks: of the script, and to run.
        spoil: a reading of the first device, and the numbers in its place.
        changes: as of `scene`.
    """
    results: list[Any] = []
    for native in (False, True):
        session = Session(scene(file, ticks, native=native, **changes))
        if spoil is not None:
            session.stations[0].numbers[spoil[0]] = spoil[1]
        assert (session.servo.native is not None) is native
        session.run(ticks)
        results += [session, session.finish()]
    return tuple(results)


COLUMNS = "finger_position", "finger_velocity", "finger_force", "displayed_force", "fresh"
