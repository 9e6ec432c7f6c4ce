"""Faults of the tables `safety`: a finger's limits without a chain, boxes of another space, a watchdog below T."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from graspfx.assembly.checks.lengths import numbers
from graspfx.errors import abbreviate
from graspfx.loop.device import Device, is_hardware
from graspfx.scene.tables.scene_table import SceneTable

Location = tuple[str | int, ...]
Finding = tuple[Location, str]


def safety_faults(scene: SceneTable) -> Iterator[Finding]:
    """Find the faults of a scene's safety table."""
    table = scene.safety
    if table is not None:
        yield from _box_faults(scene, ("safety",), table)
        if table.watchdog is not None and table.watchdog < scene.period:
            text = f"expected no less than the period, {scene.period:g} s; given {table.watchdog:g}"
            yield ("safety", "watchdog"), text


def finger_safety_faults(scene: SceneTable, i: int, finger: Any) -> Iterator[Finding]:
    """Find the faults of a finger's own limits."""
    if finger.safety is not None:
        yield from _box_faults(scene, ("finger", i, "safety"), finger.safety)


def chain_faults(scene: SceneTable, connected: Mapping[Location, Device]) -> Iterator[Finding]:
    """Find limits of fingers in a simulation without a chain, and hardware whose first force would not be zero."""
    hardware = any(map(is_hardware, connected.values()))
    if scene.safety is None:
        for i, finger in enumerate(scene.finger):
            if finger.safety is not None and not hardware:
                text = "expected a scene with [safety], which switches the chain on; add that table"
                yield ("finger", i, "safety"), text
    elif hardware and scene.safety.soft_start == 0.0:
        yield ("safety", "soft_start"), "expected a time above zero, as a person holds the hardware; given 0"


def _box_faults(scene: SceneTable, at: Location, table: Any) -> Iterator[Finding]:
    box = table.workspace
    if isinstance(box, tuple) and len(box[0]) != scene.dimensions:
        expected = numbers(scene.dimensions)
        yield (*at, "workspace"), f"expected two corners of {expected} each; given {abbreviate([list(x) for x in box])}"
