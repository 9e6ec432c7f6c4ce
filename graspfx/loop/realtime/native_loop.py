"""The loop without Python: machine code runs the ticks in a thread of its own, and Python looks on."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable
from threading import Thread
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.emission import address
from graspfx.errors import DeviceError
from graspfx.loop.arena import Arena
from graspfx.loop.device_calls import Calls, CallsDevice, DrivingDevice
from graspfx.loop.device_exchange import ZERO, DeviceExchange, DevicePort, call_of
from graspfx.loop.engine import Compiled
from graspfx.loop.parts import Parts
from graspfx.loop.realtime.exits import Exits, Interruption
from graspfx.loop.realtime.guards import Guards, patience
from graspfx.loop.realtime.native_clock import DRIVEN, PACED, ClockState
from graspfx.loop.realtime.native_machine import DRIVEN as CALLBACK
from graspfx.loop.realtime.native_machine import engine
from graspfx.loop.realtime.native_port import PortState
from graspfx.loop.realtime.native_program import CALLED, HALT, QUIT, STOP, NativeProgram
from graspfx.loop.realtime.native_texts import clock_text, port_text, stop_text
from graspfx.loop.realtime.pacing import Pacer
from graspfx.loop.realtime.ring import Ring, RingRecorder, Word, create
from graspfx.loop.realtime.soft_end import decay_ticks
from graspfx.loop.recording.header import REST, RunFault
from graspfx.loop.recording.row_taker import RowTaker
from graspfx.system import scheduling

IntArray = NDArray[np.int64]

POLL = 0.005  # between two looks [s]
PATIENCE = 0.1  # for a tick that goes on, before devices are stopped beside it [s]
STALLED = 50  # looks without a tick, and
STALLED_PERIODS = 20  # periods, after which the loop is taken to stand still where no function of a device has it
ADDRESS, TABLE, TICK, END, BUSY = range(5)  # words of a callback
FOREVER = 1 << 62  # ticks: the loop's end says when
_LOST: list[object] = []  # memories of loops that did not end: a vendor's function may still write there


@runtime_checkable
class Writer(Protocol):
    """A `stop` that writes into the memories of a run now and then."""

    @property
    def has_news(self) -> bool:
        """Whether it has something to write."""
        ...

    def __call__(self) -> bool: ...


class NativeLoop:
    """Ticks of a scene whose every device offers C functions: no Python runs between two of them.

    Args:
        arena: of the scene.
        code: its program.
        devices: all of them, in their order.
        parts: of the scene.
        guards: of hardware.

    Attributes:
        hang: which call of a device did not return, in words; empty without.
    """

    def __init__(
        self,
        arena: Arena,
        code: Compiled,
        devices: DeviceExchange,
        parts: Parts,
        guards: Guards,
    ) -> None:
        self._code, self._ports, self._period, self._guards = code, devices.ports, parts.period, guards
        self._devices, self._safety = devices, parts.safety
        self._ring = Ring(create(parts.layout.width), parts.layout.width, parts.every)
        self._driver = next((each.device for each in self._ports if isinstance(each.device, DrivingDevice)), None)
        self.program = NativeProgram(arena, self._ports, self._ring, parts.safety, nested=self._driver is not None)
        self._calls: list[Calls] = []
        self._noted = [False] * len(self._ports)  # whether a device could not be stopped
        self._drained = 0  # ticks whose rows the recorder has
        self._seen, self._looks = (-1, 0), 0  # ticks and call at the last look, and looks since one was new
        self.hang = ""

    def run(
        self,
        k: int,
        ticks: int,
        recorder: RowTaker,
        stop: Callable[[], bool] | None,
        pacer: Pacer,
        look: Callable[[int], None],
        mode: int = PACED,
    ) -> int:
        """Run ticks from k on, as many if nothing ends them before; give how many there were.

        A function of a device that does not return ends them (`hang`): whoever runs the loop stops the devices then.

        Args:
            k: the first tick.
            ticks: to run.
            recorder: of the rows.
            stop: asked every few milliseconds, whether forces are to decay and the loop to end; one that `Writes` is
                asked between two ticks.
            pacer: of the run, which is as if it had waited for each tick.
            look: called every few milliseconds with the count of ticks so far.
            mode: PACED, or FREE for ticks that follow one another at once.

        Raises:
            DeviceError: a device without functions, or one of an earlier run still has the loop.
            Interruption: no force may come any more.
        """
        ring = recorder.ring if isinstance(recorder, RingRecorder) else self._ring
        self._begin(k, k + ticks, ring, pacer, DRIVEN if self._driver is not None else mode)
        worker = self._worker(k)
        try:
            worker.start()
            while worker.goes_on(POLL):
                look(self._drain(recorder, ring))
                pacer.skipped = self.program.clock.skipped
                self.hang = self._standstill(ring)
                if not self.hang and isinstance(stop, Writer) and stop.has_news:
                    worker = self._between_ticks(worker, stop, ring, look)
                if self.hang:
                    break
                if stop is not None and stop():
                    self.program.words[STOP] = 1
                if self._exits.at_once:
                    raise Interruption(self._exits.cause)
        finally:
            self.program.words[HALT] = 1
            if not worker.end(0.0 if self.hang else PATIENCE):
                self.program.words[QUIT] = 1  # once the function returns no force follows
                _LOST.append((self, ring, recorder, worker))
            done = self._drain(recorder, ring) - k
            self._finish(pacer)
            self._note_rest(recorder)
            look(k + done)
        return done

    def _worker(self, k: int) -> _Worker | _Driven:
        if self._driver is None:
            return _Worker(self.program, k)
        return _Driven(self.program, k, self._driver)

    def _between_ticks(
        self, worker: _Worker | _Driven, stop: Writer, ring: Ring, look: Callable[[int], None]
    ) -> _Worker | _Driven:  # fmt: skip
        """Let who stops the loop write into its memories, while it waits; go on with another thread."""
        self.program.words[HALT] = 1
        if not worker.pause(PATIENCE):
            self.hang = self._hang_text(PATIENCE)
            return worker
        look(int(ring.words[Word.HEAD]))
        stop()
        self.program.words[HALT] = 0
        if isinstance(worker, _Worker):
            worker = self._worker(int(ring.words[Word.HEAD]))
            worker.start()
        return worker

    def _standstill(self, ring: Ring) -> str:
        """Say what holds the loop up for too long, empty as long as nothing does.

        Looks are counted instead of time, for a machine may stand still as a whole.
        """
        seen = int(ring.words[Word.HEAD]), int(self.program.words[CALLED])
        self._looks = 0 if seen != self._seen else self._looks + 1
        self._seen, still = seen, max(STALLED * POLL, STALLED_PERIODS * self._period)
        limit = patience(self._period, self._period * self._guards.late) if seen[1] else still
        return self._hang_text(self._looks * POLL) if self._looks * POLL > limit else ""

    def _hang_text(self, time: float) -> str:
        call = call_of(int(self.program.words[CALLED]), [each.name for each in self._ports])
        return f"{call} has not returned for {time:.2g} s; {ZERO}" if call else f"no tick for {time:.2g} s; {ZERO}"

    def _note_rest(self, recorder: RowTaker) -> None:
        """Note from which tick on forces decayed."""
        end = self.program.end
        if end.is_begun:
            recorder.change(end.start, {REST: "stop" if end.is_stopped else "end"})

    @property
    def name(self) -> str:
        """Name of the loop: "driven" where a device's maker has the clock, else "native"."""
        return "native" if self._driver is None else "driven"

    @property
    def _exits(self) -> Exits:
        return self._devices.exits  # those of the run, which come after this was made

    @property
    def stop_faults(self) -> list[RunFault]:
        """Faults of devices that could not be stopped, which were not told before."""
        faults = []
        for i, (port, state) in enumerate(zip(self._ports, self.program.states, strict=True)):
            if state.stop_code and not self._noted[i]:
                self._noted[i] = True
                faults.append(RunFault(state.stop_tick, stop_text(port, state, self._calls[i])))
        return faults

    def why(self, index: int, code: int) -> str:
        """Say why a device is a fault; the one after the last is the clock."""
        if index == len(self._ports):
            return clock_text(self.program.clock)
        return port_text(self._ports[index], self.program.states[index], self._calls[index], code)

    def _begin(self, k: int, last: int, ring: Ring, pacer: Pacer, mode: int) -> None:
        """Make all memories what Python's own loop would begin with."""
        if self.program.words[QUIT]:
            raise DeviceError(self.hang or "a device's C function of the run before has not returned")
        self._calls = [_calls(each) for each in self._ports]
        for i, calls in enumerate(self._calls):
            self.program.connect(i, calls)
            _hand_over(self._ports[i], self.program.states[i], self._period, self._guards)
        self._code.write_to(ring.rows)
        self.program.write_to(ring, self._code.spread, self._code.world)
        if ring is self._ring:
            ring.words[Word.HEAD] = k
        self._drained = k
        clock = self.program.clock
        clock.mode, clock.period, clock.most = mode, self._period, self._guards.late
        clock.is_begun = pacer.deadline is not None
        clock.deadline, clock.start = pacer.deadline or 0.0, pacer.start
        clock.row, clock.skipped = pacer.row, pacer.skipped
        clock.latest, clock.most_late = pacer.latest, pacer.lateness.most
        for field in (ClockState.lateness, ClockState.duration):
            clock.array(field)[:] = 0.0
        end, decay = self.program.end, decay_ticks(self._period)
        end.decay, end.last = decay if self._safety is not None and decay > 1 else 0, last
        end.is_stopped = end.is_begun = False
        self.program.words[[HALT, STOP, CALLED]] = 0
        self._seen, self._looks, self.hang = (-1, 0), 0, ""

    def _finish(self, pacer: Pacer) -> None:
        """Make pacer and readings what they would be after Python's own loop."""
        clock = self.program.clock
        if clock.is_begun:
            pacer.deadline, pacer.start = clock.deadline, clock.start
        pacer.row, pacer.skipped, pacer.left_out = clock.row, clock.skipped, clock.left_out
        pacer.wall, pacer.late, pacer.latest = clock.wall, clock.late, clock.latest
        pacer.lateness.merge(clock.array(ClockState.lateness).astype(int).tolist(), clock.most_late)
        for port, state in zip(self._ports, self.program.states, strict=True):
            port.is_gone = port.is_gone or bool(state.is_gone)
            port.entry = None
            port.readings.go_on(
                state.array(PortState.sample), samples=state.samples, repeats=state.repeats, row=state.row
            )  # fmt: skip

    def _drain(self, recorder: RowTaker, ring: Ring) -> int:
        """Hand the recorder the rows that it has not got; give the count of ticks so far."""
        head = int(ring.words[Word.HEAD])
        if isinstance(recorder, RingRecorder):
            recorder.ticks = head  # whoever reads the ring has them already
            return head
        lost = max(0, head - self._drained - ring.span + ring.every)
        if lost:
            recorder.fault(self._drained, f"{lost} rows are lost: the recorder was not there for {ring.span} ticks")
        while self._drained < head:
            rows, place, left = recorder.space()
            at = self._drained % ring.span
            count = min(left, head - self._drained, ring.span - at)
            first = -self._drained % ring.every  # ticks to the first one with a row
            if first < count:
                n = (count - first - 1) // ring.every + 1
                to, source = (place + first) // ring.every, (at + first) // ring.every
                rows[to : to + n] = ring.rows[source : source + n] if lost <= 0 else np.nan
            lost -= count
            self._drained += count
            recorder.take(count)
            recorder.drain()
        return head


