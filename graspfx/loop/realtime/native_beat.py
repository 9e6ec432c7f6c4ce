"""A turn of a loop without Python: wait, ask, read, compute, write, record; Python's own loop does the same.

It is written as a stage over the loop's parts, which is unfolded into a program, as the tick is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.unfold.stage import stage
from graspfx.loop.realtime.native_clock import ClockState, arrive, count_tick, is_late, set_deadline
from graspfx.loop.realtime.native_machine import call, now, peek, publish, run, sleep_until
from graspfx.loop.realtime.native_port import (
    LATE,
    NO_ASK,
    NO_WRITE,
    PortState,
    fail,
    limit_forces,
    take_sample,
)
from graspfx.loop.tick.memory import NATIVE, ServoState, latch

FloatArray = NDArray[np.float64]


@dataclass(eq=False, repr=False)
class NativePort:
    """A device in the loop; each array is a piece of a longer memory."""

    index: int
    place: int  # number of its first call, as `DevicePort.place`
    state: PortState
    ask: int  # words of its functions in the table
    read: int
    write: int
    stop: int
    is_gone: FloatArray  # (1,), of the state, as the next ones
    is_fresh: FloatArray
    seen_position: FloatArray  # (k d,)
    seen_velocity: FloatArray
    orders: FloatArray
    stop_code: FloatArray  # (1,)
    stop_tick: FloatArray  # (1,)
    readable: FloatArray  # (1,), of the tick's memory, as the next ones
    position: FloatArray  # (k d,)
    velocity: FloatArray
    command: FloatArray
    misses: FloatArray | None  # (1,), of the safety chain, as the next one
    elapsed: FloatArray | None
    fresh: Sequence[FloatArray]  # (1,) of each finger, of the loop's memory


@dataclass(eq=False, repr=False)
class LoopTimes:
    """Where a loop notes the times of a tick, each (1,)."""

    wall: FloatArray
    late: FloatArray
    skipped: FloatArray
    io_read: FloatArray
    io_write: FloatArray


@dataclass(eq=False, repr=False)
class NativeBeat:
    """All parts of the beat."""

    clock: ClockState
    wall: FloatArray  # (1,), of the clock, as the next ones
    late: FloatArray
    left_out: FloatArray
    skipped: FloatArray
    servo: ServoState
    faulted: FloatArray  # (1,)
    ports: Sequence[NativePort]
    closing: Sequence[NativePort]  # the same, in the order in which they are written
    table: FloatArray  # addresses
    own: FloatArray  # words of the loop
    quit: int  # place of the one that ends all forces
    call: int  # and of the one that says which call of a device has the thread, 0 for none
    begin: int  # words of the program in the table
    end: int
    words: FloatArray  # of the ring
    head: int  # places in it
    skips: int
    span: int  # ticks of the ring
    is_resting: FloatArray  # (1,), of the loop's end
    resting: FloatArray | None  # (1,), of the safety chain: forces decay
    times: LoopTimes | None


@stage
def turn(beat: NativeBeat, k: int) -> None:
    """Run tick k."""
    deadline = set_deadline(beat.clock, now(beat.table))
    if deadline > now(beat.table):  # to wait for what is past takes tens of microseconds
        sleep_until(beat.table, deadline)
    began = now(beat.table)
    left_out = arrive(beat.clock, began)
    late = is_late(beat.clock)
    if late != 0:
        if beat.faulted[0] == 0.0:
            stop_all(beat, k)
        latch(beat.servo, k, NATIVE, len(beat.ports), LATE)
    if beat.resting is not None and beat.is_resting[0] != 0.0:
        beat.resting[0] = 1.0
    note_times(beat)
    read_all(beat, k, left_out + 1)
    if beat.times is not None:
        beat.times.io_read[0] = now(beat.table) - began
    if beat.faulted[0] != 0.0:  # before anything else is computed
        stop_all(beat, k)
        run(beat.table, beat.begin, k, 0)
    else:
        run(beat.table, beat.begin, k, 0)
        display(beat, k)
    head = peek(beat.words, beat.head)
    before = beat.faulted[0]
    run(beat.table, beat.end, k, head % beat.span)
    if before == 0.0 and beat.faulted[0] != 0.0:  # what has moved cannot go on: its forces end now
        stop_all(beat, k)
    publish(beat.words, beat.head, head + 1)
    publish(beat.words, beat.skips, int(beat.skipped[0]))
    count_tick(beat.clock, now(beat.table) - began)


@stage
def note_times(beat: NativeBeat) -> None:
    """Note when a tick is."""
    times = beat.times
    if times is not None:
        times.wall[0] = beat.wall[0]
        times.late[0] = beat.late[0]
        times.skipped[0] = beat.left_out[0]
        times.io_write[0] = 0.0


@stage
def read_all(beat: NativeBeat, k: int, periods: int) -> None:
    """Ask all devices, then read them; one that has failed is neither asked nor read again."""
    for port in beat.ports:
        port.readable[0] = 0.0
        if port.elapsed is not None:
            port.elapsed[0] = periods
        for entry in port.fresh:
            entry[0] = 0.0
        if port.is_gone[0] == 0.0:
            publish(beat.own, beat.call, port.place)
            code = call(beat.table, port.ask)
            if code < 0:
                why = fail(port.state, NO_ASK, code)
                latch(beat.servo, k, NATIVE, port.index, why)
    for port in beat.ports:
        if port.is_gone[0] == 0.0:
            publish(beat.own, beat.call, port.place + 1)
            code = call(beat.table, port.read)
            why = take_sample(port.state, code, periods)
            if why != 0:
                latch(beat.servo, k, NATIVE, port.index, why)
            else:
                copy(port.position, port.seen_position)
                copy(port.velocity, port.seen_velocity)
                for entry in port.fresh:
                    entry[0] = port.is_fresh[0]
                if port.misses is not None:
                    if port.is_fresh[0] != 0.0:
                        port.misses[0] = 0.0
                    else:
                        port.misses[0] += 1.0
                port.readable[0] = 1.0
    publish(beat.own, beat.call, 0)


@stage
def display(beat: NativeBeat, k: int) -> None:
    """Write all forces, up to the first device that fails; once there is a fault stop all.

    Where Python has stopped the devices beside a function that did not return, its late return ends in zero, too.
    """
    if beat.faulted[0] == 0.0:
        began = now(beat.table)
        for port in beat.closing:
            if beat.faulted[0] == 0.0:
                write(beat, port, k)
        publish(beat.own, beat.call, 0)
        if beat.times is not None:
            beat.times.io_write[0] = now(beat.table) - began
    if beat.faulted[0] != 0.0 or peek(beat.own, beat.quit) != 0:
        stop_all(beat, k)


@stage
def stop_all(beat: NativeBeat, k: int) -> None:
    """Stop all devices, sound ones first."""
    for port in beat.closing:
        if port.is_gone[0] == 0.0:
            stop(beat, port, k)
    for port in beat.closing:
        if port.is_gone[0] != 0.0:
            publish(beat.own, beat.call, port.place + 3)
            call(beat.table, port.stop)
    publish(beat.own, beat.call, 0)


@stage
def write(beat: NativeBeat, port: NativePort, k: int) -> None:
    """Write a device's forces, which are finite and within its limit."""
    copy(port.orders, port.command)
    why = limit_forces(port.state)
    if why == 0 and peek(beat.own, beat.quit) == 0:
        publish(beat.own, beat.call, port.place + 2)
        code = call(beat.table, port.write)
        if code < 0:
            why = fail(port.state, NO_WRITE, code)
    if why != 0:
        latch(beat.servo, k, NATIVE, port.index, why)


@stage
def stop(beat: NativeBeat, port: NativePort, k: int) -> None:
    """Stop a device that answered until now."""
    publish(beat.own, beat.call, port.place + 3)
    code = call(beat.table, port.stop)
    if code < 0:
        port.stop_code[0] = code
        port.stop_tick[0] = k
        port.is_gone[0] = 1.0


@stage
def copy(to: FloatArray, source: FloatArray) -> None:
    """Copy entries one by one."""
    for a in range(len(to)):
        to[a] = source[a]
