"""Simulated point devices: masses with viscous damping, read through encoders, with output delay and force limit."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.devices.simulated.point_device import PointDevice
from graspfx.protocols import LARGEST, SMALLEST, WINDOW, InputError, finite, former_settings

FloatArray = NDArray[np.float64]

__all__ = ["PointDevice", "connect"]

MOST = 1_000_000  # largest number of fingers, or of samples of delay


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
    return PointDevice(
        mass=_number("mass", mass, "a finite mass above zero [kg]", zero=False),
        damping=_number("damping", damping, "a finite damping of zero or more [N s/m]"),
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


def _number(name: str, value: float, expected: str, *, zero: bool = True) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise InputError(name, value, expected)
    if not (0.0 if zero else SMALLEST) <= value <= LARGEST:
        raise InputError(name, value, expected)
    return float(value)


def _count(name: str, value: int, least: int, most: int = MOST) -> int:
    limits = f"an integer from {least} to {most}"
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise InputError(name, value, limits)
    if not least <= value <= most:
        raise InputError(name, value, limits)
    return int(value)


def _corners(workspace: tuple[ArrayLike, ArrayLike], d: int) -> tuple[FloatArray, FloatArray]:
    expected = f"a lower and an upper corner with {d} finite components each [m]"
    corners = finite("workspace", workspace, expected)
    if corners.shape != (2, d) or not (corners[0] < corners[1]).all():
        raise InputError("workspace", workspace, expected)
    corners.flags.writeable = False
    return corners[0], corners[1]
