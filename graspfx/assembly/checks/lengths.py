"""Vectors of a scene have as many components as the scene has dimensions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from graspfx.errors import abbreviate
from graspfx.scene.tables.scene_table import SceneTable

Location = tuple[str | int, ...]
Finding = tuple[Location, str]


def length_faults(scene: SceneTable, at: Location, part: Any, field: str) -> Iterator[Finding]:
    """Find the fault of a part's vector that has another number of components than d."""
    value = getattr(part, field)
    if value is not None and len(value) != scene.dimensions:
        yield (*at, field), f"expected {numbers(scene.dimensions)}; given {abbreviate(list(value))}"


def numbers(count: int) -> str:
    return "1 number (dimensions = 1)" if count == 1 else f"{count} numbers (dimensions = {count})"
