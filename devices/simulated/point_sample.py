"""A sample of simulated point devices: what their sensors tell, and what their actuators hold."""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Many, Record, Table, floats, many, start_of, table
from graspfx.devices._late import cleared, delayed
from graspfx.loop.velocity import VelocityEstimate, estimate


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
    """Round x to a whole number, halves to the even one; what is not finite stays."""
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
    """Shorten commands to the limit, put them into the delay line and what comes out of it into the efforts.

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
        device.slot = delayed(device.line, device.slot, device.delay, effort)
    return 0


@kernel
def stop(device: PointDeviceState) -> int:
    """Leave no effort, and none on its way."""
    cleared(device.line, device.delay, device.effort)
    return 0
