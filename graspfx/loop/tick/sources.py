"""Where each number of a recorded row comes from: which entry of which memory of a tick."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.records import start_of
from graspfx.loop.energy.observer import BY_MODE, OF_OBJECT
from graspfx.loop.parts import Parts
from graspfx.loop.realtime.loop_state import LoopState
from graspfx.loop.recording.layout import Layout

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]

COMPUTED = ("finger_position", "finger_velocity", "contact_position", "finger_force", "finger_moment",
            "contact_normal", "torsion_displacement", "torsion_axis", "law_force", "touching", "saturated", "status",
            "gap")  # fmt: skip
OBJECT = ("position", "centre", "velocity", "orientation", "angular_velocity", "law", "residual", "wrench")


def sources(
    parts: Parts, servo: FloatArray, own: Mapping[str, tuple[int, int]]
) -> Iterator[tuple[int, FloatArray, int]]:
    """List the numbers of a row, each with the memory and the entry that it shows.

    Args:
        parts: of the scene.
        servo: its memory.
        own: columns that are the servo's, each with its first entry and their count.
    """
    columns, numbers = parts.layout.columns, np.arange(parts.layout.width)

    def pairs(column: str, source: FloatArray, entries: Index) -> Iterator[tuple[int, FloatArray, int]]:
        if column in columns:
            places = numbers[columns[column].where]
            yield from ((int(p), source, int(e)) for p, e in zip(places, entries.ravel(), strict=True))

    for part in parts.objects:
        block, where = part.grasped.block, part.grasped.where
        for quantity in COMPUTED:
            if quantity in columns:
                places = numbers[columns[quantity].where].reshape(columns[quantity].shape)[part.fingers]
                for p, e in zip(places.ravel(), where[quantity].ravel(), strict=True):
                    yield int(p), block, int(e)
        for quantity in OBJECT:
            yield from pairs(f"objects/{part.name}/{quantity}", block, where[quantity])
    for part, observer in zip(parts.objects, parts.observers, strict=False):
        for quantity in (*BY_MODE, *OF_OBJECT):
            yield from pairs(f"objects/{part.name}/energy/{quantity}", observer.buffer, observer.where[quantity])
    if parts.safety is not None:
        for part, buffer in zip(parts.objects, parts.safety.buffers, strict=True):
            yield from pairs(f"objects/{part.name}/scale", buffer, parts.safety.where["scale"])
            yield from pairs(f"objects/{part.name}/tank", buffer, parts.safety.where["tank"])
    for column, (first, count) in own.items():
        yield from pairs(column, servo, np.arange(first, first + count))


def loop_columns(layout: Layout, memory: FloatArray) -> Iterator[tuple[str, int]]:
    """List the columns that a loop on the wall's clock tells, each with its first entry of the loop's memory."""
    loop = LoopState(memory)
    for name in ("wall", "late", "skipped"):
        yield name, start_of(LoopState, name)
    yield "io", start_of(LoopState, "io_read")
    for name, numbers in (("fresh", loop.fresh), ("largest_force", loop.largest), ("switches", loop.switches)):
        yield name, numbers.offset
    first = loop.raw.offset
    for device, count, _ in layout.raw:
        yield f"raw/{device}", first
        first += count
