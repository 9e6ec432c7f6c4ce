"""Parts of a scene, made once for all their users: connected devices, loaded shapes, coupling laws and hands."""

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
    """Compute the start position of finger i, (d,) [m]; None if no position fits the finger's table `start`.

    A table `start` has a direction, in world axes, of a line from the object's centre of mass at the object's initial
    pose. The fingertip starts on this line, outside the object, with the gap in the table to the object's surface.
    """
    start = scene.finger[i].start
    if isinstance(start, tuple):
        return start
    if i not in stock.starts:
        stock.starts[i] = _placed(scene, i, stock)
    return stock.starts[i]


def placement_faults(scene: SceneTable, i: int, stock: Stock) -> Iterator[Finding]:
    """Find the reasons why no start position fits the table `start` of finger i."""
    start, at = scene.finger[i].start, ("finger", i, "start")
    if isinstance(start, tuple):
        return
    if not any(start.toward):
        yield (*at, "toward"), "expected a direction; given zeros"
        return
    thing = scene.object[scene.finger_objects[i]]
    if thing.shape is None:
        yield at, f"expected coordinates, because {thing.name!r} has no shape from which a gap could be measured"
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
    """An object of a scene with the coupling of its fingers.

    Attributes:
        scene: Scene of the object.
        table: Table of the object.
        index: Index of the object in the scene.
        fingers: Indices of the object's fingers.
        solid: Shape of the object.
        gains: Gains of eq. (4) for these fingers; gains in the object's axes are converted to the body's frame.
        rules: Contact rules of these fingers.
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
        """Name of the object."""
        return self.table.name

    @property
    def law(self) -> Coupling:
        """Copy of `gains`. Every run needs a separate copy, because a coupling law records which warnings it issued."""
        return replace(self.gains)

    def grasped(
        self, limits: FloatArray | None = None, *, predicts: bool = True, live: Collection[str] = ()
    ) -> GraspedObject:
        """Make the grasped object with a new block.

        Args:
            limits: Largest forces of all fingers of the scene [N], inf for a finger without a limit; None if no finger
                has a limit.
            predicts: Whether the object may have the integrator "implicit" (`bodies.fill`).
            live: Names of the fields of the block that may change during a run.
        """
        scene, own = self.scene, self.fingers
        return GraspedObject(
            len(own), scene.dimensions, law=self.law, rules=self.rules, period=scene.period, shape=self.solid.shape,
            radius=[scene.finger[f].radius for f in own], limit=None if limits is None else limits[own], live=live,
            fill_body=lambda state: fill(scene, self.table, self.solid, state, predicts=predicts),
        )  # fmt: skip


def make_objects(scene: Scene, stock: Stock, wired: Sequence[Wire]) -> Iterator[ObjectPart]:
    """Make the coupling law and contact rules of each object of a scene; a mass metric uses the masses of `wired`."""
    masses = device_masses(scene, wired) if scene.coupling.split == "mass" else None
    if scene.coupling.split == "weights":
        masses = np.array(scene.coupling.weights)
    for i, table in enumerate(scene.object):
        fingers = np.flatnonzero(np.array(scene.finger_objects) == i)
        solid = stock.solid(("object", i), table)
        law = make_law(scene, fingers, solid)
        yield ObjectPart(scene, table, i, fingers, solid, law, _rules(scene, fingers, masses))


def device_masses(scene: Scene, wired: Sequence[Wire]) -> FloatArray:
    """Return the mass that the device of each finger reports, (n,) [kg]."""
    masses = np.zeros(len(scene.finger))
    for wire in wired:
        masses[wire.used] = wire.features.mass
    return masses


def make_law(scene: Scene, fingers: Index, solid: Solid) -> Coupling:
    """Make the gains of eq. (4) for the fingers of one object, and convert gains in object axes to body axes."""
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
    """Return the gain `quantity` from a table of gains; the gain of an object is returned as a matrix.

    The table may be a cached one, which has the fields but not the methods of its class.
    """
    if not hasattr(part, "object_stiffness"):
        return getattr(part, quantity)
    value = getattr(part, f"object_{quantity}")
    if value is None:
        return np.zeros_like(_given(part, "stiffness"))
    return np.array(value) if np.ndim(value) == 2 else np.diag(np.atleast_1d(value))


def _own(gain: Gains, fingers: Index) -> float | FloatArray:
    """Select the gains of `fingers` from gains per finger; return other gains unchanged.

    For an object without fingers, return one number, because no force depends on its gains.
    """
    values = np.asarray(gain, dtype=float)
    if values.ndim == 0 or not len(fingers):
        return float(values.max())
    return values[fingers] if values.ndim in (1, 3) else values


def _rules(scene: Scene, fingers: Index, masses: FloatArray | None) -> Rules:
    """Make the contact rules of one object's fingers; `masses` are the weights of all fingers, None if equal."""
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
    """Parts of a scene, which are made when they are first used.

    Attributes:
        scene: Scene of the parts.
        stock: Connected devices and shapes of the scene.
    """

    scene: Scene
    stock: Stock

    @property
    def folder(self) -> Path | None:
        """Folder to which relative paths in the scene refer; None for the current folder."""
        return self.stock.folder

    @cached_property
    def wires(self) -> tuple[Wire, ...]:
        """Connected devices, for inspection only; a run must use the devices of `claim`."""
        return wires(self.scene, self.stock)

    def claim(self, room: int = ROOM) -> tuple[tuple[Wire, ...], Memory]:
        """Return the devices of `own_wires`, and the memory with their blocks.

        Args:
            room: Number of entries of the memory for newly connected devices; the memory of devices that the checks
                connected has the default size.
        """
        if self.stock.claim():
            return self.wires, self.stock.memory
        with within(Memory(room)) as memory:
            return wires_anew(self.scene, self.folder), memory

    def own_wires(self) -> tuple[Wire, ...]:
        """Return connected devices that no other run uses.

        The first call returns the devices that the scene's checks connected. Later calls return newly connected
        devices, because a device contains the state of its run, and the hardware of an earlier run may still be open.
        """
        return self.claim()[0]

    @cached_property
    def start(self) -> FloatArray:
        """Start positions of the fingers, (n, d) [m]."""
        return np.array([start_of(self.scene, i, self.stock) for i in range(len(self.scene.finger))], dtype=float)

    @cached_property
    def objects(self) -> tuple[ObjectPart, ...]:
        """Objects with their shapes, coupling laws and contact rules, in the order of the scene."""
        return tuple(make_objects(self.scene, self.stock, self.wires))

    @cached_property
    def hands(self) -> tuple[HandPart, ...]:
        """Hands in the order of their first fingers."""
        return tuple(make_hand(self.scene, self.stock, each) for each in holdings(self.scene))

    @cached_property
    def obstacles(self) -> list[Obstacle]:
        """Obstacles at their poses."""
        return obstacles(self.scene, self.stock)

    @cached_property
    def limits(self) -> FloatArray | None:
        """Lower force limit of device and safety chain for each finger, (n,) [N], inf without one; None without any."""
        limits = force_limits(len(self.scene.finger), self.wires)
        if self.safety is None:
            return limits
        return self.safety.force if limits is None else np.minimum(limits, self.safety.force)

    @cached_property
    def safety(self) -> SafetyLimits | None:
        """Limits of the safety chain; None for a scene without a safety chain."""
        return safety_limits(self.scene, self.wires)

    @cached_property
    def simulated(self) -> bool:
        """Whether all devices are simulated."""
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
        """Sentences about repairs and probable errors of the scene's meshes."""
        meshes = [(part.table, part.solid.mesh) for part in self.objects]
        return [f"{mesh_name(table)}: {note}" for table, mesh in meshes if mesh is not None for note in mesh.mesh.notes]

    @property
    def mesh_frames(self) -> dict[str, Mapping[str, list[float]]]:
        """`SceneMesh.frame` of each object with a mesh, by name of the object."""
        meshes = [(part.name, part.solid.mesh) for part in self.objects]
        return {name: mesh.frame for name, mesh in meshes if mesh is not None}


