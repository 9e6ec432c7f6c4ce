"""Hardware that is none: a point mass whose sensors and motors are late by known times, on a virtual clock."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.device import Features
from tests.support.hardware import VirtualClock

FloatArray = NDArray[np.float64]

DRIVER = '''
"""Late masses, in the order in which they were connected."""
from tests.support.late_mass import LateMass

masses = []

def connect(**settings):
    masses.append(LateMass(**settings))
    return masses[-1]
'''


class LateMass:
    """One finger in the plane: m x'' + b x' = f, read through an encoder.

    Args:
        mass: m, in all directions [kg].
        friction: b [N s/m].
        step: of the encoder [m].
        transport: from the end of `write` to the force [s].
        age: of a sample at the end of `read` [s].
        reading, writing: what the two calls take [s].
        way: of its motors: -1 for wires that were changed over.
        stuck: whether it is held.

    Attributes:
        log: "open", "stop", "close", and forces, as they were told.
        push: of a person, (2,) [N].
    """

    def __init__(
        self,
        mass: float = 0.15,
        friction: float = 0.2,
        step: float = 1e-5,
        transport: float = 0.0007,
        age: float = 0.0002,
        reading: float = 0.0001,
        writing: float = 0.00005,
        way: float = 1.0,
        stuck: bool = False,
    ) -> None:
        self.mass, self.friction, self.step, self.way, self.stuck = mass, friction, step, way, stuck
        self.transport, self.age, self.reading, self.writing = transport, age, reading, writing
        self.features = Features(fingers=1, dimensions=2, peak_force=5.0, resolution=step)
        self.x, self.v, self.f = np.zeros(2), np.zeros(2), np.zeros(2)
        self.moved = 0.0
        self.coming: list[tuple[float, FloatArray]] = []
        self.push = np.zeros(2)
        self.log: list[Any] = []
        self._last = np.zeros(2)
        self._time = 0.0

    def open(self, period: float) -> None:
        self.log.append("open")
        self.moved = VirtualClock.time

    def read(self) -> Any:
        VirtualClock.time += self.reading
        self._move(VirtualClock.time - self.age)
        position = np.round(self.x / self.step) * self.step
        now = VirtualClock.time
        velocity = (position - self._last) / max(now - self._time, 1e-6) if self._time else np.zeros(2)
        self._last, self._time = position, now
        return position[None, :], np.clip(velocity, -0.05, 0.05)[None, :], now

    def write(self, forces: FloatArray) -> None:
        VirtualClock.time += self.writing
        self.log.append(np.array(forces))
        self.coming.append((VirtualClock.time + self.transport, self.way * np.array(forces[0])))

    def stop(self) -> None:
        self.log.append("stop")
        self.coming.append((VirtualClock.time, np.zeros(2)))

    def close(self) -> None:
        self.log.append("close")

    def __enter__(self) -> LateMass:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _move(self, until: float) -> None:
        while self.coming and self.coming[0][0] <= until:
            at, force = self.coming.pop(0)
            self._glide(at)
            self.f = force
        self._glide(until)

    def _glide(self, until: float) -> None:
        t = max(until - self.moved, 0.0)
        self.moved = max(until, self.moved)
        if self.stuck:
            return
        p = self.friction / self.mass
        slow = -math.expm1(-p * t) / p
        a = (self.f + self.push) / self.mass
        self.x = self.x + slow * self.v + (t - slow) / p * a
        self.v = self.v * math.exp(-p * t) + slow * a


def late_driver(folder: Path) -> Path:
    """Write the driver of late masses."""
    file = folder / "late.py"
    file.write_text(DRIVER)
    return file


def late_masses(file: Path) -> list[LateMass]:
    """List the masses that a driver has connected."""
    from graspfx import plugins

    devices: list[LateMass] = plugins.load("devices", str(file)).masses
    return devices
