"""Simulated device of point masses: sensors, actuators, and the kernels that run once per sample."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.devices._plant import PlantDevice, all_of, clear_line, delay_values
from graspfx.devices.simulated.operated_points import OperatedPlant, room_for
from graspfx.devices.simulated.points import PointPlant
from graspfx.protocols import (
    Device,
    DeviceError,
    DevicePorts,
    Features,
    Floats,
    InputError,
    Many,
    Operator,
    Record,
    Table,
    VelocityEstimate,
    VelocityEstimator,
    estimate,
    estimate_size,
    floats,
    kernel,
    many,
    size_for,
    start_of,
    table,
    zeros,
)

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]


class PointDeviceState(Record):
    """State of one device with k point masses in d dimensions."""

    fingers: int  # k
    dimensions: int  # d
    rounded: bool  # positions are rounded to the resolution
    bounded: bool  # there is a workspace
    limited: bool  # forces are limited
    delay: int  # [samples]
    estimate_size: int  # size of the velocity estimate of one component
    slot: int  # row of the delay line to fill next
    resolution: float  # [m]
    limit: float  # [N]
    low: Floats = floats("dimensions")  # corners of the workspace [m]
    high: Floats = floats("dimensions")
    sensed: Floats = floats("fingers * dimensions")  # true positions of the fingertips [m]
    position: Floats = floats("fingers * dimensions")  # positions as read [m]
    velocity: Floats = floats("fingers * dimensions")  # [m/s]
    command: Floats = floats("fingers * dimensions")  # forces to display [N]
    effort: Floats = floats("fingers * dimensions")  # forces that act now [N]
    line: Table = table("delay + 1", "fingers * dimensions")
    estimates: Many[VelocityEstimate] = many("fingers * dimensions", "estimate_size")


STRUCTURE = [
    start_of(PointDeviceState, name)
    for name in ("fingers", "dimensions", "rounded", "bounded", "limited", "delay", "estimate_size")
]

# Codes of the kernels other than 0; the code of a fault of finger i is one of these plus KINDS * i.
ENDLESS_FORCE, DIVERGED, OUTSIDE = 1, 2, 3
KINDS = 3

WHOLE = 2.0**52  # floats of at least this magnitude are integers


def nearest(x: float) -> float:
    """Round x to an integer, halves to even; infinities and NaN are unchanged."""
    if abs(x) < WHOLE:
        return (x + WHOLE) - WHOLE if x >= 0.0 else (x - WHOLE) + WHOLE
    return x


@kernel
def read(device: PointDeviceState) -> int:
    """Compute positions and velocities from the sensed positions.

    Returns 0, or the code DIVERGED or OUTSIDE of the first finger with such a fault.
    """
    d = device.dimensions
    low, high = device.low, device.high
    sensed, position, velocity = device.sensed, device.position, device.velocity
    rounded, resolution = device.rounded, device.resolution
    for j, state in enumerate(device.estimates):
        x = sensed[j]
        if rounded:
            x = nearest(x / resolution) * resolution
        position[j] = x
        velocity[j] = estimate(state, x)
    for i in range(device.fingers):
        for a in range(d):
            if not math.isfinite(position[d * i + a]):
                return DIVERGED + KINDS * i
        if device.bounded:
            for a in range(d):
                if not low[a] <= position[d * i + a] <= high[a]:
                    return OUTSIDE + KINDS * i
    return 0


@kernel
def write(device: PointDeviceState) -> int:
    """Scale commands down to the limit, pass them through the delay line, and set the efforts to the line's output.

    Returns 0. If a command is not finite, stops the device and returns the code ENDLESS_FORCE of its finger.
    """
    d = device.dimensions
    command, effort = device.command, device.effort
    limited, limit = device.limited, device.limit
    for i in range(device.fingers):
        force = 0.0
        for a in range(d):
            force += command[d * i + a] * command[d * i + a]
        force = math.sqrt(force)
        if not math.isfinite(force):
            stop(device)
            return ENDLESS_FORCE + KINDS * i
        share = 1.0
        if limited and force > limit:
            share = limit / force
        for a in range(d):
            effort[d * i + a] = share * command[d * i + a]
    if device.delay > 0:
        device.slot = delay_values(device.line, device.slot, device.delay, effort)
    return 0


@kernel
def stop(device: PointDeviceState) -> int:
    """Set the efforts and the delay line to zero."""
    clear_line(device.line, device.delay, device.effort)
    return 0


class PointDevice(PlantDevice):  # type: ignore[misc] # mypy does not see devices from inside the package
    """Simulated device created by `connect`: a plant moves the fingertips, and the device's sensors read the plant.

    The kernels `reading` and `writing` run once per sample on the block `state`.
    """

    declaration = PointDeviceState
    reading = staticmethod(read)
    writing = staticmethod(write)
    stopping = staticmethod(stop)

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
        self.structure: Index = np.array([*STRUCTURE, *lengths])
        self.ports = DevicePorts(
            sensed=block.sensed.offset,
            position=block.position.offset,
            velocity=block.velocity.offset,
            command=block.command.offset,
            effort=block.effort.offset,
        )
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
        self._estimator: VelocityEstimator | None = None  # only while the device is open

    @property
    def features(self) -> Features:
        return self._features

    @staticmethod
    def plant(devices: Sequence[Device]) -> PointPlant:
        """Create the plant that moves all fingertips of the devices, in order; the devices then read this plant."""
        plant: PointPlant = PointDevice._moved_by(devices, PointPlant)
        return plant

    @staticmethod
    def operated_plant(devices: Sequence[Device], operator: Operator, period: float) -> OperatedPlant:
        """Create the plant of the devices, as `plant` does, for a hand with an operator model.

        Args:
            devices: Instances of this class.
            operator: Operator model; its longest delay determines the size of the delay line.
            period: Sampling period T [s].
        """
        make = partial(OperatedPlant, room=room_for(operator.reach, period), operator=operator)
        plant: OperatedPlant = PointDevice._moved_by(devices, make)
        return plant

    @staticmethod
    def _moved_by(devices: Sequence[Device], make: Callable[..., Any]) -> Any:
        points = all_of(PointDevice, devices, "`simulated` device")
        dimensions = {device.features.dimensions for device in points}
        if len(dimensions) > 1:
            raise InputError("devices", sorted(dimensions), "devices with the same number of dimensions")
        each = [device for device in points for _ in range(device.features.fingers)]
        plant = make([device.mass for device in each], [device.damping for device in each], dimensions.pop())
        first = plant.ports.position
        for device in points:
            device._connect(plant, first)
            first += device._sensed.size
        return plant

    def open(self, period: float) -> None:
        memory = self.state[self._estimates.offset :]
        self._estimator = VelocityEstimator(period, self._shape, 0.5 * self.resolution, self._window, memory)
        self._begin()

    def fault_text(self, code: int) -> str:
        """Return the error message for a code of a kernel, with values from the block."""
        i, kind = divmod(code - 1, KINDS)
        finger, at = f"finger {i} of a simulated device", _point(self._position[i])
        if kind + 1 == ENDLESS_FORCE:
            return f"the force on {finger} is {_point(self._command[i])} N, which is not finite; zero is displayed"
        if kind + 1 == DIVERGED:
            return f"{finger} is at {at} m; its motion has diverged"
        corners = self._corners
        return (
            f"{finger} is at {at} m, outside its workspace from {_point(corners[0])} to {_point(corners[1])} m; widen "
            "`workspace`, or start or move the finger nearer to its middle"
        )

    def _take(self, forces: FloatArray) -> None:
        self._opened()
        if np.shape(forces) != self._shape:
            raise InputError("forces", forces, f"an array of shape {self._shape}")
        self._command[...] = forces

    def _opened(self) -> VelocityEstimator:
        if self._estimator is None:
            raise DeviceError("this simulated device is not open; call open(period) first")
        return self._estimator


def _point(components: FloatArray) -> str:
    return "(" + ", ".join(f"{x:.6g}" for x in components) + ")"
