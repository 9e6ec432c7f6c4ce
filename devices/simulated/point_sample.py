"""A sample of simulated point devices: sensors are read and forces are written."""

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
    """Point devices that are one device: k fingers in d dimensions."""

    fingers: int  # k
    dimensions: int  # d
    rounded: bool  # positions are multiples of the resolution
    bounded: bool  # there is a workspace
    limited: bool  # and a limit of forces
    delay: int  # [samples]
    estimate_size: int  # entries of the velocity estimate of one component
    slot: int  # row of the delay line that is filled next
    resolution: float  # [m]
    limit: float  # [N]
    low: Floats = floats("dimensions")  # corners of the workspace [m]
    high: Floats = floats("dimensions")
    sensed: Floats = floats("fingers * dimensions")  # where the fingertips are [m]
    position: Floats = floats("fingers * dimensions")  # where they are read [m]
    velocity: Floats = floats("fingers * dimensions")  # [m/s]
    command: Floats = floats("fingers * dimensions")  # forces to display [N]
    effort: Floats = floats("fingers * dimensions")  # forces that act [N]
    line: Table = table("delay + 1", "fingers * dimensions")
    estimates: Many[VelocityEstimate] = many("fingers * dimensions", "estimate_size")


STRUCTURE = [
    start_of(PointDeviceState, name)
    for name in ("fingers", "dimensions", "rounded", "bounded", "limited", "delay", "estimate_size")
]

# What the kernels give besides 0, KINDS for each finger.
ENDLESS_FORCE, DIVERGED, OUTSIDE = 1, 2, 3
KINDS = 3

WHOLE = 2.0**52  # from here on floats are whole numbers


def nearest(x: float) -> float:
    """Round x to a whole number, halves to the even one; infinities and NaN stay as they are."""
    if abs(x) < WHOLE:
        return (x + WHOLE) - WHOLE if x >= 0.0 else (x - WHOLE) + WHOLE
    return x


@kernel
def read(device: PointDeviceState) -> int:
    """Work out positions and velocities from the sensed places; 0, or DIVERGED or OUTSIDE of the first such finger."""
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
    """Shorten commands to the limit, pass them through the delay line and set the efforts to its output.

    0, or ENDLESS_FORCE of the first finger whose command is not finite, and then the device has stopped.
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
    """Leave no effort, and none on its way."""
    clear_line(device.line, device.delay, device.effort)
    return 0
