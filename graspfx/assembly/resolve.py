"""Parts of a scene, resolved once for all users: connected devices, loaded shapes, laws and hands."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.bodies import Solid, Stock, fill, obstacles, place
from graspfx.assembly.device_limits import force_limits, safety_limits
from graspfx.assembly.hands import HandPart, holdings, make_hand
from graspfx.assembly.meshes import mesh_name
from graspfx.assembly.wiring import Wire, placing_faults, wires, wires_anew
from graspfx.compile.memory import ROOM, Memory, within
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.rules import FADE, Rules
from graspfx.errors import GraspFXError, InputError, abbreviate
from graspfx.grasp.impedance import Coupling, Impedance
from graspfx.grasp.object_impedance import ObjectImpedance
from graspfx.loop.device import SimulatedDevice, is_hardware
from graspfx.loop.device_exchange import device_name
from graspfx.loop.safety.chain import SafetyLimits
from graspfx.loop.servo_parts import DeviceWiring
from graspfx.objects.surroundings import Obstacle, place_obstacle
from graspfx.scene.keys import Finding
from graspfx.surfaces.standoff import standoff

if TYPE_CHECKING:
    from graspfx.scene.model import Scene
    from graspfx.scene.tables.fields import Gains
    from graspfx.scene.tables.part_tables import Object
    from graspfx.scene.tables.scene_table import SceneTable


Point = tuple[float, ...]


def start_of(scene: SceneTable, i: int, stock: Stock) -> Point | None:
    """Compute the start position of finger i, (d,) [m]; None for a faulty table.

    A start that is a table contains a direction from the object's centre of mass, in world axes at the object's initial
    pose. The fingertip comes from far away on the line in this direction, and starts at the gap that the table gives.
    """
    start = scene.finger[i].start
    if isinstance(start, tuple):
        return start
    if i not in stock.starts:
        stock.starts[i] = _placed(scene, i, stock)
    return stock.starts[i]


def placement_faults(scene: SceneTable, i: int, stock: Stock) -> Iterator[Finding]:
    """Find the reasons why a finger has no start position on the line towards its object."""
    start, at = scene.finger[i].start, ("finger", i, "start")
    if isinstance(start, tuple):
        return
    if not any(start.toward):
        yield (*at, "toward"), "expected a direction; given zeros"
        return
    thing = scene.object[scene.finger_objects[i]]
    if thing.shape is None:
        yield at, f"expected coordinates: {thing.name!r} has no shape from which a gap could be measured"
        return
    with suppress(GraspFXError):  # the shape has a fault
        if start_of(scene, i, stock) is None:
            along = abbreviate(list(start.toward))
            yield (
                (*at, "toward"),
                f"{thing.name!r} has no surface along {along} from its centre; choose another direction",
            )


def _placed(scene: SceneTable, i: int, stock: Stock) -> Point | None:
    finger, number = scene.finger[i], scene.finger_objects[i]
    start, table = finger.start, scene.object[number]
    assert not isinstance(start, tuple)
    solid = stock.solid(("object", number), table)
    if solid.shape is None:
        return None
    d = scene.dimensions
    pose = place_obstacle(table.name, solid.shape, d, *place(table, solid))
    u = np.array(start.toward, dtype=float)
    u /= np.abs(u).max()  # scaled first, because the square of a long vector may overflow
    u /= np.sqrt((u * u).sum())
    t = standoff(solid.shape, np.einsum("ij,i->j", pose.rotation[:d, :d], u), start.gap + finger.radius)
    if t is None:
        return None
    point: Point = tuple((pose.position[:d] + t * u).tolist())
    return point


FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class ObjectPart:
    """An object of a scene, prepared for its coupling.

    Attributes:
        scene: Scene of the object.
        table: Table of the object.
        index: Index of the object in the scene.
        fingers: Indices of its fingers.
        solid: Shape of the object.
        gains: Gains of eq. (4) for its fingers; gains in the object's axes are converted to its body's axes.
        rules: Contact rules of its fingers.
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
        """New coupling law with these gains. Each run needs its own law, because the law records its warnings."""
        return replace(self.gains)

    def grasped(
        self, limits: FloatArray | None = None, *, predicts: bool = True, live: Collection[str] = ()
    ) -> GraspedObject:
        """Make the grasped object with a new block.

        Args:
            limits: Largest forces of all fingers of the scene [N], infinite for a finger without a limit; None without
                limits.
            predicts: Whether the implicit integrator is used as such (`bodies.fill`).
            live: Names of the block's fields that may change during a run.
        """
        scene, own = self.scene, self.fingers
        return GraspedObject(
            len(own), scene.dimensions, law=self.law, rules=self.rules, period=scene.period, shape=self.solid.shape,
            radius=[scene.finger[f].radius for f in own], limit=None if limits is None else limits[own], live=live,
            fill_body=lambda state: fill(scene, self.table, self.solid, state, predicts=predicts),
        )  # fmt: skip


