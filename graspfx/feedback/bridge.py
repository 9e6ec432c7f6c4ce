"""Bridge between the rates of a host program and the loop: samples, prediction, and an energy tank for each port.

The forces f_i of a port in tick k act on the operator's fingers, at the positions x_i, until tick k + 1. At tick k + 1,
the work of these forces, sum_i f_i.(x_i(k + 1) - x_i(k)), is known and is subtracted from the energy E in the port's
tank. The forces of the port are multiplied by

    s = min(1, E/(v T sum_i |f_i|)).

Here v is the scene's `host.speed`, and T the sampling period. If no finger moves farther than v T in a tick, the forces
never use more energy than the tank contains. The operator's work fills the tank up to its capacity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.kernel import kernel
from graspfx.compile.memory import zeros
from graspfx.compile.records import Floats, Record, floats, room, size_for
from graspfx.coupling.grasp_state import GraspState
from graspfx.feedback.host_record import (
    CODE,
    FAULT,
    HOST_ENDED,
    HOST_FIRST,
    HOST_NUMBER,
    LOOP_NUMBER,
    LOOP_SAMPLE,
    LOOP_SIZE,
    NOT_FINITE,
    SAMPLE,
    SLOTS,
    STATE,
    TOO_LARGE,
    HostRecord,
    make_record,
)
from graspfx.grasp.direct import PointGrasp, couple_points
from graspfx.spatial import NOTHING, dot

FloatArray = NDArray[np.float64]

HOLD, LINEAR, MODEL = 0, 1, 2  # predictions between two samples
METHODS = {"hold": HOLD, "linear": LINEAR, "model": MODEL}
MOST_NUMBER = 2.0**53


class PortTank(Record):
    """Energy tank of a port, which supplies the work that the port's forces do on the operator."""

    level: float  # energy E [J]
    most: float  # capacity [J]
    share: float  # factor on the port's forces in this tick
    given: float  # net energy given to the operator so far [J]
    exchanged: float  # energy exchanged in either direction [J]


class HostState(Record):
    """State of the bridge of one host."""

    fingers: int  # n
    dimensions: int  # d
    size: int  # size n d
    grasp_entries: int
    words: int  # address of the record
    host_first: int  # first word of the host's slots, and words per slot; the header of the record may be overwritten
    host_size: int
    loop_first: int
    loop_size: int
    period: float  # sampling period T [s]
    method: int  # HOLD, LINEAR or MODEL
    silence: float  # ticks without a new sample after which forces fade
    largest: float  # largest plausible force of a finger [N]
    stride: float  # largest displacement of a finger per tick that the tanks assume [m]
    tanked: bool
    push_model: float  # stiffness that the operator feels between two samples [N/m]
    squeeze_model: float
    number: float  # number of the last sample used
    seen: float  # number of the last sample examined
    begun: float  # ticks since the first sample
    age: float  # ticks since the last sample was taken
    time: float  # time of the last sample by the host's clock [s]
    interval: float  # time between the last two samples [s]
    lost: float  # number of lost samples
    late: float
    written: float  # number of samples written by the loop
    quiet: int  # 1 + reason why forces fade, 0 without one
    code: int  # reason why forces are zero immediately, 0 without one
    push_tank: PortTank
    squeeze_tank: PortTank
    most: Floats = floats("fingers")  # largest force of each finger [N]
    external: Floats = floats("size")  # external forces of the last sample, on the operator [N]
    internal: Floats = floats("size")
    external_slope: Floats = floats("size")  # [N/s]
    internal_slope: Floats = floats("size")
    origin: Floats = floats("size")  # position of the operator for that sample [m]
    before: Floats = floats("size")  # position of the operator in the last tick [m]
    pushed: Floats = floats("size")  # external forces of this tick, on the operator [N]
    squeezed: Floats = floats("size")  # internal forces of this tick, on the operator [N]
    grasp: PointGrasp = room("grasp_entries")


@dataclass(frozen=True, eq=False)
class HostPart:
    """Record shared with a host, and state of the bridge.

    Attributes:
        record: Record shared with the host.
        block: Block of the bridge's state, a `HostState`.
    """

    record: HostRecord
    block: FloatArray

    @property
    def state(self) -> HostState:
        """State of the bridge, a view of `block`."""
        return HostState(self.block)


def make_host(table: Any, most: FloatArray, dimensions: int, period: float) -> HostPart:
    """Create the bridge of a scene's table `host`, and the record that it shares with the host.

    Args:
        table: Table `host` of the scene.
        most: Largest force of each finger, (n,) [N].
        dimensions: Number of dimensions d.
        period: Sampling period T [s].
    """
    n, d = len(most), dimensions
    grasp = size_for(PointGrasp, count=n, dimensions=d)
    counts = {"fingers": n, "dimensions": d, "size": n * d, "grasp_entries": grasp}
    block = zeros(size_for(HostState, **counts))
    state = HostState(block)
    for name, count in counts.items():
        setattr(state, name, count)
    state.period, state.method, state.silence = period, METHODS[table.predict], table.silence / period
    state.largest, state.stride, state.tanked = table.largest, table.speed * period, table.tank > 0.0
    state.push_model, state.squeeze_model = table.push_stiffness, table.squeeze_stiffness
    for tank in (state.push_tank, state.squeeze_tank):
        tank.level, tank.most, tank.share = table.tank, max(table.tank_room, table.tank), 1.0
    state.array(HostState.most)[:] = most
    state.grasp.count, state.grasp.dimensions, state.grasp.tolerance = n, d, 1e-6
    state.grasp.external_stiffness = 1.0
    record = make_record(table.name, n, d, period)
    state.host_first, state.host_size, state.loop_first, state.loop_size = record.words[HOST_FIRST : LOOP_SIZE + 1]
    return HostPart(record, block)


