"""A described scene made to run: devices connected, hands and plants joined, objects filled."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.build.bodies import fill, make_shape
from graspfx.build.force_limits import force_limits
from graspfx.build.holdings import Holding, hold, holdings
from graspfx.build.meshes import scene_mesh
from graspfx.build.movers import make_movers
from graspfx.build.still_hands import most_forces
from graspfx.build.wiring import Wire, wires
from graspfx.coupling.fade import FADE, gaps, release_compliance
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.rules import Rules
from graspfx.errors import DeviceError
from graspfx.grasp.impedance import Coupling, Impedance
from graspfx.loop.device import SimulatedDevice
from graspfx.loop.energy.observer import Observer
from graspfx.loop.hand import join
from graspfx.loop.parts import Held, Moved, Mover, Station
from graspfx.loop.recording.layout import Layout
from graspfx.loop.servo import Servo

if TYPE_CHECKING:
    from graspfx.scene.model import Scene
    from graspfx.scene.tables.fields import Gains

FloatArray = NDArray[np.float64]


@contextmanager
def build(scene: Scene, *, engine: str = "", record: bool = True, live: bool = True) -> Iterator[Servo]:
    """A servo ready to tick; devices and bodies are closed at the end, whatever happens.

    Args:
        scene: what to build.
        engine: instead of the scene's own.
        record: whether its ticks are recorded.
        live: whether devices that are no simulations are opened too; else it is not to tick, only to be looked at.

    Raises:
        SceneError: a finger that starts out of its device's reach.
        DeviceError: a device that does not open, or a plant that does not take its fingers together.
    """
    scene.require_reach()
    start = np.array([finger.start for finger in scene.finger], dtype=float)
    with ExitStack() as stack:
        wired = wires(scene, scene.source.folder)
        masses = _masses(scene, wired)
        limits = force_limits(len(scene.finger), wired)
        objects = [_held(scene, i, masses, limits) for i in range(len(scene.object))]
        movers = list(make_movers(scene, [held.grasped.body_state for held in objects], stack))
        for mover in movers:
            if any(objects[i].grasped.implicit for i in mover.objects):
                mover.body.free_motion(scene.period)
        for held in objects:
            held.grasped.meet(start[held.fingers])
        inward = np.zeros_like(start)
        for held in objects:
            inward[held.fingers] = held.grasped.inward()
        set_fade(scene, objects, start, inward)
        moved = list(_moved(scene, wired, start, inward))
        for wire in wired:
            if live or isinstance(wire.device, SimulatedDevice):
                stack.enter_context(wire.device)
                wire.device.open(scene.period)
        stations = [Station(wire.device, wire.fingers) for wire in wired]
        layout = make_layout(
            scene,
            simulated=all(isinstance(wire.device, SimulatedDevice) for wire in wired),
            limits=limits is not None,
        )
        observers = list(_observers(scene, wired, objects, movers))
        yield Servo(
            scene.period, layout, stations, objects, movers, moved, observers, engine or scene.engine, record=record
        )


def make_layout(scene: Scene, *, simulated: bool, limits: bool) -> Layout:
    """The columns of a recording of the scene; simulated devices also tell their true positions."""
    return Layout(
        dimensions=scene.dimensions,
        fingers=scene.finger_names,
        objects=tuple(thing.name for thing in scene.object),
        finger_objects=scene.finger_objects,
        gaps=scene.coupling.contact == "unilateral",
        moments=any(finger.model == "soft" for finger in scene.finger),
        slips=any(scene.coefficients),
        simulated=simulated,
        observed=scene.coupling.passivity != "off",
        controlled=scene.coupling.passivity == "control",
        limits=limits,
    )


# Objects ----------------------------------------------------------------------------------------------------------


def _masses(scene: Scene, wired: Sequence[Wire]) -> FloatArray | None:
    """Of the device at each fingertip [kg], where the metric asks for them."""
    if scene.coupling.metric != "mass":
        return None
    masses = np.zeros(len(scene.finger))
    for wire in wired:
        masses[wire.fingers[wire.fingers >= 0]] = wire.device.features.mass
    return masses


def _held(scene: Scene, index: int, masses: FloatArray | None, limits: FloatArray | None) -> Held:
    grasped, fingers = grasped_object(scene, index, masses, limits)
    return Held(scene.object[index].name, grasped, fingers)


def grasped_object(
    scene: Scene, index: int, masses: FloatArray | None, limits: FloatArray | None = None
) -> tuple[GraspedObject, NDArray[np.intp]]:
    """An object as the coupling sees it, and the numbers of its fingers.

    Args:
        scene: the scene.
        index: of the object.
        masses: of all fingers' devices [kg], if weighed.
        limits: largest forces of all fingers [N], infinite where there is none; None where forces have no limit.
    """
    table, d = scene.object[index], scene.dimensions
    fingers = np.flatnonzero(np.array(scene.finger_objects) == index)
    folder = scene.source.folder
    rules = scene.coupling
    grasped = GraspedObject(
        len(fingers),
        d,
        scene.period,
        make_law(scene, fingers, index),
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
        ),
        lambda state: fill(scene, table, state, folder),
        shape=make_shape(table, folder),
        radius=[scene.finger[f].radius for f in fingers],
        limit=None if limits is None else limits[fingers],
    )
    return grasped, fingers


def set_fade(scene: Scene, objects: Sequence[Held], start: FloatArray, inward: FloatArray) -> None:
    """Let `coupling.fade = "auto"` begin where the squeeze of the hands asks for it: fingers have met their objects.

    h1 = 1/2 |1/kep - 1/kip| sum |f|, |f| the most with which a hand squeezes, and 2 mm at least; h2 = h1 + 8 mm.
    """
    rules = scene.coupling
    if rules.fade != "auto" or rules.absent == "follow" or rules.contact == "attached":
        return
    compliance = [release_compliance(each.grasped.law, len(each.fingers), scene.dimensions) for each in objects]
    if not any(compliance):
        return
    contacts = start.copy()
    for each in objects:
        contacts[each.fingers] = each.grasped.contact_position
    forces = most_forces(scene, start, inward, contacts)
    for each, soft in zip(objects, compliance, strict=True):
        found = gaps(soft * float(forces[each.fingers].sum()))
        if found != FADE:
            each.grasped.set_fade(*found)
            each.grasped.meet(start[each.fingers])


def _observers(
    scene: Scene, wired: Sequence[Wire], objects: Sequence[Held], movers: Sequence[Mover]
) -> Iterator[Observer]:
    if scene.coupling.passivity == "off":
        return
    friction, mass = np.zeros(len(scene.finger)), np.full(len(scene.finger), np.inf)
    for wire in wired:
        used, told = wire.fingers[wire.fingers >= 0], wire.device.features
        friction[used] = told.friction or 0.0
        mass[used] = told.mass or np.inf
    body_of = {i: mover.body for mover in movers for i in mover.objects}
    for i, held in enumerate(objects):
        yield Observer(
            held.grasped,
            body_of[i],
            scene.period,
            control=scene.coupling.passivity == "control",
            friction=friction[held.fingers],
            mass=mass[held.fingers],
        )


def make_law(scene: Scene, fingers: NDArray[np.intp], index: int) -> Coupling:
    """Make the gains of eq. (4) for the fingers of one object; those in the object's axes stand in its body's."""
    external, internal = scene.coupling.external, scene.coupling.internal
    law = Coupling(
        external=Impedance(_own(external.stiffness, fingers), _own(external.damping, fingers)),
        internal=Impedance(_own(internal.stiffness, fingers), _own(internal.damping, fingers)),
        form=scene.coupling.form,
    )
    # the body of a mesh has its principal axes, the file others
    mesh = scene_mesh(scene.object[index], scene.source.folder) if scene.coupling.axes == "object" else None
    return law if mesh is None else law.turned(mesh.unit.axes.T)


def _own(gain: Gains, fingers: NDArray[np.intp]) -> float | FloatArray:
    """Of gains that are given per finger, those of these fingers; any other as it is."""
    values = np.asarray(gain, dtype=float)
    if values.ndim == 0:
        return float(values)
    return values[fingers] if values.ndim in (1, 3) else values


# Hands and plants -------------------------------------------------------------------------------------------------


def _moved(scene: Scene, wired: Sequence[Wire], start: FloatArray, inward: FloatArray) -> Iterator[Moved]:
    """The plants of the simulated devices: one for all devices that hands join to one another."""
    groups = holdings(scene)
    for members in _components(wired, groups):
        simulated = [wired[i] for i in members]
        fingers = np.concatenate([wire.fingers for wire in simulated])
        devices = [wire.device for wire in simulated]
        hands, order = [], []
        for group in groups:
            if group.fingers[0] in fingers:
                hands.append(hold(scene, scene.source.folder, group, start, inward))
                order += group.fingers
        first = devices[0]
        assert isinstance(first, SimulatedDevice)
        plant = type(first).plant(devices)
        try:
            plant.place(start[fingers])
        except DeviceError as error:
            raise DeviceError(f"{', '.join(scene.finger_names[f] for f in fingers)}: {error}") from error
        hand = join(hands, [order.index(f) for f in fingers])
        yield Moved(plant, hand, [d for d in devices if isinstance(d, SimulatedDevice)], fingers)


def _components(wired: Sequence[Wire], groups: Sequence[Holding]) -> Iterator[list[int]]:
    """Sets of simulated devices that share a hand, directly or through others."""
    of_finger = {int(f): i for i, wire in enumerate(wired) for f in wire.fingers if f >= 0}
    left = {i for i, wire in enumerate(wired) if isinstance(wire.device, SimulatedDevice)}
    while left:
        members = [min(left)]
        for member in members:  # grows while it is walked
            left.discard(member)
            for group in groups:
                near = {of_finger[f] for f in group.fingers}
                if member in near:
                    members += sorted((near & left) - set(members))
        yield members