def make_objects(scene: Scene, stock: Stock, wired: Sequence[Wire]) -> Iterator[ObjectPart]:
    """Make the law and the rules of each object of a scene; masses for the split are those of `wired`."""
    masses = device_masses(scene, wired) if scene.coupling.split == "mass" else None
    if scene.coupling.split == "weights":
        masses = np.array(scene.coupling.weights)
    for i, table in enumerate(scene.object):
        fingers = np.flatnonzero(np.array(scene.finger_objects) == i)
        solid = stock.solid(("object", i), table)
        law = make_law(scene, fingers, solid)
        yield ObjectPart(scene, table, i, fingers, solid, law, _rules(scene, fingers, masses))


def device_masses(scene: Scene, wired: Sequence[Wire]) -> FloatArray:
    """Return the mass of the device at each fingertip from its features, (n,) [kg]."""
    masses = np.zeros(len(scene.finger))
    for wire in wired:
        masses[wire.used] = wire.features.mass
    return masses


def make_law(scene: Scene, fingers: Index, solid: Solid) -> Coupling:
    """Make the gains of eq. (4) for the fingers of one object; convert gains in object axes to body axes."""
    part = scene.coupling.external
    (K, D), inner = (
        [_own(_given(gains, quantity), fingers) for quantity in ("stiffness", "damping")]
        for gains in (part, scene.coupling.internal)
    )
    of_object = hasattr(part, "object_stiffness") and len(fingers) > 0
    law = Coupling(
        external=ObjectImpedance(K, D, getattr(part, "object_point", None)) if of_object else Impedance(K, D),
        internal=Impedance(*inner),
        form=scene.coupling.form,
    )
    # a mesh's body has principal axes, which differ from the file's
    mesh = solid.mesh if scene.coupling.axes == "object" else None
    return law if mesh is None else law.turned(mesh.unit.axes.T)


def _given(part: Any, quantity: str) -> Any:
    """Return a gain from a table, or from a cached table, which has only fields; an object's gain as a matrix."""
    if not hasattr(part, "object_stiffness"):
        return getattr(part, quantity)
    value = getattr(part, f"object_{quantity}")
    if value is None:
        return np.zeros_like(_given(part, "stiffness"))
    return np.array(value) if np.ndim(value) == 2 else np.diag(np.atleast_1d(value))


def _own(gain: Gains, fingers: Index) -> float | FloatArray:
    """Select these fingers from gains per finger; return other gains unchanged.

    Return one number for an object without fingers, because no force depends on it.
    """
    values = np.asarray(gain, dtype=float)
    if values.ndim == 0 or not len(fingers):
        return float(values.max())
    return values[fingers] if values.ndim in (1, 3) else values


def _rules(scene: Scene, fingers: Index, masses: FloatArray | None) -> Rules:
    """Make the contact rules of one object's fingers."""
    rules, own = scene.coupling, [scene.finger[i] for i in fingers]
    fade = None if rules.absent == "follow" else FADE if rules.fade == "auto" else rules.fade
    return Rules(
        attached=rules.contact == "attached",
        stick=rules.friction == "stick",
        friction=[scene.coefficients[i] for i in fingers],
        patch=[finger.patch or 0.0 for finger in own],
        share=(masses[fingers] / masses[fingers].mean()).tolist() if masses is not None and len(fingers) else None,
        fade=fade,
        at_contact=rules.reaction == "contact",
        blend=None if rules.blend == "off" else rules.blend,
        axes=rules.axes,
        damping_depth=rules.damping_depth,
        force_bound=rules.force_bound,
        pad=[finger.pad.stiffness if finger.pad else 0.0 for finger in own],
    )


