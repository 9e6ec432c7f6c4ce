"""Turns of the native loop: wait, request readings, read, compute, write, record. The Python loop takes the same steps.

`beat` runs the turns of any scene whose devices have C functions. Fields of `Beat` that are places, like those of
`World`, are indices into the arena of the scene. The source of `beat` can also be interpreted.
"""

from __future__ import annotations

import ctypes
import struct
import time
from functools import cache
from typing import TYPE_CHECKING, Any

from graspfx.compile.kernel import kernel
from graspfx.compile.kernel_marks import bound_late
from graspfx.compile.memory import Scattered, address_of
from graspfx.compile.own_sources import footprint
from graspfx.compile.program import program_source
from graspfx.compile.records import Floats, Many, Record, floats, many
from graspfx.loop.realtime.loop_log import LoopState, note_times
from graspfx.loop.realtime.pacing import (
    DRIVEN,
    ClockState,
    EndState,
    arrive,
    count_in,
    go_on,
    is_late,
    set_deadline,
)
from graspfx.loop.realtime.readings import LATE, NO_ASK, NO_WRITE, PortState, fail, limit_forces, take_sample
from graspfx.loop.realtime.ring import Word
from graspfx.loop.safety.safety_state import Pace
from graspfx.loop.step import copy
from graspfx.loop.world import NATIVE, NONE, ServoState, World, latch

if TYPE_CHECKING:
    from graspfx.compile.native import Native

# Words of a loop: whether the loop ends before the next tick, whether forces must decay and the loop then ends, whether
# forces are no longer allowed, whether the loop is over for a vendor's thread, whether a call of the loop is in
# progress, and the number of the device call in progress (`DevicePort.place`), 0 if there is none.
HALT, STOP, QUIT, OVER, BUSY, CALLED = range(6)
WORDS = 6
HEAD, STOPPED, SKIPPED = Word.HEAD.value, Word.STOP.value, Word.SKIPPED.value  # places in the ring's words


class Port(Record):
    """Device in the loop."""

    state: int  # place of the device's `PortState`
    functions: Floats = floats("8")  # ask, read, write, stop: bits of a function's address and context, not numbers


class Beat(Record):
    """Memory of the loop; fields without another description are places in the arena."""

    tick: int  # next tick
    span: int  # number of ticks whose rows fit into the ring
    code: int  # address of `steps`
    nested: bool  # whether devices are written in the reverse order of asking
    rows: int
    world: int
    clock: int
    end: int
    times: int  # place of the recorded times, NONE if they are not recorded
    own: int  # words of the loop
    ring: int  # words shared with the recorder
    port_count: int
    ports: Many[Port] = many("port_count")


@kernel
def beat(loop: Beat) -> int:
    """Run one turn if a vendor's thread calls the loop, otherwise all turns until the loop ends.

    If the loop is over (`OVER`), no turn is run and the result is 0; otherwise the result is 1.
    """
    publish(loop.buffer, loop.own + BUSY, 1)
    again = 1
    if peek(loop.buffer, loop.own + OVER) != 0:
        again = 0
    else:
        driven = ClockState(loop.buffer, loop.clock).mode == DRIVEN
        runs = goes_on(loop)
        while runs != 0:
            turn(loop, loop.tick)
            loop.tick += 1
            runs = 0
            if not driven:
                runs = goes_on(loop)
    publish(loop.buffer, loop.own + BUSY, 0)
    return again


@kernel
def goes_on(loop: Beat) -> int:
    """Return 1 if another tick must be run, otherwise 0."""
    if peek(loop.buffer, loop.own + HALT) != 0:
        return 0
    servo = ServoState(loop.buffer, World(loop.buffer, loop.world).servo)
    stop = peek(loop.buffer, loop.own + STOP) + peek(loop.buffer, loop.ring + STOPPED)
    faulted = 0.0
    if servo.faulted:
        faulted = 1.0
    return go_on(EndState(loop.buffer, loop.end), loop.tick, stop, faulted)


