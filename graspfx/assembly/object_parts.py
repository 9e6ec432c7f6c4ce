"""The objects of a scene with what grasps them: a solid, a law, rules of touching, fingers."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.bodies import Solid, fill
from graspfx.assembly.numbers import Number, Numbers, arguments
from graspfx.assembly.stock import Stock
from graspfx.assembly.wiring import Wire
from graspfx.coupling.fade import FADE
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.rules import Rules
from graspfx.grasp.impedance import Coupling, Impedance
from graspfx.grasp.object_impedance import ObjectImpedance

if TYPE_CHECKING:
    from graspfx.scene.model import Scene
    from graspfx.scene.tables.fields import Gains
    from graspfx.scene.tables.part_tables import Object

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class ObjectPart:
    """An object of a scene, as its coupling takes it.

    Attributes:
        scene: the scene.
        table: of the object.
        index: its number in the scene.
        fingers: the numbers of its fingers.
        solid: its shape.
        gains: of eq. (4) for its fingers; those in the object's axes stand in its body's.
        rules: how its fingers touch.
    """

    scene: Scene
    table: Object
    index: int
    fingers: Index
    solid: Solid
    gains: Coupling
    rules: Rules

    @property
    def name(self) -> str:
        """The object's name."""
        return self.table.name

    @property
    def law(self) -> Coupling:
        """The gains as a law of its own: it remembers of what it has warned, which is one run's business."""
        return replace(self.gains)

    def grasped(
        self, limits: FloatArray | None = None, *, predicts: bool = True, live: Collection[str] = ()
    ) -> GraspedObject:
        """Make the object as the coupling sees it, with a block of its own.

        Args:
            limits: largest forces of all fingers of the scene [N], infinite where there is none; None where forces
                have no limit.
            predicts: whether the implicit integrator is one (`bodies.fill`).
            live: names of the block's fields that may change in mid-run.
        """
        n, d, fill_body = len(self.fingers), self.scene.dimensions, self._fill_body(predicts)
        return GraspedObject(n, d, law=self.law, fill_body=fill_body, live=live, **self._numbers(limits))

    def fill(self, grasped: GraspedObject, limits: FloatArray | None = None) -> None:
        """Fill the block of an object that was made for another scene of the same structure, as `grasped` would."""
        grasped.fill(law=self.law, fill_body=self._fill_body(True), **self._numbers(limits))

    def _numbers(self, limits: FloatArray | None) -> dict[str, Any]:
        return {"rules": self.rules, **arguments(GRASP, self.scene, self.fingers, self.solid, limits)}

    def _fill_body(self, predicts: bool) -> Callable[[FloatArray], None]:
        return lambda state: fill(self.scene, self.table, self.solid, state, predicts=predicts)


def make_objects(scene: Scene, stock: Stock, wired: Sequence[Wire]) -> tuple[ObjectPart, ...]:
    """Make the law and the rules of each object of a scene; `wired` tells the masses that a split counts with."""
    masses = device_masses(scene, wired) if scene.coupling.split == "mass" else None
    if scene.coupling.split == "weights":
        masses = np.array(scene.coupling.weights)
    return tuple(_make_object(scene, stock, index, masses) for index in range(len(scene.object)))


def device_masses(scene: Scene, wired: Sequence[Wire]) -> FloatArray:
    """Give the mass of the device at each fingertip, as its features tell it, (n,) [kg]."""
    masses = np.zeros(len(scene.finger))
    for wire in wired:
        masses[wire.used] = wire.features.mass
    return masses


def _make_object(scene: Scene, stock: Stock, index: int, masses: FloatArray | None) -> ObjectPart:
    table = scene.object[index]
    fingers = np.flatnonzero(np.array(scene.finger_objects) == index)
    solid = stock.solid(("object", index), table)
    return ObjectPart(
        scene,
        table,
        index,
        fingers,
        solid,
        make_law(scene, fingers, solid),
        Rules(**arguments(RULES, scene, fingers, masses)),
    )


def make_law(scene: Scene, fingers: Index, solid: Solid) -> Coupling:
    """Make the gains of eq. (4) for the fingers of one object; those in the object's axes stand in its body's."""
    gains = arguments(GAINS, scene, fingers)
    part = scene.coupling.external
    outer = gains["external_stiffness"], gains["external_damping"]
    of_object = hasattr(part, "object_stiffness") and len(fingers) > 0
    law = Coupling(
        external=ObjectImpedance(*outer, getattr(part, "object_point", None)) if of_object else Impedance(*outer),
        internal=Impedance(gains["internal_stiffness"], gains["internal_damping"]),
        form=scene.coupling.form,
    )
    # the body of a mesh has its principal axes, the file others
    mesh = solid.mesh if scene.coupling.axes == "object" else None
    return law if mesh is None else law.turned(mesh.unit.axes.T)


def _own(gain: Gains, fingers: Index) -> float | FloatArray:
    """Pick from gains that are given per finger those of these fingers; give any other as it is.

    An object without fingers exerts no force by them: it has one number in their place.
    """
    values = np.asarray(gain, dtype=float)
    if values.ndim == 0 or not len(fingers):
        return float(values.max())
    return values[fingers] if values.ndim in (1, 3) else values


