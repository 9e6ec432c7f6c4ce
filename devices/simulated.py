"""Simulated point devices: masses with friction, read through encoders, with output delay and force limit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.devices._points import PointPlant
from graspfx.errors import DeviceError, InputError
from graspfx.loop.device import Device, Features
from graspfx.loop.velocity import WINDOW, VelocityEstimator
from graspfx.numeric import LARGEST, SMALLEST, finite

FloatArray = NDArray[np.float64]

MOST = 1_000_000  # fingers, or samples of delay


def connect(
    *,
    mass: float,
    dimensions: int,
    friction: float = 0.0,
    fingers: int = 1,
    resolution: float = 0.0,
    velocity_window: int = WINDOW,
    delay: int = 0,
    force_limit: float | None = None,
    workspace: tuple[ArrayLike, ArrayLike] | None = None,
) -> PointDevice:
    """A device whose fingertips are point masses, m x'' + b x' = force + hand's force, on every axis.

    Args:
        mass: m of each fingertip [kg].
        dimensions: d.
        friction: b [N s/m].
        fingers: k, the channels of this one device.
        resolution: of its encoders [m]: positions are read to the nearest multiple of it; 0 reads them as they are.
        velocity_window: the longest window of the velocity estimate [samples] (`graspfx.loop.velocity`).
        delay: samples between a write and its force; with 0 it acts over the coming sample.
        force_limit: largest force at a fingertip [N]; longer ones are shortened.
        workspace: lower and upper corner (d,) [m]; a finger outside it is a DeviceError.
    """
    return PointDevice(
        mass=_number("mass", mass, "a finite mass above zero [kg]", zero=False),
        friction=_number("friction", friction, "a finite friction of zero or more [N s/m]"),
        fingers=_count("fingers", fingers, 1),
        dimensions=_count("dimensions", dimensions, 1, 3),
        resolution=_number("resolution", resolution, "a finite length of zero or more [m]"),
        velocity_window=_count("velocity_window", velocity_window, 1),
        delay=_count("delay", delay, 0),
        force_limit=None
        if force_limit is None
        else _number("force_limit", force_limit, "a finite force above zero [N], or none", zero=False),
        workspace=None if workspace is None else _corners(workspace, dimensions),
    )


class PointDevice:
    """A device of `connect`: its plant moves it, and it reads the plant through its sensors."""

    def __init__(
        self,
        *,
        mass: float,
        friction: float,
        fingers: int,
        dimensions: int,
        resolution: float,
        velocity_window: int,
        delay: int,
        force_limit: float | None,
        workspace: tuple[FloatArray, FloatArray] | None,
    ) -> None:
        self.mass, self.friction, self.resolution = mass, friction, resolution
        self._window, self._limit, self._workspace = velocity_window, force_limit, workspace
        self._shape = fingers, dimensions
        self._features = Features(
            fingers=fingers,
            dimensions=dimensions,
            workspace=workspace,
            peak_force=force_limit,
            mass=mass,
            friction=friction,
            resolution=resolution or None,
            delay=delay,
        )
        self._plant: PointPlant | None = None
        self._true: FloatArray = np.zeros(self._shape)
        self._position: FloatArray = np.zeros(self._shape)
        self._velocity: FloatArray = np.zeros(self._shape)
        self._estimator: VelocityEstimator | None = None  # while the device is open
        self._seen = (-1, 0.0)  # placement and time of the plant when it was read last
        self._line: FloatArray = np.zeros((delay + 1, *self._shape))
        self._slot = 0
        self._effort: FloatArray = np.zeros(self._shape)

    @property
    def features(self) -> Features:
        return self._features

    @property
    def effort(self) -> FloatArray:
        """The force (k, d) [N] that acts on the fingertips until the next write; not to be written to."""
        return self._effort

    @staticmethod
    def plant(devices: Sequence[Device]) -> PointPlant:
        """The plant that moves all fingertips of these devices, in their order, and which they read from now on."""
        points = [device for device in devices if isinstance(device, PointDevice)]
        if not points or len(points) < len(devices):
            raise InputError(
                "devices", [type(device).__name__ for device in devices], "one or more `simulated` devices"
            )
        dimensions = {device.features.dimensions for device in points}
        if len(dimensions) > 1:
            raise InputError("devices", sorted(dimensions), "devices of the same number of dimensions")
        each = [device for device in points for _ in range(device.features.fingers)]
        plant = PointPlant([device.mass for device in each], [device.friction for device in each], dimensions.pop())
        start = 0
        for device in points:
            stop = start + device.features.fingers
            device._plant, device._true, device._seen = plant, plant.position[start:stop], (-1, 0.0)
            start = stop
        return plant

    def open(self, period: float) -> None:
        noise = 0.5 * self.resolution
        self._estimator = VelocityEstimator(period, self._shape, noise, self._window if noise else 1)
        self._seen = (-1, 0.0)
        self.stop()

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        """Positions (k, d) [m], velocities (k, d) [m/s], time [s]; within one tick of the plant always the same."""
        estimator, plant = self._opened(), self._plant
        if plant is None:
            raise DeviceError("nothing moves this simulated device; make its plant with PointDevice.plant([device])")
        now = plant.placed, plant.time
        if now != self._seen:
            if now[0] != self._seen[0]:
                estimator.reset()
            self._seen = now
            if self.resolution:
                np.rint(self._true / self.resolution, out=self._position)
                self._position *= self.resolution
            else:
                self._position[...] = self._true
            self._velocity = estimator.update(self._position)
        self._check()
        return self._position, self._velocity, plant.time

    def write(self, forces: FloatArray) -> None:
        """Hold forces (k, d) [N] on the fingertips `delay` samples from now, shortened to the force limit.

        Any that is not finite stops the device (no force on any finger, nothing left in the delay) and raises
        DeviceError.
        """
        self._opened()
        if np.shape(forces) != self._shape:
            raise InputError("forces", forces, f"an array of shape {self._shape}")
        line = self._line
        held = line[self._slot]
        held[...] = forces
        for i, row in enumerate(held.tolist()):
            size = math.hypot(*row)
            if not math.isfinite(size):
                self.stop()
                raise DeviceError(
                    f"the force on finger {i} of a simulated device is {_point(row)} N; zero is displayed"
                )
            if self._limit is not None and size > self._limit:
                held[i] *= self._limit / size
        self._slot = (self._slot + 1) % len(line)
        self._effort[...] = line[self._slot]

    def stop(self) -> None:
        self._line[...] = 0.0
        self._effort[...] = 0.0

    def close(self) -> None:
        self.stop()
        self._estimator = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _opened(self) -> VelocityEstimator:
        if self._estimator is None:
            raise DeviceError("this simulated device is not open; call open(period) first")
        return self._estimator

    def _check(self) -> None:
        for i, p in enumerate(self._position.tolist()):
            if not all(map(math.isfinite, p)):
                raise DeviceError(f"finger {i} of a simulated device is at {_point(p)} m; its motion has diverged")
            if self._workspace is not None:
                lower, upper = self._workspace[0].tolist(), self._workspace[1].tolist()
                if not all(low <= x <= high for low, x, high in zip(lower, p, upper, strict=True)):
                    raise DeviceError(
                        f"finger {i} of a simulated device is at {_point(p)} m, outside its workspace from "
                        f"{_point(lower)} to {_point(upper)} m; widen `workspace`, or start or move the finger nearer "
                        "to its middle"
                    )


def _point(components: Sequence[float]) -> str:
    return "(" + ", ".join(f"{x:.6g}" for x in components) + ")"


def _number(name: str, value: float, expected: str, *, zero: bool = True) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise InputError(name, value, expected)
    if not (0.0 if zero else SMALLEST) <= value <= LARGEST:
        raise InputError(name, value, expected)
    return float(value)


def _count(name: str, value: int, least: int, most: int = MOST) -> int:
    limits = f"a whole number, {least} or more, at most {most}"
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise InputError(name, value, limits)
    if not least <= value <= most:
        raise InputError(name, value, limits)
    return int(value)


def _corners(workspace: tuple[ArrayLike, ArrayLike], d: int) -> tuple[FloatArray, FloatArray]:
    expected = f"a lower and a higher corner, {d} finite components each [m]"
    corners = finite("workspace", workspace, expected)
    if corners.shape != (2, d) or not (corners[0] < corners[1]).all():
        raise InputError("workspace", workspace, expected)
    corners.flags.writeable = False
    return corners[0], corners[1]
