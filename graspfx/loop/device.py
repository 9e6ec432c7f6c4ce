"""The device protocol: what a driver tells, reads and writes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.plant import Plant

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Features:
    """What a device is, told before it is opened. What is not known is None, never zero."""

    fingers: int  # k, the number of channels
    dimensions: int  # d
    workspace: tuple[FloatArray, FloatArray] | None = None  # lower, upper corner, (d,) each [m]
    continuous_force: float | None = None  # [N]
    peak_force: float | None = None  # [N]
    stiffness: float | None = None  # largest stiffness it displays stably at its rate [N/m]
    damping: float | None = None  # largest virtual damping at its rate [N s/m]
    mass: float | None = None  # effective mass at a fingertip [kg]
    friction: float | None = None  # effective viscous friction at a fingertip [N s/m]
    resolution: float | None = None  # of a fingertip position [m]
    delay: int | None = None  # output delay [samples]


class Device(Protocol):
    """One piece of hardware, or its simulation, that moves `features.fingers` fingertips.

    A driver is a module with `connect(**settings) -> Device`. To connect has no effect: hardware is not touched before
    `open`, since checking a scene connects every device of it, for its features and for what is wrong with its
    settings (an InputError by the setting's name). `read` and `write` neither wait nor allocate more
    than they must; the arrays that `read` returns belong to the device and are overwritten by the next `read`.
    """

    @property
    def features(self) -> Features: ...

    def open(self, period: float) -> None:
        """Make ready for one `read` and one `write` every `period` seconds."""

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        """Positions (k, d) [m], velocities (k, d) [m/s] and the time [s] at which they were taken."""
        ...

    def write(self, forces: FloatArray) -> None:
        """Display forces (k, d) [N] to the operator until the next `write`.

        The device's own limit is applied here, last; a force that is not finite is displayed as zero
        and raises DeviceError.
        """

    def stop(self) -> None:
        """Zero force, now."""

    def close(self) -> None:
        """Zero force, and let go of the hardware; returns also with the hardware gone, and twice."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *exc: object) -> None: ...


@runtime_checkable
class SimulatedDevice(Protocol):
    """What a simulated device shows besides the protocol, so that a plant can move it."""

    @property
    def effort(self) -> FloatArray:
        """What its actuators hold until the next sample, (k, d): after delay and limit, in the plant's units."""
        ...

    @staticmethod
    def plant(devices: Sequence[Device]) -> Plant:
        """The plant that moves all channels of these devices together, in their order."""
        ...
