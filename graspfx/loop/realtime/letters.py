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
HEAD = 3  # numbers of eight bytes before the parts: how many parts, objects and plants


class Letter(NamedTuple):
    """New numbers of memories.

    Attributes:
        entries: of each memory, by its number: places, and what is written there.
        objects: numbers of the objects that take over what follows from them.
        plants: numbers of the plants that take hold of their hands anew.
    """

    entries: Sequence[tuple[int, Index, FloatArray]]
    objects: Sequence[int]
    plants: Sequence[int] = ()


def write(letter: Letter, place: memoryview) -> None:
    """Write a letter to its place.

    Raises:
        InputError: it is longer than there is room.
    """
    head: list[int] = [len(letter.entries), len(letter.objects), len(letter.plants), *letter.objects, *letter.plants]
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
    parts, objects, plants = whole[:HEAD].tolist()
    first = HEAD + objects
    at = first + plants + 2 * parts
    heads = whole[first + plants : at].reshape(parts, 2).tolist()
    places = []
    for _, count in heads:
        places.append(whole[at : at + count].astype(np.intp))
        at += count
    numbers, floats = [], whole.view(np.float64)
    for _, count in heads:
        numbers.append(floats[at : at + count].copy())
        at += count
    entries = [(memory, p, n) for (memory, _), p, n in zip(heads, places, numbers, strict=True)]
    return Letter(entries, whole[HEAD:first].tolist(), whole[first : first + plants].tolist())