@kernel
def turn(loop: Beat, k: int) -> None:
    """Wait for the deadline of tick k, exchange with the devices, and run the tick."""
    world, clock = World(loop.buffer, loop.world), ClockState(loop.buffer, loop.clock)
    servo = ServoState(loop.buffer, world.servo)
    deadline = set_deadline(clock, now(loop.buffer))
    if deadline > now(loop.buffer):  # waiting for a past time takes tens of microseconds
        sleep_until(loop.buffer, deadline)
    began = now(loop.buffer)
    left_out = arrive(clock, began)
    if is_late(clock) != 0:
        if not servo.faulted:
            stop_all(loop, k)
        latch(servo, k, NATIVE, loop.port_count, LATE)
    end, pace = EndState(loop.buffer, loop.end), Pace(loop.buffer, world.pace)
    times = LoopState(loop.buffer, loop.times)
    if world.pace != NONE and end.is_begun:
        pace.resting = True
    if loop.times != NONE:
        note_times(times, clock)
    read_all(loop, servo, k, left_out + 1)
    if loop.times != NONE:
        times.io_read = now(loop.buffer) - began
    if servo.faulted:  # devices are stopped before anything else is computed
        stop_all(loop, k)
        run_tick(loop, k, 0)
    else:
        run_tick(loop, k, 0)
        display(loop, servo, k)
    head = peek(loop.buffer, loop.ring + HEAD)
    sound = not servo.faulted
    run_tick(loop, k, head % loop.span)
    if sound and servo.faulted:  # the computation failed and cannot continue, so forces end now
        stop_all(loop, k)
    publish(loop.buffer, loop.ring + HEAD, head + 1)
    publish(loop.buffer, loop.ring + SKIPPED, clock.skipped)
    count_in(clock.duration, now(loop.buffer) - began)


@kernel
def run_tick(loop: Beat, k: int, row: int) -> None:
    """Run a part of tick k: in the first call, up to the writing of devices; in the second call, the rest."""
    run_steps(loop.buffer, loop.code, loop.rows, loop.world, k, row)


@kernel
def read_all(loop: Beat, servo: ServoState, k: int, periods: int) -> None:
    """Request a reading of each device that has not failed, then read all these devices."""
    memory, world = Floats(loop.buffer, 0), World(loop.buffer, loop.world)
    devices, pace = world.devices, Pace(loop.buffer, world.pace)
    misses = pace.misses
    for i, port in enumerate(loop.ports):
        memory[devices[i].state] = 0.0  # the device could not be read
        note_fresh(loop, world, i, 0.0)
        if world.pace != NONE:
            pace.elapsed = periods
        state = PortState(loop.buffer, port.state)
        if not state.is_gone:
            code = call_port(loop, port, i, 0, state.raw.offset)
            state.is_asked = True
            if code < 0:
                latch(servo, k, NATIVE, i, fail(state, NO_ASK, code))
    for i, port in enumerate(loop.ports):
        state = PortState(loop.buffer, port.state)
        if not state.is_gone:
            code = call_port(loop, port, i, 1, state.raw.offset)
            why = take_sample(state, code, periods)
            if why != 0:
                latch(servo, k, NATIVE, i, why)
            else:
                place = devices[i].state
                copy(memory, place + 1, state.placed.offset, 2 * state.entries)
                note_fresh(loop, world, i, 1.0 if state.is_fresh else 0.0)
                if world.pace != NONE:
                    misses[i] = 0.0 if state.is_fresh else misses[i] + 1.0
                memory[place] = 1.0
    publish(loop.buffer, loop.own + CALLED, 0)


@kernel
def note_fresh(loop: Beat, world: World, i: int, fresh: float) -> None:
    """Record whether the fingers of device i have a new sample."""
    if loop.times != NONE:
        device, entries = world.devices[i], LoopState(loop.buffer, loop.times).fresh
        for c in range(device.first, device.first + device.count):
            entries[world.channels[c].finger] = fresh


@kernel
def display(loop: Beat, servo: ServoState, k: int) -> None:
    """Write the forces to the devices until a device fails; then stop all devices.

    If Python has stopped the devices because a device function did not return, and this function returns later, all
    devices are stopped again.
    """
    if not servo.faulted:
        began = now(loop.buffer)
        for j in range(loop.port_count):
            if not servo.faulted:
                write(loop, servo, closing(loop, j), k)
        publish(loop.buffer, loop.own + CALLED, 0)
        if loop.times != NONE:
            times = LoopState(loop.buffer, loop.times)
            times.io_write = now(loop.buffer) - began
    if servo.faulted or peek(loop.buffer, loop.own + QUIT) != 0:
        stop_all(loop, k)


@kernel
def stop_all(loop: Beat, k: int) -> None:
    """Stop all devices, beginning with the devices that have not failed; if a stop fails, repeat it once."""
    for j in range(loop.port_count):
        i = closing(loop, j)
        state = PortState(loop.buffer, loop.ports[i].state)
        if not state.is_gone:
            code = stop_port(loop, state, i)
            if code < 0:
                state.stop_code = code
                state.stop_tick = k
                state.is_gone = True
    for j in range(loop.port_count):
        i = closing(loop, j)
        state = PortState(loop.buffer, loop.ports[i].state)
        if state.is_gone and stop_port(loop, state, i) >= 0:
            state.stop_code = 0
    publish(loop.buffer, loop.own + CALLED, 0)


