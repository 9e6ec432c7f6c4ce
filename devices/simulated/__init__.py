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
    """Create a simulated device whose fingertips are point masses with viscous damping.

        m x'' + b x' = displayed force + hand's force      on every axis, for a fingertip at x

    Args:
        mass: Mass m of each fingertip [kg].
        dimensions: Number of dimensions d.
        damping: Viscous damping b of each fingertip [N s/m].
        fingers: Number of fingers, one channel each.
        resolution: Resolution of the encoders [m]; positions are rounded to its multiples, or exact if it is 0.
        velocity_window: Largest number of samples in the window of the velocity estimate (`graspfx.loop.velocity`).
        delay: Delay between a write and its force [samples]; with 0, the force acts over the next sample.
        force_limit: Largest force at a fingertip [N]; larger forces are scaled down. None for no limit.
        workspace: Lower and upper corner (d,) [m] of the region outside which the reading of a finger raises
            DeviceError; None for no limits.
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
