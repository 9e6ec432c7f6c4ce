"""A two-link arm moved by a plant, whose time and link directions it reads."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graspfx.devices.two_link import arm_sample as sample
from graspfx.devices.two_link.adapter import TwoLinkArm
from graspfx.devices.two_link.arm import Arm, Both, Mechanics
from graspfx.devices.two_link.arm_dynamics import ArmPlant
from graspfx.devices.two_link.arm_sample import ArmState
from graspfx.devices.two_link.board import Wiring
from graspfx.protocols import Device, DeviceError, DevicePorts, InputError, VelocityEstimate, start_of

FloatArray = NDArray[np.float64]


class SimulatedTwoLink(TwoLinkArm):  # type: ignore[misc] # mypy does not see devices from inside the package
    """An arm simulated together with its board: counts are rounded, and torques act after `delay` samples.

    The kernels `reading` and `writing` run once per sample on the block `state`.
    """

    reading = staticmethod(sample.read)
    writing = staticmethod(sample.write)
    stopping = staticmethod(sample.stop)
    ports = DevicePorts(
        sensed=start_of(ArmState, "angles"),
        position=start_of(ArmState, "position"),
        velocity=start_of(ArmState, "velocity"),
        command=start_of(ArmState, "command"),
        effort=start_of(ArmState, "effort"),
    )

    def __init__(self, arm: Arm, wiring: Wiring, mechanics: Mechanics, velocity_window: int, delay: int) -> None:
        super().__init__(arm, wiring, mechanics, velocity_window, delay)
        lengths = [start_of(VelocityEstimate, "length") + estimate.offset for estimate in self._block.estimates]
        self.structure = np.array([*sample.STRUCTURE, *lengths])
        self._fault = 0  # fault code of the last reading
        self._wire(ArmPlant([mechanics]), 0)  # at rest, until the arm is connected to a moving plant

    @property
    def effort(self) -> FloatArray:
        """Torques at the joints until the next sample (1, 2) [N m]; read-only."""
        effort: FloatArray = self._effort
        return effort

    @staticmethod
    def plant(devices: Sequence[Device]) -> ArmPlant:
        """Create the plant that moves the arms of these devices together with the hand at their tips."""
        arms = [device for device in devices if isinstance(device, SimulatedTwoLink)]
        if not arms or len(arms) < len(devices):
            kinds = [type(device).__name__ for device in devices]
            raise InputError("devices", kinds, "at least one simulated two-link arm, and no other device")
        plant = ArmPlant([device._require_mechanics() for device in arms])
        for i, device in enumerate(arms):
            device._wire(plant, i)
        return plant

    def open(self, period: float) -> None:
        super().open(period)
        self._seen = (-1, 0.0)
        self.stop()

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        """Return position (1, 2) [m], velocity (1, 2) [m/s] and time [s], constant within a tick of the plant."""
        estimator, plant = self._opened(), self._plant
        now = plant.placed, plant.time
        if now != self._seen:
            if now[0] != self._seen[0]:
                estimator.reset()
            self._seen = now
            self._block.angles = Both(self._angles[0], self._angles[1])
            self._fault = self.reading(self._entries, 0)
        if self._fault:
            raise DeviceError(self.fault_text(self._fault))
        return self._position, self._velocity, plant.time

    def write(self, forces: FloatArray) -> None:
        self._take(forces)
        code = self.writing(self._entries, 0)
        if code:
            raise DeviceError(self.fault_text(code))

    def stop(self) -> None:
        self.stopping(self._entries, 0)

    def close(self) -> None:
        self.stop()
        self._estimator = None

    def _wire(self, plant: ArmPlant, i: int) -> None:
        """Connect the encoders to the plant's arm i."""
        self._plant, self._angles, self.sensed = plant, plant.angles(i), plant.sensed(i)
        self._seen = (-1, 0.0)  # placement and time of the plant at the last reading
