"""Many values of keys of devices and hands at once: their blocks, made for each choice of values and nothing else.

What decides a choice is checked by the tables' own fields and by the drivers; the blocks are filled by the functions
that fill those of one scene, so that they are the same, bit by bit. No object is filled anew and no program written.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from graspfx import plugins
from graspfx.assembly.fading import squeezes
from graspfx.assembly.force_limits import force_limits
from graspfx.assembly.hand_parts import make_hand
from graspfx.assembly.holdings import holdings
from graspfx.assembly.live import value_of
from graspfx.assembly.plants import make_plants
from graspfx.assembly.resolve import Parts
from graspfx.assembly.stock import Stock
from graspfx.assembly.wiring import Wire, connect, fitted, outside_faults
from graspfx.errors import GraspFXError
from graspfx.loop.plant import is_still
from graspfx.numeric import LARGEST
from graspfx.scene.tables.fields import Table
from graspfx.scene.tables.part_tables import Device

if TYPE_CHECKING:
    from graspfx.assembly.hand_parts import HandPart
    from graspfx.loop.servo import Servo
    from graspfx.scene.model import Scene
    from graspfx.scene.tables.scene_table import SceneTable

Location = tuple[str | int, ...]
FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Index = NDArray[np.intp]
Column = tuple[FloatArray, int, FloatArray]  # a block, an entry of it, and its number in each variant

SAME = ("fingers", "dimensions", "continuous_force", "stiffness", "delay")  # features that other parts go by


class NotAlikeError(Exception):
    """Values choose what is computed: variants of several programs."""


@dataclass(frozen=True, eq=False)
class PartColumns:
    """Values of keys of devices and hands, one of each for every variant.

    Args:
        scene: the scene; other keys of it may be replaced, too.
        values: by key, numbered, (V,).
    """

    scene: Scene
    values: Mapping[str, FloatArray]

    @cached_property
    def _choices(self) -> tuple[FloatArray, Index]:
        """Give the choices of values, to the last bit, and which of them each variant has."""
        bits = np.stack([each.view(np.int64) for each in self.values.values()], axis=1)
        rows, choice = np.unique(bits, axis=0, return_inverse=True)
        return rows.view(np.float64), choice.ravel()

    @property
    def has_hands(self) -> bool:
        return any(map(is_of_a_hand, self.values))

    def sound(self, parts: Parts) -> BoolArray:
        """Tell of which values it is sure that the scene's checks pass them, as those of another variant pass."""
        rows, choice = self._choices
        return np.array([self._is_sound(parts, row) for row in rows])[choice]

    def _is_sound(self, parts: Parts, row: FloatArray) -> bool:
        if not (np.isfinite(row) & (np.abs(row) <= LARGEST)).all():
            return False
        try:
            scene = self._scene(row)
            wired = _wires(parts, scene, self._changed(parts, scene))
            force_limits(len(scene.finger), wired)
        except (GraspFXError, ValidationError):
            return False
        return all(_fits(wire, own, parts.start) for wire, own in zip(wired, parts.wires, strict=True))

    def _scene(self, row: FloatArray) -> Scene:
        """Copy the scene with a choice of values, checked by the fields of their tables."""
        tables: dict[str, list[Any]] = {name: list(getattr(self.scene, name)) for name in ("finger", "device", "hand")}
        for key, value in zip(self.values, row.tolist(), strict=True):
            first, number, *path = key.split(".")
            for k in range(len(tables[first])) if number == "*" else [int(number)]:
                tables[first][k] = _with(tables[first][k], path, value)
        return self.scene.model_copy(update={name: tuple(items) for name, items in tables.items()})

    def _changed(self, parts: Parts, scene: Scene) -> list[Location]:
        """List where the tables of devices stand that differ."""
        return [wire.at for wire in parts.wires if _device_at(scene, wire) is not _device_at(self.scene, wire)]

    def blocks(self, parts: Parts, servo: Servo) -> PartBlocks:
        """Make the blocks of all choices, of those devices, plants and hands that the keys reach.

        Args:
            parts: of the scene.
            servo: of one of the variants, which has not run.

        Raises:
            NotAlikeError: some values choose what is computed.
        """
        rows, choice = self._choices
        first = self._scene(rows[0])
        changed = self._changed(parts, first)
        fingers = {f for wire in parts.wires if wire.at in changed for f in wire.used.tolist()}
        for own, new in zip(parts.hands, holdings(first), strict=True):
            fingers |= set(own.fingers) if own.holding.table is not new.table else set()
        plants = [wiring for wiring in servo.plants if fingers & set(wiring.fingers.tolist())]
        reached = [wire for wire in parts.wires if any(set(wire.used) & set(each.fingers) for each in plants)]
        own_parts: list[Any] = [s.device for s in servo.stations if any(set(s.fingers) & set(w.used) for w in reached)]
        own_parts += [part for wiring in plants for part in (wiring.plant, wiring.hand)]
        inward = np.zeros_like(parts.start)
        for each in servo.objects:
            inward[each.fingers] = each.grasped.inward()
        states: list[list[FloatArray]] = [[] for _ in own_parts]
        limits: list[FloatArray | None] = []
        pushes: list[list[float]] = []
        for row in rows:
            scene = self._scene(row)
            wired = _wires(parts, scene, [wire.at for wire in reached])
            hands = [
                own if new.table is own.holding.table else make_hand(scene, parts.stock, new)
                for own, new in zip(parts.hands, holdings(scene), strict=True)
            ]
            used = [wire for wire, own in zip(wired, parts.wires, strict=True) if wire is not own]
            inside = {f for wire in used for f in wire.used.tolist()}
            anew = _parts(parts, scene, [hand for hand in hands if inside & set(hand.fingers)])
            for to, part, base in zip(states, _ready(anew, used, servo, inward), own_parts, strict=True):
                to.append(_alike(part, base))
            limits.append(force_limits(len(scene.finger), wired))
            if self.has_hands and fades(scene):
                pushes.append(squeezes(_parts(parts, scene, hands), servo.objects, inward))
        blocks = [part.state for part in own_parts]
        return PartBlocks(blocks, [np.array(each) for each in states], limits, np.array(pushes), choice)


