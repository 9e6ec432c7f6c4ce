"""Real-time loop in which machine code runs the ticks in a separate thread, while Python monitors the thread."""

from __future__ import annotations

import time
from collections.abc import Callable
from threading import Thread
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.records import size_for
from graspfx.errors import DeviceError
from graspfx.loop.arena import Arena
from graspfx.loop.columns import RowTaker, RunFault
from graspfx.loop.device import FRESH, REPEAT, Calls, CallsDevice, DrivingDevice
from graspfx.loop.device_exchange import ZERO, DeviceExchange, DevicePort, call_of
from graspfx.loop.engine import Compiled
from graspfx.loop.realtime.beat import BUSY, CALLED, HALT, OVER, QUIT, STOP, WORDS, Beat, Port, program
from graspfx.loop.realtime.pacing import DRIVEN, PACED, Pacer, SoftEnd
from graspfx.loop.realtime.process import Exits, Interruption
from graspfx.loop.realtime.readings import NO_ASK, NO_READ, NO_WRITE, Guards, patience, reading_text
from graspfx.loop.realtime.ring import SLOTS, Ring, RingRecorder, Word, create
from graspfx.loop.servo_parts import Parts
from graspfx.system import scheduling

IntArray = NDArray[np.int64]

POLL = 0.005  # time between two checks [s]
PATIENCE = 0.1  # longest wait for a running tick before devices are stopped from outside [s]
STALLED = 50  # number of checks without a tick and without a device call, after which the loop counts as stalled
STALLED_PERIODS = 20  # number of periods after which the loop counts as stalled, if this is longer
ACTIONS = {NO_ASK: "cannot be asked", NO_READ: "cannot be read", NO_WRITE: "cannot be written"}
_LOST: list[object] = []  # memory of loops that did not end: a vendor's function may still write to it


@runtime_checkable
class Writer(Protocol):
    """Function `stop` of `NativeLoop.run` that may also write to the memory of the run."""

    @property
    def has_news(self) -> bool:
        """Whether the function must be called to write to the memory."""
        ...

    def __call__(self) -> bool: ...


