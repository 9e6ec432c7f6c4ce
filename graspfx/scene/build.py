"""A described scene made to run: devices connected, hands and plants joined, objects filled."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from inspect import signature
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx import plugins
from graspfx.coupling.grasped import GraspedObject, Rules
from graspfx.errors import DeviceError, InputError
from graspfx.grasp.impedance import Coupling, Impedance
from graspfx.loop import motion as motions
from graspfx.loop.device import Device, SimulatedDevice
from graspfx.loop.hand import Hand, join
from graspfx.loop.layout import Layout
from graspfx.loop.servo import Body, Held, Moved, Servo, Station
from graspfx.objects import shape as shapes
from graspfx.objects.body import fill_body, step_is_stable, viscous_step
from graspfx.scene.hands import Hand as HandTable
from graspfx.scene.hands import Motion, SharedHand
from graspfx.scene.model import Scene
from graspfx.scene.parts import Device as DeviceTable
from graspfx.scene.parts import Object as ObjectTable

FloatArray = NDArray[np.float64]


@contextmanager
def build(scene: Scene) -> Iterator[Servo]:
    """A servo ready to tick; devices and bodies are closed at the end, whatever happens.

    Raises InputError or DeviceError for what only shows when a device is connected, such as a start out of its reach.
    """
    start = np.array([finger.start for finger in scene.finger], dtype=float)
    with ExitStack() as stack:
        objects = [_held(scene, i, start, stack) for i in range(len(scene.object))]
        wired = _connect(scene)
        inward = np.zeros_like(start)
        for held in objects:
            inward[held.fingers] = held.grasped.inward()
        moved = list(_moved(scene, wired, start, inward))
        for wire in wired:
            stack.enter_context(wire.device)
            wire.device.open(scene.period)
        stations = [Station(wire.device, wire.fingers) for wire in wired]
        layout = Layout(
            dimensions=scene.dimensions,
            fingers=scene.finger_names,
            objects=tuple(held.name for held in objects),
            finger_objects=scene.finger_objects,
            gaps=scene.coupling.contact == "unilateral",
            simulated=all(isinstance(wire.device, SimulatedDevice) for wire in wired),
        )
        yield Servo(scene.period, layout, stations, objects, moved)


# Objects ----------------------------------------------------------------------------------------------------------


def _held(scene: Scene, index: int, start: FloatArray, stack: ExitStack) -> Held:
    table, d = scene.object[index], scene.dimensions
    fingers = np.flatnonzero(np.array(scene.finger_objects) == index)
    shape = make_shape(table, d)
    rules = scene.coupling
    grasped = GraspedObject(
        len(fingers),
        d,
        scene.period,
        make_law(scene),
        Rules(
            attached=rules.contact == "attached",
            stick=rules.friction == "stick",
            fade=rules.fade if rules.absent == "fade" else None,
            at_contact=rules.reaction == "contact",
            blend=rules.blend,
        ),
        lambda state: _fill(scene, table, shape, state),
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


def make_shape(table: ObjectTable, d: int) -> shapes.Box | shapes.Sphere | None:
    """The shape that a table describes."""
    if table.shape is None:
        return None
    if table.shape.kind == "box":
        return shapes.Box(table.shape.size)
    return shapes.Sphere(table.shape.radius)


def make_law(scene: Scene) -> Coupling:
    """The gains of eq. (4)."""
    external, internal = scene.coupling.external, scene.coupling.internal
    return Coupling(
        external=Impedance(external.stiffness, external.damping),
        internal=Impedance(internal.stiffness, internal.damping),
        form=scene.coupling.form,
    )


def _fill(scene: Scene, table: ObjectTable, shape: shapes.Box | shapes.Sphere | None, state: FloatArray) -> None:
    d = scene.dimensions
    inertia: Any = table.inertia
    if inertia is None and shape is not None and d > 1:
        inertia = shape.inertia(table.mass, d)
    fill_body(
        state,
        dimensions=d,
        mass=table.mass,
        inertia=inertia,
        viscosity=table.viscosity,
        rotational_viscosity=table.rotational_viscosity or 0.0,
        # others have an integrator of their own; only the native implicit one is asked for its free motion
        integrator=table.integrator if table.dynamics == "native" else "semi-implicit",
        free=scene.free(table),
        gravity=scene.gravity,
        position=table.position,
        orientation=table.orientation,
        velocity=table.velocity,
        angular_velocity=table.angular_velocity,
    )
    if table.dynamics == "native" and not step_is_stable(state, scene.period):
        raise InputError(
            f"{table.name}: viscosity",
            f"a viscous step of {viscous_step(state, scene.period):.4g}",
            f"below 2 with {table.integrator} integration",
            "integrator = 'exact' or 'implicit' takes any",
        )


# Devices ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Wire:
    """A connected device and the finger of each of its channels (-1: none)."""

    name: str
    device: Device
    fingers: NDArray[np.intp]


def _connect(scene: Scene) -> list[_Wire]:
    """Every device once, in the order of the first finger that names it."""
    channels: dict[str, dict[int, int]] = {}
    tables: dict[str, DeviceTable] = {}
    shared = {table.label: table for table in scene.device}
    for i, finger in enumerate(scene.finger):
        key = finger.device if isinstance(finger.device, str) else f"device of {scene.finger_names[i]}"
        tables[key] = shared[finger.device] if isinstance(finger.device, str) else finger.device
        channels.setdefault(key, {})[finger.channel] = i
    wired = []
    for key, table in tables.items():
        device = connect(table, scene)
        k = device.features.fingers
        beyond = [c for c in channels[key] if c >= k]
        if beyond:
            raise InputError(f"{key}: channel", beyond[0], f"a channel below {k}: the device has {k} finger(s)")
        if device.features.dimensions != scene.dimensions:
            raise InputError(key, f"{device.features.dimensions} dimensions", f"the scene's {scene.dimensions}")
        fingers = np.array([channels[key].get(c, -1) for c in range(k)])
        wired.append(_Wire(key, device, fingers))
    return wired


def connect(table: DeviceTable, scene: Scene) -> Device:
    """The device that a table names; a driver whose `connect` takes `dimensions` is given the scene's."""
    driver = plugins.load("devices", table.name, scene.source.folder)
    settings = table.settings
    if "dimensions" in signature(driver.connect).parameters:
        settings.setdefault("dimensions", scene.dimensions)
    device: Device = driver.connect(**settings)
    return device


