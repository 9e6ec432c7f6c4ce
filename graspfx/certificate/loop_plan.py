"""The loop of a scene with hardware in its plan: of what, where it runs, and who takes the force away when it dies."""

from __future__ import annotations

from collections.abc import Iterator

from graspfx.build.build import build
from graspfx.build.process.quenching import quenchers
from graspfx.build.resolve import Parts
from graspfx.errors import InputError
from graspfx.loop.parts import DeviceWiring
from graspfx.loop.realtime.lifecycle import loop_text, why_python
from graspfx.system.child_process import is_possible

Row = tuple[str, bool, str]


def loop_rows(parts: Parts) -> Iterator[Row]:
    """List what runs between ticks, where the servo runs, and what becomes of each force if its process dies."""
    if not parts.hardware:
        return
    yield "loop", True, _loop(parts)
    if is_possible():
        yield "process", True, "the servo has a process of its own with --real-time; who records stands guard over it"
    else:
        yield "process", False, "this system has none with shared memory: the servo runs where the recording is written"
    try:
        devices = quenchers(parts)
    except InputError as error:
        yield "guard", False, f"refused with --real-time: {error}"
        return
    for each in devices:
        own = "" if each.watchdog is None else f"its watchdog drops the force within {each.watchdog:g} s"
        ours = "" if each.quench is None else "its driver's quench takes the force away"
        yield "guard", True, f"{each.name}: if the process dies {' and '.join(text for text in (ours, own) if text)}"


def _loop(parts: Parts) -> str:
    """Say which loop it is, and why."""
    scene = parts.scene
    stations = [DeviceWiring(wire.device, wire.fingers, wire.fitting) for wire in parts.wires]
    why = why_python(stations, scene.finger_names, scene.engine, scene.period, None)
    if not why:
        with build(scene, real_time=True) as servo:
            why = servo.why_python
    return loop_text(why, stations)
