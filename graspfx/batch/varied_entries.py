"""Entries of blocks for many variants of a scene, computed as columns without building each variant.

A key is plain if its values determine entries directly or by a short formula, and if the scene's checks of these values
can be vectorised. Variants with values of other keys must be built. Special values, such as equal gains or a
coefficient of zero, divide the variants into kinds, and one variant of each kind is built. The blocks of devices and
hands are made by the functions for a single scene, once for each combination of values, and are therefore bit-identical
to those of a single scene.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from graspfx import plugins
from graspfx.assembly import live
from graspfx.assembly.bodies import Stock, mass, solid_inertia
from graspfx.assembly.build import make_plants
from graspfx.assembly.device_limits import force_limits
from graspfx.assembly.grasps import squeezes
from graspfx.assembly.hands import holdings, make_hand
from graspfx.assembly.resolve import Parts, resolve
from graspfx.assembly.wiring import Wire, connect, fitted, outside_faults
from graspfx.compile.kernel import source_function
from graspfx.compile.records import start_of
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.rules import compliance_of_numbers, gaps
from graspfx.errors import GraspFXError
from graspfx.loop.plant import is_still
from graspfx.numeric import LARGEST, SMALLEST
from graspfx.objects.body import VISCOUS_LIMIT
from graspfx.objects.body_state import BodyState
from graspfx.scene.keys import Key, general
from graspfx.scene.tables.fields import Table
from graspfx.scene.tables.part_tables import Device

if TYPE_CHECKING:
    from graspfx.assembly.hands import HandPart
    from graspfx.assembly.resolve import ObjectPart, Parts
    from graspfx.loop.servo import Servo
    from graspfx.scene.model import Scene
    from graspfx.scene.tables.scene_table import SceneTable


FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Index = NDArray[np.intp]
Column = tuple[FloatArray, int, FloatArray]  # a block, the index of an entry, and the entry's value in each variant
SAME = ("fingers", "dimensions", "continuous_force", "stiffness", "delay")  # features on which other parts depend


class NotAlikeError(Exception):
    """The values of variants select different computations, so that the variants cannot share a program."""


@dataclass(frozen=True, eq=False)
class PartColumns:
    """Values of plain keys of devices and hands in V variants.

    Args:
        scene: Scene of the variants.
        values: Values of each key, (V,); tables in the keys are denoted by their indices.
    """

    scene: Scene
    values: Mapping[str, FloatArray]

    @cached_property
    def _choices(self) -> tuple[FloatArray, Index]:
        """Return the distinct combinations of values, (R, keys), and the index of each variant's combination, (V,)."""
        bits = np.stack([each.view(np.int64) for each in self.values.values()], axis=1)
        rows, choice = np.unique(bits, axis=0, return_inverse=True)
        return rows.view(np.float64), choice.ravel()

    @property
    def has_hands(self) -> bool:
        return any(map(is_of_a_hand, self.values))

    def sound(self, parts: Parts) -> BoolArray:
        """Return a mask of variants that pass the scene's checks if another variant passes; others may pass too."""
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
        """Return a copy of the scene with a combination of values (keys,), which the fields of the tables validate."""
        tables: dict[str, list[Any]] = {name: list(getattr(self.scene, name)) for name in ("finger", "device", "hand")}
        for key, value in zip(self.values, row.tolist(), strict=True):
            first, number, *path = key.split(".")
            for k in range(len(tables[first])) if number == "*" else [int(number)]:
                tables[first][k] = _with(tables[first][k], path, value)
        return self.scene.model_copy(update={name: tuple(items) for name, items in tables.items()})

    def _changed(self, parts: Parts, scene: Scene) -> list[Key]:
        """List the locations of the device tables in which `scene` differs from the original scene."""
        return [wire.at for wire in parts.wires if _device_at(scene, wire) is not _device_at(self.scene, wire)]

    def blocks(self, parts: Parts, servo: Servo) -> PartBlocks:
        """Make the blocks of the devices, plants and hands that depend on the keys, for all combinations of values.

        Args:
            parts: Parts of the scene.
            servo: Servo of one of the variants, which has not run.

        Raises:
            NotAlikeError: If the values select different computations.
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
    """Blocks of devices, plants and hands for R combinations of values.

    Attributes:
        blocks: Blocks of the servo.
        states: Contents of each of these blocks for every combination, (R, size).
        limits: Largest forces of the fingers for every combination, (n,) [N]; None for a combination without limits.
        pushes: Largest squeezing force on each object for every combination, (R, objects) [N]; empty if no
            gains fade.
        choice: Index of each variant's combination, (V,).
    """

    blocks: list[Any]
    states: list[FloatArray]
    limits: list[FloatArray | None]
    pushes: FloatArray
    choice: Index

    def columns(self) -> Iterator[Column]:
        """Yield the columns of the entries whose value in a combination differs from the value in the servo."""
        for block, rows in zip(self.blocks, self.states, strict=True):
            for entry in np.flatnonzero((rows.view(np.int64) != block.view(np.int64)).any(axis=0)).tolist():
                yield block, entry, rows[self.choice, entry]

    def limit(self, finger: int) -> FloatArray | None:
        """Return the largest force of a finger in each variant, (V,) [N]; None if a combination has no limits."""
        if any(each is None for each in self.limits):
            return None
        return np.array([each[finger] for each in self.limits if each is not None])[self.choice]


def is_of_a_hand(own: str) -> bool:
    """Return whether a key, in which tables are denoted by indices, belongs to a hand."""
    return own.startswith("hand.") or own.split(".")[2:3] == ["hand"]


def is_of_a_part(scene: Scene, own: str) -> bool:
    """Return whether a key denotes a number of a device or hand that only affects blocks of devices, plants and hands.

    Tables in the key are denoted by indices.
    """
    first, *rest = own.split(".")
    path = rest[1:]
    if scene.coupling.split == "mass" or not path:
        return False
    if first == "finger" and (len(path) < 2 or path[0] not in ("device", "hand")):
        return False
    if first not in ("finger", "device", "hand"):
        return False
    try:
        value = live.value_of(scene, own)
    except GraspFXError:
        return False
    numbers = value if isinstance(value, tuple) else (value,)
    return all(isinstance(each, int | float) and not isinstance(each, bool) for each in numbers)


def fades(scene: SceneTable) -> bool:
    """Return whether the fade of a scene is computed automatically from the hands' squeeze."""
    rules = scene.coupling
    return rules.fade == "auto" and rules.absent != "follow" and rules.contact != "attached"


