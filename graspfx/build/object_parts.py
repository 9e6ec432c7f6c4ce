"""The objects of a scene with what grasps them: a solid, a law, rules of touching, fingers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.build.bodies import Solid, fill
from graspfx.build.stock import Stock
from graspfx.build.wiring import Wire
from graspfx.coupling.fade import FADE
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.rules import Rules
from graspfx.grasp.impedance import Coupling, Impedance

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

    def grasped(self, limits: FloatArray | None = None, *, predicts: bool = True) -> GraspedObject:
        """Make the object as the coupling sees it, with a block of its own.

        Args:
            limits: largest forces of all fingers of the scene [N], infinite where there is none; None where forces
                have no limit.
            predicts: whether the implicit integrator is one (`bodies.fill`).
        """
        return GraspedObject(
            len(self.fingers),
            self.scene.dimensions,
            self.scene.period,
            self.law,
            self.rules,
            lambda state: fill(self.scene, self.table, self.solid, state, predicts=predicts),
            shape=self.solid.shape,
            radius=[self.scene.finger[f].radius for f in self.fingers],
            limit=None if limits is None else limits[self.fingers],
        )


def make_objects(scene: Scene, stock: Stock, wired: Sequence[Wire]) -> tuple[ObjectPart, ...]:
    """Make the law and the rules of each object of a scene; `wired` tells the masses that a metric counts with."""
    masses = device_masses(scene, wired) if scene.coupling.metric == "mass" else None
    return tuple(_make_object(scene, stock, index, masses) for index in range(len(scene.object)))


def device_masses(scene: Scene, wired: Sequence[Wire]) -> FloatArray:
    """Give the mass of the device at each fingertip, as its features tell it, (n,) [kg]."""
    masses = np.zeros(len(scene.finger))
    for wire in wired:
        masses[wire.used] = wire.features.mass
    return masses


def _make_object(scene: Scene, stock: Stock, index: int, masses: FloatArray | None) -> ObjectPart:
    table, rules = scene.object[index], scene.coupling
    fingers = np.flatnonzero(np.array(scene.finger_objects) == index)
    solid = stock.solid(("object", index), table)
    return ObjectPart(
        scene,
        table,
        index,
        fingers,
        solid,
        make_law(scene, fingers, solid),
        Rules(
            attached=rules.contact == "attached",
            stick=rules.friction == "stick",
            friction=[scene.coefficients[i] for i in fingers],
            patch=[scene.finger[i].patch or 0.0 for i in fingers],
            share=None if masses is None else (masses[fingers] / masses[fingers].mean()).tolist(),
            fade=None if rules.absent == "follow" else FADE if rules.fade == "auto" else rules.fade,
            at_contact=rules.reaction == "contact",
            blend=None if rules.blend == "off" else rules.blend,
            axes=rules.axes,
            damping_depth=rules.damping_depth,
            pad=[0.0 if pad is None else pad.stiffness for pad in (scene.finger[i].pad for i in fingers)],
        ),
    )


def make_law(scene: Scene, fingers: Index, solid: Solid) -> Coupling:
    """Make the gains of eq. (4) for the fingers of one object; those in the object's axes stand in its body's."""
    external, internal = scene.coupling.external, scene.coupling.internal
    law = Coupling(
        external=Impedance(_own(external.stiffness, fingers), _own(external.damping, fingers)),
        internal=Impedance(_own(internal.stiffness, fingers), _own(internal.damping, fingers)),
        form=scene.coupling.form,
    )
    # the body of a mesh has its principal axes, the file others
    mesh = solid.mesh if scene.coupling.axes == "object" else None
    return law if mesh is None else law.turned(mesh.unit.axes.T)


def _own(gain: Gains, fingers: Index) -> float | FloatArray:
    """Pick from gains that are given per finger those of these fingers; give any other as it is."""
    values = np.asarray(gain, dtype=float)
    if values.ndim == 0:
        return float(values)
    return values[fingers] if values.ndim in (1, 3) else values