@kernel
def stop_port(loop: Beat, state: PortState, i: int) -> int:
    """Stop a device and return the code that its function returns.

    In a vendor's thread, a force can only be set in a frame, which `ask` opens and `write` or `stop` closes. If the
    frame is not open, `ask` is therefore called first.
    """
    if loop.nested and not state.is_asked:
        call_port(loop, loop.ports[i], i, 0, state.raw.offset)
    state.is_asked = False
    return call_port(loop, loop.ports[i], i, 3, state.forces.offset)


@kernel
def closing(loop: Beat, j: int) -> int:
    """Return the index of the j-th device in the order in which devices are written and stopped."""
    return loop.port_count - 1 - j if loop.nested else j


@kernel
def write(loop: Beat, servo: ServoState, i: int, k: int) -> None:
    """Write the forces of device i, reduced to the device's limit; a non-finite force is a fault and is not written."""
    port, device = loop.ports[i], World(loop.buffer, loop.world).devices[i]
    state = PortState(loop.buffer, port.state)
    half = state.entries
    copy(Floats(loop.buffer, 0), state.orders.offset, device.state + 1 + 2 * half, half)
    why = limit_forces(state)
    if why == 0 and peek(loop.buffer, loop.own + QUIT) == 0:
        code = call_port(loop, port, i, 2, state.forces.offset)
        if code < 0:
            why = fail(state, NO_WRITE, code)
        else:
            state.is_asked = False
    if why != 0:
        latch(servo, k, NATIVE, i, why)


@kernel
def call_port(loop: Beat, port: Port, i: int, which: int, block: int) -> int:
    """Call a function of device i, and publish the number of this call while it is in progress.

    Args:
        loop: Memory of the loop.
        port: Device i.
        i: Index of the device.
        which: 0 for ask, 1 for read, 2 for write, 3 for stop.
        block: Place of the block that is passed to the function.
    """
    publish(loop.buffer, loop.own + CALLED, 1 + 4 * i + which)
    return call_device(loop.buffer, port.functions.offset + 2 * which, block)


# Functions that a compiled program defines itself (graspfx/compile/llvm/late.py); interpreted kernels call these ------


@bound_late
def now(buffer: Any) -> float:
    """Return the time of the monotonic clock [s]."""
    return time.clock_gettime(time.CLOCK_MONOTONIC)


@bound_late
def sleep_until(buffer: Any, deadline: float) -> int:
    """Wait until a time of the monotonic clock [s]."""
    while (left := deadline - now(buffer)) > 0.0:
        time.sleep(left)
    return 0


@bound_late
def call_device(buffer: Any, words: int, block: int) -> int:
    """Call a C function with its context and the address of a block; return its code, 0 if there is no function."""
    function, context = _bits(buffer[words]), _bits(buffer[words + 1])
    return int(_CALLED(function)(context, buffer.address(block))) if function else 0


@bound_late
def run_steps(buffer: Any, code: int, rows: int, world: int, k: int, row: int) -> int:
    """Run a part of tick k by `steps` (see `run_tick`)."""
    return int(buffer.steps(k, 1, row))


@bound_late
def peek(buffer: Any, place: int) -> int:
    """Return a word that another thread may write."""
    return _bits(buffer[place])


@bound_late
def publish(buffer: Any, place: int, number: int) -> int:
    """Write a word; a thread that reads the new value also sees everything that was written before."""
    buffer[place] = struct.unpack("d", struct.pack("q", number))[0]
    return 0


_CALLED = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p)


def _bits(number: float) -> int:
    """Reinterpret the bits of a float as an integer."""
    return int(struct.unpack("q", struct.pack("d", number))[0])


class Reach(Scattered):
    """All memory of a loop as one buffer, for interpreted kernels.

    Args:
        memory: Memory of the scene.
        arrays: Arrays that are not in this memory.
        steps: Function that runs ticks, like `Engine.run`.
    """

    def __init__(self, memory: Any, arrays: Any, steps: Any) -> None:
        super().__init__(memory, arrays)
        self._base, self.steps = address_of(memory.floats), steps

    def address(self, place: int) -> int:
        """Return the address of an entry."""
        return self._base + 8 * place


@cache
def program() -> Native:
    """Load the compiled program of the native loop; if it is not found, compile and store it."""
    from graspfx.compile import library
    from graspfx.compile.native import compiled

    return library.find(footprint(beat)) or compiled(source())


def source() -> str:
    """Return the Python source of the program run(arena, loop) of the native loop."""
    return program_source("def run(loop):\n    return beat(arena, loop)", {"beat": beat}, ["arena"])