@dataclass(frozen=True, eq=False)
class PartBlocks:
    """Blocks of devices, plants and hands for each choice of values.

    Attributes:
        blocks: of the servo.
        states: of each of them, its numbers for every choice, (R, size).
        limits: largest forces of fingers for every choice [N], (n,), or None.
        pushes: how hard each object is squeezed at most [N], (R, objects).
        choice: which of them each variant has, (V,).
    """

    blocks: list[Any]
    states: list[FloatArray]
    limits: list[FloatArray | None]
    pushes: FloatArray
    choice: Index

    def columns(self) -> Iterator[Column]:
        """List the entries that are not the same for all choices or in the servo."""
        for block, rows in zip(self.blocks, self.states, strict=True):
            for entry in np.flatnonzero((rows.view(np.int64) != block.view(np.int64)).any(axis=0)).tolist():
                yield block, entry, rows[self.choice, entry]

    def limit(self, finger: int) -> FloatArray | None:
        """Give the largest force of a finger in each variant [N]; None where there is none."""
        if any(each is None for each in self.limits):
            return None
        return np.array([each[finger] for each in self.limits if each is not None])[self.choice]


def is_of_a_hand(own: str) -> bool:
    """Tell whether a key, numbered, is one of a hand."""
    return own.startswith("hand.") or own.split(".")[2:3] == ["hand"]