# Hands and plants -------------------------------------------------------------------------------------------------


def _moved(scene: Scene, wired: Sequence[_Wire], start: FloatArray, inward: FloatArray) -> Iterator[Moved]:
    """The plants of the simulated devices: one for all devices that hands join to one another."""
    groups = _hand_groups(scene)
    for members in _components(scene, wired, groups):
        simulated = [wired[i] for i in members]
        fingers = np.concatenate([wire.fingers for wire in simulated])
        devices = [wire.device for wire in simulated]
        kinds = {type(device) for device in devices}
        if len(kinds) > 1:
            names = ", ".join(sorted(kind.__name__ for kind in kinds))
            raise InputError("hand", f"devices of different kinds ({names})", "one hand to hold devices of one kind")
        if (fingers < 0).any():
            wire = next(w for w in simulated if (w.fingers < 0).any())
            c = int(np.flatnonzero(wire.fingers < 0)[0])
            raise InputError(
                f"{wire.name}: channel {c}", "no finger", "a finger for every channel of a simulated device"
            )
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


def _components(scene: Scene, wired: Sequence[_Wire], groups: Sequence[Sequence[int]]) -> Iterator[list[int]]:
    """Sets of simulated devices that share a hand, directly or through others."""
    of_finger = {int(f): i for i, wire in enumerate(wired) for f in wire.fingers if f >= 0}
    for wire in wired:
        held = [f for f in wire.fingers if f >= 0 and scene.finger[f].hand is not None]
        if not isinstance(wire.device, SimulatedDevice) and held:
            raise InputError(
                f"{scene.finger_names[held[0]]}.hand", "a hand on a real device", "no hand: the operator's own holds it"
            )
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
