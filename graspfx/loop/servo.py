"""Servo, which runs the ticks of a scene and changes parameters of the scene between ticks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from graspfx import log
from graspfx.compile.memory import Memory
from graspfx.compile.records import start_of
from graspfx.coupling.grasped import fault_text
from graspfx.errors import GraspFXError, InputError
from graspfx.feedback.bridge import HostPart
from graspfx.loop import plant as plants_
from graspfx.loop.arena import Arena
from graspfx.loop.columns import Layout, RowTaker, RunFault
from graspfx.loop.device import fused, is_hardware
from graspfx.loop.device_exchange import DeviceExchange, DevicePort, LoopLog, device_name, part_name
from graspfx.loop.energy.observer import Observer
from graspfx.loop.engine import Compiled, Engine, engine_for
from graspfx.loop.number_watch import Watch
from graspfx.loop.plant import FusedPlant
from graspfx.loop.played import Playback
from graspfx.loop.realtime.lifecycle import require_simulations, why_python
from graspfx.loop.realtime.pacing import Pacer, SoftEnd, WallClock
from graspfx.loop.realtime.readings import GUARDS, Guards
from graspfx.loop.safety.chain import SafetyChain
from graspfx.loop.servo_parts import BodyGroup, DeviceWiring, GraspedPart, Parts, PlantWiring
from graspfx.loop.world import CHUNK, FOREIGN, MOVER, NATIVE, OBJECT_, SAFETY, STATION, ServoState, latch
from graspfx.objects.guest import CallingGuest, Guest

if TYPE_CHECKING:
    from graspfx.loop.realtime.native_loop import NativeLoop


FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]
Stop = Callable[[], bool]


@runtime_checkable
class Steerable(Protocol):
    """Plant, hand or body whose parameters may change during a run."""

    def adopt(self, other: Any) -> None:
        """Copy the parameters of another part with the same structure; the present motion is unchanged."""


@runtime_checkable
class SteerablePlant(Steerable, Protocol):
    """Plant whose mechanics and hand may change during a run.

    Attributes:
        live: Whether mechanics and hand may change; if True, `structure` must not contain entries that then change.
    """

    live: bool


@runtime_checkable
class CarriedPlant(Steerable, Protocol):
    """Plant whose mechanics may be set by another process.

    Attributes:
        mechanics: Masses [kg] and dampings [N s/m] of the fingers, (2, n); after a change, `hold` must be called.
    """

    mechanics: FloatArray


@dataclass(frozen=True, eq=False)
class Update:
    """New values of keys of a scene, and the changes in the parts of the scene that result from them.

    Attributes:
        values: New values by key.
        entries: Memories, each with the indices of the entries that change and with their new numbers.
        parts: Plants, hands and bodies, each with another part that contains the new parameters.
        plants: Indices of the plants whose method `hold` must be called again.
    """

    values: Mapping[str, Any] = field(default_factory=dict)
    entries: Sequence[tuple[FloatArray, Index, FloatArray]] = ()
    parts: Sequence[tuple[Steerable, Any]] = ()
    plants: Sequence[int] = ()


class Servo:
    """Loop that runs the ticks of a scene.

    A fault occurs if a motion is not finite, if a device, body or plant raises an error of this package, or if a
    projection does not converge. In the tick of the first fault and all later ticks, the forces are zero; forces that
    were computed in this tick are not displayed.

    If all parts are kernels, one call of the engine runs many ticks. With a Python body or plant, the engine is called
    once per tick, and with a Python device, twice; the methods of these parts run between the calls. The recordings are
    bit-identical in all cases. A guest is a body that other software moves. The exchange with a guest in a tick is
    completed in the next tick or, after the last tick, at the end of `run`.

    Args:
        period: Sampling period T [s].
        layout: Layout of the recorded rows.
        stations: Devices, each with the fingers that it moves.
        objects: Objects with their grasps.
        movers: Bodies, each with the objects that it moves.
        plants: Plants, each with its devices, fingers and hand.
        observers: Observers of energy, one for each object or none.
        engine: Name of the engine: "auto", "compiled" or "interpreted".
        record: Whether ticks are recorded; if False, `run` must be called without a recorder.
        every: Number of ticks from one recorded row to the next.
        safety: Safety chain between law and devices; None if the scene has none.
        host: Other program that simulates the object; None if the scene has none.
        guards: Limits beyond which a run with hardware ends in a fault.
        memory: Memory in which the blocks of the parts are allocated.
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
        host: HostPart | None = None,
        guards: Guards = GUARDS,
        memory: Memory | None = None,
    ) -> None:
        self.ticks = 0  # time is ticks x period, never the wall clock, so two runs are bit-identical
        self.period, self.layout, self.every, self.guards = period, layout, every, guards
        self.stations, self.objects, self.movers, self.plants = stations, objects, movers, plants
        self.observers = observers  # one for each object, or none
        self.safety, self.host = safety, host
        self.fault: RunFault | None = None
        self._nowhere = np.empty((1, layout.width))
        self.row = np.zeros(layout.width)  # last recorded row
        self._kind, self._record, self._memory = engine, record, memory
        self._engine: Engine | None = None  # created at the first tick
        self.watch = Watch(objects)  # watch of numbers that only `write` may change
        self._foreign_faults: list[str] = []  # faults of parts that are not kernels
        self.hardware = [device_name(each, layout.fingers) for each in stations if is_hardware(each.device)]
        self._stop_faults: list[str] = []  # faults of devices that could not be stopped, not recorded yet
        self._io: DeviceExchange | LoopLog | Playback  # source of the readings
        self.native: NativeLoop | None = None  # loop without Python, set up by `prepare`
        self._periods = 1  # wall-clock periods since the last tick

    @property
    def coupling(self) -> dict[str, Any]:
        """Entries of the run's `Outcome` that the couplings of the objects compute."""
        grasps = [part.grasped for part in self.objects]
        return {
            "fade_shortfall": max(each.shortfall for each in grasps),
            "fade_needed": max(each.fade_needed for each in grasps),
            "blended": max(each.blended for each in grasps),
        }

    @property
    def faulted(self) -> bool:
        return self.fault is not None

    @property
    def hang(self) -> str:
        """Message about a device call or a tick of the native loop that takes too long; empty if there is none."""
        return "" if self.native is None else self.native.hang

    @property
    def engine(self) -> Engine:
        """Engine that runs the ticks."""
        return self._ready()

    @property
    def engine_name(self) -> str:
        """Name of the engine; empty before the first tick."""
        return "" if self._engine is None else self._engine.name

    @property
    def parts(self) -> Parts:
        """All parts of the scene."""
        return Parts(
            self.period, self.layout, self.stations, self.objects, self.movers, self.plants, self.observers, self.every,
            self.safety, self.host,
        )  # fmt: skip

    @property
    def arena(self) -> Arena:
        """Memory layout of the scene's parts."""
        self._ready()
        return self._arena

    def prepare(self) -> DeviceExchange:
        """Prepare a run, because preparations are too slow when hardware is open; return the exchange with devices."""
        engine = self._ready()
        self._rehearse(engine)
        if self.hardware and isinstance(engine, Compiled):
            Pacer(self.period, machine=True)  # compiles the kernels that the run's pacer needs
            for each in self._devices.hardware.ports:
                each.readings.compile()
        if self._record and isinstance(engine, Compiled) and not self.why_python:
            from graspfx.loop.realtime.native_loop import NativeLoop

            self.native = NativeLoop(self._arena, engine, self._devices, self.parts, self.guards)
        return self._devices

    def start(self) -> FloatArray | None:
        """Return a copy of the servo's memory before the first tick, for `begin_again`.

        The result is None if a run also changes state outside this memory.
        """
        self._ready()
        arena, memory = self._arena, self._arena.memory
        others = arena.world.pauses or arena.guests or arena.tables or arena.foreign
        own = self.hardware or self.native is not None or not arena.is_whole
        if others or own or any(part.grasped.matrices for part in self.objects):  # matrix gains count warnings
            return None
        return memory.floats[: memory.used].copy()

    def begin_again(self, start: FloatArray) -> None:
        """Reset the memory to a copy from `start`; the next tick is the first tick again."""
        self._arena.memory.floats[: start.size] = start
        self.ticks, self.fault, self.row = 0, None, np.zeros(self.layout.width)

    def forget_rows(self) -> None:
        """Release the memory of the rows to which the last ticks were recorded."""
        self.engine.write_to(self._nowhere)
        self.row = self._nowhere[0]

    def _rehearse(self, engine: Engine) -> None:
        """Run one tick with and one without a fault, so that everything is initialised; then restore all memories."""
        arrays = self._arena.arrays
        copies = [array.copy() for array in arrays]
        engine.write_to(np.empty((1, self.layout.width)))
        try:
            for is_faulted in (False, True):
                if is_faulted:
                    latch(self._own, 0, FOREIGN, 0, 0)
                while not engine.run(0, 1, 0):  # one call up to the writing of its devices, and one from there on
                    pass
        finally:
            for array, copy in zip(arrays, copies, strict=True):
                array[...] = copy

    @property
    def why_python(self) -> str:
        """Reason why Python runs between the ticks of a real-time run; empty if only machine code runs."""
        return why_python(self.stations, self.layout.fingers, self._kind, self.period, self.arena)

    def run(
        self,
        ticks: int,
        recorder: RowTaker | None,
        stop: Stop | None = None,
        pacer: Pacer | None = None,
    ) -> None:
        """Run and record a number of ticks.

        Args:
            ticks: Number of ticks to run.
            recorder: Recorder of rows, faults and changes; None if the servo was made with record=False.
            stop: Function that returns whether the run must end before `ticks`; None if it must not. With a pacer, it
                is called every few milliseconds; otherwise before every interpreted tick, before every tick with Python
                parts, and every 64 compiled ticks.
            pacer: Pacer by which each tick waits for its deadline; None for ticks without waiting.

        Raises:
            InputError: If a recorder is given or omitted contrary to `record`, or if the scene has hardware and there
                is no pacer. Also if a number was written directly into a block and this number selects the computation,
                contradicts a switch of the block, or determines how recorded forces are split.
        """
        if pacer is None:
            require_simulations(self.hardware)
        if (recorder is not None) is not self._record:
            expected = "a Recorder" if self._record else "None, because the servo was made with record=False"
            raise InputError("recorder", recorder, expected)
        self._ready()
        self.watch.require()
        if self.host is not None:
            self.host.record.publish()
        if pacer is None:
            self._run(ticks, recorder, stop)
        elif self.native is not None and recorder is not None and isinstance(pacer.clock, WallClock):
            self._run_native(self.native, ticks, recorder, stop, pacer)
        else:
            self._run_paced(ticks, recorder, stop, pacer)
        settle_guests(self._arena.guests, self.movers, self._own, self.ticks)
        self._notice(recorder)
        for part in self.objects:
            part.grasped.check_activity()

    def tick(self, recorder: RowTaker | None) -> None:
        """Run one tick."""
        self.run(1, recorder)

    def write(self, update: Update, recorder: RowTaker | None = None) -> None:
        """Apply new values between two ticks; the next tick uses them.

        Args:
            update: New values for the parts of this servo.
            recorder: Recorder that records the tick and the new values; None to record nothing.

        Raises:
            InputError: If a number was written directly into a block, as in `run`. The update is then not applied.
        """
        self.watch.require()
        for memory, entries, numbers in update.entries:
            memory[entries] = numbers
        for each, other in update.parts:
            each.adopt(other)
        for wiring in (self.plants[j] for j in update.plants):
            if isinstance(wiring.plant, FusedPlant):  # other plants receive their hand in every tick
                wiring.plant.hold(wiring.hand, self.period)
        self.watch.note()
        if recorder is not None:
            recorder.change(self.ticks, update.values)

    def _ready(self) -> Engine:
        if self._engine is None:
            self.watch.require()
            self._arena = arena = Arena(self.parts, self._memory, record=self._record)
            self._own = arena.servo
            faulted = start_of(ServoState, "faulted")
            self._flag = arena.own.data[faulted : faulted + 1]
            self._devices = DeviceExchange(
                DevicePort(port, self.stations[port.station], self.layout.fingers, self.period, self.guards)
                for port in arena.ports
            )
            self._io = self._devices
            self._engine = engine = engine_for(self._kind, arena)
            self._exchanges: list[object] = []
            if arena.guests and isinstance(engine, Compiled) and not engine.is_checking:
                self._exchanges = exchange_by_machine(arena, [self.movers[i].body for i in arena.guests])
            self._apart = arena.world.pauses  # whether a tick has parts in plain Python
            log.info("engine %s; devices whose Python methods are called: %d", engine.name, len(arena.ports))
        return self._engine

    def _run(self, ticks: int, recorder: RowTaker | None, stop: Stop | None) -> None:
        engine = self._ready()
        apart, last = self._apart, self.ticks + ticks
        while self.ticks < last and not (stop is not None and stop()):
            rows, row, left = (self._nowhere, 0, CHUNK) if recorder is None else recorder.space()
            engine.write_to(rows)
            most = TURN if self._exchanges else CHUNK
            if stop is not None:
                most = 1 if apart else engine.patience
            count = min(left, last - self.ticks, most)
            if apart:
                for r in range(row, row + count):
                    self._one(engine, recorder, r, self._periods)
            else:
                self._look_ahead(count)
                self._several(engine, recorder, count, row)
            if recorder is not None:
                self.row = recorder.row
                recorder.drain()

    def _several(self, engine: Engine, recorder: RowTaker | None, count: int, row: int) -> None:
        """Run ticks of a scene without Python parts, up to the tick of the first fault."""
        try:
            done = engine.run(self.ticks, count, row)
        except BaseException:  # raised by other software; the ticks before the exception are kept
            if self._arena.world.failed:
                self._arena.world.failed = False
                self._finish_tick(self._arena.world.done, recorder)
            raise
        self._finish_tick(done, recorder)
        if self._arena.guests and self._own.faulted and self._own.tick == self.ticks - 1:
            self._exchange()  # exchange of the tick with the fault

    def _run_paced(self, ticks: int, recorder: RowTaker | None, stop: Stop | None, pacer: Pacer) -> None:
        """Run each tick at its deadline; with hardware, too many late ticks are a fault and forces decay at the end."""
        end, log = SoftEnd(self.safety if self.hardware else None, self.period, self.ticks + ticks), None
        pacer.most = self.guards.late
        if self._arena.loop is not None:
            self._io = log = LoopLog(self._arena.loop, self.layout, self._devices, pacer)
        while end.goes_on(self.ticks, stop=False, faulted=self.faulted):
            self._periods = 1 + pacer.wait(stop)
            if stop is not None and stop():
                if not end.goes_on(self.ticks, stop=True, faulted=self.faulted):
                    return
                stop = None  # only a few ticks remain
                pacer.finish()
            if log is not None:
                log.begin()
            if self.hardware and pacer.is_too_late():
                if not self._own.faulted:
                    self._stop()
                self._tell(self.ticks, pacer.late_text)
            end.tell(recorder)
            self._run(1, recorder, None)

    def _run_native(self, native: NativeLoop, ticks: int, recorder: RowTaker, stop: Stop | None, pacer: Pacer) -> None:
        """Run each tick at its deadline by the native loop, and record faults while the loop runs."""

        def look(done: int) -> None:
            self.ticks = done
            self._notice(recorder, native.stop_faults)

        native.run(self.ticks, ticks, recorder, stop, pacer, look)
        if native.hang:
            self._stop()
            self._notice(recorder, [RunFault(self.ticks, native.hang)])
        self.row = recorder.row

    def _exchange(self) -> None:
        """Exchange with all guests that have not failed."""
        for i in self._arena.guests:
            if not self._own.stuck_bodies[i]:
                self.movers[i].body.exchange()

    def _one(self, engine: Engine, recorder: RowTaker | None, row: int, periods: int = 1) -> None:
        """Run one tick with Python parts, `periods` sampling periods after the previous tick."""
        tick, k = self._arena, self.ticks
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
            engine.run(k, 1, row)  # up to the forces that devices display
            if not is_over:
                self._display(k)
            is_stopped = self._own.faulted
        else:
            is_stopped = True  # no device is written
        engine.run(k, 1, row)
        if not tick.world.exchanging or (self._own.faulted and self._own.tick == k):
            self._exchange()
        for i in tick.bodies:
            self._step(k, i)
        for j in tick.plants:
            self._advance(k, j)
        if self._own.faulted and not is_stopped:  # the computation failed and cannot continue, so forces end now
            self._stop()
        self._finish_tick(1, recorder)

    def _finish_tick(self, count: int, recorder: RowTaker | None) -> None:
        self.ticks += count
        if recorder is not None:
            recorder.take(count)
        self._notice(recorder)

    # Python parts -------------------------------------------------------------------------------------------------

    def _display(self, k: int) -> None:
        """Write the forces to the devices; if there is a fault, stop all devices before the fault is recorded."""
        text = "" if self._own.faulted else self._io.write()
        if text or self._own.faulted:
            self._stop()
        if text:
            self._tell(k, text)

    def _stop(self) -> None:
        """Set the force of every Python device to zero."""
        self._stop_faults += self._devices.stop()

    def show_calls(self, word: memoryview) -> None:
        """Set the memory to which the number of the device call in progress is written (see `call_of`)."""
        self._ready()
        self._devices.call = word

    def rest(self, recorder: RowTaker | None = None) -> None:
        """Set the force of every Python device to zero; if this fails for a device, record a fault."""
        try:
            self._stop()
        finally:
            self._notice(recorder)

    def _step(self, k: int, i: int) -> None:
        """Move body i to the end of the sample, unless the body has failed before."""
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
        """Compute the targets of Python hands for the next `count` ticks."""
        if not self._arena.tables:
            return
        self._own.table_start = self.ticks
        for table in self._arena.tables:
            table.fill(self.ticks, count, self.period)

    # Faults -------------------------------------------------------------------------------------------------------

    def _tell(self, k: int, message: str) -> None:
        if not self._own.faulted:
            self._foreign_faults.append(message)
            latch(self._own, k, FOREIGN, 0, len(self._foreign_faults) - 1)

    def _notice(self, recorder: RowTaker | None, others: Sequence[RunFault] = ()) -> None:
        """Record the first fault of a tick, faults of devices that could not be stopped, and the faults `others`."""
        if self.fault is None and self._flag[0]:
            self.fault = RunFault(self._own.tick, self.why(self._arena.own))
            if recorder is not None:
                recorder.fault(*self.fault)
        faults = [*others, *(RunFault(self.ticks, text) for text in self._stop_faults)]
        self._stop_faults.clear()
        for fault in faults:
            self.fault = self.fault or fault
            if recorder is not None:
                recorder.fault(*fault)

    def why(self, own: FloatArray) -> str:
        """Return the message for the fault that is stored in the memory of the tick, `Arena.own`."""
        servo = ServoState(own)
        if servo.kind == FOREIGN:
            return self._foreign_faults[servo.code]
        if servo.kind == NATIVE and self.native is not None:
            return self.native.why(servo.index, servo.code)
        return kernel_fault(self.parts, servo.kind, servo.index, servo.code)


