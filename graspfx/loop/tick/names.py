"""Names of the entries of a tick's memories, by the declarations of what stands in them: `finger[0].force.x`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.entry_names import name_of
from graspfx.compile.records import Record, layout, size_of
from graspfx.coupling.grasp_state import GraspState
from graspfx.loop.device import FusedDevice
from graspfx.loop.parts import Parts, guest_of
from graspfx.loop.plant import FusedHand, FusedPlant
from graspfx.loop.realtime.loop_state import LoopState
from graspfx.loop.recording.layout import Layout
from graspfx.loop.safety.safety_state import Pace, SafetyState
from graspfx.loop.tick.memory import ServoState
from graspfx.loop.tick.script import Script, Tick
from graspfx.objects.guest import GuestState

FloatArray = NDArray[np.float64]
NamedEntry = tuple[FloatArray, int, str]  # a memory, an entry of it, and its name, in full or from the first point on
AXES = "xyz"


class Names:
    """Names of a script's memories, and of their entries.

    An object's block is declared by `GraspState`, a guest's by `GuestState`. The entries at the ports of devices,
    plants and hands have the ports' names; which record all of their memory is, or that of a body or a ledger, is said
    by an attribute `declaration`.

    Attributes:
        memories: names of arrays, such as `object[0]`.
    """

    def __init__(self, parts: Parts, tick: Tick) -> None:
        script, self.memories = tick.script, _memories(tick.script)
        arrays = {id(array): name for name, array in script.arrays.items()}
        self._arrays = script.arrays
        self._fingers = {arrays[id(part.grasped.block)]: part.fingers.tolist() for part in parts.objects}
        self._declarations = {
            arrays[id(array)]: declaration for array, declaration in _declarations(parts) if id(array) in arrays
        }
        entries = [_servo(parts, tick.own), _ports(parts, tick), _loop(tick)]
        entries += [each(parts) for each in (_devices, _plants, _hands, _guests)]
        self._entries = {(arrays[id(array)], k): name for array, k, name in chain(*entries) if id(array) in arrays}

    def entry(self, array: str, k: int) -> str:
        """Name an entry of an array; one that nothing declares by its number."""
        name = self._declared(array, k)
        if array in self._fingers and name.startswith(".fingers["):  # by their numbers in the scene
            j, _, rest = name.removeprefix(".fingers[").partition("]")
            return f"finger[{self._fingers[array][int(j)]}]{rest}"
        return name if name[0] not in ".[" else f"{self.memories[array]}{name}"

    def shared(self, array: str, k: int) -> str:
        """Name an entry where a function serves several memories of a kind: without the number of this one."""
        name = self._declared(array, k)
        return name if name[0] not in ".[" else f"{self.memories[array].partition('[')[0]}{name}"

    def _declared(self, array: str, k: int) -> str:
        """Name an entry in full, or from the point or bracket after its memory's name on."""
        name = self._entries.get((array, k))
        if name is None and array in self._declarations:
            name = name_of(self._declarations[array], k, self._arrays[array])
            return name if name.startswith("[") else f".{name}"
        return name or f"[{k}]"


def columns(layout: Layout) -> Mapping[int, str]:
    """Name each number of a recorded row."""
    names: dict[int, str] = {}
    for column in layout.columns.values():
        by_finger = column.dimensions[:1] == ("finger",)
        ends = _components(column.shape[by_finger:])
        starts = [f"[{f}]" for f in range(len(layout.fingers))] if by_finger else [""]
        name = f"row.{column.name.replace('/', '.')}"
        suffixes = [f"{name}{start}{end}" for start in starts for end in ends]
        names |= dict(zip(range(*column.where.indices(layout.width)), suffixes, strict=True))
    return names


def _memories(script: Script) -> dict[str, str]:
    """Name the arrays with numbers that begin anew for each kind."""
    counts: dict[str, int] = {}
    names = {}
    for array in script.arrays:
        kind = array.rstrip("0123456789")
        names[array] = kind if kind == "servo" else f"{kind}[{counts.get(kind, 0)}]"
        counts[kind] = counts.get(kind, 0) + 1
    return names


def _declarations(parts: Parts) -> Iterator[tuple[FloatArray, type[Record]]]:
    """List memories with the records that they are."""
    yield from ((part.grasped.block, GraspState) for part in parts.objects)
    if parts.safety is not None:
        yield parts.safety.pace, Pace
        yield from ((buffer, SafetyState) for buffer in parts.safety.buffers)
    owners: list[tuple[object, object]] = [(s.device, getattr(s.device, "state", None)) for s in parts.stations]
    for m in parts.plants:
        owners += [(part, getattr(part, "state", None)) for part in (m.plant, m.hand)]
    owners += [(mover.body, getattr(mover.body, "buffer", None)) for mover in parts.movers]
    owners += [(observer, observer.buffer) for observer in parts.observers]
    for owner, array in owners:
        declaration = getattr(owner, "declaration", None)
        if declaration is not None and isinstance(array, np.ndarray):
            yield array, declaration


