"""Samples and forces of a device that C functions read and write: the rule of `Readings`, as kernels."""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Record, Table, floats, table
from graspfx.loop.device_calls import REPEAT

NEAR = 1e-3  # of a position that was zero to the last bit only by chance [m]
FAST, FAR, ZEROS, STALE, NOT_FINITE, FORCE, NO_ASK, NO_READ, NO_WRITE, LATE = range(1, 11)  # why a device is a fault


class PortState(Record):
    """A device between its C functions and the tick."""

    fingers: int  # k
    dimensions: int  # d
    entries: int  # k d
    hold: int  # readings in a row without a new sample that are let pass
    period: float  # T [s]
    speed: float  # the fastest motion of a finger along an axis [m/s]
    force: float  # the largest force of a finger [N]
    is_begun: bool  # whether there has been a sample
    is_gone: bool  # whether a function has failed: it is not read again
    is_fresh: bool  # whether the last reading brought a sample
    samples: int
    repeats: int  # readings without one
    row: int  # those in a row
    periods: int  # since the last sample
    why: int  # it is a fault; 0 for none
    code: int  # that a function returned
    figure: float  # that was too much
    bound: float  # it was compared with
    stop_code: int  # of `stop`, if it failed while the device answered; 0 for none
    stop_tick: int  # in which it failed
    ramp: float  # over which the depth at the start is let in [s]
    ramp_ticks: int  # of it so far
    is_framed: bool  # whether it stands in axes of its own (`Frame`)
    scale: float  # metres of the scene for a metre of the device
    origin: Floats = floats("dimensions")  # of the device, in the scene [m]
    axes: Table = table("dimensions", "dimensions")  # R, a row for each axis of the scene
    raw: Floats = floats("2 * entries")  # as `read` wrote them: positions [m], velocities [m/s]
    sample: Floats = floats("2 * entries")  # the last one
    position: Floats = floats("entries")  # as the tick takes them [m]
    velocity: Floats = floats("entries")  # [m/s]
    depth: Floats = floats("entries")  # depth at the start, of which less and less is taken off [m]
    orders: Floats = floats("entries")  # forces, in the scene's axes [N]
    forces: Floats = floats("entries")  # for `write` [N]


@kernel
def fail(port: PortState, why: int, code: int) -> int:
    """Note the first failure of a device, which is gone from then on; give why."""
    port.is_gone = True
    if port.why == 0:
        port.why = why
        port.code = code
    return why


@kernel
def take_sample(port: PortState, code: int, periods: int) -> int:
    """Take a reading over, whole or not at all; give why it is a fault, 0 for none.

    Args:
        port: whose `raw` has the reading.
        code: that `read` returned.
        periods: that have passed since the one before.
    """
    if code < 0 or code > REPEAT:
        return fail(port, NO_READ, code)
    raw, last = port.raw, port.sample
    half = port.entries
    for i in range(2 * half):
        if not math.isfinite(raw[i]):
            return fail(port, NOT_FINITE, i)
    port.periods += periods
    port.is_fresh = code != REPEAT
    if code == REPEAT:
        port.repeats += 1
        port.row += 1
        if port.row > port.hold:
            return fail(port, STALE, port.row)
        return enter(port)
    fastest = 0.0
    empty = True
    for i in range(half):
        fastest = max(fastest, abs(raw[half + i]))
        if raw[i] != 0.0 or raw[half + i] != 0.0:
            empty = False
    port.bound = port.speed
    port.figure = fastest
    if fastest > port.speed:
        return fail(port, FAST, 0)
    if port.is_begun:
        step = 0.0
        for i in range(half):
            step = max(step, abs(raw[i] - last[i]))
        port.figure = step
        port.bound = port.speed * port.period * max(port.periods, 1)
        if step > NEAR and empty:
            return fail(port, ZEROS, 0)
        if step > port.bound:
            return fail(port, FAR, max(port.periods, 1))
    for i in range(2 * half):
        last[i] = raw[i]
    port.is_begun = True
    port.samples += 1
    port.row = 0
    port.periods = 0
    return enter(port)


@kernel
def enter(port: PortState) -> int:
    """Put the last sample into the scene's axes, set off by what is not let in yet (`Entry`)."""
    last, half, d = port.sample, port.entries, port.dimensions
    for i in range(half):
        port.position[i] = last[i]
        port.velocity[i] = last[half + i]
    if port.is_framed:
        for j in range(port.fingers):
            for a in range(d):
                x = v = 0.0
                for b in range(d):
                    x += last[j * d + b] * port.axes[a, b]
                    v += last[half + j * d + b] * port.axes[a, b]
                port.position[j * d + a] = port.origin[a] + port.scale * x
                port.velocity[j * d + a] = port.scale * v
    time = port.ramp_ticks * port.period
    if time < port.ramp:
        u = time / port.ramp
        for i in range(half):
            port.position[i] -= (1.0 - u * u * (3.0 - 2.0 * u)) * port.depth[i]
            port.velocity[i] += 6.0 * u * (1.0 - u) / port.ramp * port.depth[i]
        port.ramp_ticks += 1
    return 0


@kernel
def limit_forces(port: PortState) -> int:
    """Turn `orders` into the device's axes, and limit each finger's force, whole; give why none may be displayed.

    0 is no reason.
    """
    forces, orders, d = port.forces, port.orders, port.dimensions
    for i in range(port.entries):
        forces[i] = orders[i]
    if port.is_framed:
        for j in range(port.fingers):
            for b in range(d):
                f = 0.0
                for a in range(d):
                    f += orders[j * d + a] * port.axes[a, b]
                forces[j * d + b] = port.scale * f
    for i in range(port.entries):
        if not math.isfinite(forces[i]):
            return fail(port, FORCE, 0)
    for j in range(port.fingers):
        square = 0.0
        for a in range(d):
            square += forces[j * d + a] * forces[j * d + a]
        size = math.sqrt(square)
        if size > port.force:
            for a in range(d):
                forces[j * d + a] *= port.force / size
    return 0
