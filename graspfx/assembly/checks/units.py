"""Warnings about units: values that may be in millimetres, grams, milliseconds or degrees."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import numpy as np

from graspfx.assembly.bodies import Stock
from graspfx.assembly.hands import holdings
from graspfx.assembly.resolve import start_of
from graspfx.errors import GraspFXError
from graspfx.scene.keys import Finding, Key, dotted
from graspfx.scene.tables.fields import NotValid
from graspfx.scene.tables.hand_tables import MadeHand, OwnHand, Reach, SharedHand, SharedMadeHand, Step, TurnReach
from graspfx.scene.tables.reading import listed
from graspfx.scene.tables.scene_table import SceneTable
from graspfx.scene.tables.shapes import MeshShape

Doubt = tuple[Key, float, str, str]  # key, value, unit, and the probable meaning or an empty string

FARTHEST = 5.0  # [m]: initial distance between finger and object, and amplitude of a reach: more than an arm
LARGEST = 0.1  # [m]: fingertip radius, squeeze and depth
SMALLEST_SIZE, LARGEST_SIZE = 1e-3, 2.0  # [m]: size of an object that fingers hold
TURN = 4.0 * np.pi  # [rad]: two whole turns of a wrist
HEAVIEST = 30.0  # [kg]: mass of an object, a device or a limb: more than a person lifts
ABSURD = 1e30  # a larger value is not due to a wrong unit [kg]
LIGHTEST_MATTER, HEAVIEST_MATTER = 20.0, 25e3  # [kg/m^3]: a light foam, osmium
SOFTEST = 1.0  # [N/m]: 1 N moves such a spring by a metre
SHORTEST, LONGEST = 1e-5, 0.05  # [s]: periods of 100 kHz and 20 Hz
MOST_MILLISECONDS = 20.0  # a larger period is more likely a rate in Hz
STRONGEST = 100.0  # [m/s^2]: ten times the earth's gravity


def unit_doubts(scene: SceneTable, stock: Stock) -> list[Finding]:
    """List the values of a scene or of a draft that are implausible in SI units, with their probable meanings.

    Args:
        scene: Tables of the scene; invalid fields are ignored.
        stock: Stock of the scene's shapes and of its fingers' start positions.
    """
    found: list[Finding] = []
    for rule in (_period, _gravity, _objects, _world, _gains, _fingers, _hands, _devices):
        with suppress(NotValid, GraspFXError, KeyError):  # invalid fields and unknown names are separate faults
            for at, value, unit, meaning in rule(scene, stock):
                text = f"{value:g} {unit}: check the unit"
                found.append((at, f"{text} ({meaning})" if meaning else text))
    return found


def unit_notes(scene: SceneTable, stock: Stock) -> list[str]:
    """Return the result of `unit_doubts` as texts, each with the key in the scene."""
    return [f"{dotted(at)} = {text}" for at, text in unit_doubts(scene, stock)]


def _in(value: float, unit: str, factor: float) -> str:
    """Return a text that converts `value`, as if it were given in `unit`, by `factor` to SI units."""
    return f"{value:g} {unit} would be {factor * value:.4g}"


def _period(scene: SceneTable, stock: Stock) -> Iterator[Doubt]:
    T = scene.period
    if T > LONGEST:
        meaning = _in(T, "ms", 1e-3) if T <= MOST_MILLISECONDS else f"{T:g} Hz would be {1.0 / T:.4g}"
        yield ("period",), T, "s", meaning
    elif T < SHORTEST:
        yield ("period",), T, "s", ""


def _gravity(scene: SceneTable, stock: Stock) -> Iterator[Doubt]:
    if scene.gravity is not None and math.hypot(*scene.gravity) > STRONGEST:
        g = math.hypot(*scene.gravity)
        yield ("gravity",), g, "m/s^2", _in(g, "mm/s^2", 1e-3)


def _objects(scene: SceneTable, stock: Stock) -> Iterator[Doubt]:
    for i, thing in enumerate(scene.object):
        at: Key = ("object", i)
        if thing.mass is not None and thing.mass > HEAVIEST:
            yield (*at, "mass"), thing.mass, "kg", _in(thing.mass, "g", 1e-3)
        if thing.density is not None and not LIGHTEST_MATTER <= thing.density <= HEAVIEST_MATTER:
            light = thing.density < LIGHTEST_MATTER
            meaning = _in(thing.density, "g/cm^3", 1e3) if light else ""
            yield (*at, "density"), thing.density, "kg/m^3", meaning
        if thing.shape is None or thing.shape.kind not in SIZES:
            continue
        size = SIZES[thing.shape.kind](stock, at, thing)
        if not SMALLEST_SIZE <= size <= LARGEST_SIZE:
            meaning = _in(size, "mm", 1e-3) if size > LARGEST_SIZE else ""
            if isinstance(thing.shape, MeshShape):
                meaning = "; ".join(each for each in (meaning, "scale = 0.001 for millimetres") if each)
            yield (*at, "shape"), size, "m across", meaning


SIZES: dict[str, Callable[[Stock, Key, Any], float]] = {  # largest side of a shape, by kind
    "box": lambda stock, at, thing: max(thing.shape.size),
    "sphere": lambda stock, at, thing: 2.0 * thing.shape.radius,
    "capsule": lambda stock, at, thing: thing.shape.length + 2.0 * thing.shape.radius,
    "cylinder": lambda stock, at, thing: max(thing.shape.length, 2.0 * thing.shape.radius),
    "ellipsoid": lambda stock, at, thing: 2.0 * max(thing.shape.semi_axes),
    "mesh": lambda stock, at, thing: _mesh_size(stock.solid(at, thing).mesh),
}


def _mesh_size(mesh: Any) -> float:
    """Return the largest extent of a mesh along the axes of the mesh's file [m]."""
    return float(np.ptp(mesh.mesh.vertices @ mesh.unit.axes.T, axis=0).max())


