"""One sample of simulated point devices: reading of sensors and writing of forces."""

from __future__ import annotations

import math

from graspfx.devices._late import clear_line, delay_values
from graspfx.protocols import (
    Floats,
    Many,
    Record,
    Table,
    VelocityEstimate,
    estimate,
    floats,
    kernel,
    many,
    start_of,
    table,
)


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

# Codes of the kernels besides 0, KINDS for each finger.
ENDLESS_FORCE, DIVERGED, OUTSIDE = 1, 2, 3
KINDS = 3

WHOLE = 2.0**52  # floats from here on are integers


def nearest(x: float) -> float:
    """Round x to an integer, halves to even; infinities and NaN are unchanged."""
    if abs(x) < WHOLE:
        return (x + WHOLE) - WHOLE if x >= 0.0 else (x - WHOLE) + WHOLE
    return x


@kernel
def read(device: PointDeviceState) -> int:
    """Compute positions and velocities from the sensed positions; return 0, or DIVERGED or OUTSIDE of a finger."""
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
    """Scale commands to the limit, pass them through the delay line and set the efforts to its output.

    Returns 0, or ENDLESS_FORCE of the first finger with a non-finite command, after which the device has stopped.
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