def _device_at(scene: SceneTable, wire: Wire) -> Any:
    first, number = wire.at[:2]
    table = getattr(scene, str(first))[number]
    return table.device if first == "finger" else table


def _wires(parts: Parts, scene: Scene, places: Collection[Key]) -> list[Wire]:
    """Return the devices of a scene, of which those at the locations `places` are connected again."""
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
    """Return whether a device can replace the device `own` without effects on other parts of the scene."""
    if wire is own:
        return True
    same = all(getattr(wire.features, name) == getattr(own.features, name) for name in SAME)
    same = same and repr(wire.features.workspace) == repr(own.features.workspace)
    return same and not any(outside_faults(wire, start))


def _parts(parts: Parts, scene: Scene, hands: Sequence[HandPart]) -> Parts:
    """Return the parts of a scene with the given hands and the start positions of `parts`."""
    anew = Parts(scene, Stock(parts.folder))
    vars(anew).update(start=parts.start, hands=tuple(hands))
    return anew


def _ready(anew: Parts, wired: Sequence[Wire], servo: Servo, inward: FloatArray) -> Iterator[Any]:
    """Prepare devices, plants and hands for the first tick; yield all devices, and then each plant and its hand."""
    plants = list(make_plants(anew, wired, inward))
    for wire in wired:
        with wire.device:
            wire.device.open(servo.period)
            yield wire.device
    for each in plants:
        plant: Any = each.plant
        plant.hold(each.hand, servo.period)
        if is_still(each.hand):  # its targets are written to the plant's block, as by the tick's wires
            r, v = each.hand.target(0.0)
            for port in (plant.ports.end, plant.ports.middle):
                if port is not None:
                    plant.state[port : port + r.size] = r.ravel()
                    plant.state[port + r.size : port + 2 * r.size] = v.ravel()
        yield plant
        yield each.hand


def _alike(part: Any, own: Any) -> FloatArray:
    """Return a copy of the block of `part`; raise NotAlikeError if `own` has a block of another structure."""
    if part.state.shape != own.state.shape or not np.array_equal(part.structure, own.structure):
        raise NotAlikeError
    places = own.structure
    if part.state[places].tobytes() != own.state[places].tobytes():
        raise NotAlikeError
    return np.array(part.state)


