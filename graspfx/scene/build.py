"""A described scene made to run: devices connected, hands and plants joined, objects filled."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path as FilePath

import numpy as np
from numpy.typing import NDArray

from graspfx import plugins
from graspfx.coupling.grasped import GraspedObject, Rules
from graspfx.errors import DeviceError
from graspfx.grasp.impedance import Coupling, Impedance
from graspfx.loop import motion as motions
from graspfx.loop.device import SimulatedDevice
from graspfx.loop.hand import Hand, join
from graspfx.loop.layout import Layout
from graspfx.loop.servo import Body, Held, Moved, Servo, Station
from graspfx.scene.bodies import fill, make_shape
from graspfx.scene.fields import Gains
from graspfx.scene.hands import Hand as HandTable
from graspfx.scene.hands import Motion, SharedHand
from graspfx.scene.model import Scene
from graspfx.scene.wiring import Wire, wires

FloatArray = NDArray[np.float64]


@contextmanager
def build(scene: Scene) -> Iterator[Servo]:
    """A servo ready to tick; devices and bodies are closed at the end, whatever happens.

    Raises:
        SceneError: a finger that starts out of its device's reach.
        DeviceError: a device that does not open, or a plant that does not take its fingers together.
    """
    scene.require_reach()
    start = np.array([finger.start for finger in scene.finger], dtype=float)
    with ExitStack() as stack:
        wired = wires(scene, scene.source.folder)
        masses = _masses(scene, wired)
        objects = [_held(scene, i, start, masses, stack) for i in range(len(scene.object))]
        inward = np.zeros_like(start)
        for held in objects:
            inward[held.fingers] = held.grasped.inward()
        moved = list(_moved(scene, wired, start, inward))
        for wire in wired:
            stack.enter_context(wire.device)
            wire.device.open(scene.period)
        stations = [Station(wire.device, wire.fingers) for wire in wired]
        layout = make_layout(scene, simulated=all(isinstance(wire.device, SimulatedDevice) for wire in wired))
        yield Servo(scene.period, layout, stations, objects, moved)


def make_layout(scene: Scene, *, simulated: bool) -> Layout:
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


def _held(scene: Scene, index: int, start: FloatArray, masses: FloatArray | None, stack: ExitStack) -> Held:
    table, d = scene.object[index], scene.dimensions
    fingers = np.flatnonzero(np.array(scene.finger_objects) == index)
    shape = make_shape(table)
    rules = scene.coupling
    grasped = GraspedObject(
        len(fingers),
        d,
        scene.period,
        make_law(scene, fingers),
        Rules(
            attached=rules.contact == "attached",
            stick=rules.friction == "stick",
            friction=[scene.coefficients[i] for i in fingers],
            patch=[scene.finger[i].patch or 0.0 for i in fingers],
            share=None if masses is None else (masses[fingers] / masses[fingers].mean()).tolist(),
            fade=rules.fade if rules.absent == "fade" else None,
            at_contact=rules.reaction == "contact",
            blend=rules.blend,
        ),
        lambda state: fill(scene, table, state),
        shape=shape,
    )
    create = plugins.load("dynamics", table.dynamics, scene.source.folder).create
    body: Body = create(grasped.body_state)
    stack.callback(getattr(body, "close", _nothing))
    if grasped.implicit:
        body.free_motion(scene.period)
    grasped.meet(start[fingers])
    return Held(table.name, grasped, body, fingers)


def _nothing() -> None:
    return None


def make_law(scene: Scene, fingers: NDArray[np.intp]) -> Coupling:
    """The gains of eq. (4) for the fingers of one object."""
    external, internal = scene.coupling.external, scene.coupling.internal
    return Coupling(
        external=Impedance(_own(external.stiffness, fingers), _own(external.damping, fingers)),
        internal=Impedance(_own(internal.stiffness, fingers), _own(internal.damping, fingers)),
        form=scene.coupling.form,
    )


def _own(gain: Gains, fingers: NDArray[np.intp]) -> float | FloatArray:
    """Of gains that are given per finger, those of these fingers; any other as it is."""
    values = np.asarray(gain, dtype=float)
    if values.ndim == 0:
        return float(values)
    return values[fingers] if values.ndim in (1, 3) else values


# Hands and plants -------------------------------------------------------------------------------------------------


def _moved(scene: Scene, wired: Sequence[Wire], start: FloatArray, inward: FloatArray) -> Iterator[Moved]:
    """The plants of the simulated devices: one for all devices that hands join to one another."""
    groups = _hand_groups(scene)
    for members in _components(scene, wired, groups):
        simulated = [wired[i] for i in members]
        fingers = np.concatenate([wire.fingers for wire in simulated])
        devices = [wire.device for wire in simulated]
        hands, order = [], []
        for group in groups:
            if group[0] in fingers:
                hands.append(_hand(scene, group, start, inward))
                order += group
        first = devices[0]
        assert isinstance(first, SimulatedDevice)
        plant = type(first).plant(devices)
        try:
            plant.place(start[fingers])
        except DeviceError as error:
            raise DeviceError(f"{', '.join(scene.finger_names[f] for f in fingers)}: {error}") from error
        hand = join(hands, [order.index(f) for f in fingers])
        yield Moved(plant, hand, [d for d in devices if isinstance(d, SimulatedDevice)], fingers)


def _hand_groups(scene: Scene) -> list[list[int]]:
    """The fingers of every hand; a finger without one stands alone."""
    groups: dict[str, list[int]] = {}
    for i, finger in enumerate(scene.finger):
        key = f"hand {finger.hand}" if isinstance(finger.hand, str) else f"finger {i}"
        groups.setdefault(key, []).append(i)
    return list(groups.values())


def _components(scene: Scene, wired: Sequence[Wire], groups: Sequence[Sequence[int]]) -> Iterator[list[int]]:
    """Sets of simulated devices that share a hand, directly or through others."""
    of_finger = {int(f): i for i, wire in enumerate(wired) for f in wire.fingers if f >= 0}
    left = {i for i, wire in enumerate(wired) if isinstance(wire.device, SimulatedDevice)}
    while left:
        members = [min(left)]
        for member in members:  # grows while it is walked
            left.discard(member)
            for group in groups:
                near = {of_finger[f] for f in group}
                if member in near:
                    members += sorted((near & left) - set(members))
        yield members


def _hand(scene: Scene, group: Sequence[int], start: FloatArray, inward: FloatArray) -> Hand:
    table = scene.finger[group[0]].hand
    if table is None:
        return Hand(start[group], 0.0)
    if isinstance(table, HandTable):
        rest = start[group] if table.rest is None else np.array([table.rest])
        return Hand(
            rest,
            table.stiffness,
            table.damping,
            make_motion(scene, table.motion),
            table.squeeze,
            inward[group],
            table.squeeze_ramp,
        )
    shared: SharedHand = next(hand for hand in scene.hand if hand.name == table)
    return Hand.arm_and_grip(
        start[group],
        arm=(shared.arm.stiffness, shared.arm.damping),
        grip=(shared.grip.stiffness, shared.grip.damping),
        motion=make_motion(scene, shared.motion),
        squeeze=shared.squeeze,
        inward=inward[group],
        squeeze_ramp=shared.squeeze_ramp,
    )


def make_motion(scene: Scene, table: Motion) -> motions.Motion:
    """The intended motion that a table describes."""
    if table.kind == "rest":
        return motions.Rest()
    if table.kind == "sine":
        axis = "xyz".index(table.axis) if isinstance(table.axis, str) else table.axis
        along = np.eye(scene.dimensions)[axis]
        return motions.Sine(table.amplitude, table.frequency, along, table.begin, table.ramp)
    if table.kind == "reach":
        return motions.Reach(table.displacement, table.begin, table.duration)
    if table.file is not None:
        return motions.Path.read((scene.source.folder or FilePath()) / table.file)
    assert table.times is not None and table.positions is not None
    return motions.Path(table.times, table.positions)