def _world(scene: SceneTable, stock: Stock) -> Iterator[Doubt]:
    yield from _soft(("world", "stiffness"), scene.world.stiffness)


def _gains(scene: SceneTable, stock: Stock) -> Iterator[Doubt]:
    for share in ("external", "internal"):
        gain = getattr(scene.coupling, share).stiffness
        if np.ndim(gain) < 2:  # a number, or one per finger
            yield from _soft(("coupling", share, "stiffness"), gain)
    depth = scene.coupling.damping_depth
    if depth > LARGEST:
        yield ("coupling", "damping_depth"), depth, "m", _in(depth, "mm", 1e-3)


def _soft(at: Key, stiffness: Any) -> Iterator[Doubt]:
    """Report the largest stiffness if it is too small to be felt; zero stiffnesses are not reported."""
    springs = [k for k in np.ravel(stiffness).tolist() if k > 0.0]
    if springs and max(springs) < SOFTEST:
        yield at, max(springs), "N/m", _in(max(springs), "N/mm", 1e3)


def _fingers(scene: SceneTable, stock: Stock) -> Iterator[Doubt]:
    for i, finger in enumerate(scene.finger):
        thing = scene.object[scene.finger_objects[i]]
        toward = getattr(finger.start, "toward", None)
        is_placed = toward is None or (any(toward) and len(toward) == scene.dimensions)  # otherwise a separate fault
        start = start_of(scene, i, stock) if is_placed else None
        if start is not None and len(start) == len(thing.position or start):  # another length is a separate fault
            away = float(np.linalg.norm(np.array(start) - np.array(thing.position or 0.0)))
            if away > FARTHEST:
                yield ("finger", i, "start from its object"), away, "m", _in(away, "mm", 1e-3)
        if finger.radius > LARGEST:
            yield ("finger", i, "radius"), finger.radius, "m", _in(finger.radius, "mm", 1e-3)
        if finger.pad is not None and finger.pad.stiffness * LARGEST**1.5 < 1.0:  # depth at 1 N above LARGEST
            k = finger.pad.stiffness
            yield ("finger", i, "pad", "stiffness"), k, "N/m^1.5", f"{k:g} N/mm^1.5 would be {k * 1e3**1.5:.4g}"


def _hands(scene: SceneTable, stock: Stock) -> Iterator[Doubt]:
    for holding in holdings(scene):
        table, at = holding.table, holding.at
        if table is None or isinstance(table, MadeHand | SharedMadeHand):
            continue
        for squeeze in [each.to if isinstance(each, Step) else each for each in listed(table.squeeze)]:
            if abs(squeeze) > LARGEST:
                yield (*at, "squeeze"), squeeze, "m", _in(squeeze, "mm", 1e-3)
        for reach in [each for each in listed(table.motion) if isinstance(each, Reach)]:
            if (far := float(np.linalg.norm(reach.displacement))) > FARTHEST:
                yield (*at, "motion", "displacement"), far, "m", _in(far, "mm", 1e-3)
        for turn in [each for each in listed(table.turn) if isinstance(each, TurnReach)]:
            if abs(turn.angle) > TURN:
                yield (*at, "turn", "angle"), turn.angle, "rad", _in(turn.angle, "degrees", np.pi / 180.0)
        if isinstance(table, OwnHand):
            yield from _soft((*at, "stiffness"), table.stiffness)
        if isinstance(table, SharedHand):
            yield from _soft((*at, "arm", "stiffness"), table.arm.stiffness)
            yield from _soft((*at, "grip", "stiffness"), table.grip.stiffness)
        if table.limb is not None and table.limb.mass > HEAVIEST:
            yield (*at, "limb", "mass"), table.limb.mass, "kg", _in(table.limb.mass, "g", 1e-3)


def _devices(scene: SceneTable, stock: Stock) -> Iterator[Doubt]:
    own = [(("finger", i, "device"), finger.device) for i, finger in enumerate(scene.finger)]
    for at, table in [*own, *((("device", k), each) for k, each in enumerate(scene.device))]:
        mass = None if isinstance(table, str) else table.settings.get("mass")
        if isinstance(mass, int | float) and HEAVIEST < mass < ABSURD:
            yield (*at, "mass"), float(mass), "kg", _in(mass, "g", 1e-3)
