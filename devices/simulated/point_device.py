"""The device of point masses: their sensors and actuators, sample by sample."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from graspfx.devices.simulated import point_sample as sample
from graspfx.devices.simulated.operated_points import OperatedPlant, room_for
from graspfx.devices.simulated.point_sample import PointDeviceState
from graspfx.devices.simulated.points import PointPlant
from graspfx.protocols import (
    Device,
    DeviceError,
    DevicePorts,
    Features,
    InputError,
    Operator,
    VelocityEstimate,
    VelocityEstimator,
    estimate_size,
    size_for,
    start_of,
    zeros,
)

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]


class PointDevice:
    """A device of `connect`: its plant moves it, and it reads the plant through its sensors.

    What is done each sample are the kernels `reading` and `writing`, on the block `state`.
    """

    declaration = PointDeviceState
    reading = staticmethod(sample.read)
    writing = staticmethod(sample.write)
    stopping = staticmethod(sample.stop)

    def __init__(
        self,
        *,
        mass: float,
        damping: float,
        fingers: int,
        dimensions: int,
        resolution: float,
        velocity_window: int,
        delay: int,
        force_limit: float | None,
        workspace: tuple[FloatArray, FloatArray] | None,
    ) -> None:
        self.mass, self.damping, self.resolution = mass, damping, resolution
        self._window = velocity_window if resolution else 1
        k, d = self._shape = fingers, dimensions
        entries, each = k * d, estimate_size(self._window)
        self.state: FloatArray = zeros(
            size_for(PointDeviceState, fingers=k, dimensions=d, delay=delay, estimate_size=each)
        )
        self._entries: Any = self.state.data  # plain floats, where items of an array cost twice as much
        block = PointDeviceState(self.state)
        block.fingers, block.dimensions, block.delay, block.estimate_size = k, d, delay, each
        block.rounded, block.bounded, block.limited = resolution > 0.0, workspace is not None, force_limit is not None
        block.resolution, block.limit = resolution, force_limit or 0.0
        self._corners = self.state[block.low.offset : block.sensed.offset].reshape(2, d)
        if workspace is not None:
            self._corners[...] = workspace
        self._estimates = block.estimates
        lengths = [start_of(VelocityEstimate, "length") + estimate.offset for estimate in block.estimates]
        self.structure: Index = np.array([*sample.STRUCTURE, *lengths])
        self.ports = DevicePorts(
            sensed=block.sensed.offset,
            position=block.position.offset,
            velocity=block.velocity.offset,
            command=block.command.offset,
            effort=block.effort.offset,
        )
        self.sensed: Index = np.zeros(0, dtype=np.intp)
        arrays = [self.state[at : at + entries].reshape(self._shape) for at in self.ports]
        self._sensed, self._position, self._velocity, self._command, self._effort = arrays
        self._features = Features(
            fingers=fingers,
            dimensions=dimensions,
            workspace=workspace,
            peak_force=force_limit,
            mass=mass,
            friction=damping,
            resolution=resolution or None,
            delay=delay,
        )
        self._plant: PointPlant | OperatedPlant | None = None
        self._true: FloatArray = np.zeros(self._shape)
        self._estimator: VelocityEstimator | None = None  # while the device is open
        self._seen = (-1, 0.0)  # placement and time of the plant when it was read last
        self._fault = 0  # of the last reading

    @property
    def features(self) -> Features:
        return self._features

    @property
    def effort(self) -> FloatArray:
        """The force (k, d) [N] that acts on the fingertips until the next write; not to be written to."""
        return self._effort

    @staticmethod
    def plant(devices: Sequence[Device]) -> PointPlant:
        """Make the plant that moves all fingertips of these devices, in their order; from now on they read it."""
        plant: PointPlant = PointDevice._moved_by(devices, PointPlant)
        return plant

    @staticmethod
    def operated_plant(devices: Sequence[Device], operator: Operator, period: float) -> OperatedPlant:
        """Make the plant of `plant` for the hand of an operator who is not a spring.

        Args:
            devices: of this class.
            operator: who holds them; the longest reaction is that which the plant has room for.
            period: T [s].
        """
        make = partial(OperatedPlant, room=room_for(operator.reach, period), operator=operator)
        plant: OperatedPlant = PointDevice._moved_by(devices, make)
        return plant

    @staticmethod
    def _moved_by(devices: Sequence[Device], make: Callable[..., Any]) -> Any:
        points = [device for device in devices if isinstance(device, PointDevice)]
        if not points or len(points) < len(devices):
            raise InputError(
                "devices", [type(device).__name__ for device in devices], "one or more `simulated` devices"
            )
        dimensions = {device.features.dimensions for device in points}
        if len(dimensions) > 1:
            raise InputError("devices", sorted(dimensions), "devices of the same number of dimensions")
        each = [device for device in points for _ in range(device.features.fingers)]
        plant = make([device.mass for device in each], [device.damping for device in each], dimensions.pop())
        start = 0
        for device in points:
            stop = start + device.features.fingers
            device._plant, device._true, device._seen = plant, plant.position[start:stop], (-1, 0.0)
            d = device.features.dimensions
            device.sensed = plant.ports.position + np.arange(start * d, stop * d)
            start = stop
        return plant

    def open(self, period: float) -> None:
        memory = self.state[self._estimates.offset :]
        self._estimator = VelocityEstimator(period, self._shape, 0.5 * self.resolution, self._window, memory)
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
            self._sensed[...] = self._true
            self._fault = self.reading(self._entries, 0)
        if self._fault:
            raise DeviceError(self.fault_text(self._fault))
        return self._position, self._velocity, plant.time

    def write(self, forces: FloatArray) -> None:
        """Hold forces (k, d) [N] on the fingertips `delay` samples from now, shortened to the force limit.

        Any that is not finite stops the device (no force on any finger, nothing left in the delay) and raises
        DeviceError.
        """
        self._opened()
        if np.shape(forces) != self._shape:
            raise InputError("forces", forces, f"an array of shape {self._shape}")
        self._command[...] = forces
        code = self.writing(self._entries, 0)
        if code:
            raise DeviceError(self.fault_text(code))

    def stop(self) -> None:
        self.stopping(self._entries, 0)

    def fault_text(self, code: int) -> str:
        """Explain a number that a kernel gave, with the figures in the block."""
        i, kind = divmod(code - 1, sample.KINDS)
        finger, at = f"finger {i} of a simulated device", _point(self._position[i])
        if kind + 1 == sample.ENDLESS_FORCE:
            return f"the force on {finger} is {_point(self._command[i])} N; zero is displayed"
        if kind + 1 == sample.DIVERGED:
            return f"{finger} is at {at} m; its motion has diverged"
        corners = self._corners
        return (
            f"{finger} is at {at} m, outside its workspace from {_point(corners[0])} to {_point(corners[1])} m; widen "
            "`workspace`, or start or move the finger nearer to its middle"
        )

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


def _point(components: FloatArray) -> str:
    return "(" + ", ".join(f"{x:.6g}" for x in components) + ")"
