"""Many values of a scene's keys at once, as columns of numbers for fields of blocks: `Number`s of all of them together.

A key is plain where its values go to fields as they stand, or by a formula of a few operations, and where what a scene
checks of them can be said of an array. All else is built. What only some values mean, as gains that are equal or a
coefficient of zero, makes kinds of variants, of each of choice one is built.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.bodies import mass, solid_inertia
from graspfx.assembly.fading import squeezes
from graspfx.assembly.live import numbered
from graspfx.assembly.numbers import general
from graspfx.assembly.part_columns import PartBlocks, PartColumns, fades, is_of_a_hand, is_of_a_part
from graspfx.assembly.resolve import resolve
from graspfx.compile.records import start_of
from graspfx.coupling import block as at
from graspfx.coupling.fade import BAND, FADE
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.errors import GraspFXError
from graspfx.numeric import LARGEST, SMALLEST
from graspfx.objects.body import VISCOUS_LIMIT
from graspfx.objects.body_state import BodyState

if TYPE_CHECKING:
    from graspfx.assembly.object_parts import ObjectPart
    from graspfx.assembly.resolve import Parts
    from graspfx.loop.servo import Servo
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Column = tuple[FloatArray, int, FloatArray]  # a block, an entry of it, and its number in each variant

GAINS = {
    f"coupling.{share}.{quantity}": f"{share}_{quantity}"
    for share in ("external", "internal") for quantity in ("stiffness", "damping")
}  # fmt: skip
BODY = ("mass", "viscosity", "rotational_viscosity")
BESIDE = re.compile(
    r"(finger\.[^.]+\.(device|hand|start|radius)|device|hand)\b"
)  # keys that leave the plain ones alone
NEAR = 1e-6  # relative: gains as near as this are built one by one
ROUGH = 1e6  # coefficients of friction above it likewise


@dataclass(frozen=True, eq=False)
class Columns:
    """Values of the plain keys of a scene, one of each for every variant.

    Args:
        scene: the scene; other keys of it may be replaced, too.
        values: by key, (V,).
    """

    scene: Scene
    values: Mapping[str, FloatArray]

    @cached_property
    def by_field(self) -> dict[str, FloatArray]:
        """Values by the key in its general form, or with its number where only one of a list has it."""
        numbers = {_own(self.scene, key): each for key, each in self.values.items()}
        return {key: each for key, each in numbers.items() if not is_of_a_part(self.scene, key)}

    @cached_property
    def of_parts(self) -> PartColumns | None:
        """Values of devices and hands; None where there are none."""
        numbers = {_own(self.scene, key): each for key, each in self.values.items()}
        own = {key: each for key, each in numbers.items() if key not in self.by_field}
        return PartColumns(self.scene, own) if own else None

    @property
    def count(self) -> int:
        return len(next(iter(self.values.values())))

    def of(self, key: str, own: Any) -> FloatArray:
        """Give the values of a key; the scene's own in every variant if it is none of these."""
        if key in self.by_field:
            return self.by_field[key]
        return np.full(self.count, np.nan if own is None else float(own))

    def gain(self, key: str) -> FloatArray:
        _, share, quantity = key.split(".")
        return self.of(key, getattr(getattr(self.scene.coupling, share), quantity))

    def body(self, k: int, field: str) -> FloatArray:
        """Give a number of an object's body, NaN where it is not given."""
        key, table = f"object.{k}.{field}", self.scene.object[k]
        if key in self.by_field:
            return self.by_field[key]
        own = mass(table, resolve(self.scene).objects[k].solid) if field == "mass" else getattr(table, field)
        return self.of(key, own)

    # What may be said of all --------------------------------------------------------------------------------------

    def kinds(self) -> NDArray[np.int_]:
        """Number the kinds of variants: in those of one kind the same is computed, of what these values decide."""
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
        """Tell of choice values it is sure that the scene's checks pass them, as those of another variant pass."""
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
        """Tell where the integrator stands the viscosity: the test of one scene, of all."""
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
        """Compute the moments of an object's body, (V, 3): by the formula of one, for each mass that there is."""
        masses, choice = np.unique(self.body(part.index, "mass"), return_inverse=True)
        return np.asarray(_moments(self.scene, part, masses.tolist())[choice.ravel()])

    # Where they go ------------------------------------------------------------------------------------------------

    def fill(self, parts: Parts, servo: Servo) -> Iterator[Column]:
        """List the entries of a servo's blocks that these values go to, with their numbers.

        Raises:
            NotAlikeError: values of devices and hands that choose what is computed.
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
                limit = None if blocks is None else blocks.limit(finger)
                if limit is not None:
                    yield block, at.ROW + j * at.STRIDE + start_of(FingerState, "limit"), limit
                values = self._coefficient(finger)
                if values is not None:
                    yield block, at.ROW + j * at.STRIDE + at.COEFFICIENT, values

    def _coefficient(self, finger: int) -> FloatArray | None:
        own, table = f"finger.{finger}.friction", self.scene.finger[finger]
        if own in self.by_field:
            return self.by_field[own]
        return self.by_field.get("coupling.friction") if table.friction is None else None

    def _body(self, part: ObjectPart, block: FloatArray) -> Iterator[Column]:
        for field in BODY:
            values = self.by_field.get(f"object.{part.index}.{field}")
            if values is not None:
                yield block, at.BODY + start_of(BodyState, field), values
        if f"object.{part.index}.mass" in self.by_field and self.scene.dimensions > 1:
            moments = self.moments(part)
            for a in range(3):
                yield block, at.BODY + start_of(BodyState, "inertia") + a, moments[:, a]

    def _fade(
        self, parts: Parts, servo: Servo, block: FloatArray, index: int, blocks: PartBlocks | None
    ) -> Iterator[Column]:
        """Compute where an automatic fade begins and ends, `fading.set_fade` for all variants."""
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
        kep, kip = self.gain("coupling.external.stiffness"), self.gain("coupling.internal.stiffness")
        needed = 0.5 * np.abs(1.0 / kep - 1.0 / kip) * push
        near = needed <= FADE[0]
        yield block, at.NEAR, np.where(near, FADE[0], needed)
        yield block, at.FAR, np.where(near, FADE[1], needed + BAND)


PAIRS = tuple(
    (f"coupling.external.{quantity}", f"coupling.internal.{quantity}") for quantity in ("stiffness", "damping")
)


def plain_keys(scene: Scene, parts: Parts, values: Mapping[str, Sequence[Any]]) -> list[str]:
    """Choose the keys whose values columns can take, of those of a batch."""
    if (
        scene.safety is not None
        or scene.coupling.passivity != "off"
        or any(each.integrator == "implicit" for each in scene.object)
    ):
        return []  # a safety chain, a ledger, and a motion that is predicted, are made of these numbers too
    try:
        own = {key: _own(scene, key) for key in values}
    except GraspFXError:
        return []
    if len(set(own.values())) < len(own):
        return []  # two keys for one value: the later one wins
    if any(".*." in one and one != two and general(two) == one for one in own.values() for two in own.values()):
        return []  # a key of all tables, and of one of them
    numbers = {key for key, items in values.items() if all(type(each) in (int, float) for each in items)}
    others = [key for key in values if key not in numbers or not _is_plain(scene, parts, own[key])]
    if fades(scene) and others:  # they may change what the hands squeeze with
        others += [key for key in values if own[key] in GAINS]
    if not all(BESIDE.match(key) for key in others):
        return []  # its checks, or what it fills, may ask for the plain ones
    return [key for key in values if key not in others]


def _is_plain(scene: Scene, parts: Parts, own: str) -> bool:
    coupling = scene.coupling
    gains = [
        getattr(part, name, None)
        for part in (coupling.external, coupling.internal)
        for name in ("stiffness", "damping")
    ]
    meshes = any(part.solid.mesh is not None for part in parts.objects)  # walks on them reach as far as a fade
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
    """Write a key with the numbers of its tables; one that stands for the only table of a list has 0."""
    key = numbered(scene, key)
    first, *rest = key.split(".")
    if first in ("object", "finger", "device", "hand") and rest and not (rest[0].isdecimal() or rest[0] == "*"):
        return f"{first}.0.{'.'.join(rest)}" if len(getattr(scene, first)) == 1 else key
    return key


def _moments(scene: Scene, part: ObjectPart, weights: Sequence[float]) -> FloatArray:
    """Compute the moments that a body's block has with some masses, (M, 3), as `fill_body` does."""
    rows = np.zeros((len(weights), 3))
    for k, weight in enumerate(weights):
        own = part.table.inertia
        moments = solid_inertia(part.solid, weight, scene.dimensions) if own is None else own
        if moments is not None:
            rows[k] = moments
    if scene.dimensions == 2:
        rows[:, :2] = 0.0
    return rows