def _with(table: Any, path: list[str], value: float) -> Any:
    """Return a copy of a table with the number at `path` replaced by `value`, which the field validates."""
    name, *rest = path
    if isinstance(table, Device) and not rest and name in table.settings:
        return table.model_copy(update={name: value})
    if not isinstance(table, Table) or isinstance(table, Device):
        raise ValidationError.from_exception_data("table", [])  # the number does not exist, or has another form
    if rest:
        return table.model_copy(update={name: _with(getattr(table, name), rest, value)})
    fields = {field: getattr(table, field) for field in table.model_fields_set}
    return type(table).model_validate({**fields, name: value})


GAINS = {key: key.removeprefix("coupling.").replace(".", "_") for key in live.GAINS}  # field of a grasp's block
BODY = ("mass", "viscosity", "rotational_viscosity")
BESIDE = re.compile(r"(finger\.[^.]+\.(device|hand|start|radius)|device|hand)\b")  # keys that do not affect plain keys
NEAR = 1e-6  # relative difference of gains below which variants are built one by one
ROUGH = 1e6  # coefficient of friction above which variants are built one by one


@dataclass(frozen=True, eq=False)
class Columns:
    """Values of plain keys in V variants of a scene.

    Args:
        scene: Scene of the variants.
        values: Values of each key, (V,).
    """

    scene: Scene
    values: Mapping[str, FloatArray]

    @cached_property
    def by_field(self) -> dict[str, FloatArray]:
        """Values of the keys that do not belong to devices or hands, by key with indices of tables or `*`."""
        numbers = {_own(self.scene, key): each for key, each in self.values.items()}
        return {key: each for key, each in numbers.items() if not is_of_a_part(self.scene, key)}

    @cached_property
    def of_parts(self) -> PartColumns | None:
        """Values of the keys that belong to devices or hands; None without such keys."""
        numbers = {_own(self.scene, key): each for key, each in self.values.items()}
        own = {key: each for key, each in numbers.items() if key not in self.by_field}
        return PartColumns(self.scene, own) if own else None

    @property
    def count(self) -> int:
        return len(next(iter(self.values.values())))

    def of(self, key: str, own: Any) -> FloatArray:
        """Return the values (V,) of a key: those in `by_field` or, for another key, the scene's value `own`."""
        if key in self.by_field:
            return self.by_field[key]
        return np.full(self.count, np.nan if own is None else float(own))

    def gain(self, key: str) -> FloatArray:
        _, share, quantity = key.split(".")
        return self.of(key, getattr(getattr(self.scene.coupling, share), quantity))

    def body(self, k: int, field: str) -> FloatArray:
        """Return a number of the body of object k in each variant, (V,); nan if the scene does not give it."""
        key, table = f"object.{k}.{field}", self.scene.object[k]
        if key in self.by_field:
            return self.by_field[key]
        own = mass(table, resolve(self.scene).objects[k].solid) if field == "mass" else getattr(table, field)
        return self.of(key, own)

    # Kinds and checks ---------------------------------------------------------------------------------------------

    def kinds(self) -> NDArray[np.int_]:
        """Return the number of each variant's kind, (V,); variants of the same kind require the same computation."""
        tests = [self.gain(key) == 0.0 for key in GAINS] if self.has_gains else []
        if self.has_gains:
            tests += [self.gain(one) == self.gain(other) for one, other in PAIRS]
        tests += [each == 0.0 for key, each in self.by_field.items() if key not in GAINS]
        if self.of_parts is not None:
            tests += [each == 0.0 for each in self.of_parts.values.values()]
        return np.asarray(np.stack(tests, axis=1) @ (1 << np.arange(len(tests))))

    @property
    def has_gains(self) -> bool:
        return any(key in GAINS for key in self.by_field)

    def sound(self, parts: Parts) -> BoolArray:
        """Return a mask of variants that pass the scene's checks if another variant passes; others may pass too."""
        sound = np.ones(self.count, dtype=bool)
        if self.of_parts is not None:
            sound &= self.of_parts.sound(parts)
        for key, values in self.by_field.items():
            sound &= np.isfinite(values) & (values >= 0.0) & (values <= LARGEST)
            if key.endswith(".mass"):
                sound &= values >= SMALLEST
            if key.endswith("friction"):
                sound &= values <= ROUGH
        if self.has_gains:
            for one, other in PAIRS:
                a, b = self.gain(one), self.gain(other)
                sound &= (a == b) | (np.abs(a - b) > NEAR * np.maximum(a, b))
            if self.scene.coupling.contact != "attached":
                sound &= (self.gain("coupling.external.stiffness") > 0) & (self.gain("coupling.internal.stiffness") > 0)
        for part in parts.objects:
            if any(f"object.{part.index}.{field}" in self.by_field for field in BODY):
                sound &= self._slowed(part)
        return sound

    def _slowed(self, part: ObjectPart) -> BoolArray:
        """Return a mask of variants in which an object's integrator is stable with the object's viscosities."""
        table, T = part.table, self.scene.period
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            ratio = self.body(part.index, "viscosity") * T / self.body(part.index, "mass")
            sound = np.isfinite(ratio)
            if table.integrator in ("explicit", "semi-implicit"):
                sound &= ratio < VISCOUS_LIMIT
            if self.scene.dimensions > 1 and any(self.scene.free(table)[self.scene.dimensions :]):
                moments = self.moments(part)
                least = moments[:, 2] if self.scene.dimensions == 2 else moments.min(axis=1)
                turning = self.body(part.index, "rotational_viscosity") * T / least
                sound &= np.isfinite(turning) & (least >= SMALLEST)
                if table.integrator in ("explicit", "semi-implicit"):
                    sound &= turning < VISCOUS_LIMIT
        return sound

    def moments(self, part: ObjectPart) -> FloatArray:
        """Compute the moments of inertia of an object's body in each variant, (V, 3) [kg m^2]."""
        masses, choice = np.unique(self.body(part.index, "mass"), return_inverse=True)
        return np.asarray(_moments(self.scene, part, masses.tolist())[choice.ravel()])

    # Entries ------------------------------------------------------------------------------------------------------

    def fill(self, parts: Parts, servo: Servo) -> Iterator[Column]:
        """Yield the columns of the entries of a servo's blocks that depend on the values.

        Raises:
            NotAlikeError: If values of devices or hands select different computations.
        """
        blocks = None if self.of_parts is None else self.of_parts.blocks(parts, servo)
        if blocks is not None:
            yield from blocks.columns()
        for part, grasped in zip(parts.objects, (each.grasped for each in servo.objects), strict=True):
            block = grasped.block
            if self.has_gains:
                for key, field in GAINS.items():
                    yield block, start_of(GraspState, field), self.gain(key)
            if self.has_gains or (self.of_parts is not None and self.of_parts.has_hands):
                yield from self._fade(parts, servo, block, part.index, blocks)
            yield from self._body(part, block)
            for j, finger in enumerate(part.fingers.tolist()):
                row = grasped.state.fingers[j].offset
                limit = None if blocks is None else blocks.limit(finger)
                if limit is not None:
                    yield block, row + start_of(FingerState, "limit"), limit
                values = self._coefficient(finger)
                if values is not None:
                    yield block, row + start_of(FingerState, "coefficient"), values

    def _coefficient(self, finger: int) -> FloatArray | None:
        own, table = f"finger.{finger}.friction", self.scene.finger[finger]
        if own in self.by_field:
            return self.by_field[own]
        return self.by_field.get("coupling.friction") if table.friction is None else None

    def _body(self, part: ObjectPart, block: FloatArray) -> Iterator[Column]:
        at = start_of(GraspState, "body")
        for field in BODY:
            values = self.by_field.get(f"object.{part.index}.{field}")
            if values is not None:
                yield block, at + start_of(BodyState, field), values
        if f"object.{part.index}.mass" in self.by_field and self.scene.dimensions > 1:
            moments = self.moments(part)
            for a in range(3):
                yield block, at + start_of(BodyState, "inertia") + a, moments[:, a]

    def _fade(
        self, parts: Parts, servo: Servo, block: FloatArray, index: int, blocks: PartBlocks | None
    ) -> Iterator[Column]:
        """Yield the columns of start and end of an automatic fade, computed as in `set_fade`."""
        if not fades(self.scene):
            return
        inward = np.zeros_like(parts.start)
        for each in servo.objects:
            inward[each.fingers] = each.grasped.inward()
        push = (
            blocks.pushes[blocks.choice, index]
            if blocks is not None and len(blocks.pushes)
            else squeezes(parts, servo.objects, inward)[index]
        )
        pushes = np.broadcast_to(push, (self.count,)).tolist()
        gains = (self.gain(f"coupling.{share}.stiffness").tolist() for share in ("external", "internal"))
        fades_ = [gaps(compliance(kep, kip) * most) for kep, kip, most in zip(*gains, pushes, strict=True)]
        for name, values in zip(("fade_start", "fade_end"), np.array(fades_).T, strict=True):
            yield block, start_of(GraspState, name), values