class NativeLoop:
    """Loop for scenes whose devices all have C functions, so that no Python code runs between two ticks.

    Args:
        arena: Arena of the scene.
        code: Compiled program that runs ticks.
        devices: Exchange with all devices, in the order of the scene.
        parts: Parts of the scene.
        guards: Limits beyond which a run with hardware ends in a fault.

    Attributes:
        beat: Memory of the loop.
        words: Words of the loop, HALT to CALLED (`graspfx.loop.realtime.beat`).
        hang: Message about a device call or a tick that takes too long; empty if there is none.
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
        self._devices, self._safety, self._arena = devices, parts.safety, arena
        self._ring = Ring(create(parts.layout.width), parts.layout.width, parts.every)
        self._driver = next((each.device for each in self._ports if isinstance(each.device, DrivingDevice)), None)
        self.words: IntArray = np.zeros(WORDS, dtype=np.int64)
        self.beat = loop = Beat(np.zeros(size_for(Beat, port_count=len(self._ports))).data)
        loop.world, loop.times, loop.own = arena.offset, arena.place(arena.loop), self._place(self.words)
        loop.port_count, loop.nested = len(self._ports), self._driver is not None
        for port, device in zip(loop.ports, self._ports, strict=True):
            port.state = self._place(device.readings.memory)
        self._program = program()
        self._bound = self._program.bind(arena.memory.floats)
        self._pacer, self._end = Pacer(parts.period), SoftEnd(None, parts.period, 0)  # pacer and end of the last run
        self._calls: list[Calls] = []
        self._noted = [False] * len(self._ports)  # whether it was recorded that a device could not be stopped
        self._drained = 0  # ticks whose rows the recorder has
        self._seen, self._looks = (-1, 0), 0  # ticks and call at the last check; number of checks since the last change
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
        """Run ticks from tick k on; return the number of ticks that were run.

        If a device function does not return, the loop ends and `hang` contains a message; the caller must then stop the
        devices.

        Args:
            k: First tick.
            ticks: Largest number of ticks to run.
            recorder: Recorder of the rows.
            stop: Function called every few milliseconds; it returns whether forces must decay and the loop must end. If
                it is a `Writer` with `has_news`, it is called while the loop pauses between two ticks.
            pacer: Pacer of the run; afterwards, its state is the same as if it had waited for each tick.
            look: Function called every few milliseconds with the number of ticks that have been run.
            mode: PACED, or FREE for ticks without waiting; ignored if a vendor's thread calls the loop.

        Raises:
            DeviceError: If a device has no C functions, or a device function has not returned since an earlier run.
            Interruption: If a signal requires that forces are zero immediately, without decay.
        """
        ring = recorder.ring if isinstance(recorder, RingRecorder) else self._ring
        self._begin(k, k + ticks, ring, pacer, DRIVEN if self._driver is not None else mode)
        worker = self._worker(k)
        try:
            worker.start()
            while worker.goes_on(POLL):
                look(self._drain(recorder, ring))
                self.hang = self._standstill(ring)
                if not self.hang and isinstance(stop, Writer) and stop.has_news:
                    worker = self._between_ticks(worker, stop, ring, look)
                if self.hang:
                    break
                if stop is not None and stop():
                    self.words[STOP] = 1
                if self._exits.at_once:
                    raise Interruption(self._exits.cause)
        finally:
            self.words[HALT] = 1
            if not worker.end(0.0 if self.hang else PATIENCE):
                self.words[QUIT] = 1  # no force is written after the function returns
                _LOST.append((self, ring, recorder, worker))
            done = self._drain(recorder, ring) - k
            pacer.mode = PACED
            self._end.tell(recorder)
            look(k + done)
        return done

    def _worker(self, k: int) -> _Worker | _Driven:
        """Create the thread that runs ticks from tick k on."""
        self.beat.tick, place = k, self._place(self.beat.buffer)
        if self._driver is None:
            return _Worker(lambda: self._bound.long(place))
        return _Driven(self, np.array([self._arena.memory.floats.ctypes.data, place]), self._driver)

    def _between_ticks(
        self, worker: _Worker | _Driven, stop: Writer, ring: Ring, look: Callable[[int], None]
    ) -> _Worker | _Driven:  # fmt: skip
        """Pause the loop between two ticks, call `stop`, and continue the loop in the thread that is returned."""
        self.words[HALT] = 1
        if not worker.pause(PATIENCE):
            self.hang = self._hang_text(PATIENCE)
            return worker
        look(int(ring.words[Word.HEAD]))
        stop()
        self.words[HALT] = 0
        if isinstance(worker, _Worker):
            worker = self._worker(int(ring.words[Word.HEAD]))
            worker.start()
        return worker

    def _standstill(self, ring: Ring) -> str:
        """Return a message about a device call or a tick that takes too long; empty if there is none.

        The duration is the number of checks times their interval, because the whole machine may pause.
        """
        seen = int(ring.words[Word.HEAD]), int(self.words[CALLED])
        self._looks = 0 if seen != self._seen else self._looks + 1
        self._seen, still = seen, max(STALLED * POLL, STALLED_PERIODS * self._period)
        limit = patience(self._period, self._period * self._guards.late) if seen[1] else still
        return self._hang_text(self._looks * POLL) if self._looks * POLL > limit else ""

    def _hang_text(self, time: float) -> str:
        call = call_of(int(self.words[CALLED]), [each.name for each in self._ports])
        return f"{call} has not returned for {time:.2g} s; {ZERO}" if call else f"no tick for {time:.2g} s; {ZERO}"

    @property
    def name(self) -> str:
        """Name of the loop: "driven" if a vendor's thread calls it, otherwise "native"."""
        return "native" if self._driver is None else "driven"

    @property
    def last(self) -> int:
        """Index of the first tick that the loop does not run."""
        return self._end.last

    @property
    def _exits(self) -> Exits:
        return self._devices.exits  # of the present run, which are created after this object

    @property
    def stop_faults(self) -> list[RunFault]:
        """Faults of devices that could not be stopped, without faults that were returned before."""
        faults = []
        for i, port in enumerate(self._ports):
            state = port.readings.state
            if state.stop_code and not self._noted[i]:
                self._noted[i] = True
                faults.append(RunFault(state.stop_tick, stop_text(port, self._calls[i])))
        return faults

    def why(self, index: int, code: int) -> str:
        """Return the message for a fault.

        Args:
            index: Index of the device; the number of devices if ticks came too late.
            code: Fault code of the device.
        """
        if index == len(self._ports):
            return self._pacer.late_text
        return port_text(self._ports[index], self._calls[index], code)

    def _begin(self, k: int, last: int, ring: Ring, pacer: Pacer, mode: int) -> None:
        """Prepare the ticks k, ..., last - 1."""
        if self.words[QUIT]:
            raise DeviceError(self.hang or "a device's C function has not returned since the previous run")
        self._calls = [_calls(each) for each in self._ports]
        for port, device, calls in zip(self.beat.ports, self._ports, self._calls, strict=True):
            peak = device.device.features.peak_force
            device.readings.state.force = np.inf if peak is None else peak
            words = [w for f in (calls.ask, calls.read, calls.write, calls.stop) for w in (f, calls.context)]
            port.array(Port.functions).view(np.int64)[:] = words
        self._pacer, self._end = pacer, SoftEnd(self._safety, self._period, last)
        pacer.mode, pacer.most = mode, self._guards.late
        self._running = ring  # ring that the loop writes to
        loop = self.beat
        loop.clock, loop.end = self._place(pacer.buffer), self._place(self._end.buffer)
        loop.code, loop.rows = self._code.entry, self._place(ring.rows)
        loop.ring, loop.span = self._place(ring.words), ring.span
        if ring is self._ring:
            ring.words[Word.HEAD] = k
        self._drained = k
        self.words[[HALT, STOP, OVER, CALLED]] = 0
        self._seen, self._looks, self.hang = (-1, 0), 0, ""

    def _place(self, memory: Any) -> int:
        """Return the place of an array in the arena of the scene."""
        return self._arena.memory.place(np.asarray(memory).reshape(-1).view(np.float64))

    def _drain(self, recorder: RowTaker, ring: Ring) -> int:
        """Pass new rows to the recorder; return the number of ticks that have been run."""
        head = int(ring.words[Word.HEAD])
        if isinstance(recorder, RingRecorder):
            recorder.ticks = head  # a reader of the ring already has them
            return head
        since, lost = self._drained, 0
        while self._drained < head:
            rows, place, left = recorder.space()
            at = self._drained % ring.span
            count = min(left, head - self._drained, ring.span - at)
            first = -self._drained % ring.every  # ticks until the first one with a row
            if first < count:
                n = (count - first - 1) // ring.every + 1
                to, source = (place + first) // ring.every, (at + first) // ring.every
                rows[to : to + n] = ring.rows[source : source + n]
                valid = -(-int(ring.words[Word.HEAD]) // ring.every) + 1 - SLOTS  # first row not being overwritten
                late = min(max(valid - (self._drained + first) // ring.every, 0), n)
                rows[to : to + late] = np.nan
                lost += late
            self._drained += count
            recorder.take(count)
            recorder.drain()
        if lost:
            recorder.fault(since, f"{lost} rows are lost: the recorder did not read for {ring.span} ticks")
        return head


class _Worker:
    """Thread of GraspFX in which the loop runs."""

    def __init__(self, loop: Callable[[], object]) -> None:
        priority = scheduling.real_time_policy()
        self._error: BaseException | None = None

        def run() -> None:
            try:
                if priority is not None:
                    scheduling.set_policy(*priority)
                loop()
            except BaseException as error:  # noqa: BLE001 - raised where the thread is awaited
                self._error = error

        self._thread = Thread(target=run, name="graspfx-loop", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def goes_on(self, wait: float) -> bool:
        self._thread.join(wait)
        return self._thread.is_alive()

    def end(self, wait: float) -> bool:
        """Wait at most `wait` seconds for the end of the thread; return whether it has ended."""
        if self._thread.ident is not None:
            self._thread.join(wait)
        if self._error is not None:
            raise self._error
        return not self._thread.is_alive()

    pause = end  # another thread continues


class _Driven:
    """Thread of a vendor's library, which calls the loop once per period.

    Args:
        loop: Loop that the thread calls.
        table: Arguments of the program.
        driver: Device whose vendor's thread calls the loop.
    """

    def __init__(self, loop: NativeLoop, table: IntArray, driver: DrivingDevice) -> None:
        self._loop, self._table, self._driver = loop, table, driver

    def start(self) -> None:
        self._driver.drive(program().callback, self._table.ctypes.data)

    def goes_on(self, wait: float) -> bool:
        time.sleep(wait)
        return self._loop.beat.tick < self._loop.last and self._driver.drives

    def pause(self, wait: float) -> bool:
        """Wait at most `wait` seconds until no tick of the halted loop is in progress; return whether none is."""
        end = time.monotonic() + wait
        while self._loop.words[BUSY]:
            if time.monotonic() > end:
                return False
            time.sleep(1e-4)
        return True

    def end(self, wait: float) -> bool:
        """End the calls of the loop by the thread; return whether the last call ended within `wait` seconds."""
        self._loop.words[OVER] = 1
        return self._driver.release(wait)


def _calls(port: DevicePort) -> Calls:
    calls = port.device.calls if isinstance(port.device, CallsDevice) else None
    if calls is None:
        raise DeviceError(f"{port.name} offers C functions, but returns none after opening")
    return calls


# Fault messages -------------------------------------------------------------------------------------------------------


def port_text(port: DevicePort, calls: Calls, why: int) -> str:
    """Return the message for a device's fault with the cause `why`."""
    state = port.readings.state
    if why in ACTIONS:
        return f"{port.name} {ACTIONS[why]}: {call_text(port, calls, state.code)}; {ZERO}"
    return f"{port.name} {reading_text(state, why)}; {ZERO}"


def stop_text(port: DevicePort, calls: Calls) -> str:
    """Return the message for a device that cannot be stopped."""
    return (
        f"{port.name} cannot be stopped, and its force may remain; switch the device off: "
        f"{call_text(port, calls, port.readings.state.stop_code)}; {ZERO}"
    )


def call_text(port: DevicePort, calls: Calls, code: int) -> str:
    """Return a text for a code that a C function has returned, from `fault_text` of the device or its adapter."""
    if code > 0:
        expected = f"{FRESH} (new sample), {REPEAT} (no new sample) or below 0 (fault)"
        return f"its C function returned {code}, expected {expected}"
    for owner in (port.device, calls.keep):
        text = getattr(owner, "fault_text", None)
        if callable(text):
            return str(text(code))
    return f"its C function returned {code}"
