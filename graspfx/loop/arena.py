"""Arena of a scene: the memory blocks of all parts, and the `World`, which lists where each quantity is stored."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.memory import Memory, Scattered
from graspfx.compile.records import Record, layout, size_for, start_of
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.errors import InputError
from graspfx.loop import plant as plants
from graspfx.loop.columns import OF_FINGERS, OF_OBJECTS
from graspfx.loop.device import Device, FusedDevice, LimitedDevice, fused, limit_port
from graspfx.loop.device_exchange import Port
from graspfx.loop.energy.observer import MET
from graspfx.loop.kernels import number_of
from graspfx.loop.plant import FusedHand, FusedPlant
from graspfx.loop.realtime.loop_log import LoopState, loop_memory
from graspfx.loop.safety.safety_state import Pace
from graspfx.loop.servo_parts import DeviceWiring, Parts, PlantWiring, guest_of
from graspfx.loop.world import (
    CHUNK,
    KERNEL,
    NONE,
    STILL,
    TABLE,
    ServoState,
    World,
)
from graspfx.objects.body import NativeBody

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]
Kernel = Callable[..., Any]

OF_PART, OF_HAND, OF_BODY = (), ("t",), ("beside", "T")  # arguments of a kernel after its block
BODY = start_of(GraspState, "body")
MANY = {
    "finger": "fingers", "channel": "channels", "device": "devices", "grasp": "grasps", "body": "bodies",
    "exchange": "exchanges", "plant": "plants", "wire": "wires",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Table:
    """Targets of a hand in plain Python, for the ticks of one call of the engine.

    Attributes:
        memory: Targets (CHUNK, width), flattened. A row contains the target position r and the target velocity r' at
            the end of a sample; if `middle`, it then contains r and r' in the middle of the sample.
        wiring: Wiring of the plant that the hand moves.
        middle: Whether the plant needs the targets in the middle of a sample.
    """

    memory: FloatArray
    wiring: PlantWiring
    middle: bool

    def fill(self, k: int, count: int, period: float) -> None:
        """Compute and store the hand's targets in the ticks k, ..., k + count - 1, where count is at most CHUNK."""
        each = self.memory.reshape(CHUNK, -1, *self.wiring.plant.position.shape)
        for i in range(count):
            each[i, 0], each[i, 1] = self.wiring.hand.target((k + i + 1) * period)
            if self.middle:
                each[i, 2], each[i, 3] = self.wiring.hand.target(0.5 * ((k + i) * period + (k + i + 1) * period))


@dataclass(frozen=True, eq=False)
class ForeignKernel:
    """Kernel that is not in `kernels.KERNELS`.

    Attributes:
        kernel: Kernel function.
        parameters: Names of the kernel's arguments after the place of its first block: `t` and `T` are floats, and
            `beside` is the place of a second block.
        blocks: Blocks that the kernel uses.
        entries: Entries of the world's memory that contain the kernel's number.
    """

    kernel: Kernel
    parameters: tuple[str, ...]
    blocks: Sequence[FloatArray]
    entries: list[int]