class _Worker:
    """A thread in which the loop runs."""

    def __init__(self, program: NativeProgram, k: int) -> None:
        priority = scheduling.real_time_policy()
        self._error: BaseException | None = None

        def run() -> None:
            try:
                if priority is not None:
                    scheduling.set_policy(*priority)
                program.run(k, FOREVER)
            except BaseException as error:  # noqa: BLE001 - told to who waits for the thread
                self._error = error

        self._thread = Thread(target=run, name="graspfx-loop", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def goes_on(self, wait: float) -> bool:
        self._thread.join(wait)
        return self._thread.is_alive()

    def end(self, wait: float) -> bool:
        """Wait for the thread's end, so long [s]; tell whether it has ended."""
        if self._thread.ident is not None:
            self._thread.join(wait)
        if self._error is not None:
            raise self._error
        return not self._thread.is_alive()

    pause = end  # another thread goes on


class _Driven:
    """A vendor's thread, which calls the loop once a period."""

    def __init__(self, program: NativeProgram, k: int, driver: DrivingDevice) -> None:
        spread = program.spread
        self.words: IntArray = np.zeros(5, dtype=np.int64)
        self.words[[ADDRESS, TABLE, TICK]] = spread.address, ctypes.addressof(spread.table), k
        self._owner, self._driver, self._end = spread, driver, program.end

    def start(self) -> None:
        self._driver.drive(address(engine(), CALLBACK), self.words.ctypes.data)

    def goes_on(self, wait: float) -> bool:
        time.sleep(wait)
        return int(self.words[TICK]) < self._end.last and self._driver.drives

    def pause(self, wait: float) -> bool:
        """Wait until no tick of a loop that halts goes on, so long [s]; tell whether it is so."""
        end = time.monotonic() + wait
        while self.words[BUSY]:
            if time.monotonic() > end:
                return False
            time.sleep(1e-4)
        return True

    def end(self, wait: float) -> bool:
        """Take the loop back from the thread; tell whether it has let go."""
        self.words[END] = 1
        return self._driver.release(wait)


def _calls(port: DevicePort) -> Calls:
    calls = port.device.calls if isinstance(port.device, CallsDevice) else None
    if calls is None:
        raise DeviceError(f"{port.name} offers C functions and gives none once it is open")
    return calls


def _hand_over(port: DevicePort, state: PortState, period: float, guards: Guards) -> None:
    """Let a device's memory in the loop go on from its readings so far."""
    readings, peak = port.readings, port.device.features.peak_force
    state.hold, state.speed, state.period = guards.hold, guards.speed, period
    state.force = np.inf if peak is None else peak
    state.is_begun, state.row, state.periods = readings.standing
    state.samples, state.repeats, state.is_gone = readings.samples, readings.repeats, port.is_gone
    state.array(PortState.sample)[:] = np.concatenate([readings.position.ravel(), readings.velocity.ravel()])
    state.array(PortState.raw)[:] = state.array(PortState.sample)
    frame = port.fitting.frame
    state.is_framed = frame is not None
    if frame is not None:
        state.scale = frame.scale
        state.array(PortState.origin)[:], state.array(PortState.axes)[:] = frame.origin, frame.axes.ravel()
    state.ramp = 0.0
    if port.entry is not None:
        state.ramp, state.ramp_ticks = port.entry.duration, port.entry.ticks
        state.array(PortState.depth)[:] = port.entry.offset.ravel()