def is_of_a_part(scene: Scene, own: str) -> bool:
    """Tell whether a key, numbered, is a number of a device or of a hand that blocks alone are made from."""
    first, *rest = own.split(".")
    path = rest[1:]
    if scene.coupling.split == "mass" or not path:
        return False
    if first == "finger" and (len(path) < 2 or path[0] not in ("device", "hand")):
        return False
    if first not in ("finger", "device", "hand"):
        return False
    try:
        value = value_of(scene, own)
    except GraspFXError:
        return False
    numbers = value if isinstance(value, tuple) else (value,)
    return all(isinstance(each, int | float) and not isinstance(each, bool) for each in numbers)


def fades(scene: SceneTable) -> bool:
    """Tell whether a fade is automatic, so that it begins where the hands' squeeze asks for it."""
    rules = scene.coupling
    return rules.fade == "auto" and rules.absent != "follow" and rules.contact != "attached"


def _device_at(scene: SceneTable, wire: Wire) -> Any:
    first, number = wire.at[:2]
    table = getattr(scene, str(first))[number]
    return table.device if first == "finger" else table


def _wires(parts: Parts, scene: Scene, places: Collection[Location]) -> list[Wire]:
    """Connect the devices that stand at some places anew; all others are those of the parts."""
    out = []
    for wire in parts.wires:
        if wire.at not in places:
            out.append(wire)
            continue
        table = _device_at(scene, wire)
        device = connect(plugins.load("devices", table.name, parts.folder), table, scene.dimensions)
        out.append(fitted(wire.at, device, wire.fingers, table, scene))
    return out


def _fits(wire: Wire, own: Wire, start: FloatArray) -> bool:
    """Tell whether other parts of a scene see no other device, but for what follows from its numbers."""
    if wire is own:
        return True
    same = all(getattr(wire.features, name) == getattr(own.features, name) for name in SAME)
    same = same and repr(wire.features.workspace) == repr(own.features.workspace)
    return same and not any(outside_faults(wire, start))


def _parts(parts: Parts, scene: Scene, hands: Sequence[HandPart]) -> Parts:
    """Give the parts of a scene that differs in its hands."""
    anew = Parts(scene, Stock(parts.folder))
    vars(anew).update(start=parts.start, hands=tuple(hands))
    return anew


def _ready(anew: Parts, wired: Sequence[Wire], servo: Servo, inward: FloatArray) -> Iterator[Any]:
    """Make devices, plants and hands ready for the first tick, as `build` does, one after another."""
    plants = list(make_plants(anew, wired, inward))
    for wire in wired:
        with wire.device:
            wire.device.open(servo.period)
            yield wire.device
    for each in plants:
        plant: Any = each.plant
        plant.hold(each.hand, servo.period)
        if is_still(each.hand):  # its targets stand in the plant's block, as the tick's wires leave them there
            r, v = each.hand.target(0.0)
            for port in (plant.ports.end, plant.ports.middle):
                if port is not None:
                    plant.state[port : port + r.size] = r.ravel()
                    plant.state[port + r.size : port + 2 * r.size] = v.ravel()
        yield plant
        yield each.hand


def _alike(part: Any, own: Any) -> FloatArray:
    """Copy the block of a part that is laid out like one of the servo."""
    if part.state.shape != own.state.shape or not np.array_equal(part.structure, own.structure):
        raise NotAlikeError
    places = own.structure
    if part.state[places].tobytes() != own.state[places].tobytes():
        raise NotAlikeError
    return np.array(part.state)


def _with(table: Any, path: list[str], value: float) -> Any:
    """Copy a table with one number in it, or below it, replaced; its own fields check it."""
    name, *rest = path
    if isinstance(table, Device) and not rest and name in table.settings:
        return table.model_copy(update={name: value})
    if not isinstance(table, Table) or isinstance(table, Device):
        raise ValidationError.from_exception_data("table", [])  # no such number, or in a form of its own
    if rest:
        return table.model_copy(update={name: _with(getattr(table, name), rest, value)})
    fields = {field: getattr(table, field) for field in table.model_fields_set}
    return type(table).model_validate({**fields, name: value})