TURN = 64  # number of ticks after which the interpreter may handle signals and other threads


def exchange_by_machine(arena: Arena, guests: Sequence[Guest]) -> list[object]:
    """If possible, let machine code exchange with all guests.

    The result is a list of objects that must be kept; it is empty if the exchange by machine code is not possible.
    """
    from graspfx.compile.exchange import MachineExchange

    if not all(isinstance(guest, CallingGuest) and guest.calls for guest in guests):
        return []
    with suppress(ImportError, LookupError):
        made = [MachineExchange(guest.calls) for guest in guests if isinstance(guest, CallingGuest)]
        for record, each in zip(arena.world.exchanges, made, strict=True):
            record.address, record.plan = each.address, arena.place(each.plan.view(float))
        arena.world.exchanging = True
        arena.world.pauses = bool(arena.ports or arena.bodies or arena.plants)
        return list(made)
    return []


def settle_guests(guests: Sequence[int], movers: Sequence[BodyGroup], servo: ServoState, k: int) -> None:
    """Complete the exchange with guests in the last tick; a failure is a fault of tick k.

    Args:
        guests: Indices of the guests among the body groups.
        movers: Body groups of the scene.
        servo: Memory of the tick.
        k: Index of the tick after the last tick.
    """
    for i in guests:
        code = 0 if servo.stuck_bodies[i] else movers[i].body.take()
        if code:
            latch(servo, k, MOVER, i, code)
            servo.stuck_bodies[i] = 1.0