def reach_faults(scene: Scene) -> list[Finding]:
    """Find the fingers of a valid scene whose devices cannot be placed at the start positions."""
    parts = resolve(scene)
    return placing_faults(parts.start, parts.own_wires())


def resolve(scene: Scene) -> Parts:
    """Return the parts of a scene; every call with the same `Scene` object returns the same parts.

    Devices and shapes that the scene's checks have connected and loaded are reused. A copy of a scene, with or without
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
    """Yield each device with late forces, and its delay from a motion to the force, lateness plus latency [s]."""
    for wire in parts.wires:
        late = (wire.features.lateness or 0.0) + (wire.features.latency or 0.0)
        if late > 0.0:
            yield wire, late


def require_no_host(scene: Scene, action: str) -> None:
    """Raise an error if a host program simulates the object that an action needs.

    Args:
        scene: Scene to check.
        action: Name of the action for the message.

    Raises:
        InputError: If the scene has a host.
    """
    host = getattr(scene, "host", None)
    if host is not None:
        raise InputError(
            "host", host.name, f"a scene that simulates its object, for {action}",
            "the host program simulates the object, so that its forces are not known to the scene; "
            "gx.Feedback.limits computes the limits of a linear host",
        )  # fmt: skip


def require_prompt_simulations(parts: Parts) -> None:
    """Raise an error if a simulated device has late forces, because a simulation does not include this delay.

    Raises:
        InputError: If there is such a device.
    """
    for wire, late in late_wires(parts):
        if isinstance(wire.device, SimulatedDevice):
            names = ", ".join(parts.scene.finger_names[i] for i in wire.used)
            raise InputError(
                "measures.lateness", late, f"no lateness, because forces of the simulated device of {names} start at "
                "the beginning of a sample",
                "`check` and `stability` support any delay; to run the scene, remove the measures, or set a delay of "
                f"whole samples in the device's settings, delay = {round(late / parts.scene.period)}",
            )  # fmt: skip
