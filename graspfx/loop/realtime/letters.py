"""Letters to a running servo: new numbers for its memories, each letter taken whole between two ticks.

There are two places for letters, taken in turn; a letter is published by its number once all of it stands there, and
the next is written when the servo has taken it. The servo never waits, and finds no half of a letter.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]
HEAD = 2  # numbers of eight bytes before the parts: how many parts, and how many objects


class Letter(NamedTuple):
    """New numbers of memories.

    Attributes:
        entries: of each memory, by its number: places, and what is written there.
        objects: numbers of the objects that take over what follows from them.
    """

    entries: Sequence[tuple[int, Index, FloatArray]]
    objects: Sequence[int]


def write(letter: Letter, place: memoryview) -> None:
    """Write a letter to its place.

    Raises:
        InputError: it is longer than there is room.
    """
    head: list[int] = [len(letter.entries), len(letter.objects), *letter.objects]
    for memory, places, _ in letter.entries:
        head += [memory, len(places)]
    parts = [np.array(head, np.int64).tobytes()]
    parts += [np.asarray(places, np.int64).tobytes() for _, places, _ in letter.entries]
    parts += [np.asarray(numbers, np.float64).tobytes() for _, _, numbers in letter.entries]
    text = b"".join(parts)
    if len(text) > len(place):
        raise InputError("values", len(text), f"new numbers of {len(place)} bytes at most", "change fewer keys at once")
    place[: len(text)] = text


def read(place: memoryview) -> Letter:
    """Read a letter, a copy."""
    whole = np.frombuffer(place, np.int64)
    parts, objects = int(whole[0]), int(whole[1])
    heads = whole[HEAD + objects : HEAD + objects + 2 * parts].reshape(parts, 2).tolist()
    at = HEAD + objects + 2 * parts
    places = []
    for _, count in heads:
        places.append(whole[at : at + count].astype(np.intp))
        at += count
    numbers, floats = [], whole.view(np.float64)
    for _, count in heads:
        numbers.append(floats[at : at + count].copy())
        at += count
    entries = [(memory, p, n) for (memory, _), p, n in zip(heads, places, numbers, strict=True)]
    return Letter(entries, whole[HEAD : HEAD + objects].tolist())
