"""The loop of a scene with hardware in its plan: where it runs, and who takes the force away when it dies."""

from __future__ import annotations

from collections.abc import Iterator

from graspfx.build.process.boot import is_possible
from graspfx.build.process.quenching import quenchers
from graspfx.build.resolve import Parts
from graspfx.errors import InputError

Row = tuple[str, bool, str]


def loop_rows(parts: Parts) -> Iterator[Row]:
    """List where the servo runs, and of each device what becomes of its force if the servo's process dies."""
    if parts.simulated:
        return
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
