"""The tick of a scene as a script: read, couple, limit, display; record, move."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from graspfx.coupling import block as at
from graspfx.coupling.approach import LOST
from graspfx.coupling.limit import limit
from graspfx.coupling.sample import conclude, couple, let_go, sample
from graspfx.errors import InputError
from graspfx.loop import plant as plants
from graspfx.loop.device import Device, FusedDevice, LimitedDevice, fused, limit_port
from graspfx.loop.energy.observer import MET, Observer
from graspfx.loop.energy.watch import watch
from graspfx.loop.parts import Moved, Mover, Parts, Station, guest_of
from graspfx.loop.plant import FusedHand, FusedPlant
from graspfx.loop.tick.script import Script, copied, under
from graspfx.loop.tick.sources import sources
from graspfx.objects.body import NativeBody
from graspfx.objects.guest import Guest

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]

# The servo's own memory.
FAULTED = 0
TICK = 1  # of the first fault
KIND = 2  # what could not go on,
INDEX = 3  # which of its kind,
CODE = 4  # and why
PERIOD = 5  # T [s]
AHEAD = 6  # the tick that the targets of hands without kernels begin with
STUCK = 7  # one for each mover, then for each plant

STATION, OBJECT_, MOVER, PLANT, TOLD = range(5)  # TOLD: by code that is no kernel, in words

CHUNK = 1024  # ticks for which the targets of a hand without a kernel are known ahead


def latch(S: Any, k: int, kind: int, index: int, code: int) -> None:
    """Keeps the first fault; from then on every force is zero."""
    if S[FAULTED] == 0.0:
        S[FAULTED] = 1.0
        S[TICK] = k
        S[KIND] = kind
        S[INDEX] = index
        S[CODE] = code


@dataclass
class Port:
    """The memory through which a device that is no kernel is read and written."""

    station: int
    position: FloatArray
    velocity: FloatArray
    command: FloatArray
    memory: FloatArray  # whether it could be read; then the three above, and the limits
    limit: FloatArray | None = None  # of a device whose largest force depends on where it stands


@dataclass
class Table:
    """The targets of a hand that is no kernel, for each tick of a call."""

    moved: int
    memory: FloatArray  # (CHUNK, width), flat: r and r' at the end of each sample, then in its middle if asked for
    middle: bool


@dataclass
class Tick:
    """The script's lines, and what is left to be done beside it."""

    script: Script
    own: FloatArray
    begin: list[str] = field(default_factory=list)  # read, couple, limit, display
    end: list[str] = field(default_factory=list)  # let go after a fault, record, move
    ports: list[Port] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    guests: list[int] = field(default_factory=list)  # movers that other software moves between two calls
    bodies: list[int] = field(default_factory=list)  # movers that are no kernels
    plants: list[int] = field(default_factory=list)  # plants that are no kernels

    @property
    def own_name(self) -> str:
        """Of the servo's own memory in the script."""
        return next(name for name, array in self.script.arrays.items() if array is self.own)


def write(parts: Parts, *, record: bool = True) -> Tick:
    """The tick of these parts.

    Args:
        record: whether a row is written, to the array `rows` at row r.
    """
    return _Writer(parts).written(record)


def _shown(m: Moved) -> FloatArray:
    """Where a plant that is no kernel shows its fingertips, flat."""
    flat: FloatArray = m.plant.position.reshape(-1)
    if not np.shares_memory(flat, m.plant.position):
        raise InputError(
            "plant", type(m.plant).__qualname__, "a `position` that is the same contiguous array for the plant's life",
            "keep one array and write into it",
        )  # fmt: skip
    return flat