@dataclass(frozen=True, eq=False)
class Parts:
    """A scene's parts, each made on demand.

    Attributes:
        scene: Description of the scene.
        stock: Connected devices and shapes.
    """

    scene: Scene
    stock: Stock

    @property
    def folder(self) -> Path | None:
        """Folder of the scene's relative paths; None for the current folder."""
        return self.stock.folder

    @cached_property
    def wires(self) -> tuple[Wire, ...]:
        """Devices for inspection only; a run uses those of `claim`."""
        return wires(self.scene, self.stock)

    def claim(self, room: int = ROOM) -> tuple[tuple[Wire, ...], Memory]:
        """Return devices as `own_wires` does, with the memory for their blocks.

        Args:
            room: Number of entries of that memory; the memory of devices connected by the checks has the
                default size.
        """
        if self.stock.claim():
            return self.wires, self.stock.memory
        with within(Memory(room)) as memory:
            return wires_anew(self.scene, self.folder), memory

    def own_wires(self) -> tuple[Wire, ...]:
        """Return devices that no other run uses, to be opened or moved by a plant.

        The first caller gets the devices that the checks connected. A later caller gets newly connected devices,
        because a device contains the state of one run, and hardware may still be open.
        """
        return self.claim()[0]

    @cached_property
    def start(self) -> FloatArray:
        """Start positions of the fingers, (n, d) [m]."""
        return np.array([start_of(self.scene, i, self.stock) for i in range(len(self.scene.finger))], dtype=float)

    @cached_property
    def objects(self) -> tuple[ObjectPart, ...]:
        """Objects with their solids, laws and rules, in the scene's order."""
        return tuple(make_objects(self.scene, self.stock, self.wires))

    @cached_property
    def hands(self) -> tuple[HandPart, ...]:
        """Hands in the order of their first fingers."""
        return tuple(make_hand(self.scene, self.stock, each) for each in holdings(self.scene))

    @cached_property
    def obstacles(self) -> list[Obstacle]:
        """Placed obstacles."""
        return obstacles(self.scene, self.stock)

    @cached_property
    def limits(self) -> FloatArray | None:
        """Largest force of each finger [N] by device or safety, infinite without a limit; None if all stay infinite."""
        limits = force_limits(len(self.scene.finger), self.wires)
        if self.safety is None:
            return limits
        return self.safety.force if limits is None else np.minimum(limits, self.safety.force)

    @cached_property
    def safety(self) -> SafetyLimits | None:
        """Limits of the safety chain; None for a scene without one."""
        return safety_limits(self.scene, self.wires)

    @cached_property
    def simulated(self) -> bool:
        """Whether every device is a simulation."""
        return not self.hardware

    @property
    def hardware(self) -> list[str]:
        """Names of the real devices."""
        names = self.scene.finger_names
        return [
            device_name(DeviceWiring(wire.device, wire.fingers), names)
            for wire in self.wires
            if is_hardware(wire.device)
        ]

    @property
    def mesh_notes(self) -> list[str]:
        """Sentences about repairs and likely errors of the meshes."""
        meshes = [(part.table, part.solid.mesh) for part in self.objects]
        return [f"{mesh_name(table)}: {note}" for table, mesh in meshes if mesh is not None for note in mesh.mesh.notes]

    @property
    def mesh_frames(self) -> dict[str, Mapping[str, list[float]]]:
        """`SceneMesh.frame` of each object with a mesh, by name."""
        meshes = [(part.name, part.solid.mesh) for part in self.objects]
        return {name: mesh.frame for name, mesh in meshes if mesh is not None}


def reach_faults(scene: Scene) -> list[Finding]:
    """Find the fingers that cannot be placed at their start, in a scene without other faults."""
    parts = resolve(scene)
    return placing_faults(parts.start, parts.own_wires())


def resolve(scene: Scene) -> Parts:
    """Return the parts of a scene; every call for the same scene returns the same parts.

    Devices and shapes that the scene's checks have connected and loaded are reused. A copy of a scene, or one with
    replaced values, has separate parts.
    """
    if scene._stock is None:
        scene._stock = Stock(scene.source.folder)
    stock: Stock = scene._stock
    if stock.parts is None:
        stock.parts = Parts(scene, stock)
    parts: Parts = stock.parts
    return parts


def late_wires(parts: Parts) -> Iterator[tuple[Wire, float]]:
    """List devices with late forces, each with the time from a motion to its force: lateness plus latency [s]."""
    for wire in parts.wires:
        late = (wire.features.lateness or 0.0) + (wire.features.latency or 0.0)
        if late > 0.0:
            yield wire, late


def require_no_host(scene: Scene, action: str) -> None:
    """Reject an action that needs the scene's object if another program simulates it.

    Args:
        scene: Scene to check.
        action: Name of the action in the message.

    Raises:
        InputError: If the scene has a host.
    """
    host = getattr(scene, "host", None)
    if host is not None:
        raise InputError(
            "host", host.name, f"a scene that simulates its object, for {action}",
            "the host simulates the object, so the scene lacks its forces; gx.Feedback.limits computes the limits of "
            "a linear host",
        )  # fmt: skip


def require_prompt_simulations(parts: Parts) -> None:
    """Reject simulated devices with late forces, because a simulation does not include this delay.

    Raises:
        InputError: If there is such a device; a certificate supports any delay.
    """
    for wire, late in late_wires(parts):
        if isinstance(wire.device, SimulatedDevice):
            names = ", ".join(parts.scene.finger_names[i] for i in wire.used)
            raise InputError(
                "measures.lateness", late, f"none in a simulation: forces of the simulated device of {names} start "
                "at the beginning of a sample",
                "`check` and `stability` support any delay; remove the measures to run it, or give the driver whole "
                f"samples, delay = {round(late / parts.scene.period)}",
            )  # fmt: skip
