"""Where each number of a recorded row comes from: which entry of which memory of a tick."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.energy.observer import BY_MODE, OF_OBJECT
from graspfx.loop.parts import Parts

Index = NDArray[np.intp]

COMPUTED = ("finger_position", "finger_velocity", "contact_position", "finger_force", "finger_moment",
            "law_force", "touching", "saturated", "status", "gap")  # fmt: skip
OBJECT = ("position", "velocity", "orientation", "angular_velocity", "law", "residual", "wrench")


def sources(
    parts: Parts, blocks: Sequence[str], books: Sequence[str], servo: str, own: Mapping[str, tuple[int, int]]
) -> Iterator[tuple[int, tuple[str, int]]]:
    """Numbers of a row, each with the name of a memory and an entry of it.

    Args:
        parts: what runs.
        blocks: the names of the objects' memories.
        books: those of the observers.
        servo: that of the servo.
        own: columns that are the servo's, each with its first entry and their count.
    """
    columns, numbers = parts.layout.columns, np.arange(parts.layout.width)

    def pairs(column: str, source: str, entries: Index) -> Iterator[tuple[int, tuple[str, int]]]:
        if column in columns:
            places = numbers[columns[column].where]
            yield from ((int(p), (source, int(e))) for p, e in zip(places, entries.ravel(), strict=True))

    for held, block in zip(parts.objects, blocks, strict=True):
        where = held.grasped.where
        for quantity in COMPUTED:
            if quantity in columns:
                places = numbers[columns[quantity].where].reshape(columns[quantity].shape)[held.fingers]
                for p, e in zip(places.ravel(), where[quantity].ravel(), strict=True):
                    yield int(p), (block, int(e))
        for quantity in OBJECT:
            yield from pairs(f"objects/{held.name}/{quantity}", block, where[quantity])
    for held, observer, book in zip(parts.objects, parts.observers, books, strict=False):
        for quantity in (*BY_MODE, *OF_OBJECT):
            yield from pairs(f"objects/{held.name}/energy/{quantity}", book, observer.where[quantity])
    for column, (first, count) in own.items():
        yield from pairs(column, servo, np.arange(first, first + count))