def _servo(parts: Parts, servo: FloatArray) -> Iterator[NamedEntry]:
    for name, field in layout(ServoState).items():
        if field.offset.isdigit() and field.size == "1":
            yield servo, int(field.offset), f"servo.{name}"
    block, n, d = ServoState(servo), len(parts.layout.fingers), parts.layout.dimensions
    yield from ((servo, block.stuck_bodies.offset + i, f"body[{i}].stuck") for i in range(block.bodies))
    yield from ((servo, block.stuck_plants.offset + j, f"plant[{j}].stuck") for j in range(block.plants))
    for quantity, array, width in (
        ("displayed", block.displayed, d),
        ("before", block.before, d),
        ("energy", block.energy, 1),
    ):
        for f in range(n):
            yield from _vectors(servo, array.offset + f * width, f"finger[{f}].{quantity}", 1, width)


def _loop(tick: Tick) -> Iterator[NamedEntry]:
    if tick.loop is not None:
        yield from ((tick.loop, k, f"loop.{name_of(LoopState, k, tick.loop)}") for k in range(len(tick.loop)))


def _devices(parts: Parts) -> Iterator[NamedEntry]:
    d = parts.layout.dimensions
    for station in parts.stations:
        if isinstance(station.device, FusedDevice):
            state, ports, k = station.device.state, station.device.ports, len(station.fingers)
            yield from _vectors(state, ports.sensed, ".sensed", 1, len(station.device.sensed))
            for quantity in ("position", "velocity", "command", "effort"):
                yield from _vectors(state, getattr(ports, quantity), f".{quantity}", k, d)


def _ports(parts: Parts, tick: Tick) -> Iterator[NamedEntry]:
    d = parts.layout.dimensions
    for port in tick.ports:
        k = len(port.position)
        yield port.memory, 0, ".readable"
        for i, quantity in enumerate(("position", "velocity", "command")):
            yield from _vectors(port.memory, 1 + i * k * d, f".{quantity}", k, d)
        if port.limit is not None:
            yield from _vectors(port.memory, 1 + 3 * k * d, ".limit", k, 1)


def _plants(parts: Parts) -> Iterator[NamedEntry]:
    d = parts.layout.dimensions
    for m in parts.plants:
        if isinstance(m.plant, FusedPlant):
            state, ports, n = m.plant.state, m.plant.ports, len(m.fingers)
            for quantity in ("effort", "position", "velocity"):
                yield from _vectors(state, getattr(ports, quantity), f".{quantity}", n, d)
            for quantity, first in (("middle", ports.middle), ("end", ports.end)):
                if first is not None:
                    yield from _vectors(state, first, f".{quantity}.position", n, d)
                    yield from _vectors(state, first + n * d, f".{quantity}.velocity", n, d)


def _hands(parts: Parts) -> Iterator[NamedEntry]:
    for m in parts.plants:
        if isinstance(m.hand, FusedHand):
            for quantity in ("position", "velocity"):
                first = getattr(m.hand.ports, quantity)
                yield from _vectors(m.hand.state, first, f".{quantity}", len(m.fingers), parts.layout.dimensions)


def _guests(parts: Parts) -> Iterator[NamedEntry]:
    for mover in parts.movers:
        if (guest := guest_of(mover.body)) is not None:
            places = [place for place in guest.places if place >= 0]
            for i, place in enumerate(places):
                front = f".body[{i}]." if len(places) > 1 else "."
                for k in range(place, place + size_of(GuestState)):
                    yield guest.buffer, k, name_of(GuestState, k, guest.buffer, front, place)


def _vectors(state: FloatArray, first: int, name: str, count: int, d: int) -> Iterator[NamedEntry]:
    """Name some vectors one after another."""
    for i in range(count):
        for a, suffix in enumerate(_components((d,))):
            yield state, first + i * d + a, f"{name}{f'[{i}]' if count > 1 else ''}{suffix}"


def _components(shape: Sequence[int]) -> list[str]:
    """List suffixes of a number, of a vector's components, or of many numbers."""
    width = shape[0] if shape else 1
    if width == 1:
        return [""]
    return [f".{AXES[a]}" for a in range(width)] if width <= len(AXES) else [f"[{a}]" for a in range(width)]