class _Writer:
    def __init__(self, parts: Parts) -> None:
        self.parts = parts
        self.n, self.d = len(parts.layout.fingers), parts.layout.dimensions
        self.displayed = STUCK + len(parts.movers) + len(parts.moved)
        self.before = self.displayed + self.n * self.d
        self.energy = self.before + self.n * self.d
        self.script = script = Script()
        self.tick = Tick(script, np.zeros(self.energy + self.n))
        self.tick.own[PERIOD] = parts.period
        self.own = script.memory("servo", self.tick.own, [PERIOD])
        self.blocks = [script.memory("object", h.grasped.block, h.grasped.structure) for h in parts.objects]
        self.books = [script.memory("ledger", o.buffer, o.structure) for o in parts.observers]
        for m in parts.moved:
            if isinstance(m.plant, FusedPlant):
                m.plant.hold(m.hand, parts.period)
        for mover in parts.movers:
            if (guest := guest_of(mover.body)) is not None:
                guest.hold(parts.period)
        self.native = [self._is_native(m) for m in parts.moved]
        self.plants = [
            script.memory("plant", m.plant.state, m.plant.structure)
            if isinstance(m.plant, FusedPlant)
            else script.memory("plant", _shown(m))
            for m in parts.moved
        ]
        self.limit_of: dict[int, tuple[str, int]] = {}  # where the largest force of each finger stands
        self.entry_of = self._fingers()

    def written(self, record: bool) -> Tick:
        tick = self.tick
        tick.begin += [*self._take(), *self._read(), *self._couple(), *self._work(), *self._display()]
        tick.end += [*self._let_go(), *(self._record() if record else ()), *self._move(), *self._advance()]
        return tick

    def _is_native(self, m: Moved) -> bool:
        """Whether kernels do all that a plant needs."""
        seen = {id(station.device) for station in self.parts.stations}
        devices = [cast("Device", device) for device in m.devices]
        return plants.fused(m.plant) is not None and all(fused(d) is not None and id(d) in seen for d in devices)

    def _fingers(self) -> dict[int, tuple[str, int]]:
        """Name and row of the block that holds each finger."""
        found = {}
        for name, held in zip(self.blocks, self.parts.objects, strict=True):
            for j, f in enumerate(held.fingers.tolist()):
                found[f] = name, at.ROW + j * at.STRIDE
                if held.grasped.limit is not None:
                    self.limit_of[f] = name, at.ROW + j * at.STRIDE + at.LIMIT
        return found

    def _latched(self, kind: int, index: int) -> str:
        return f"{self.script.kernel(latch)}({self.own}, k, {kind}, {index}, code)"

    def _faulted(self) -> str:
        return f"{self.own}[{FAULTED}] != 0.0"

    # Take: what a guest was told after the last tick ---------------------------------------------------------------

    def _take(self) -> Iterator[str]:
        for i, mover in enumerate(self.parts.movers):
            guest = guest_of(mover.body)
            if guest is not None:
                stuck = f"{self.own}[{STUCK + i}]"
                failed = [f"{self.script.kernel(latch)}({self.own}, k - 1, {MOVER}, {i}, code)", f"{stuck} = 1.0"]
                for part in self._guest_parts(mover, guest):
                    lines = [f"code = {self.script.kernel(guest.taking)}({part})", *under("code != 0", failed)]
                    yield from under(f"{stuck} == 0.0", lines)

    def _guest_parts(self, mover: Mover, guest: Guest) -> Iterator[str]:
        """The arguments of its kernels for each body that moves."""
        name = self.script.memory("guest", guest.buffer, guest.structure)
        for number, place in zip(mover.objects, guest.places, strict=True):
            if place >= 0:
                yield f"{self.blocks[number]}, {at.BODY}, {name}, {place}, {self.own}[{PERIOD}]"

    # Read ---------------------------------------------------------------------------------------------------------

    def _read(self) -> Iterator[str]:
        for i, station in enumerate(self.parts.stations):
            device, used = station.device, station.fingers
            plant = self._plant_of(device)
            if plant is not None and isinstance(device, FusedDevice):
                name = self.script.memory("device", device.state, device.structure)
                port = device.ports
                sensed = range(port.sensed, port.sensed + len(device.sensed))
                yield from copied(name, sensed, plant, device.sensed)
                yield f"code = {self.script.kernel(device.reading)}({name}, 0)"
                seen = self._seen(used, name, port.position, port.velocity, limit_port(device))
                yield from under("code != 0", [self._latched(STATION, i)], seen)
            else:
                name, position, velocity, limit = self._port(i, station)
                yield from under(f"{name}[0] != 0.0", self._seen(used, name, position, velocity, limit))

    def _plant_of(self, device: Device) -> str | None:
        """The memory of the native plant that moves a device."""
        for m, name, native in zip(self.parts.moved, self.plants, self.native, strict=True):
            if native and id(device) in map(id, m.devices):
                return name
        return None

    def _port(self, i: int, station: Station) -> tuple[str, int, int, int | None]:
        k, size = len(station.fingers), len(station.fingers) * self.d
        limited = isinstance(station.device, LimitedDevice)
        memory = np.zeros(1 + 3 * size + (k if limited else 0))
        arrays, last = memory[1 : 1 + 3 * size].reshape(3, k, self.d), 1 + 3 * size
        self.tick.ports.append(Port(i, arrays[0], arrays[1], arrays[2], memory, memory[last:] if limited else None))
        return self.script.memory("port", memory), 1, 1 + size, last if limited else None

    def _seen(self, fingers: Index, name: str, position: int, velocity: int, limit: int | None) -> Iterator[str]:
        for c, f in enumerate(fingers.tolist()):
            if f >= 0:
                block, row = self.entry_of[f]
                for to, source in ((at.POSITION, position), (at.VELOCITY, velocity)):
                    start = source + c * self.d
                    yield from copied(block, range(row + to, row + to + self.d), name, range(start, start + self.d))
                if limit is not None and f in self.limit_of:
                    block, entry = self.limit_of[f]
                    yield from copied(block, [entry], name, [limit + c])

    # Couple -------------------------------------------------------------------------------------------------------

    def _couple(self) -> Iterator[str]:
        T = f"{self.own}[{PERIOD}]"
        for mover in self.parts.movers:
            if isinstance(mover.body, NativeBody) and self.parts.objects[mover.objects[0]].grasped.implicit:
                block, other = self._bodies_memory(mover)
                yield f"{self.script.kernel(mover.body.predicting)}({block}, {at.BODY}, {other}, 0, {T})"
        for i, block in enumerate(self.blocks):
            number = next(number for number, mover in enumerate(self.parts.movers) if i in mover.objects)
            lost = under(f"code == {LOST}", [f"{self.own}[{STUCK + number}] = 1.0"])
            lines = [f"code = {self.script.kernel(sample)}({block}, 0)"]
            if self.parts.objects[i].grasped.limit is not None:  # what the object receives is what is displayed
                lines = [
                    f"code = {self.script.kernel(couple)}({block}, 0)",
                    f"code = {self.script.kernel(limit)}({block}, 0, code)",
                    f"code = {self.script.kernel(conclude)}({block}, 0, code)",
                ]
            lines += under("code != 0", [self._latched(OBJECT_, i), *lost])
            if self.parts.observers:
                observer, book = self.parts.observers[i], self.books[i]
                lines += under(f"{self.own}[{FAULTED}] == 0.0", self._watched(observer, number, block, book))
            yield from under(f"{self.own}[{FAULTED}] == 0.0", lines)

    def _watched(self, observer: Observer, mover: int, block: str, book: str) -> Iterator[str]:
        if observer.met is not None:
            body = self.parts.movers[mover].body
            first = (observer.met.ctypes.data - body.buffer.ctypes.data) // observer.met.itemsize
            _, floor = self._bodies_memory(self.parts.movers[mover])
            yield from copied(book, range(MET, MET + 6), floor, range(first, first + 6))
        yield f"{self.script.kernel(watch)}({block}, 0, {book}, 0, {self.own}[{PERIOD}])"

    def _bodies_memory(self, mover: Mover) -> tuple[str, str]:
        """The block that a native body is in, and its buffer beside it or the block again."""
        block = self.blocks[mover.objects[0]]
        buffer = mover.body.buffer
        return block, block if buffer is None else self.script.memory("floor", buffer, mover.body.structure)

    def _work(self) -> Iterator[str]:
        """Of the last sample's forces at the devices; then where the fingers are now."""
        places = [self._place(f) for f in range(self.n)]
        lines = []
        for f, (name, place) in enumerate(places):
            o = f * self.d
            terms = [
                f"{self.own}[{self.displayed + o + a}] * ({name}[{place + a}] - {self.own}[{self.before + o + a}])"
                for a in range(self.d)
            ]
            lines.append(f"{self.own}[{self.energy + f}] += {' + '.join(terms)}")
        yield from under(f"k > 0 and {self.own}[{FAULTED}] == 0.0", lines)
        for f, (name, place) in enumerate(places):
            o = self.before + f * self.d
            yield from copied(self.own, range(o, o + self.d), name, range(place, place + self.d))
        yield from under(self._faulted(), self._released())

    def _place(self, f: int) -> tuple[str, int]:
        """Where the fingertip truly is, or where it was read if that is not known."""
        if self.parts.layout.simulated:
            for m, name in zip(self.parts.moved, self.plants, strict=True):
                if f in m.fingers:
                    start = m.plant.ports.position if isinstance(m.plant, FusedPlant) else 0
                    return name, start + m.fingers.tolist().index(f) * self.d
        block, row = self.entry_of[f]
        return block, row + at.POSITION

    def _released(self) -> list[str]:
        return [f"{self.script.kernel(let_go)}({block}, 0)" for block in self.blocks]

    # Display ------------------------------------------------------------------------------------------------------

    def _display(self) -> Iterator[str]:
        for f in range(self.n):
            block, row = self.entry_of[f]
            o, force = self.displayed + f * self.d, row + at.FORCE
            yield from copied(self.own, range(o, o + self.d), block, range(force, force + self.d), sign="-")
        foreign = {port.station: port for port in self.tick.ports}
        for i, station in enumerate(self.parts.stations):
            device = station.device
            if i in foreign:
                name, start = self.script.memory("port", foreign[i].memory), 1 + 2 * len(station.fingers) * self.d
                yield from self._told(station.fingers, name, start)
            elif isinstance(device, FusedDevice):
                name = self.script.memory("device", device.state)
                yield from self._told(station.fingers, name, device.ports.command)
                yield f"code = {self.script.kernel(device.writing)}({name}, 0)"
                yield from under("code != 0", [self._latched(STATION, i)])

    def _told(self, fingers: Index, name: str, command: int) -> Iterator[str]:
        for c, f in enumerate(fingers.tolist()):
            if f >= 0:
                to, o = command + c * self.d, self.displayed + f * self.d
                yield from copied(name, range(to, to + self.d), self.own, range(o, o + self.d))

    # The end of the tick ------------------------------------------------------------------------------------------

    def _let_go(self) -> list[str]:
        lines = self._released()
        lines += [f"{self.own}[{self.displayed + a}] = 0.0" for a in range(self.n * self.d)]
        foreign = {port.station for port in self.tick.ports}
        for i, station in enumerate(self.parts.stations):
            device = station.device
            if i not in foreign and isinstance(device, FusedDevice):
                lines.append(f"{self.script.kernel(device.stopping)}({self.script.memory('device', device.state)}, 0)")
        return under(self._faulted(), lines)

    def _record(self) -> Iterator[str]:
        width = self.parts.layout.width
        yield f"row = r * {width}"
        own = {
            "displayed_force": (self.displayed, self.n * self.d),
            "device_energy": (self.energy, self.n),
            "true_position": (self.before, self.n * self.d),
        }
        for column, (name, entry) in sorted(sources(self.parts, self.blocks, self.books, self.own, own)):
            yield f"rows[row + {column}] = {name}[{entry}]"

    def _move(self) -> Iterator[str]:
        for i, mover in enumerate(self.parts.movers):
            guest = guest_of(mover.body)
            if guest is not None:
                self.tick.guests.append(i)
                kernel = self.script.kernel(guest.handing)
                lines = [f"{kernel}({part})" for part in self._guest_parts(mover, guest)]
                yield from under(f"{self.own}[{STUCK + i}] == 0.0", lines)
                continue
            if not isinstance(mover.body, NativeBody):
                self.tick.bodies.append(i)
                continue
            block, other = self._bodies_memory(mover)
            stuck = f"{self.own}[{STUCK + i}]"
            step = f"{self.script.kernel(mover.body.stepping)}({block}, {at.BODY}, {other}, 0, {self.own}[{PERIOD}])"
            failed = under("code != 0", [self._latched(MOVER, i), f"{stuck} = 1.0"])
            yield from under(f"{stuck} == 0.0", [f"code = {step}", *failed])

    def _advance(self) -> Iterator[str]:
        for j, (m, name, native) in enumerate(zip(self.parts.moved, self.plants, self.native, strict=True)):
            if not native:
                self.tick.plants.append(j)
                continue
            assert isinstance(m.plant, FusedPlant)
            stuck = f"{self.own}[{STUCK + len(self.parts.movers) + j}]"
            lines = [*self._efforts(m, name), *self._targets(j, m, name)]
            lines.append(f"code = {self.script.kernel(m.plant.kernel)}({name}, 0)")
            lines += under("code != 0", [self._latched(PLANT, j), f"{stuck} = 1.0"])
            yield from under(f"{stuck} == 0.0", lines)

    def _efforts(self, m: Moved, plant: str) -> Iterator[str]:
        assert isinstance(m.plant, FusedPlant)
        to = m.plant.ports.effort
        for device in m.devices:
            fingers = device.features.fingers  # type: ignore[attr-defined] # it is a Device too
            assert isinstance(device, FusedDevice)
            count = fingers * self.d
            name, effort = self.script.memory("device", device.state), device.ports.effort
            yield from copied(plant, range(to, to + count), name, range(effort, effort + count))
            to += count

    def _targets(self, j: int, m: Moved, plant: str) -> Iterator[str]:
        assert isinstance(m.plant, FusedPlant)
        count, port = len(m.fingers) * self.d, m.plant.ports
        hand = m.hand if isinstance(m.hand, FusedHand) else None
        T = f"{self.own}[{PERIOD}]"
        wanted = [(port.end, f"(k + 1) * {T}")]
        if port.middle is not None:
            wanted.insert(0, (port.middle, f"0.5 * (k * {T} + (k + 1) * {T})"))
        if hand is not None:
            if plants.is_still(hand):
                for to, _ in wanted:
                    for start, source in ((to, hand.ports.position), (to + count, hand.ports.velocity)):
                        m.plant.state[start : start + count] = hand.state[source : source + count]
                return
            name = self.script.memory("hand", hand.state, hand.structure)
            for to, time in wanted:
                yield f"{self.script.kernel(hand.kernel)}({name}, 0, {time})"
                yield from copied(
                    plant, range(to, to + count), name, range(hand.ports.position, hand.ports.position + count)
                )
                velocity = range(hand.ports.velocity, hand.ports.velocity + count)
                yield from copied(plant, range(to + count, to + 2 * count), name, velocity)
            return
        width = 2 * count * len(wanted)
        table = Table(j, np.zeros(CHUNK * width), port.middle is not None)
        self.tick.tables.append(table)
        name = self.script.memory("targets", table.memory)
        yield f"ahead = (k - int({self.own}[{AHEAD}])) * {width}"
        for start, (to, _) in zip(range(width - 2 * count, -1, -2 * count), wanted, strict=True):
            for a in range(2 * count):
                yield f"{plant}[{to + a}] = {name}[ahead + {start + a}]"
