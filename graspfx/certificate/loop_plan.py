"""Row of a plan: the loop that a scene with hardware runs in."""

from __future__ import annotations

from collections.abc import Iterator

from graspfx.build.build import build
from graspfx.build.resolve import Parts
from graspfx.loop.parts import DeviceWiring
from graspfx.loop.realtime.native_choice import loop_text, why_python


def loop_rows(parts: Parts) -> Iterator[tuple[str, bool, str]]:
    """List the loop of a scene with hardware; none of a simulated one."""
    if not parts.hardware:
        return
    scene = parts.scene
    stations = [DeviceWiring(wire.device, wire.fingers, wire.fitting) for wire in parts.wires]
    why = why_python(stations, scene.finger_names, scene.engine, scene.period, None)
    if not why:
        with build(scene, real_time=True) as servo:
            why = servo.why_python
    yield "loop", True, loop_text(why, stations)