@kernel
def host_forces(state: GraspState, host: HostState) -> int:
    """Exchange samples and set the fingers' forces of this tick; return 0, or a code if all forces are zero."""
    settle(state, host)
    host.age += 1.0
    take_sample(host)
    if host.number > 0.0:
        host.begun += 1.0
    if host.number > 0.0 and host.age > host.silence and host.quiet == 0:
        host.quiet = 1
    elif host.quiet == 1 and host.age <= host.silence:  # the host sent a new sample before the forces were zero
        host.quiet = 0
    if host.code == 0:
        predict(state, host)
        bound(host)
        host.push_tank.share = pay(host, host.push_tank, host.pushed)
        host.squeeze_tank.share = pay(host, host.squeeze_tank, host.squeezed)
    write_sample(state, host)
    hand_over(state, host)
    return host.code


@kernel
def tell_fault(host: HostState, code: int) -> None:
    """Report a fault of the run to the host."""
    words = Floats(host.buffer, host.words)
    words[CODE] = code
    words[STATE] = FAULT


# Tanks ----------------------------------------------------------------------------------------------------------------


@kernel
def settle(state: GraspState, host: HostState) -> None:
    """Subtract the work that the displayed forces did in the last tick from the tanks."""
    d = host.dimensions
    pushed = squeezed = 0.0
    for i, finger in enumerate(state.fingers):
        wanted = shown = push = squeeze = 0.0
        for a in range(d):
            k = i * d + a
            f, step = host.pushed[k] + host.squeezed[k], finger.position[a] - host.before[k]
            wanted += f * f
            shown -= f * finger.force[a]  # the safety chain scales the whole force of a finger
            push += host.pushed[k] * step
            squeeze += host.squeezed[k] * step
        if wanted > 0.0:
            pushed += shown / wanted * push
            squeezed += shown / wanted * squeeze
        for a in range(d):
            host.before[i * d + a] = finger.position[a]
    book(host.push_tank, pushed)
    book(host.squeeze_tank, squeezed)


@kernel
def book(tank: PortTank, work: float) -> None:
    """Subtract work on the operator [J] from a tank; negative work fills it up to its capacity."""
    tank.level = min(tank.level - work, tank.most)
    tank.given += work
    tank.exchanged += abs(work)


@kernel
def pay(host: HostState, tank: PortTank, forces: Floats) -> float:
    """Scale the forces of a port to the energy in its tank; return the factor."""
    if not host.tanked:
        return 1.0
    d, price = host.dimensions, 0.0
    for i in range(host.fingers):
        square = 0.0
        for a in range(d):
            square += forces[i * d + a] * forces[i * d + a]
        price += math.sqrt(square) * host.stride
    share = 1.0
    if price > tank.level:
        share = max(tank.level, 0.0) / price
        for k in range(host.size):
            forces[k] *= share
    return share


@kernel
def bound(host: HostState) -> None:
    """Limit each finger's force by a common factor on all internal forces.

    If external forces alone exceed a limit, a common factor reduces all external forces too.
    """
    d = host.dimensions
    outer = squeeze = 1.0
    for i in range(host.fingers):
        most, square = host.most[i], 0.0
        for a in range(d):
            square += host.pushed[i * d + a] * host.pushed[i * d + a]
        if square > most * most:
            outer = min(outer, most / math.sqrt(square))
    for i in range(host.fingers):
        most, along, square = host.most[i], 0.0, 0.0
        rest = most * most
        for a in range(d):
            e, s = outer * host.pushed[i * d + a], host.squeezed[i * d + a]
            rest -= e * e
            along += e * s
            square += s * s
        if square + 2.0 * along > rest:  # |e + l s| = L
            root = along * along + square * max(rest, 0.0)
            squeeze = min(squeeze, max((math.sqrt(root) - along) / square, 0.0))
    if outer < 1.0 or squeeze < 1.0:
        for k in range(host.size):
            host.pushed[k] *= outer
            host.squeezed[k] *= squeeze


# Samples --------------------------------------------------------------------------------------------------------------


