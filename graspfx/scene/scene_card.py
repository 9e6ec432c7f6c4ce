"""Card of a scene: objects, coupling, fingers and hands, with units."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from graspfx.card import Card, counted, listed, span
from graspfx.scene.source import Source
from graspfx.scene.tables.scene_table import SceneTable

MOST = 4  # largest number of objects, or hands, that have a line each


def scene_card(scene: SceneTable, source: Source) -> Card:
    """Return the card of a scene."""
    name = source.path.stem.replace("_", "-") if source.path is not None else source.name
    title = f"Scene {name}: {scene.title}" if scene.title else f"Scene {name}"
    calls = "gx.run(scene), gx.check(scene), gx.certify(scene), gx.open(scene), .replace({key: value}), .to_dict()"
    return Card(title, [*_rows(scene, source)], calls)


def _rows(scene: SceneTable, source: Source) -> Iterator[tuple[str, str]]:
    ticks = round(scene.duration / scene.period)
    yield "time", f"{scene.duration:g} s in {counted(ticks, 'tick')} of {1e3 * scene.period:g} ms"
    yield "space", f"{counted(scene.dimensions, 'dimension')}{_gravity(scene)}"
    yield "objects" if len(scene.object) > 1 else "object", "\n".join(_some(map(_object, scene.object)))
    yield "obstacles", listed(f"{each.name} ({each.shape.kind})" for each in scene.obstacle)
    yield "coupling", "\n".join(_coupling(scene))
    yield "fingers", "\n".join(_fingers(scene))
    yield "hands", "\n".join(_some(f"{each.name}: {_hand(each)}" for each in scene.hand))
    yield "presets", listed(f"{name}{' (in force)' if name == source.preset else ''}" for name in scene.preset)
    yield "set", listed(f"{key} = {value!r}" for key, value in source.overrides.items())
    yield "file", str(source.path or "")


def _some(lines: Iterator[str]) -> Iterator[str]:
    for k, line in enumerate(lines):
        if k < MOST:
            yield line
        elif k == MOST:
            yield "..."


def _gravity(scene: SceneTable) -> str:
    if scene.gravity is None:
        return ", no gravity"
    return f", gravity ({', '.join(f'{each:g}' for each in scene.gravity)}) m/s^2"


def _object(thing: Any) -> str:
    weight = f"{thing.mass:g} kg" if thing.mass is not None else f"{thing.density:g} kg/m^3"
    shape = f", {_shape(thing.shape)}" if thing.shape is not None else ""
    mover = f"native, {thing.integrator}" if thing.dynamics == "native" else thing.dynamics
    locked = "" if thing.free is None or all(thing.free) else f", locked: {_locked(thing.free)}"
    return f"{thing.name}: {weight}{shape}, viscosity {thing.viscosity:g} N s/m, {mover}{locked}"


def _locked(free: tuple[bool, ...]) -> str:
    names = {1: ("x",), 3: ("x", "y", "turn"), 6: ("x", "y", "z", "turn x", "turn y", "turn z")}[len(free)]
    return ", ".join(name for name, moves in zip(names, free, strict=True) if not moves)


def _shape(shape: Any) -> str:
    sizes = getattr(shape, "size", None)
    if sizes is not None:
        return f"{shape.kind} {' x '.join(f'{1e3 * each:g}' for each in sizes)} mm"
    radius = getattr(shape, "radius", None)
    if isinstance(radius, float):
        return f"{shape.kind} of radius {1e3 * radius:g} mm"
    file = getattr(shape, "mesh", None)
    return f"mesh {file}" if isinstance(file, str) else str(shape.kind)


def _coupling(scene: SceneTable) -> Iterator[str]:
    law = scene.coupling
    for name, part in (("external", law.external), ("internal", law.internal)):
        yield f"{name} {_gain(part.stiffness, 'N/m')}, {_gain(part.damping, 'N s/m')}"
    friction = "contacts stick" if law.friction == "stick" else f"friction {law.friction:g}"
    touch = "attached contacts" if law.contact == "attached" else f"fingers only push, {friction}"
    passivity = "" if law.passivity == "off" else f", passivity {law.passivity}"
    yield f"{touch}{passivity}"


def _gain(gain: Any, unit: str) -> str:
    return f"{gain:g} {unit}" if isinstance(gain, int | float) else f"matrix [{unit}]"


def _fingers(scene: SceneTable) -> Iterator[str]:
    fingers = scene.finger
    drivers: dict[str, int] = {}
    labels = {each.label: each.name for each in scene.device}
    for finger in fingers:
        name = finger.device if isinstance(finger.device, str) else finger.device.name
        driver = labels.get(name, name)
        drivers[driver] = drivers.get(driver, 0) + 1
    yield f"{len(fingers)}: {listed(scene.finger_names)}"
    devices = listed(f"{count} x {driver}" for driver, count in drivers.items())
    balls = [finger.radius for finger in fingers if finger.radius]
    tips = f"balls of {span((1e3 * each for each in balls), 'mm')}" if balls else "points"
    yield f"devices {devices}; fingertips are {tips}"
    own = [finger.hand for finger in fingers if finger.hand is not None and not isinstance(finger.hand, str)]
    if own:
        yield f"{counted(len(own), 'hand')} of their own: {_hand(own[0])}"


def _hand(hand: Any) -> str:
    parts = []
    for key in ("arm", "grip"):
        part = getattr(hand, key, None)
        if part is not None:
            parts.append(f"{key} {_gain(part.stiffness, 'N/m')}")
    stiffness = getattr(hand, "stiffness", None)
    if stiffness is not None:
        parts.append(_gain(stiffness, "N/m"))
    for key in ("motion", "turn"):
        course = getattr(hand, key, None)
        courses = course if isinstance(course, tuple) else () if course is None else (course,)
        if courses:
            parts.append(f"{key} {' + '.join(str(each.kind) for each in courses)}")
    squeeze = getattr(hand, "squeeze", None)
    if isinstance(squeeze, int | float) and squeeze:
        parts.append(f"squeeze {1e3 * squeeze:g} mm")
    elif isinstance(squeeze, tuple) and squeeze:
        parts.append(f"squeeze in {counted(len(squeeze), 'step')}")
    return ", ".join(parts) or "held"
