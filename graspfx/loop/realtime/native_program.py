"""The program of a loop without Python: its memories, its table of addresses, and its machine code."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.joined import joined
from graspfx.compile.native import Native, Spread
from graspfx.compile.records import size_for, start_of
from graspfx.compile.unfold.rewrite import keep_stages
from graspfx.compile.unfold.unfold import unfold
from graspfx.loop.arena import Arena
from graspfx.loop.device_calls import Calls
from graspfx.loop.device_exchange import CALLS, DevicePort
from graspfx.loop.realtime.loop_state import LoopState
from graspfx.loop.realtime.native_beat import LoopTimes, NativeBeat, NativePort, turn
from graspfx.loop.realtime.native_clock import ClockState
from graspfx.loop.realtime.native_end import EndState, go_on
from graspfx.loop.realtime.native_machine import CALL, FUNCTIONS, RUN, machine_functions, peek
from graspfx.loop.realtime.native_port import PortState
from graspfx.loop.realtime.ring import Ring, Word
from graspfx.loop.safety.chain import SafetyChain
from graspfx.loop.safety.safety_state import Pace
from graspfx.loop.tick.script import Script
from graspfx.loop.world import ServoState

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Own words: whether the loop ends before the next tick, is to stop softly, may bring no force any more; and which call
# of a device has its thread, as `DevicePort.place` counts them, 0 for none.
HALT, STOP, QUIT, CALLED = range(4)
TEXT = """
def turn({arrays}, k):
    {lines}
def beat({arrays}, k, count):
    for i in range(count):
        if {peek}({own}, {halt}) != 0:
            return i
        if {go_on}({end}, 0, k, {peek}({own}, {stop}) + {peek}({words}, {quit}), {faulted}) == 0:
            return i
        turn({arrays}, k)
        k += 1
    return count
