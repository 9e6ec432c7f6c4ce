"""The servo: runs the tick of a scene, as many at a time as what is no kernel allows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx import log
from graspfx.compile.records import start_of
from graspfx.errors import GraspFXError, InputError
from graspfx.loop.coupling_report import coupling_report
from graspfx.loop.device import is_hardware
from graspfx.loop.device_exchange import DeviceExchange, DevicePort, device_name
from graspfx.loop.energy.observer import Observer
from graspfx.loop.guest_rounds import GuestRounds, settle_guests
from graspfx.loop.hand_tables import fill_table
from graspfx.loop.kernel_faults import finger_names, kernel_fault, object_names
from graspfx.loop.parts import BodyGroup, DeviceWiring, GraspedPart, Parts, PlantWiring
from graspfx.loop.plant import FusedPlant
from graspfx.loop.played import Playback
from graspfx.loop.realtime.guards import GUARDS, Guards
from graspfx.loop.realtime.loop_log import LoopLog
from graspfx.loop.realtime.native_choice import why_python
from graspfx.loop.realtime.pacing import Pacer, WallClock, late_text
from graspfx.loop.realtime.refusal import require_simulations
from graspfx.loop.realtime.soft_end import SoftEnd
from graspfx.loop.recording.header import RunFault
from graspfx.loop.recording.layout import Layout
from graspfx.loop.recording.row_taker import RowTaker
from graspfx.loop.safety.chain import SafetyChain
from graspfx.loop.tick.engine import engine_for
from graspfx.loop.tick.memory import CHUNK, FOREIGN, NATIVE, ServoState, latch
from graspfx.loop.tick.number_watch import Watch
from graspfx.loop.tick.programs import Engine, Generic, Interpreted, MachineCode
from graspfx.loop.tick.rehearsal import rehearse
from graspfx.loop.tick.script import Tick
from graspfx.loop.tick.text import write
from graspfx.loop.update import Update

if TYPE_CHECKING:
    from graspfx.loop.realtime.native_loop import NativeLoop

FloatArray = NDArray[np.float64]
Stop = Callable[[], bool]


class Servo:
    """Runs a scene that has been built.

    A motion that is not finite, a device, body or plant that raises one of our errors, or a projection that does not
    settle latches a fault: from that tick on every force is zero, and what had been computed in it is not displayed.

    Where all parts are kernels any number of ticks is one call; a device, body or plant that is none takes one call a
    tick (two for a device) and its own methods between. The recording is the same, bit by bit. What a guest is told
    after a tick the next one takes, and after the last one `run` itself.

    Args:
        engine: "auto", "generic", "compiled" or "interpreted".
        record: whether ticks are recorded; else `run` takes no recorder.
        every: ticks from one recorded row to the next.
        safety: the chain between law and devices, if the scene has one.
        guards: of devices that are no simulations.
    """

    def __init__(
        self,
        period: float,
        layout: Layout,
        stations: Sequence[DeviceWiring],
        objects: Sequence[GraspedPart],
        movers: Sequence[BodyGroup],
        plants: Sequence[PlantWiring] = (),
        observers: Sequence[Observer] = (),
        engine: str = "auto",
        *,
        record: bool = True,
        every: int = 1,
        safety: SafetyChain | None = None,
        guards: Guards = GUARDS,
    ) -> None:
        self.ticks = 0  # time is ticks x period, never a reading of the wall: two runs are bit-identical
        self.period, self.layout, self.every, self.guards = period, layout, every, guards
        self.stations, self.objects, self.movers, self.plants = stations, objects, movers, plants
        self.observers = observers  # one for each object, or none at all
        self.safety = safety
        self.fault: RunFault | None = None
        self._nowhere = np.empty((0, layout.width))
        self.row = np.zeros(layout.width)  # of the last tick that was recorded
        self._kind, self._record = engine, record
        self._engine: Engine | None = None  # made at the first tick
        self.watch = Watch(objects)  # of numbers that only `write` changes
        self._foreign_faults: list[str] = []  # faults of parts that are no kernels
        self.hardware = [device_name(each, layout.fingers) for each in stations if is_hardware(each.device)]
        self._stop_faults: list[str] = []  # of devices that could not be stopped, not recorded yet
        self._io: DeviceExchange | LoopLog | Playback  # that readings come from
        self.native: NativeLoop | None = None  # of ticks without Python, made ready by `prepare`
        self._periods = 1  # of the wall's clock since the last tick

    @property
    def coupling(self) -> dict[str, Any]:
        """Report of the objects' couplings on the run so far, as entries of an `Outcome`."""
        return coupling_report(self.objects)

    @property
    def faulted(self) -> bool:
        return self.fault is not None

    @property
    def hang(self) -> str:
        """Which C function of a device did not return, in words; empty without."""
        return "" if self.native is None else self.native.hang

    @property
    def engine(self) -> Engine:
        """Engine of the ticks."""
        return self._ready()

    @property
    def parts(self) -> Parts:
        """All that runs."""
        return Parts(
            self.period, self.layout, self.stations, self.objects, self.movers, self.plants, self.observers, self.every,
            self.safety,
        )  # fmt: skip

    @property
    def script(self) -> Tick:
        """The tick as it runs."""
        self._ready()
        return self._tick

    def prepare(self) -> DeviceExchange:
        """Make ready all that takes time, before hardware is opened; give the devices in Python."""
        engine = self._ready()
        rehearse(engine, self._tick, self.layout.width)
        if self._record and isinstance(engine, MachineCode) and not self.why_python:
            from graspfx.loop.realtime.native_loop import NativeLoop

            self.native = NativeLoop(self._tick, engine, self._devices, self.parts, self.guards)
        return self._devices

    @property
    def why_python(self) -> str:
        """Why Python runs between two ticks on the wall's clock; empty if it does not."""
        return why_python(self.stations, self.layout.fingers, self._kind, self.period, self.script)

    def run(
        self,
        ticks: int,
        recorder: RowTaker | None,
        stop: Stop | None = None,
        pacer: Pacer | None = None,
    ) -> None:
        """Run that many ticks, each recorded; fewer if `stop` says so.

        It is asked before each call of the engine: before every tick as it stands, or where parts are no kernels, and
        before every 64 that are compiled.

        Args:
            ticks: to run.
            recorder: of what happens.
            stop: tells whether to stop.
            pacer: that each tick waits for, on the wall's clock; without one ticks follow one another at once.

        Raises:
            InputError: no recorder for a servo that records, or one for a servo that does not; a number was written
                into a block that the program has folded in, on which a switch of the block depends, or by which the
                recording divides forces; hardware without a pacer.
        """
        if pacer is None:
            require_simulations(self.hardware)
        if (recorder is not None) is not self._record:
            raise InputError("recorder", recorder, "a Recorder, or None for a servo that was made with record=False")
        engine = self._ready()
        self.watch.require()
        engine.expect(ticks)
        if pacer is None:
            self._run(ticks, recorder, stop)
        elif self.native is not None and recorder is not None and isinstance(pacer.clock, WallClock):
            self._run_native(self.native, ticks, recorder, stop, pacer)
        else:
            self._run_paced(ticks, recorder, stop, pacer)
        settle_guests(self._tick.guests, self.movers, self._own, self.ticks)
        self._notice(recorder)
        for part in self.objects:
            part.grasped.check_activity()

    def tick(self, recorder: RowTaker | None) -> None:
        """Run one sample."""
        self.run(1, recorder)

    def write(self, update: Update, recorder: RowTaker | None = None) -> None:
        """Write new numbers into the parts, between two ticks: the next tick computes with them.

        Args:
            update: of this servo's parts.
            recorder: which notes the tick and the values.

        Raises:
            InputError: a number was written into a block by another way, as of `run`; nothing has changed then.
        """
        self.watch.require()
        for memory, entries, numbers in update.entries:
            memory[entries] = numbers
        for each, other in update.parts:
            each.adopt(other)
        for wiring in (self.plants[j] for j in update.plants):
            if isinstance(wiring.plant, FusedPlant):  # others are handed their hand in every tick
                wiring.plant.hold(wiring.hand, self.period)
        self.watch.note()
        if recorder is not None:
            recorder.change(self.ticks, update.values)

    def _ready(self) -> Engine:
        if self._engine is None:
            self.watch.require()  # what stands there now is folded in
            self._tick = write(self.parts, record=self._record)
            self._own = ServoState(self._tick.own.data)
            faulted = start_of(ServoState, "faulted")
            self._flag = self._tick.own.data[faulted : faulted + 1]
            self._rounds = GuestRounds([self.movers[i].body for i in self._tick.guests], self._flag)
            # "auto" watches from the first tick on: when it takes a program is no matter of what is computed
            if self._kind not in (Interpreted.name, Generic.name):
                self.watch.fold(self.parts, self._tick)
            self._devices = DeviceExchange(
                DevicePort(port, self.stations[port.station], self.layout.fingers, self.period, self.guards)
                for port in self._tick.ports
            )
            self._io = self._devices
            self._engine = engine_for(self._kind, self._tick, at_once=bool(self.hardware))
            log.info("engine %s; ports that are called in a tick: %d", self._kind, len(self._tick.ports))
        return self._engine

    def _run(self, ticks: int, recorder: RowTaker | None, stop: Stop | None) -> None:
        engine, tick = self._ready(), self._tick
        apart = bool(tick.ports or tick.bodies or tick.plants or (tick.tables and tick.guests))
        last = self.ticks + ticks
        while self.ticks < last and not (stop is not None and stop()):
            rows, row, left = (self._nowhere, 0, CHUNK) if recorder is None else recorder.space()
            engine.write_to(rows)
            count = min(left, last - self.ticks, CHUNK if stop is None else 1 if apart else engine.patience)
            if apart:
                for r in range(row, row + count):
                    self._one(engine, recorder, r, self._periods)
            elif tick.guests:
                self._with_guests(engine, recorder, row, count)
            else:
                self._look_ahead(count)
                self._finish_tick(engine.run(self.ticks, count, row), recorder)
            if recorder is not None:
                self.row = recorder.row
                recorder.drain()

    def _run_paced(self, ticks: int, recorder: RowTaker | None, stop: Stop | None, pacer: Pacer) -> None:
        """Run ticks, each at its deadline; hardware that waits too long has a fault; forces decay at the end."""
        end, log = SoftEnd(self.safety if self.hardware else None, self.period, self.ticks + ticks), None
        if self._tick.loop is not None:
            self._io = log = LoopLog(self._tick.loop, self.layout, self._devices, pacer)
        while self.ticks < end.last:
            self._periods = 1 + pacer.wait(stop)
            if stop is not None and stop():
                if not end.stop(self.ticks, faulted=self.faulted):
                    return
                stop = None  # the rest are few
                pacer.finish()
            if log is not None:
                log.begin()
            if self.hardware and pacer.row > self.guards.late:
                if not self._own.faulted:
                    self._stop()
                self._tell(self.ticks, late_text(pacer.row, pacer.period, self.guards.late))
            end.begin(self.ticks, recorder)
            self._run(1, recorder, None)

    def _run_native(self, native: NativeLoop, ticks: int, recorder: RowTaker, stop: Stop | None, pacer: Pacer) -> None:
        """Run ticks on the wall's clock by machine code alone, which Python looks at from time to time."""

        def look(done: int) -> None:
            self.ticks = done
            self._notice(recorder, native.stop_faults)

        native.run(self.ticks, ticks, recorder, stop, pacer, look)
        if native.hang:
            self._stop()
            self._notice(recorder, [RunFault(self.ticks, native.hang)])
        self.row = recorder.row

    def _with_guests(self, engine: Engine, recorder: RowTaker | None, row: int, count: int) -> None:
        """Run ticks with an exchange with guests after each, many by one call where all of it is machine code."""
        rounds, last, shift = self._rounds, self.ticks + count, row - self.ticks
        rounds.k = self.ticks
        try:
            while not rounds.run(engine, last, shift):
                self._notice(recorder)  # now, as it says how things stand
                self._exchange()
                rounds.k += 1
        finally:  # what was run is kept also if the run breaks off here
            self._finish_tick(rounds.k - self.ticks, recorder)

    def _exchange(self) -> None:
        """Exchange with the guests that are not stuck."""
        exchanges = self._rounds.exchanges(machine=self._kind != Interpreted.name)
        for i, exchange in zip(self._tick.guests, exchanges, strict=True):
            if not self._own.stuck_bodies[i]:
                exchange()

    def _one(self, engine: Engine, recorder: RowTaker | None, row: int, periods: int = 1) -> None:
        """Run one tick with parts that are no kernels, so many periods after the one before."""
        tick, k = self._tick, self.ticks
        self._look_ahead(1)
        for i in tick.bodies:
            if any(self.objects[o].grasped.implicit for o in self.movers[i].objects):
                self.movers[i].body.free_motion(self.period)
        if tick.ports:
            is_over = self._own.faulted
            if is_over:
                self._stop()
            faults = self._io.read(periods)
            if faults and not is_over:
                self._stop()
                is_over = True
            for text in faults:
                self._tell(k, text)
            engine.begin(k)
            if not is_over:
                self._display(k)
            is_stopped = self._own.faulted
            engine.end(k, row)
        else:
            is_stopped = True  # no device is written to
            engine.run(k, 1, row)
        self._exchange()
        for i in tick.bodies:
            self._step(k, i)
        for j in tick.plants:
            self._advance(k, j)
        if self._own.faulted and not is_stopped:  # what has moved cannot go on: its forces end now
            self._stop()
        self._finish_tick(1, recorder)

    def _finish_tick(self, count: int, recorder: RowTaker | None) -> None:
        self.ticks += count
        if recorder is not None:
            recorder.take(count)
        self._notice(recorder)

    # What is no kernel --------------------------------------------------------------------------------------------

    def _display(self, k: int) -> None:
        """Hand the devices their forces; where there is a fault all are stopped, before it is told."""
        text = "" if self._own.faulted else self._io.write()
        if text or self._own.faulted:
            self._stop()
        if text:
            self._tell(k, text)

    def _stop(self) -> None:
        """Set the force of every device in plain Python to zero, now; nothing comes between a fault and this."""
        self._stop_faults += self._devices.stop()

    def show_calls(self, word: memoryview) -> None:
        """Show in a word which call of a device in Python has the thread, as `call_of` reads it; before a run."""
        self._ready()
        self._devices.call = word

    def rest(self, recorder: RowTaker | None = None) -> None:
        """Set the force of every device in plain Python to zero, now; one that does not answer is a fault."""
        try:
            self._stop()
        finally:
            self._notice(recorder)

    def _step(self, k: int, i: int) -> None:
        """Step a body to the end of the sample; one that cannot go on stays where it is."""
        if not self._own.stuck_bodies[i]:
            try:
                self.movers[i].body.step(self.period)
            except GraspFXError as error:
                self._own.stuck_bodies[i] = 1.0
                self._tell(k + 1, f"{object_names(self.parts, i)}: {error}")

    def _advance(self, k: int, j: int) -> None:
        m = self.plants[j]
        if not self._own.stuck_plants[j]:
            try:
                m.plant.advance(np.concatenate([d.effort for d in m.devices]), m.hand, self.period)
            except GraspFXError as error:
                self._own.stuck_plants[j] = 1.0
                self._tell(k + 1, f"{finger_names(self.parts, j)}: {error}")

    def _look_ahead(self, count: int) -> None:
        """Ask hands that are no kernels where they mean to be over the coming ticks."""
        self._own.table_start = self.ticks
        for table in self._tick.tables:
            fill_table(table, self.plants[table.plant], self.ticks, count, self.period)

    # Faults -------------------------------------------------------------------------------------------------------

    def _tell(self, k: int, message: str) -> None:
        if not self._own.faulted:
            self._foreign_faults.append(message)
            latch(self._own, k, FOREIGN, 0, len(self._foreign_faults) - 1)

    def _notice(self, recorder: RowTaker | None, others: Sequence[RunFault] = ()) -> None:
        """Note faults that were not noted yet, with others beside those of the tick."""
        if self.fault is None and self._flag[0]:
            self.fault = RunFault(self._own.tick, self.why(self._tick.own))
            if recorder is not None:
                recorder.fault(*self.fault)
        faults = [*others, *(RunFault(self.ticks, text) for text in self._stop_faults)]
        self._stop_faults.clear()
        for fault in faults:
            self.fault = self.fault or fault
            if recorder is not None:
                recorder.fault(*fault)

    def why(self, own: FloatArray) -> str:
        """Explain the fault that is latched in the memory of a tick, `Tick.own`."""
        servo = ServoState(own)
        if servo.kind == FOREIGN:
            return self._foreign_faults[servo.code]
        if servo.kind == NATIVE and self.native is not None:
            return self.native.why(servo.index, servo.code)
        return kernel_fault(self.parts, servo.kind, servo.index, servo.code)
