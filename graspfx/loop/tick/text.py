"""The text of a tick: its code, unfolded over a scene's parts."""

from __future__ import annotations

from graspfx.compile.unfold.rewrite import keep_stages
from graspfx.compile.unfold.unfold import unfold
from graspfx.compile.unfold.writer import Line
from graspfx.loop.parts import Parts
from graspfx.loop.tick.script import Script, Tick
from graspfx.loop.tick.tick import begin, end
from graspfx.loop.tick.wire_parts import Wirer


def write(parts: Parts, *, record: bool = True) -> Tick:
    """Write the tick of these parts.

    Args:
        record: whether a row is written, to the array `rows` at row r.
    """
    tick = Tick(Script())
    for lines, half in zip((tick.begin, tick.end), lines_of(parts, tick, record=record), strict=True):
        lines += [line.text for line in half]
    return tick


def lines_of(parts: Parts, tick: Tick, *, record: bool = True) -> tuple[list[Line], list[Line]]:
    """Write both halves of a tick, each line with its line of code; its memories go to the script."""
    wiring = Wirer(parts, tick).wire(record=record)
    halves = unfold(begin, tick.script, scene=wiring), unfold(end, tick.script, scene=wiring)
    keep_stages()
    return halves