compliance = source_function(compliance_of_numbers)
PAIRS = tuple(
    (f"coupling.external.{quantity}", f"coupling.internal.{quantity}") for quantity in ("stiffness", "damping")
)


def plain_keys(scene: Scene, parts: Parts, values: Mapping[str, Sequence[Any]]) -> list[str]:
    """Return the plain keys of a batch, whose values can be computed as columns."""
    if (
        scene.safety is not None
        or scene.coupling.passivity != "off"
        or any(each.integrator == "implicit" for each in scene.object)
    ):
        return []  # safety chain, ledger and prediction also depend on these numbers
    try:
        own = {key: _own(scene, key) for key in values}
    except GraspFXError:
        return []
    if len(set(own.values())) < len(own):
        return []  # two keys for one value: the later key applies
    if any(".*." in one and one != two and general(two) == one for one in own.values() for two in own.values()):
        return []  # a key for all tables, and one for a single table
    numbers = {key for key, items in values.items() if all(type(each) in (int, float) for each in items)}
    others = [key for key in values if key not in numbers or not _is_plain(scene, parts, own[key])]
    if fades(scene) and others:  # the other keys may change the hands' squeeze
        others += [key for key in values if own[key] in GAINS]
    if not all(BESIDE.match(key) for key in others):
        return []  # checks or entries of the other key may depend on the plain keys
    return [key for key in values if key not in others]