"""


class NativeProgram:
    """The machine code of a loop, beat(k, count), and the memories that it works on; it gives the ticks done.

    Args:
        arena: of the scene, whose ticks the loop calls.
        ports: of all devices, in their order.
        ring: that rows are written to.
        safety: the chain between law and devices; without one the loop ends at once.
        nested: whether devices are written in the reverse of the order in which they are asked.

    Attributes:
        clock, end, states: memories, as records; a state for each port.
        words: own ones, HALT, STOP, QUIT and CALLED.
    """

    def __init__(
        self,
        arena: Arena,
        ports: Sequence[DevicePort],
        ring: Ring,
        safety: SafetyChain | None,
        *,
        nested: bool = False,
    ) -> None:
        self.words: IntArray = np.zeros(4, dtype=np.int64)
        self.clock = ClockState(np.zeros(size_for(ClockState)))
        self.end = EndState(np.zeros(size_for(EndState)))
        self.states = [PortState(_state_memory(each)) for each in ports]
        self._table: IntArray = np.zeros(RUN + 4 * CALL * len(ports), dtype=np.int64)
        self._keep: list[object] = []
        script = Script()
        script.memory("clock", self.clock.buffer)
        end = script.memory("end", self.end.buffer)
        servo = script.memory("servo", arena.own)
        if safety is not None:
            script.memory("pace", safety.pace)
        if arena.loop is not None:
            script.memory("loop", arena.loop)
        table = self._table.view(np.float64)
        script.memory("table", table)
        self._ring_name = script.memory("ring", ring.words.view(np.float64))
        words = self.words.view(np.float64)
        own = script.memory("own", words)
        for state, port in zip(self.states, ports, strict=True):
            script.memory("native", state.buffer)
            script.memory("port", port.port.memory)
        wires = [_port(i, s, p, arena, script) for i, (s, p) in enumerate(zip(self.states, ports, strict=True))]
        ring_words = script.arrays[self._ring_name]
        beat = self._beat(arena, wires, table, words, ring_words, ring.span, safety, nested=nested)
        lines = [line.text for line in unfold(turn, script, beat=beat)]
        keep_stages()
        faulted = f"{servo}[{start_of(ServoState, 'faulted')}]"
        source = TEXT.format(
            arrays=", ".join(script.arrays), lines="\n    ".join(lines), peek=script.kernel(peek),
            go_on=script.kernel(go_on), words=self._ring_name, quit=Word.STOP.value, own=own, halt=HALT, stop=STOP,
            end=end, faulted=faulted,
        )  # fmt: skip
        functions = machine_functions()
        machine = {name: functions[f.__name__] for name, f in script.kernels.items() if f in FUNCTIONS}
        kernels = {name: each for name, each in script.kernels.items() if name not in machine}
        self._native: Native = joined(source, kernels, script.arrays, machine=machine)
        self._bound = self._native.bind(*(script.arrays[name] for name in self._native.arrays))

    def _beat(
        self,
        arena: Arena,
        wires: list[NativePort],
        table: FloatArray,
        own: FloatArray,
        words: FloatArray,
        span: int,
        safety: SafetyChain | None,
        *,
        nested: bool,
    ) -> NativeBeat:
        """Wire the parts of a turn."""
        servo, clock = ServoState(arena.own), self.clock
        return NativeBeat(
            clock=clock,
            wall=clock.array(ClockState.wall),
            late=clock.array(ClockState.late),
            left_out=clock.array(ClockState.left_out),
            skipped=clock.array(ClockState.skipped),
            servo=servo,
            faulted=servo.array(ServoState.faulted),
            ports=wires,
            closing=wires[::-1] if nested else wires,
            table=table,
            own=own,
            quit=QUIT,
            call=CALLED,
            tick=0,
            words=words,
            head=Word.HEAD.value,
            skips=Word.SKIPPED.value,
            span=span,
            is_resting=self.end.array(EndState.is_begun),
            resting=None if safety is None else Pace(safety.pace).array(Pace.resting),
            times=None if arena.loop is None else _times(arena.loop),
        )

    def write_to(self, ring: Ring, steps: Spread, world: int) -> None:
        """Write to a ring, by `steps` that are bound to its rows, for the world at a place."""
        self._bound = self._native.rebind(self._bound, self._ring_name, ring.words.view(np.float64))
        self._table[:RUN] = steps.address, ctypes.addressof(steps.table), world
        self._keep += [steps, ring]

    def connect(self, i: int, calls: Calls) -> None:
        """Let a port's functions be these, which are kept as long as the program."""
        state, at = self.states[i], RUN + 4 * CALL * i
        raw, forces = state.array(PortState.raw).ctypes.data, state.array(PortState.forces).ctypes.data
        words: list[int] = []
        for function, block in ((calls.ask, raw), (calls.read, raw), (calls.write, forces), (calls.stop, forces)):
            words += [function, calls.context, block]
        self._table[at : at + 4 * CALL] = words
        self._keep.append(calls)

    def run(self, k: int, count: int) -> int:
        """Run ticks from k on with the interpreter's lock released; give how many were done."""
        return self._bound.long(k, count)

    @property
    def spread(self) -> Spread:
        """The program for other machine code."""
        assert self._bound.spread is not None
        return self._bound.spread


def _state_memory(port: DevicePort) -> FloatArray:
    k, d = port.port.position.shape
    memory = np.zeros(size_for(PortState, entries=k * d, dimensions=d))
    state = PortState(memory)
    state.fingers, state.dimensions, state.entries = k, d, k * d
    return memory


def _port(i: int, state: PortState, port: DevicePort, arena: Arena, script: Script) -> NativePort:
    at, own, n = RUN + 4 * CALL * i, port.port, state.entries
    fresh: list[FloatArray] = []
    if arena.loop is not None:
        whole = LoopState(arena.loop).array(LoopState.fresh)
        fresh = [whole[f : f + 1] for f in port.fingers]
    return NativePort(
        index=i,
        place=1 + len(CALLS) * i,
        state=state,
        ask=at,
        read=at + CALL,
        write=at + 2 * CALL,
        stop=at + 3 * CALL,
        is_gone=state.array(PortState.is_gone),
        is_fresh=state.array(PortState.is_fresh),
        seen_position=state.array(PortState.position),
        seen_velocity=state.array(PortState.velocity),
        orders=state.array(PortState.orders),
        stop_code=state.array(PortState.stop_code),
        stop_tick=state.array(PortState.stop_tick),
        readable=own.memory[:1],
        position=own.memory[1 : 1 + n],
        velocity=own.memory[1 + n : 1 + 2 * n],
        command=own.memory[1 + 2 * n : 1 + 3 * n],
        misses=own.misses,
        elapsed=own.elapsed,
        fresh=fresh,
    )


def _times(memory: FloatArray) -> LoopTimes:
    loop, names = LoopState(memory), ("wall", "late", "skipped", "io_read", "io_write")
    return LoopTimes(*(loop.array(getattr(LoopState, name)) for name in names))
