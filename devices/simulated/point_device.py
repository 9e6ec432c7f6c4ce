"""The device of point masses: sensors and actuators, sample by sample."""

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
    """A device from `connect`: a plant moves the fingers, and the device reads the plant through its sensors.

    The kernels `reading` and `writing` perform each sample on the block `state`.
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
        self._entries: Any = self.state.data  # plain floats, because access to items of an array takes twice as long
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
        self._estimator: VelocityEstimator | None = None  # only while the device is open
        self._seen = (-1, 0.0)  # placement and time of the plant at the last reading
        self._fault = 0  # fault code of the last reading

    @property
    def features(self) -> Features:
        return self._features

    @property
    def effort(self) -> FloatArray:
        """Force (k, d) [N] that acts on the fingertips until the next write; read-only."""
        return self._effort

    @staticmethod
    def plant(devices: Sequence[Device]) -> PointPlant:
        """Create the plant that moves all fingertips of these devices, in order; the devices then read this plant."""
        plant: PointPlant = PointDevice._moved_by(devices, PointPlant)
        return plant

    @staticmethod
    def operated_plant(devices: Sequence[Device], operator: Operator, period: float) -> OperatedPlant:
        """Create the plant of these devices, as `plant` does, for a hand with an operator model.

        Args:
            devices: Devices of this class.
            operator: Operator model; its longest delay determines the size of the delay line.
            period: Sampling period T [s].
        """
        make = partial(OperatedPlant, room=room_for(operator.reach, period), operator=operator)
        plant: OperatedPlant = PointDevice._moved_by(devices, make)
        return plant

    @staticmethod
    def _moved_by(devices: Sequence[Device], make: Callable[..., Any]) -> Any:
        points = [device for device in devices if isinstance(device, PointDevice)]
        if not points or len(points) < len(devices):
            raise InputError(
                "devices",
                [type(device).__name__ for device in devices],
                "at least one `simulated` device, and no other device",
            )
        dimensions = {device.features.dimensions for device in points}
        if len(dimensions) > 1:
            raise InputError("devices", sorted(dimensions), "devices with the same number of dimensions")
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
        """Return positions (k, d) [m], velocities (k, d) [m/s] and time [s]; constant within a tick of the plant."""
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
        """Apply forces (k, d) [N], scaled down to the force limit, to the fingertips after `delay` samples.

        A non-finite force stops the device, clears the delay line and raises DeviceError.
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
        """Explain a code of a kernel with the values in the block."""
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