@kernel
def take_sample(host: HostState) -> None:
    """Use the host's newest sample if it is new and complete."""
    words = Floats(host.buffer, host.words)
    number = words[HOST_NUMBER]
    if number == host.seen or not (number >= 1.0 and number < MOST_NUMBER):
        return
    size = host.host_size
    slot = Floats(host.buffer, host.words + host.host_first + size * (int(number) % SLOTS))
    total = 0.0
    for k in range(size - 1):
        total += slot[k]
    if total != total:  # NaN
        host.code = NOT_FINITE
        return
    if slot[0] != number or slot[size - 1] != total:
        return  # the slot is being written
    host.seen = number
    if number < host.number:
        host.late += 1.0
        return
    if host.number > 0.0:
        host.lost += number - host.number - 1.0
    if slot[2] != 0.0:
        code = int(slot[2])
        if code == HOST_ENDED:
            host.quiet = 1 + HOST_ENDED
            return
        host.code = code
        return
    check_sample(host, slot)
    if host.code == 0:
        keep_sample(host, slot, number)


@kernel
def check_sample(host: HostState, slot: Floats) -> None:
    """Set `host.code` if a value of the sample is not finite, or if a finger's force is implausibly large."""
    d, m = host.dimensions, host.size
    for i in range(host.fingers):
        square, sums = 0.0, 0.0
        for a in range(d):
            k = SAMPLE + i * d + a
            f = slot[k] + slot[k + m]
            square += f * f
            sums += slot[k] * 0.0 + slot[k + m] * 0.0 + slot[k + 2 * m] * 0.0
        if sums != 0.0:
            host.code = NOT_FINITE
        elif square > host.largest * host.largest:
            host.code = TOO_LARGE


@kernel
def keep_sample(host: HostState, slot: Floats, number: float) -> None:
    """Store a sample's forces, their slopes since the previous sample, and the positions to which they refer."""
    m, interval = host.size, slot[1] - host.time
    known = host.number > 0.0 and interval > 0.1 * host.period
    for k in range(m):
        external, internal = slot[SAMPLE + k], slot[SAMPLE + m + k]
        host.external_slope[k] = (external - host.external[k]) / interval if known else 0.0
        host.internal_slope[k] = (internal - host.internal[k]) / interval if known else 0.0
        host.external[k], host.internal[k] = external, internal
        host.origin[k] = slot[SAMPLE + 2 * m + k]
    host.interval = interval if known else 0.0
    host.time, host.number, host.age = slot[1], number, 0.0


@kernel
def predict(state: GraspState, host: HostState) -> None:
    """Compute the forces of both ports in this tick.

    They are held, extrapolated, or predicted with the environment's stiffness.
    """
    ahead = 0.0
    if host.method == LINEAR:
        ahead = min(host.age * host.period, host.interval)
    for k in range(host.size):
        host.pushed[k] = host.external[k] + ahead * host.external_slope[k]
        host.squeezed[k] = host.internal[k] + ahead * host.internal_slope[k]
    if host.method == MODEL and host.number > 0.0:
        d, grasp = host.dimensions, host.grasp
        pushes = squeezes = False
        for i, finger in enumerate(state.fingers):
            for a in range(d):
                k = i * d + a
                grasp.points[k] = finger.position[a]
                grasp.displacement[k] = finger.position[a] - host.origin[k]
                grasp.rate[k] = 0.0
                pushes = pushes or host.external[k] != 0.0
                squeezes = squeezes or host.internal[k] != 0.0
        couple_points(grasp)  # P (x - x_sample)
        for k in range(host.size):
            moved = grasp.force[k]
            if pushes:
                host.pushed[k] -= host.push_model * moved
            if squeezes:
                host.squeezed[k] -= host.squeeze_model * (grasp.displacement[k] - moved)


@kernel
def hand_over(state: GraspState, host: HostState) -> None:
    """Write the forces to the fingers; a force on the object is the negative of the force on the operator."""
    d = host.dimensions
    for i, finger in enumerate(state.fingers):
        for a in range(d):
            k = i * d + a
            finger.local[a] = -(host.pushed[k] + host.squeezed[k]) if host.code == 0 else 0.0
        for a in range(d, 4):
            finger.local[a] = 0.0
        f = finger.local.vector
        finger.touching = dot(f, f) > 0.0
        finger.law_force = f
        finger.elastic = NOTHING
        finger.displacement = NOTHING
        finger.rate = NOTHING


@kernel
def write_sample(state: GraspState, host: HostState) -> None:
    """Write the operator's state, and the forces displayed in the last tick, to the record."""
    words = Floats(host.buffer, host.words)
    number, size, m, d = host.written + 1.0, host.loop_size, host.size, host.dimensions
    slot = Floats(host.buffer, host.words + host.loop_first + size * (int(number) % SLOTS))
    slot[0] = number
    slot[1] = host.written * host.period
    slot[2] = host.age * host.period
    slot[3] = host.push_tank.level
    slot[4] = host.squeeze_tank.level
    slot[5] = host.lost
    slot[6] = host.late
    for i, finger in enumerate(state.fingers):
        for a in range(d):
            k = LOOP_SAMPLE + i * d + a
            slot[k] = finger.position[a]
            slot[k + m] = finger.velocity[a]
            slot[k + 2 * m] = -finger.force[a]
    total = 0.0
    for k in range(size - 1):
        total += slot[k]
    slot[size - 1] = total
    words[LOOP_NUMBER] = number
    host.written = number