class Arena:
    """Memory layout of the parts of a scene, for the program that runs ticks.

    A place is the position of a number relative to the start of `memory`. The arena also gives the period to plants and
    guests, and hands to their plants.

    Args:
        parts: Parts of the scene.
        memory: Memory in which blocks are allocated. Blocks of parts may also be elsewhere, because machine code
            addresses each block directly.
        record: Whether rows are recorded.

    Attributes:
        world: World of the scene.
        offset: Place of the world.
        servo: Memory of the tick, `ServoState`.
        loop: Memory of the real-time loop, `LoopState`; None if the run does not follow the wall clock.
        arrays: All blocks, in the order of their registration.
        ports: Ports of devices in plain Python.
        tables: Tables of hands in plain Python.
        guests: Indices of bodies that other software moves after each tick.
        bodies: Indices of bodies in plain Python.
        plants: Indices of plants in plain Python.
        foreign: Third-party kernels.
    """

    def __init__(self, parts: Parts, memory: Memory | None = None, *, record: bool = True) -> None:
        self.parts, self.memory = parts, Memory() if memory is None else memory
        self.n, self.d = n, d = len(parts.layout.fingers), parts.layout.dimensions
        self.arrays: list[FloatArray] = []
        self.ports: list[Port] = []
        self.tables: list[Table] = []
        self.guests: list[int] = []
        self.bodies: list[int] = []
        self.plants: list[int] = []
        self.foreign: list[ForeignKernel] = []
        whole = {"bodies": len(parts.movers), "plants": len(parts.plants), "fingers": n, "dimensions": d}
        self.own = self._block(self.memory.take(size_for(ServoState, **whole)))
        self.servo = servo = ServoState(self.own.data)
        for name, number in whole.items():
            setattr(servo, name, number)
        servo.period = parts.period
        self.loop = None
        if parts.layout.timed or parts.layout.varying:
            self.loop = self._block(loop_memory(parts.layout))
        for array in self._blocks_of(parts):
            self._block(array)
        for m in parts.plants:
            if isinstance(m.plant, FusedPlant):
                m.plant.hold(m.hand, parts.period)
        for mover in parts.movers:
            if (guest := guest_of(mover.body)) is not None:
                guest.hold(parts.period)
        self._native = [self._is_native(m) for m in parts.plants]
        self._motions = [self._motion_of(m) for m in parts.plants]
        self._lay(record=record)

    @property
    def buffer(self) -> Any:
        """All blocks as one buffer, for interpreted kernels."""
        if self.is_whole:
            return memoryview(self.memory.floats[: self.memory.used])
        return Scattered(self.memory, self.arrays)

    def place(self, array: FloatArray | None) -> int:
        """Return the place of the first number of an array or a view; NONE for None."""
        return NONE if array is None else self.memory.place(array)

    # Blocks -----------------------------------------------------------------------------------------------------------

    def _block(self, array: FloatArray) -> FloatArray:
        """Register a block.

        Raises:
            InputError: If the array is not a contiguous one-dimensional float64 array, or if it shares memory with
                another block.
        """
        if array.dtype != np.float64 or not array.flags.c_contiguous or array.ndim != 1:
            given = f"an array {array.shape} of {array.dtype}"
            raise InputError("state", given, "a contiguous one-dimensional float64 array")
        if not any(each is array for each in self.arrays):
            first = self.memory.place(array)
            for each in self.arrays:
                other = self.memory.place(each)
                if first == other and array.size == each.size:
                    return array
                if first < other + each.size and other < first + array.size:
                    raise InputError(
                        "state", array.shape, "a block that does not share memory with the block of another part"
                    )
            self.arrays.append(array)
        return array

    @staticmethod
    def _blocks_of(parts: Parts) -> Iterator[FloatArray]:
        yield from (part.grasped.block for part in parts.objects)
        yield from (observer.buffer for observer in parts.observers)
        if parts.safety is not None:
            yield parts.safety.pace
            yield from parts.safety.buffers
        if parts.host is not None:
            yield parts.host.block
            yield parts.host.record.words
        for mover in parts.movers:
            if isinstance(mover.body, NativeBody) and mover.body.buffer is not None:
                yield mover.body.buffer
            if (guest := guest_of(mover.body)) is not None:
                yield guest.buffer

    def _is_native(self, m: PlantWiring) -> bool:
        """Return whether a plant and all its devices are kernels."""
        wired = {id(station.device) for station in self.parts.stations}
        devices = [cast("Device", device) for device in m.devices]
        return plants.fused(m.plant) is not None and all(fused(d) is not None and id(d) in wired for d in devices)

    def _motion_of(self, m: PlantWiring) -> tuple[FloatArray, int]:
        """Return the array that contains the fingertips' positions, and the entry at which they start.

        The array is the plant's block or, for a plant in plain Python, its flattened positions.
        """
        if isinstance(m.plant, FusedPlant):
            return self._block(m.plant.state), m.plant.ports.position
        flat: FloatArray = m.plant.position.reshape(-1)
        if not np.shares_memory(flat, m.plant.position):
            raise InputError(
                "plant", type(m.plant).__qualname__,
                "an attribute `position` that is always the same contiguous array",
                "create the array once, and write the positions into it",
            )  # fmt: skip
        return self._block(flat), 0

    # The world --------------------------------------------------------------------------------------------------------

    def _lay(self, *, record: bool) -> None:
        """Allocate the world and fill the records of the world."""
        self._copies: list[dict[str, Any]] = []
        self._channels: list[dict[str, Any]] = []
        self._largest: dict[int, int] = {}  # places where devices report a finger's largest force
        self._fingers = self._finger_records()
        groups = {
            "finger": self._fingers,
            "device": [self._device(i, station) for i, station in enumerate(self.parts.stations)],
            "channel": self._channels,
            "grasp": [self._grasp(i) for i in range(len(self.parts.objects))],
            "body": list(self._body_records()),
            "exchange": [{"stuck": self._stuck_body(i)} for i in self.guests],
            "plant": list(self._plant_records()),
            "wire": self._copies,
        }
        columns = self._columns() if record else []
        counts = {f"{name}_count": len(records) for name, records in groups.items()} | {"column_count": len(columns)}
        array = self._block(self.memory.take(size_for(World, **counts)))
        self.world, self.offset = World(array.data), self.memory.place(array)
        whole = {
            **counts,
            "pauses": bool(self.ports or self.guests or self.bodies or self.plants),
            "ports": len(self.ports),
            "dimensions": self.d,
            "width": self.parts.layout.width,
            "every": self.parts.every,
            "recorded": len(columns),
            "servo": self.place(self.own),
            "pace": NONE if self.parts.safety is None else self.place(self.parts.safety.pace),
        }
        self._fill(World, 0, whole)
        for name, records in groups.items():
            group = getattr(self.world, MANY[name])
            for i, values in enumerate(records):
                self._fill(group.kind, group.offset + i * group.stride, values)
        first = self.world.columns.offset
        array[first : first + len(columns)] = columns

    def _fill(self, kind: type[Record], at: int, values: Mapping[str, Any]) -> None:
        """Write fields of a record that starts at the entry `at` of the world's memory."""
        fields, memory = layout(kind), self.world.buffer
        for name, value in values.items():
            entry = at + fields[name].start
            if isinstance(value, ForeignKernel):
                value.entries.append(entry)
                self.foreign.append(value)
            elif isinstance(value, dict):
                self._fill(fields[name].kind, entry, value)
            else:
                memory[entry] = value

    def _kernel(self, kernel: Kernel, parameters: tuple[str, ...], *blocks: FloatArray) -> int | ForeignKernel:
        """Return the number of a kernel; for a third-party kernel, a `ForeignKernel` whose number is set later."""
        number = number_of(kernel)
        return ForeignKernel(kernel, parameters, blocks, []) if number is None else number

    def _copy(self, to: int, source: int, count: int) -> None:
        self._copies.append({"to": to, "source": source, "count": count})

    def _has(self, array: FloatArray) -> bool:
        return any(each is array for each in self.arrays)

    @property
    def is_whole(self) -> bool:
        """Whether all blocks are in `memory`, so that a copy of `memory` is a copy of the scene."""
        end = self.memory.used
        return all(0 < self.memory.place(each) <= end - each.size for each in self.arrays)

    @property
    def size(self) -> int:
        """Number of entries in all blocks."""
        return sum(array.size for array in self.arrays)

    # Fingers and devices ----------------------------------------------------------------------------------------------

    def _finger_records(self) -> list[dict[str, Any]]:
        d, fingers = self.d, dict[int, dict[str, Any]]()
        displayed, before, energy = (
            self.place(self.own) + each.offset for each in (self.servo.displayed, self.servo.before, self.servo.energy)
        )
        for part in self.parts.objects:
            limited = part.grasped.limit is not None
            group = GraspState(part.grasped.block).fingers
            arrays = {name: group.array(getattr(FingerState, name)) for name in ("position", "velocity", "force")}
            limits = group.array(FingerState.limit)
            for j, f in enumerate(part.fingers.tolist()):
                own = {name: self.place(array[j]) for name, array in arrays.items()}
                fingers[f] = {
                    **own,
                    "limit": self.place(limits[j : j + 1]) if limited else NONE,
                    "displayed": displayed + f * d,
                    "tip": self._tip(f, own["position"]),
                    "before": before + f * d,
                    "energy": energy + f,
                }
        return [fingers[f] for f in range(self.n)]

    def _tip(self, f: int, position: int) -> int:
        """Return the place of a fingertip's true position or, if this is unknown, of its measured position."""
        if self.parts.layout.simulated:
            for m, (memory, start) in zip(self.parts.plants, self._motions, strict=True):
                if f in m.fingers:
                    return self.place(memory) + start + int(m.fingers.tolist().index(f)) * self.d
        return position

    def _device(self, i: int, station: DeviceWiring) -> dict[str, Any]:
        plant = self._plant_of(station.device)
        if plant is None:
            return self._port(i, station)
        device = cast("FusedDevice", station.device)
        state, port = self._block(device.state), device.ports
        place, seen, first = self.place(state), device.sensed.tolist(), len(self._copies)
        runs = [0, *(a for a in range(1, len(seen)) if seen[a] != seen[a - 1] + 1), len(seen)]
        for a, b in pairwise(runs) if seen else ():
            self._copy(place + port.sensed + a, self.place(plant) + seen[a], b - a)
        limit = limit_port(device)
        return {
            "state": place,
            **self._add_channels(
                station, place + port.position, place + port.velocity, place + port.command,
                NONE if limit is None else place + limit,
            ),
            "first_sensed": first,
            "sensed": len(self._copies) - first,
            **{n: self._kernel(getattr(device, n), OF_PART, state) for n in ("reading", "writing", "stopping")},
        }  # fmt: skip

    def _port(self, i: int, station: DeviceWiring) -> dict[str, Any]:
        k, size = len(station.fingers), len(station.fingers) * self.d
        last = 1 + 3 * size
        limited = isinstance(station.device, LimitedDevice)
        memory = self._block(self.memory.take(last + (k if limited else 0)))
        arrays = memory[1:last].reshape(3, k, self.d)
        chain, misses, cause, elapsed = self.parts.safety, None, None, None
        if chain is not None:
            misses = chain.pace[Pace(chain.pace).misses.offset + i :][:1]
            cause, elapsed = Pace(chain.pace).array(Pace.cause), Pace(chain.pace).array(Pace.elapsed)
        limit = memory[last:] if limited else None
        self.ports.append(Port(i, arrays[0], arrays[1], arrays[2], memory, limit, misses, elapsed, cause=cause))
        place = self.place(memory)
        starts = place + 1, place + 1 + size, place + 1 + 2 * size, place + last if limited else NONE
        return {"plain": True, "state": place, **self._add_channels(station, *starts)}

    def _add_channels(
        self, station: DeviceWiring, position: int, velocity: int, command: int, limit: int
    ) -> dict[str, int]:
        """Add the channels of a device that move fingers; return the index of the first and the number of channels.

        Args:
            station: Device and the fingers that it moves.
            position, velocity, command, limit: Places of the quantities of the device's first channel.
        """
        first = len(self._channels)
        for c, f in enumerate(station.fingers.tolist()):
            if f >= 0:
                if limit != NONE:
                    self._largest[f] = limit + c
                self._channels.append({
                    "finger": f,
                    "position": position + c * self.d,
                    "velocity": velocity + c * self.d,
                    "limit": NONE if NONE in (limit, self._fingers[f]["limit"]) else limit + c,
                    "command": command + c * self.d,
                })  # fmt: skip
        return {"first": first, "count": len(self._channels) - first}

    # Objects and bodies -----------------------------------------------------------------------------------------------

    def _grasp(self, i: int) -> dict[str, Any]:
        grasped = self.parts.objects[i].grasped
        number = next(number for number, mover in enumerate(self.parts.movers) if i in mover.objects)
        record: dict[str, Any] = {
            "state": self.place(grasped.block),
            "stuck": self._stuck_body(number),
            "limited": grasped.limit is not None,
        }
        if self.parts.observers:
            observer = self.parts.observers[i]
            record["ledger"] = self.place(observer.buffer)
            if observer.met is not None:
                met = {"to": self.place(observer.buffer) + MET, "source": self.place(observer.met), "count": 6}
                record["met"] = met
        if self.parts.safety is not None:
            record["safety"] = self.place(self.parts.safety.buffers[i])
            record["steered"] = self.parts.safety.is_steered(i)
        if self.parts.host is not None:
            self.parts.host.state.words = self.place(self.parts.host.record.words)
            record["host"] = self.place(self.parts.host.block)
        return record

    def _stuck_body(self, i: int) -> int:
        return self.place(self.own) + self.servo.stuck_bodies.offset + i

    def _body_records(self) -> Iterator[dict[str, Any]]:
        for i, mover in enumerate(self.parts.movers):
            body, blocks = mover.body, [self.parts.objects[o].grasped.block for o in mover.objects]
            common = {"index": i, "stuck": self._stuck_body(i)}
            if (guest := guest_of(body)) is not None:
                self.guests.append(i)
                for block_, place in zip(blocks, guest.places, strict=True):
                    if place >= 0:
                        state = self.place(block_) + BODY
                        kernels = {"stepping": guest.handing, "taking": guest.taking}
                        yield {
                            **common, "guest": True, "state": state, "beside": self.place(guest.buffer) + place,
                            **{n: self._kernel(k, OF_BODY, block_, guest.buffer) for n, k in kernels.items()},
                        }  # fmt: skip
            elif isinstance(body, NativeBody):
                beside = blocks[0] if body.buffer is None else body.buffer
                implicit = self.parts.objects[mover.objects[0]].grasped.implicit
                yield {
                    **common, "state": self.place(blocks[0]) + BODY, "beside": self.place(beside),
                    "stepping": self._kernel(body.stepping, OF_BODY, blocks[0], beside),
                    "predicting": self._kernel(body.predicting, OF_BODY, blocks[0], beside) if implicit else NONE,
                }  # fmt: skip
            else:
                self.bodies.append(i)

    # Plants and hands -------------------------------------------------------------------------------------------------

    def _plant_of(self, device: Device) -> FloatArray | None:
        """Return the block of the native plant that moves a device."""
        for m, (memory, _), native in zip(self.parts.plants, self._motions, self._native, strict=True):
            if native and id(device) in map(id, m.devices):
                return memory
        return None

    def _plant_records(self) -> Iterator[dict[str, Any]]:
        for j, (m, native) in enumerate(zip(self.parts.plants, self._native, strict=True)):
            if not native:
                self.plants.append(j)
                continue
            plant, first, width = cast("FusedPlant", m.plant), len(self._copies), len(m.fingers) * self.d
            place, port = self.place(plant.state), plant.ports
            start = place + port.effort
            for device in cast("Sequence[FusedDevice]", m.devices):
                size = cast("Device", device).features.fingers * self.d
                self._copy(start, self.place(device.state) + device.ports.effort, size)
                start += size
            targets = {} if port.middle is None else {"middle": place + port.middle}
            targets["end"] = place + port.end
            yield {
                "index": j,
                "stuck": self.place(self.own) + self.servo.stuck_plants.offset + j,
                "state": place,
                "kernel": self._kernel(plant.kernel, OF_PART, plant.state),
                "first": first,
                "count": len(m.devices),
                "width": width,
                **{f"{name}_position": at for name, at in targets.items()},
                **{f"{name}_velocity": at + width for name, at in targets.items()},
                **self._hand(m, width, len(targets)),
            }

    def _hand(self, m: PlantWiring, width: int, targets: int) -> dict[str, Any]:
        """Return the entries of a plant's record that describe its hand; `targets` is the number of targets a sample.

        The targets of a constant hand are written here, once.
        """
        if not isinstance(m.hand, FusedHand):
            table = Table(self._block(self.memory.take(CHUNK * 2 * width * targets)), m, targets == 2)
            self.tables.append(table)
            return {"hand_kind": TABLE, "hand": self.place(table.memory)}
        hand = m.hand
        if plants.is_still(hand):
            plant = cast("FusedPlant", m.plant)
            target = np.concatenate([hand.state[at : at + width] for at in hand.ports])
            for port in (plant.ports.middle, plant.ports.end):
                if port is not None:
                    plant.state[port : port + 2 * width] = target
            return {"hand_kind": STILL}
        place = self.place(self._block(hand.state))
        return {
            "hand_kind": KERNEL,
            "hand": place,
            "hand_kernel": self._kernel(hand.kernel, OF_HAND, hand.state),
            "target_position": place + hand.ports.position,
            "target_velocity": place + hand.ports.velocity,
        }

    # The recording ----------------------------------------------------------------------------------------------------

    def _columns(self) -> list[int]:
        """List the places of the values of a row, in the order of the row."""
        columns = self.parts.layout.columns
        numbers, places = np.arange(self.parts.layout.width), dict[int, int]()

        def add(column: str, first: int, entries: Iterable[int]) -> None:
            if column in columns:
                where = numbers[columns[column].where].tolist()
                places.update(zip(where, [first + int(e) for e in entries], strict=True))

        for part in self.parts.objects:
            place, where = self.place(part.grasped.block), part.grasped.where
            for each in OF_FINGERS:
                if each.filled != "sample" or each.name not in columns:
                    continue
                column = columns[each.name]
                own = numbers[column.where].reshape(column.shape)[part.fingers]
                places.update(zip(own.ravel().tolist(), (place + where[column.name].ravel()).tolist(), strict=True))
            for each in OF_OBJECTS:
                if each.filled == "sample":
                    add(f"objects/{part.name}/{each.name}", place, where[each.name].ravel())
        for part, observer in zip(self.parts.objects, self.parts.observers, strict=False):
            for quantity, entries in observer.where.items():
                add(f"objects/{part.name}/energy/{quantity}", self.place(observer.buffer), entries.ravel())
        if self.parts.safety is not None:
            for part, buffer in zip(self.parts.objects, self.parts.safety.buffers, strict=True):
                for quantity, entries in self.parts.safety.where.items():
                    add(f"objects/{part.name}/{quantity}", self.place(buffer), entries.ravel())
        size, servo = self.n * self.d, self.place(self.own)
        add("displayed_force", servo + self.servo.displayed.offset, range(size))
        add("device_energy", servo + self.servo.energy.offset, range(self.n))
        add("true_position", servo + self.servo.before.offset, range(size))
        for name, first, count in self._loop_columns():
            add(name, first, range(count))
        if "largest_force" in columns:
            where = numbers[columns["largest_force"].where].tolist()
            places.update({where[f]: place for f, place in self._largest.items()})
        assert sorted(places) == list(range(len(numbers)))
        return [places[k] for k in range(len(numbers))]

    def _loop_columns(self) -> Iterator[tuple[str, int, int]]:
        """Yield name, first place and size of each column that the real-time loop fills."""
        if self.loop is None:
            return
        state, place, columns = LoopState(self.loop), self.place(self.loop), self.parts.layout.columns
        firsts = {name: start_of(LoopState, name) for name in ("wall", "late", "skipped")}
        firsts |= {"io": start_of(LoopState, "io_read"), "fresh": state.fresh.offset, "switches": state.switches.offset}
        firsts["largest_force"] = state.largest.offset
        first = state.raw.offset
        for device, count, _ in self.parts.layout.raw:
            firsts[f"raw/{device}"] = first
            first += count
        for name, entry in firsts.items():
            if name in columns:
                where = columns[name].where
                yield name, place + entry, len(range(*where.indices(self.parts.layout.width)))
