"""A described scene made to run: devices opened, hands and plants joined, objects filled."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.fading import set_fade
from graspfx.assembly.live import live_fields
from graspfx.assembly.loop_layout import loop_fields
from graspfx.assembly.movers import make_movers
from graspfx.assembly.plants import make_plants
from graspfx.assembly.resolve import Parts, resolve
from graspfx.assembly.scene_guards import guards_of
from graspfx.assembly.wiring import outside_faults, placing_faults
from graspfx.compile.memory import ROOM, Memory, within, without
from graspfx.loop.device import SimulatedDevice
from graspfx.loop.energy.observer import Observer
from graspfx.loop.parts import BodyGroup, DeviceWiring, GraspedPart
from graspfx.loop.played import Playback
from graspfx.loop.recording.layout import Layout, chosen_layout
from graspfx.loop.safety.chain import SafetyChain
from graspfx.loop.servo import Servo

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]


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
    """Build a servo ready to tick; simulated devices and bodies are closed at the end, whatever happens.

    Hardware is not opened: a run does so once all that it needs is there (`graspfx.assembly.hardware`). The first build
    of a scene has the devices that its checks connected; a later one connects others.

    Args:
        scene: what to build.
        engine: instead of the scene's own.
        record: whether its ticks are recorded.
        selected: whether they write the columns and ticks alone that the scene's `record` asks for; else all.
        live: keys that may change in mid-run (`graspfx.assembly.live`): no program folds in what they reach.
        real_time: whether its ticks are on the wall's clock, and record what they say of it.
        varying: whether largest forces that devices tell are recorded in any case.
        playback: of a recording in the place of devices, hands and plants; none is opened then.
        room: entries of the memory in which the parts' blocks stand; those for which there is none stand apart.

    Raises:
        InputError: a live key that cannot change in mid-run.
        SceneError: a finger that starts out of its device's reach.
        DeviceError: a device that does not open, or a plant that does not take its fingers together.
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
                if isinstance(wire.device, SimulatedDevice):
                    stack.enter_context(wire.device)
                    wire.device.open(scene.period)
        observers, safety = list(_observers(parts, objects, movers)), _safety(parts, objects, fields)
        layout, every = make_layout(parts, real_time=real_time), 1
        if varying:
            layout = replace(layout, varying=True)
        if selected:
            layout, every = chosen_layout(layout, scene.record.columns), scene.record.every
        servo = Servo(
            scene.period, layout, stations, objects, movers, plants, observers, engine or scene.engine,
            record=record, every=every, guards=guards_of(parts), safety=safety, memory=memory,
        )  # fmt: skip
        with without():
            yield servo


def meet(
    parts: Parts, objects: Sequence[GraspedPart], movers: Sequence[BodyGroup], start: FloatArray | None = None
) -> FloatArray:
    """Let the fingers meet their objects where they start; the unit normals into the objects there, (n, d).

    Args:
        parts: of the scene.
        objects: to be met.
        movers: their bodies.
        start: where the fingers are, (n, d) [m]; where the scene has them start if not given.
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
    """Lay out the columns of a recording; simulated devices also tell their true positions.

    Args:
        parts: of the scene.
        real_time: whether the run is on the wall's clock.
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
    """List the objects that turn about a centre which moves some ways only, where the implicit integrator puts it."""
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
