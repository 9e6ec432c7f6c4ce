"""A sample of simulated point devices on a flat block: what their sensors tell, and what their actuators hold."""

from __future__ import annotations

import math
from typing import Any

from graspfx.devices._late import cleared, delayed
from graspfx.loop.velocity import estimate

# The block begins with these entries; switches are 1 or 0. Corners of the workspace (d each) follow, then the places
# that are sensed, positions, velocities, commands and efforts, (k, d) each, the delay line, (delay + 1, k, d), and
# the velocity estimates' states, one for each of the k d components.
FINGERS, DIMENSIONS, ROUNDED, BOUNDED, LIMITED, DELAY, ESTIMATE, SLOT, RESOLUTION, LIMIT, HEADER = range(11)
SENSED, POSITION, VELOCITY, COMMAND, EFFORT, LINE = range(6)  # in k d entries after the corners
STRUCTURE = FINGERS, DIMENSIONS, ROUNDED, BOUNDED, LIMITED, DELAY, ESTIMATE

# What the kernels give besides 0, KINDS for each finger.
ENDLESS_FORCE, DIVERGED, OUTSIDE = 1, 2, 3
KINDS = 3

WHOLE = 2.0**52  # from here on floats are whole numbers


def nearest(x: float) -> float:
    """x rounded to a whole number, halves to the even one; what is not finite stays."""
    if abs(x) < WHOLE:
        return (x + WHOLE) - WHOLE if x >= 0.0 else (x - WHOLE) + WHOLE
    return x


def read(S: Any, o: int) -> int:
    """Positions and velocities from the places that are sensed; 0, DIVERGED or OUTSIDE of the first such finger."""
    k, d, size = int(S[o + FINGERS]), int(S[o + DIMENSIONS]), int(S[o + ESTIMATE])
    entries = k * d
    low = o + HEADER
    high, sensed = low + d, low + 2 * d
    position, velocity = sensed + POSITION * entries, sensed + VELOCITY * entries
    states = sensed + (LINE + 1 + int(S[o + DELAY])) * entries
    rounded, resolution = int(S[o + ROUNDED]), S[o + RESOLUTION]
    for j in range(entries):
        x = S[sensed + j]
        if rounded == 1:
            x = nearest(x / resolution) * resolution
        S[position + j] = x
        S[velocity + j] = estimate(S, states + j * size, x)
    for i in range(k):
        at = position + i * d
        for a in range(d):
            if not math.isfinite(S[at + a]):
                return DIVERGED + KINDS * i
        if int(S[o + BOUNDED]) == 1:
            for a in range(d):
                if not S[low + a] <= S[at + a] <= S[high + a]:
                    return OUTSIDE + KINDS * i
    return 0


def write(S: Any, o: int) -> int:
    """Commands, shortened to the limit, into the delay line and what comes out of it into the efforts.

    0, or ENDLESS_FORCE of the first finger whose command is not finite, and then the device has stopped.
    """
    k, d, delay = int(S[o + FINGERS]), int(S[o + DIMENSIONS]), int(S[o + DELAY])
    entries = k * d
    sensed = o + HEADER + 2 * d
    command, effort = sensed + COMMAND * entries, sensed + EFFORT * entries
    limited, limit = int(S[o + LIMITED]), S[o + LIMIT]
    for i in range(k):
        at = command + i * d
        force = 0.0
        for a in range(d):
            force += S[at + a] * S[at + a]
        force = math.sqrt(force)
        if not math.isfinite(force):
            stop(S, o)
            return ENDLESS_FORCE + KINDS * i
        share = 1.0
        if limited == 1 and force > limit:
            share = limit / force
        for a in range(d):
            S[effort + i * d + a] = share * S[at + a]
    delayed(S, o + SLOT, sensed + LINE * entries, delay, effort, entries)
    return 0


def stop(S: Any, o: int) -> int:
    """No effort now, and none on its way."""
    entries = int(S[o + FINGERS]) * int(S[o + DIMENSIONS])
    sensed = o + HEADER + 2 * int(S[o + DIMENSIONS])
    cleared(S, sensed + LINE * entries, int(S[o + DELAY]), sensed + EFFORT * entries, entries)
    return 0