# Faults of kernels ----------------------------------------------------------------------------------------------------


def kernel_fault(parts: Parts, kind: int, index: int, code: int) -> str:
    """Return the message for a fault code of a kernel.

    Args:
        parts: Parts of the scene.
        kind: Kind of the part that failed, as stored by the tick.
        index: Index of this part among the parts of this kind.
        code: Fault code that the kernel of this part returned.
    """
    fingers = parts.layout.fingers
    if kind == SAFETY and parts.safety is not None:
        devices = [device_name(each, fingers) for each in parts.stations]
        return parts.safety.fault_text(code, fingers, devices)
    if kind == STATION:
        return parts.stations[index].device.fault_text(code)  # type: ignore[attr-defined,no-any-return]
    if kind == OBJECT_:
        part = parts.objects[index]
        return fault_text(code, [fingers[f] for f in part.fingers], part.grasped)
    if kind == MOVER:
        return f"{object_names(parts, index)}: {parts.movers[index].body.fault_text(code)}"
    return f"{finger_names(parts, index)}: {parts.plants[index].plant.fault_text(code)}"  # type: ignore[attr-defined]


def object_names(parts: Parts, mover: int) -> str:
    """Return the names of the objects that a body group moves, separated by commas."""
    return ", ".join(parts.objects[number].name for number in parts.movers[mover].objects)