def _is_plain(scene: Scene, parts: Parts, own: str) -> bool:
    coupling = scene.coupling
    gains = [
        getattr(part, name, None)
        for part in (coupling.external, coupling.internal)
        for name in ("stiffness", "damping")
    ]
    meshes = any(part.solid.mesh is not None for part in parts.objects)  # searches on meshes depend on the fade
    steady = all(isinstance(gain, int | float) for gain in gains) and not (meshes and fades(scene))
    if own in GAINS:
        return steady
    if is_of_a_part(scene, own):
        return steady or not (fades(scene) and is_of_a_hand(own))
    if own == "coupling.friction":
        return isinstance(coupling.friction, int | float) and coupling.contact != "attached"
    first, *rest = own.split(".")
    if first == "finger" and len(rest) == 2 and rest[1] == "friction" and rest[0].isdecimal():
        return int(rest[0]) < len(scene.finger) and scene.finger[int(rest[0])].friction is not None
    if first == "object" and len(rest) == 2 and rest[1] in BODY and rest[0].isdecimal():
        if int(rest[0]) >= len(scene.object) or scene.obstacle:
            return False
        table = scene.object[int(rest[0])]
        return table.dynamics == "native" and getattr(table, rest[1]) is not None
    return False


def _own(scene: Scene, key: str) -> str:
    """Return a key in which tables are denoted by indices; an omitted index of a single table becomes 0."""
    key = live.numbered(scene, key)
    first, *rest = key.split(".")
    if first in ("object", "finger", "device", "hand") and rest and not (rest[0].isdecimal() or rest[0] == "*"):
        return f"{first}.0.{'.'.join(rest)}" if len(getattr(scene, first)) == 1 else key
    return key


def _moments(scene: Scene, part: ObjectPart, weights: Sequence[float]) -> FloatArray:
    """Compute the moments of inertia in a body's block for M masses `weights` [kg], (M, 3), as `fill_body` does."""
    rows = np.zeros((len(weights), 3))
    for k, weight in enumerate(weights):
        own = part.table.inertia
        moments = solid_inertia(part.solid, weight, scene.dimensions) if own is None else own
        if moments is not None:
            rows[k] = moments
    if scene.dimensions == 2:
        rows[:, :2] = 0.0
    return rows
