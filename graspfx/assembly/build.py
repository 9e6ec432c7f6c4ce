"""Construction of a servo from a scene's devices, bodies, plants, hands and objects."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx import plugins
from graspfx.assembly.bodies import collide, groups, in_world
from graspfx.assembly.device_limits import changes, guards_of
from graspfx.assembly.grasps import set_fade
from graspfx.assembly.live import GUIDE, live_fields
from graspfx.assembly.resolve import Parts, resolve
from graspfx.assembly.wiring import Wire, outside_faults, placing_faults
from graspfx.compile.memory import ROOM, Memory, within, without
from graspfx.errors import DeviceError
from graspfx.feedback.bridge import make_host
from graspfx.loop.columns import Layout, chosen_layout
from graspfx.loop.device import OperatedDevice, RawDevice, SimulatedDevice, is_hardware
from graspfx.loop.energy.observer import Observer
from graspfx.loop.hand import join
from graspfx.loop.played import Playback
from graspfx.loop.safety.chain import SafetyChain
from graspfx.loop.servo import Servo, SteerablePlant
from graspfx.loop.servo_parts import BodyGroup, DeviceWiring, GraspedPart, PlantWiring
from graspfx.objects.surroundings import Meeting, Member
from graspfx.scene.keys import general

if TYPE_CHECKING:
    from graspfx.assembly.hands import HandPart
    from graspfx.scene.model import Scene


def loop_fields(wired: Sequence[Wire], fingers: Sequence[str]) -> dict[str, Any]:
    """Return the fields of a `Layout` that only a real-time run has."""
    devices = device_names(wired, fingers)
    own = [(name, wire.device) for name, wire in zip(devices, wired, strict=True)]
    raw = [(name, device.raw) for name, device in own if isinstance(device, RawDevice)]
    return {
        "timed": True,
        "varying": any(changes(wire) for wire in wired),
        "switched": any(wire.features.switches for wire in wired),
        "devices": devices,
        "raw": tuple((name, len(numbers), str(numbers.dtype)) for name, numbers in raw),
    }


def device_names(wired: Sequence[Wire], fingers: Sequence[str]) -> tuple[str, ...]:
    """Return the name of each device, which is that of its first finger."""
    return tuple(fingers[int(wire.used[0])] for wire in wired)


FloatArray = NDArray[np.float64]


def make_movers(parts: Parts, states: Sequence[FloatArray], stack: ExitStack) -> Iterator[BodyGroup]:
    """Make the body groups of a scene's objects, whose blocks are `states`; closing `stack` closes the bodies.

    Raises:
        PluginError: If a plug-in raises an error when it creates a body.
    """
    scene, world = parts.scene, parts.scene.world
    meeting = Meeting(world.friction, world.restitution, world.stiffness, collide(scene))
    for group in groups(scene):
        module = plugins.load_blaming("dynamics", scene.object[group[0]].dynamics, parts.folder)
        file = Path(module.__file__ or module.__name__)
        make_world = getattr(module, "create_world", None)
        if make_world is None or not in_world(scene, group):
            for i in group:
                with plugins.blaming(file):
                    body = module.create(states[i])
                stack.callback(getattr(body, "close", _nothing))
                yield BodyGroup(body, [i])
            continue
        members = [Member(states[i], parts.objects[i].solid.shape) for i in group]
        with plugins.blaming(file):
            body = make_world(members, parts.obstacles, meeting)
        stack.callback(getattr(body, "close", _nothing))
        yield BodyGroup(body, group)


def _nothing() -> None:
    return None


def make_plants(
    parts: Parts, wired: Sequence[Wire], inward: FloatArray, live: Collection[str] = ()
) -> Iterator[PlantWiring]:
    """Make the plants of the simulated devices, one for each group of devices that share hands.

    Args:
        parts: Parts of the scene.
        wired: Devices of the scene.
        inward: Unit normals of the fingers' contacts, into the objects, (n, d).
        live: Keys whose values may change during the run. If a squeeze may change, every squeeze is implemented as a
            motion, even a squeeze of zero.

    Raises:
        SceneError: If a finger starts outside the workspace of its device.
        DeviceError: If a plant cannot be placed at its fingers' start positions.
    """
    scene, start = parts.scene, parts.start
    others = [key for key in live if general(key) not in GUIDE]  # goals of guided hands do not change a plant
    squeezes = any(key.endswith(".squeeze") for key in others)
    changes = any(key.startswith(("hand.", "device.")) or ".hand." in key or ".device." in key for key in others)
    for members in _components(wired, parts.hands):
        simulated = [wired[i] for i in members]
        fingers = np.concatenate([wire.fingers for wire in simulated])
        devices = [wire.device for wire in simulated]
        hands, order = [], []
        for hand in parts.hands:
            if hand.fingers[0] in fingers:
                hands.append((hand.with_course() if squeezes else hand).hold(start, inward))
                order += hand.fingers
        first = devices[0]
        assert isinstance(first, SimulatedDevice)
        joined = join(hands, [order.index(f) for f in fingers])
        operator = getattr(joined, "operator", None)
        if operator is None:
            plant = type(first).plant(devices)
        else:
            assert isinstance(first, OperatedDevice)
            plant = type(first).operated_plant(devices, operator, scene.period)
        if changes and isinstance(plant, SteerablePlant):
            plant.live = True
        try:
            plant.place(start[fingers])
        except DeviceError as error:
            if faults := placing_faults(start, wired):
                raise scene.error(faults) from error
            raise DeviceError(f"{', '.join(scene.finger_names[f] for f in fingers)}: {error}") from error
        yield PlantWiring(plant, joined, [d for d in devices if isinstance(d, SimulatedDevice)], fingers)


def _components(wired: Sequence[Wire], hands: Sequence[HandPart]) -> Iterator[list[int]]:
    """Yield the sets of simulated devices, by index, that hands connect directly or through other devices."""
    of_finger = {int(f): i for i, wire in enumerate(wired) for f in wire.used}
    left = {i for i, wire in enumerate(wired) if not is_hardware(wire.device)}
    while left:
        members = [min(left)]
        for member in members:  # this list grows during the loop
            left.discard(member)
            for hand in hands:
                near = {of_finger[f] for f in hand.fingers}
                if member in near:
                    members += sorted((near & left) - set(members))
        yield members


@contextmanager
def build(
    scene: Scene,
    *,
    engine: str = "",
    record: bool = True,
    selected: bool = False,
    live: Collection[str] = (),
    real_time: bool = False,
    varying: bool = False,
    playback: Playback | None = None,
    room: int = ROOM,
) -> Iterator[Servo]:
    """Build a servo that is ready to run, and close its simulated devices and bodies on exit.

    Hardware is not opened here: a run opens it last (`graspfx.assembly.hardware`). The first build of a scene uses the
    devices that the scene's checks connected, and each later build connects new devices.

    Args:
        scene: Scene to build.
        engine: Engine to use instead of the scene's engine; the scene's engine if empty.
        record: Whether the servo's ticks are recorded.
        selected: Whether ticks write only the columns and rows that the scene's `record` table selects; otherwise,
            ticks write all columns and rows.
        live: Keys whose values may change during the run (`graspfx.assembly.live`); compiled ticks read these values in
            every tick.
        real_time: Whether ticks follow the wall clock, and record the times of the clock.
        varying: Whether each tick records the largest forces of the devices; a real-time run records them in any case
            if they may change.
        playback: Playback of a recording in place of devices, hands and plants, without opening a device; None to use
            the devices, hands and plants of the scene.
        room: Number of entries of the memory for the parts' blocks; blocks that do not fit are separate arrays.

    Raises:
        InputError: If the value of a live key cannot change during a run.
        SceneError: If a finger starts outside the workspace of its device.
        DeviceError: If a device does not open, or a plant cannot be placed at its fingers' start positions.
    """
    fields = live_fields(live)
    parts = resolve(scene)
    start = parts.start
    wired, memory = parts.claim(room) if playback is None else (parts.wires, Memory())
    if playback is None and any(fault for wire in wired for fault in outside_faults(wire, start)):
        raise scene.error(placing_faults(start, wired))
    with ExitStack() as stack, within(memory):
        objects = [
            GraspedPart(part.name, part.grasped(parts.limits, live=fields), part.fingers) for part in parts.objects
        ]
        movers = list(make_movers(parts, [member.grasped.body_state for member in objects], stack))
        inward = meet(parts, objects, movers)
        stations = [DeviceWiring(wire.device, wire.fingers, wire.fitting) for wire in wired]
        if playback is not None:
            stations, plants = playback.wirings(stations)
        else:
            plants = list(make_plants(parts, wired, inward, live=live))
            for wire in wired:
                if not is_hardware(wire.device):
                    stack.enter_context(wire.device)
                    wire.device.open(scene.period)
        observers, safety = list(_observers(parts, objects, movers)), _safety(parts, objects, fields)
        host = None
        if scene.host is not None and safety is not None:
            host = make_host(scene.host, safety.limits.force, scene.dimensions, scene.period)
            safety.silence = scene.host.silence
            stack.callback(host.record.close)
        layout, every = make_layout(parts, real_time=real_time), 1
        if varying:
            layout = replace(layout, varying=True)
        if selected:
            layout, every = chosen_layout(layout, scene.record.columns), scene.record.every
        servo = Servo(
            scene.period, layout, stations, objects, movers, plants, observers, engine or scene.engine,
            record=record, every=every, guards=guards_of(parts.scene, parts.wires), safety=safety, host=host,
            memory=memory,
        )  # fmt: skip
        with without():
            yield servo


@contextmanager
def build_again(scene: Scene, **how: Any) -> Iterator[Servo]:
    """Return the servo of the scene's previous run with its memory reset, or build a servo as `build` does.

    A servo is reused if the arguments `how` of `build` are the same, and if all its parts are kernels, so that a run
    changes only its memory. The devices are opened on entry and closed on exit in both cases.
    """
    stock = resolve(scene).stock
    kept = stock.take_built()
    if kept is None or kept[0] != how:
        with build(scene, **how) as servo:
            start = servo.start()
            yield servo
        if start is None:
            return
        kept = how, servo, start
    else:
        _, servo, start = kept
        with ExitStack() as stack:
            for station in servo.stations:
                stack.enter_context(station.device)
                station.device.open(scene.period)
            servo.begin_again(start)
            yield servo
    servo.forget_rows()
    stock.built = kept


def meet(
    parts: Parts, objects: Sequence[GraspedPart], movers: Sequence[BodyGroup], start: FloatArray | None = None
) -> FloatArray:
    """Compute the contacts of the fingers at their start positions; return the unit normals into the objects, (n, d).

    Args:
        parts: Parts of the scene.
        objects: Grasped objects.
        movers: Body groups of the objects.
        start: Positions of the fingers, (n, d) [m]; the scene's start positions if None.
    """
    start = parts.start if start is None else start
    for mover in movers:
        if any(objects[i].grasped.implicit for i in mover.objects):
            mover.body.free_motion(parts.scene.period)
    for part in objects:
        part.grasped.meet(start[part.fingers])
    inward = np.zeros_like(start)
    for part in objects:
        inward[part.fingers] = part.grasped.inward()
    set_fade(parts, objects, inward, start)
    return inward


def make_layout(parts: Parts, *, real_time: bool = False) -> Layout:
    """Return the columns of a scene's recording.

    Args:
        parts: Parts of the scene.
        real_time: Whether the run follows the wall clock, which adds columns such as times.
    """
    scene = parts.scene
    soft = any(finger.model == "soft" for finger in scene.finger)
    return Layout(
        dimensions=scene.dimensions,
        fingers=scene.finger_names,
        objects=tuple(thing.name for thing in scene.object),
        finger_objects=scene.finger_objects,
        gaps=scene.coupling.contact == "unilateral",
        moments=soft,
        slips=any(scene.coefficients),
        simulated=parts.simulated,
        observed=scene.coupling.passivity != "off",
        controlled=scene.coupling.passivity == "control",
        limits=parts.limits is not None,
        guarded=parts.safety is not None,
        normals=soft or any(scene.coefficients),
        torsion_axes=soft and scene.coupling.reaction == "fingertip",
        predicted=_predicted(parts),
        **(loop_fields(parts.wires, scene.finger_names) if real_time else {}),
    )


def _predicted(parts: Parts) -> tuple[int, ...]:
    """List the objects, by index, with the integrator "implicit", a free rotation, and one or more locked translations.

    At least one translation is free.
    """
    scene, d = parts.scene, parts.scene.dimensions
    return tuple(
        k
        for k, thing in enumerate(scene.object)
        if thing.integrator == "implicit" and thing.dynamics == "native" and scene.turns(thing)
        and any(scene.free(thing)[:d]) and not all(scene.free(thing)[:d])
    )  # fmt: skip


def _safety(parts: Parts, objects: Sequence[GraspedPart], live: Collection[str]) -> SafetyChain | None:
    if parts.safety is None:
        return None
    grasped = [(part.grasped, part.fingers) for part in objects]
    return SafetyChain(parts.safety, grasped, len(parts.wires), parts.scene.period, live=live)


def _observers(parts: Parts, objects: Sequence[GraspedPart], movers: Sequence[BodyGroup]) -> Iterator[Observer]:
    scene = parts.scene
    if scene.coupling.passivity == "off":
        return
    friction, mass = np.zeros(len(scene.finger)), np.full(len(scene.finger), np.inf)
    for wire in parts.wires:
        friction[wire.used] = wire.features.friction or 0.0
        mass[wire.used] = wire.features.mass or np.inf
    body_of = {i: mover.body for mover in movers for i in mover.objects}
    for i, part in enumerate(objects):
        yield Observer(
            part.grasped,
            body_of[i],
            scene.period,
            control=scene.coupling.passivity == "control",
            friction=friction[part.fingers],
            mass=mass[part.fingers],
            guarded=parts.safety is not None,
        )