def finger_names(parts: Parts, plant: int) -> str:
    """Return the names of the fingers that a plant moves, separated by commas."""
    return ", ".join(parts.layout.fingers[f] for f in parts.plants[plant].fingers)


# Parts that run as Python code, or wait for other software, between the engine's calls --------------------------------


def foreign(servo: Servo) -> list[str]:
    """List the names of devices, plants and bodies whose Python methods are called in each tick."""
    arena = servo.arena
    stations = [servo.stations[port.station] for port in arena.ports]
    moved = [servo.plants[j] for j in arena.plants]
    return [
        *(_of_fingers(servo, "device", s.device, s.fingers) for s in stations if fused(s.device) is None),
        *(_of_fingers(servo, "plant", m.plant, m.fingers) for m in moved if plants_.fused(m.plant) is None),
        *(_body(servo, i) for i in arena.bodies),
    ]


def guests(servo: Servo) -> list[str]:
    """List the names of bodies that other software moves after each tick."""
    return [_body(servo, i) for i in servo.arena.guests]


def looked_ahead(servo: Servo) -> list[str]:
    """List the names of hands in plain Python, whose targets are computed for many ticks at once."""
    return [_of_fingers(servo, "hand", m.hand, m.fingers) for m in (table.wiring for table in servo.arena.tables)]


def _body(servo: Servo, i: int) -> str:
    mover = servo.movers[i]
    return part_name("body", mover.body, (servo.objects[o].name for o in mover.objects))


def _of_fingers(servo: Servo, kind: str, part: object, numbers: Iterable[int]) -> str:
    return part_name(kind, part, (servo.layout.fingers[f] for f in numbers if f >= 0))
