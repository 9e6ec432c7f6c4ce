"""Wires a scene's parts for its tick: which piece of which memory each quantity is, and which kernels run."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.records import Floats, entries_of, size_for
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.errors import InputError
from graspfx.loop import plant as plants
from graspfx.loop.device import Device, FusedDevice, LimitedDevice, fused, limit_port
from graspfx.loop.energy.books import LedgerState
from graspfx.loop.energy.observer import MET
from graspfx.loop.parts import BodyGroup, DeviceWiring, Parts, PlantWiring, guest_of
from graspfx.loop.plant import FusedHand, FusedPlant
from graspfx.loop.realtime.loop_state import LoopState, loop_memory
from graspfx.loop.safety.safety_state import Pace, SafetyState
from graspfx.loop.tick.memory import CHUNK, ServoState
from graspfx.loop.tick.script import Port, Table, Tick
from graspfx.loop.tick.sources import loop_columns, sources
from graspfx.loop.tick.wires import (
    BodyWires,
    Channel,
    DeviceWires,
    FingerWires,
    GraspWires,
    GuestPart,
    GuestWires,
    HandWires,
    LedgerWires,
    PlantWires,
    PortWires,
    SafetyWires,
    TableWires,
    Target,
    Wiring,
)
from graspfx.objects.body import NativeBody
from graspfx.objects.guest import GuestState

FloatArray = NDArray[np.float64]


class Wirer:
    """Wires parts, and gives each memory its name in a tick's script.

    Args:
        parts: of the scene; plants and guests are told the period, and plants their hands.
        tick: the tick, which is told what runs by its own methods.
    """

    def __init__(self, parts: Parts, tick: Tick) -> None:
        self.parts, self.tick, self.script = parts, tick, tick.script
        self.n, self.d = n, d = len(parts.layout.fingers), parts.layout.dimensions
        whole = {"bodies": len(parts.movers), "plants": len(parts.plants), "fingers": n, "dimensions": d}
        tick.own = np.zeros(size_for(ServoState, **whole))
        self.servo = servo = ServoState(tick.own)
        for name, number in whole.items():
            setattr(servo, name, number)
        servo.period = parts.period
        self.script.memory("servo", tick.own, entries_of(ServoState, *whole), entries_of(ServoState, "period"))
        if parts.layout.timed or parts.layout.varying:
            tick.loop = loop_memory(parts.layout)
            self.script.memory("loop", tick.loop, entries_of(LoopState, "fingers", "devices", "raws"))
        self.largest: dict[int, tuple[FloatArray, int]] = {}  # where a device tells a finger's largest force
        for part in parts.objects:
            self.script.memory("object", part.grasped.block, part.grasped.structure)
        for observer in parts.observers:
            self.script.memory("ledger", observer.buffer, observer.structure)
        if parts.safety is not None:
            self.script.memory("pace", parts.safety.pace, entries_of(Pace, "devices"))
            for i, buffer in enumerate(parts.safety.buffers):
                self.script.memory("safety", buffer, parts.safety.structure(i))
        for m in parts.plants:
            if isinstance(m.plant, FusedPlant):
                m.plant.hold(m.hand, parts.period)
        for mover in parts.movers:
            if (guest := guest_of(mover.body)) is not None:
                guest.hold(parts.period)
        self.native = [self._is_native(m) for m in parts.plants]
        self.plants = [self._memory(m) for m in parts.plants]

    def wire(self, *, record: bool) -> Wiring:
        """Wire all parts, recorded or not."""
        for mover in self.parts.movers:
            if (guest := guest_of(mover.body)) is not None:
                self.script.memory("guest", guest.buffer, guest.structure)
        fingers = self._fingers()
        devices = [self._device(i, station, fingers) for i, station in enumerate(self.parts.stations)]
        return Wiring(
            servo=self.servo,
            faulted=self.servo.array(ServoState.faulted),
            period=self.servo.array(ServoState.period),
            dimensions=self.d,
            pace=None if self.parts.safety is None else Pace(self.parts.safety.pace),
            fingers=fingers,
            devices=devices,
            grasps=[self._grasp(i) for i in range(len(self.parts.objects))],
            bodies=list(self._bodies()),
            plants=list(self._plant_wires()),
            width=self.parts.layout.width,
            every=self.parts.every,
            columns=self._columns() if record else None,
        )

    # Fingers and devices ------------------------------------------------------------------------------------------

    def _fingers(self) -> list[FingerWires]:
        n, d = self.n, self.d
        displayed, before = self.servo.displayed.array(n), self.servo.before.array(n)
        energy = self.servo.array(ServoState.energy)
        fingers: dict[int, FingerWires] = {}
        for part in self.parts.objects:
            block, limited = part.grasped.block, part.grasped.limit is not None
            group = GraspState(block).fingers
            quantities = [group.array(q) for q in (FingerState.position, FingerState.velocity, FingerState.force)]
            for j, f in enumerate(part.fingers.tolist()):
                position, velocity, force = (rows[j, :d] for rows in quantities)
                fingers[f] = FingerWires(
                    position=position,
                    velocity=velocity,
                    force=force,
                    limit=group.array(FingerState.limit)[j : j + 1] if limited else None,
                    displayed=displayed[f],
                    tip=self._tip(f, position),
                    before=before[f],
                    energy=energy[f : f + 1],
                )
        return [fingers[f] for f in range(n)]

    def _tip(self, f: int, position: FloatArray) -> FloatArray:
        """Find where the fingertip truly is, or where it was read if that is not known."""
        if self.parts.layout.simulated:
            for m, memory in zip(self.parts.plants, self.plants, strict=True):
                if f in m.fingers:
                    start = m.plant.ports.position if isinstance(m.plant, FusedPlant) else 0
                    return memory[start + m.fingers.tolist().index(f) * self.d :][: self.d]
        return position

    def _device(self, i: int, station: DeviceWiring, fingers: list[FingerWires]) -> DeviceWires | PortWires:
        device = station.device
        plant = self._plant_of(device)
        if plant is None or not isinstance(device, FusedDevice):
            return self._port(i, station, fingers)
        self.script.memory("device", device.state, device.structure)
        port, state = device.ports, device.state
        return DeviceWires(
            index=i,
            state=state,
            sensed=state[port.sensed : port.sensed + len(device.sensed)],
            plant=plant,
            sensed_entries=device.sensed.tolist(),
            channels=self._channels(
                station, fingers, state, port.position, port.velocity, port.command, limit_port(device)
            ),
            reading=device.reading,
            writing=device.writing,
            stopping=device.stopping,
        )

    def _port(self, i: int, station: DeviceWiring, fingers: list[FingerWires]) -> PortWires:
        k, size = len(station.fingers), len(station.fingers) * self.d
        last = 1 + 3 * size
        limited = isinstance(station.device, LimitedDevice)
        memory = np.zeros(last + (k if limited else 0))
        arrays = memory[1:last].reshape(3, k, self.d)
        chain, misses, cause, elapsed = self.parts.safety, None, None, None
        if chain is not None:
            misses = chain.pace[Pace(chain.pace).misses.offset + i :][:1]
            cause, elapsed = Pace(chain.pace).array(Pace.cause), Pace(chain.pace).array(Pace.elapsed)
        limit = memory[last:] if limited else None
        self.tick.ports.append(Port(i, arrays[0], arrays[1], arrays[2], memory, limit, misses, elapsed, cause=cause))
        self.script.memory("port", memory)
        starts = 1, 1 + size, 1 + 2 * size, last if limited else None
        return PortWires(i, memory[:1], self._channels(station, fingers, memory, *starts))

    def _channels(
        self,
        station: DeviceWiring,
        fingers: list[FingerWires],
        memory: FloatArray,
        position: int,
        velocity: int,
        command: int,
        limit: int | None,
    ) -> list[Channel]:
        """List the channels that the scene uses, by where a device's memory has the first of each quantity."""

        def vector(start: int, c: int) -> FloatArray:
            return memory[start + c * self.d :][: self.d]

        if limit is not None:
            self.largest |= {f: (memory, limit + c) for c, f in enumerate(station.fingers.tolist()) if f >= 0}

        return [
            Channel(
                finger=fingers[f],
                position=vector(position, c),
                velocity=vector(velocity, c),
                limit=None if limit is None or fingers[f].limit is None else memory[limit + c :][:1],
                command=vector(command, c),
            )
            for c, f in enumerate(station.fingers.tolist())
            if f >= 0
        ]

    # Objects and bodies -------------------------------------------------------------------------------------------

    def _grasp(self, i: int) -> GraspWires:
        grasped = self.parts.objects[i].grasped
        number = next(number for number, mover in enumerate(self.parts.movers) if i in mover.objects)
        ledger = None
        if self.parts.observers:
            observer = self.parts.observers[i]
            if observer.met is not None:
                self._floor(self.parts.movers[number])
            met = None if observer.met is None else observer.buffer[MET : MET + 6]
            ledger = LedgerWires(LedgerState(observer.buffer), met, observer.met)
        safety, chain = None, self.parts.safety
        if chain is not None:
            safety = SafetyWires(SafetyState(chain.buffers[i]), Pace(chain.pace), chain.is_steered(i))
        return GraspWires(i, grasped.state, grasped.limit is not None, self._stuck_body(number), ledger, safety)

    def _stuck_body(self, i: int) -> FloatArray:
        return self.servo.array(ServoState.stuck_bodies)[i : i + 1]

    def _bodies(self) -> Iterator[BodyWires | GuestWires]:
        for i, mover in enumerate(self.parts.movers):
            body, stuck = mover.body, self._stuck_body(i)
            if (guest := guest_of(body)) is not None:
                self.tick.guests.append(i)
                parts = [
                    GuestPart(self.parts.objects[number].grasped.state.body, GuestState(guest.buffer, place))
                    for number, place in zip(mover.objects, guest.places, strict=True)
                    if place >= 0
                ]
                yield GuestWires(i, stuck, parts, guest.handing, guest.taking)
            elif isinstance(body, NativeBody):
                grasped = self.parts.objects[mover.objects[0]].grasped
                predicting = body.predicting if grasped.implicit else None
                yield BodyWires(i, stuck, grasped.state.body, Floats(self._floor(mover)), predicting, body.stepping)
            else:
                self.tick.bodies.append(i)

    def _floor(self, mover: BodyGroup) -> FloatArray:
        """Find the floor beside a native body's block, or the block again."""
        buffer: FloatArray | None = mover.body.buffer
        if buffer is None:
            return self.parts.objects[mover.objects[0]].grasped.block
        self.script.memory("floor", buffer, mover.body.structure)
        return buffer

    # Plants and hands ---------------------------------------------------------------------------------------------

    def _is_native(self, m: PlantWiring) -> bool:
        """Tell whether kernels do all that a plant needs."""
        wired = {id(station.device) for station in self.parts.stations}
        devices = [cast("Device", device) for device in m.devices]
        return plants.fused(m.plant) is not None and all(fused(d) is not None and id(d) in wired for d in devices)

    def _memory(self, m: PlantWiring) -> FloatArray:
        """Give a plant's block, or its fingertips' positions, flat."""
        if isinstance(m.plant, FusedPlant):
            self.script.memory("plant", m.plant.state, m.plant.structure, getattr(m.plant, "grouping", ()))
            return m.plant.state
        flat: FloatArray = m.plant.position.reshape(-1)
        if not np.shares_memory(flat, m.plant.position):
            raise InputError(
                "plant", type(m.plant).__qualname__,
                "a `position` that is the same contiguous array for the plant's life",
                "keep one array and write into it",
            )  # fmt: skip
        self.script.memory("plant", flat)
        return flat

    def _plant_of(self, device: Device) -> FloatArray | None:
        """Find the block of the native plant that moves a device."""
        for m, memory, native in zip(self.parts.plants, self.plants, self.native, strict=True):
            if native and id(device) in map(id, m.devices):
                return memory
        return None

    def _plant_wires(self) -> Iterator[PlantWires]:
        for j, (m, native) in enumerate(zip(self.parts.plants, self.native, strict=True)):
            if not native:
                self.tick.plants.append(j)
                continue
            assert isinstance(m.plant, FusedPlant)
            state, port, size = m.plant.state, m.plant.ports, len(m.fingers) * self.d
            middle = None if port.middle is None else _target(state, port.middle, port.middle + size, size)
            end = _target(state, port.end, port.end + size, size)
            yield PlantWires(
                index=j,
                stuck=self.servo.array(ServoState.stuck_plants)[j : j + 1],
                state=state,
                kernel=m.plant.kernel,
                efforts=list(self._efforts(m, m.plant)),
                hand=self._hand(j, m, [end] if middle is None else [middle, end]),
                middle=middle,
                end=end,
            )

    def _efforts(self, m: PlantWiring, plant: FusedPlant) -> Iterator[tuple[FloatArray, FloatArray]]:
        start = plant.ports.effort
        for device in m.devices:
            assert isinstance(device, FusedDevice)
            size = cast("Device", device).features.fingers * self.d
            yield plant.state[start : start + size], device.state[device.ports.effort :][:size]
            start += size

    def _hand(self, j: int, m: PlantWiring, targets: list[Target]) -> HandWires | TableWires | None:
        """Wire a hand for its plant's targets in a sample; one that keeps still needs nothing from now on."""
        hand = m.hand if isinstance(m.hand, FusedHand) else None
        size = len(m.fingers) * self.d
        if hand is None:
            width = 2 * size * len(targets)
            table = Table(j, np.zeros(CHUNK * width), len(targets) == 2)
            self.tick.tables.append(table)
            self.script.memory("targets", table.memory)
            return TableWires(table.memory, self.servo.array(ServoState.table_start), width)
        port = _target(hand.state, hand.ports.position, hand.ports.velocity, size)
        if plants.is_still(hand):
            for target in targets:
                target.position[:], target.velocity[:] = port.position, port.velocity
            return None
        self.script.memory("hand", hand.state, hand.structure)
        return HandWires(hand.state, hand.kernel, port)

    # The recording ------------------------------------------------------------------------------------------------

    def _columns(self) -> list[tuple[int, FloatArray, int]]:
        """List each number of a row, with the memory and the entry that it shows."""
        size, servo = self.n * self.d, self.servo
        own = {
            "displayed_force": (servo.displayed.offset, size),
            "device_energy": (servo.energy.offset, self.n),
            "true_position": (servo.before.offset, size),
        }
        columns = [*sources(self.parts, self.tick.own, own), *self._loop_columns()]
        return sorted(columns, key=lambda column: column[0])

    def _loop_columns(self) -> Iterator[tuple[int, FloatArray, int]]:
        """List the numbers of a row that a loop on the wall's clock tells."""
        loop = self.tick.loop
        if loop is None:
            return
        own = dict(loop_columns(self.parts.layout, loop))
        places = np.arange(self.parts.layout.width)
        for name, column in self.parts.layout.columns.items():
            if name in own:
                for i, place in enumerate(places[column.where].tolist()):
                    memory, entry = loop, own[name] + i
                    if name == "largest_force":
                        memory, entry = self.largest.get(i, (memory, entry))
                    yield place, memory, entry


def _target(memory: FloatArray, position: int, velocity: int, size: int) -> Target:
    return Target(memory[position : position + size], memory[velocity : velocity + size])