OF_OBJECT = {"external": ("coupling.external.object_stiffness", "coupling.external.object_damping")}


def _given(part: Any, quantity: str) -> Any:
    """Give a gain of a table, also of one from the cache, which has fields alone; of an object as a square."""
    if not hasattr(part, "object_stiffness"):
        return getattr(part, quantity)
    value = getattr(part, f"object_{quantity}")
    if value is None:
        return np.zeros_like(_given(part, "stiffness"))
    return np.array(value) if np.ndim(value) == 2 else np.diag(np.atleast_1d(value))


def _gain(share: str, quantity: str, field: str, matrix: str) -> Number:
    """Declare a gain of eq. (4): its own field where it is a number, and what tells the solvers of its kind."""
    both = ("release",) if quantity == "stiffness" else ("damped", "singular", "gradual")
    both = ("equal", "rays", "matrices", *both)
    return Number(
        (f"coupling.{share}.{quantity}", *OF_OBJECT.get(share, ()), "coupling.form", "coupling.axes"),
        (field, matrix, *both, "stiffest", "stiffness_rule", "damping_rule"),
        lambda scene, fingers: _own(_given(getattr(scene.coupling, share), quantity), fingers),
    )


def _share(masses: FloatArray | None, fingers: Index) -> list[float] | None:
    if masses is None or not len(fingers):
        return None
    shares: list[float] = (masses[fingers] / masses[fingers].mean()).tolist()
    return shares


def _fade(scene: Scene) -> tuple[float, float] | None:
    rules = scene.coupling
    return None if rules.absent == "follow" else FADE if rules.fade == "auto" else rules.fade


GAINS: Numbers = {
    "external_stiffness": _gain("external", "stiffness", "external_stiffness", "kep"),
    "external_damping": _gain("external", "damping", "external_damping", "ked"),
    "internal_stiffness": _gain("internal", "stiffness", "internal_stiffness", "kip"),
    "internal_damping": _gain("internal", "damping", "internal_damping", "kid"),
}
KIND = ("friction", "rays", "coordinates", "width", "unknowns", "problem", "damping_problem")  # of solver
DEVICES = ("device", "finger.*.device")

RULES: Numbers = {  # the arguments of `Rules`
    "attached": Number(
        ("coupling.contact",), ("attached", "fingers.touching", *KIND),
        lambda scene, fingers, masses: scene.coupling.contact == "attached",
    ),
    "stick": Number(
        ("coupling.friction",), ("stick", *KIND), lambda scene, fingers, masses: scene.coupling.friction == "stick"
    ),
    "friction": Number(
        ("coupling.friction", "finger.*.friction", "coupling.contact"), ("fingers.coefficient", *KIND),
        lambda scene, fingers, masses: [scene.coefficients[i] for i in fingers],
    ),
    "patch": Number(
        ("finger.*.patch", "finger.*.model"), ("fingers.patch", *KIND),
        lambda scene, fingers, masses: [scene.finger[i].patch or 0.0 for i in fingers],
    ),
    "share": Number(
        ("coupling.metric", "coupling.split", "coupling.weights", *DEVICES), ("fingers.share", "fingers.weight"),
        lambda scene, fingers, masses: _share(masses, fingers),
    ),
    "fade": Number(
        ("coupling.fade", "coupling.absent"), ("fade", "fade_start", "fade_end"),
        lambda scene, fingers, masses: _fade(scene),
    ),
    "at_contact": Number(
        ("coupling.reaction",), ("at_contact",), lambda scene, fingers, masses: scene.coupling.reaction == "contact"
    ),
    "blend": Number(
        ("coupling.blend",), ("arm_low", "arm_high"),
        lambda scene, fingers, masses: None if scene.coupling.blend == "off" else scene.coupling.blend,
    ),
    "axes": Number(("coupling.axes",), ("axes_of_gains",), lambda scene, fingers, masses: scene.coupling.axes),
    "damping_depth": Number(
        ("coupling.damping_depth",), ("gradual", "damping_depth"),
        lambda scene, fingers, masses: scene.coupling.damping_depth,
    ),
    "force_bound": Number(
        ("coupling.force_bound",), ("force_bound",), lambda scene, fingers, masses: scene.coupling.force_bound
    ),
    "pad": Number(
        ("finger.*.pad", "finger.*.pad.stiffness"), ("padded", "fingers.pad", *KIND),
        lambda scene, fingers, masses: [pad.stiffness if (pad := scene.finger[i].pad) else 0.0 for i in fingers],
    ),
}  # fmt: skip

GRASP: Numbers = {  # the other arguments of `GraspedObject.fill`
    "period": Number(("period",), ("period",), lambda scene, fingers, solid, limits: scene.period),
    "shape": Number(("object.*.shape",), ("shape", "parameters"), lambda scene, fingers, solid, limits: solid.shape),
    "radius": Number(
        ("finger.*.radius",), ("fingers.radius",),
        lambda scene, fingers, solid, limits: [scene.finger[f].radius for f in fingers],
    ),
    "limit": Number(
        DEVICES, ("limited", "fingers.limit", "fingers.cut"),
        lambda scene, fingers, solid, limits: None if limits is None else limits[fingers],
    ),
}  # fmt: skip
