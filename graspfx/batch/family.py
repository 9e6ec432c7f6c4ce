"""Families of programs that compile alike but for numbers, noted in the disk cache once one of them is compiled.

To look for a program in the cache its text has to be written, which takes some milliseconds; where none of its family
was ever compiled that is time for nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from graspfx.compile import cache
from graspfx.compile.array_cache import content_key


def family_key(kind: str, source: str, columns: Sequence[int], statistics: Collection[str]) -> str:
    """Name the family of the programs of a kind.

    Args:
        kind: what the programs are.
        source: the program of one variant.
        columns, statistics: that are measured.
    """
    return content_key((kind, list(columns), sorted(statistics)), source.encode())


def is_compiled(key: str) -> bool:
    """Tell whether a program of the family was compiled before."""
    return cache.load(key) is not None


def note_compiled(key: str) -> None:
    """Note that a program of the family is in the cache."""
    cache.store(key, b"compiled")
