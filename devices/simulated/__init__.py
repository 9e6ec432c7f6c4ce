"""Simulated point devices: masses with viscous damping, read through encoders, with output delay and force limit."""

from __future__ import annotations

from numpy.typing import ArrayLike

from graspfx.devices._settings import corners, number, whole
from graspfx.devices.simulated.point_device import PointDevice
from graspfx.protocols import SMALLEST, WINDOW, former_settings

__all__ = ["PointDevice", "connect"]


@former_settings(friction="damping")
def connect(
    *,
    mass: float,
    dimensions: int,
    damping: float = 0.0,
    fingers: int = 1,
    resolution: float = 0.0,
    velocity_window: int = WINDOW,
    delay: int = 0,
    force_limit: float | None = None,
    workspace: tuple[ArrayLike, ArrayLike] | None = None,
) -> PointDevice:
    """Create a device whose fingertips are point masses, m x'' + b x' = force + hand's force, on every axis.

    Args:
        mass: Mass m of each fingertip [kg].
        dimensions: Number of dimensions d.
        damping: Viscous damping b [N s/m].
        fingers: Number k of fingers, the channels of this device.
        resolution: Resolution of the encoders [m]; readings are multiples of the resolution, or exact if it is 0.
        velocity_window: Longest window of the velocity estimate [samples] (`graspfx.loop.velocity`).
        delay: Delay between a write and its force [samples]; with 0, the force acts over the next sample.
        force_limit: Largest force at a fingertip [N]; larger forces are scaled down.
        workspace: Lower and upper corner (d,) [m]; a finger outside raises a DeviceError.
    """
    if force_limit is not None:
        force_limit = number("force_limit", force_limit, SMALLEST, expected="a finite force above zero [N], or none")
    d = whole("dimensions", dimensions, 1, 3)
    return PointDevice(
        mass=number("mass", mass, SMALLEST, expected="a finite mass above zero [kg]"),
        damping=number("damping", damping, 0.0, expected="a finite damping of zero or more [N s/m]"),
        fingers=whole("fingers", fingers, 1),
        dimensions=d,
        resolution=number("resolution", resolution, 0.0, expected="a finite length of zero or more [m]"),
        velocity_window=whole("velocity_window", velocity_window, 1),
        delay=whole("delay", delay, 0),
        force_limit=force_limit,
        workspace=None if workspace is None else tuple(corners(workspace, d)),
    )
