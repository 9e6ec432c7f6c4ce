"""Variants of one program that are to be run: what they begin with, and what is asked for of each."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from threading import Lock
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from graspfx.batch.part_memory import PartMemory
from graspfx.loop.arena import Arena

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]
More = Callable[[FloatArray], FloatArray]


class Beginnings(Protocol):
    """The buffers of variants at the beginning."""

    def arenas(self, members: Any) -> FloatArray:
        """Give all of it, (v, arena)."""
        ...

    def fill_lanes(self, arena: FloatArray, members: Index) -> None:
        """Fill what varies into lanes side by side, (entries, lanes)."""


@dataclass
class Task:
    """Variants of one program.

    Args:
        arena: of one of them.
        size: entries of an arena.
        begin: what the arenas hold at the beginning.
        variants: how many.
        width: of a row.
        columns: numbers of a row of which measures are kept.
        statistics: that are asked for.
        ticks: N.
        varying: entries of the arena that are not the same in all variants.
        constant: the first and the end of entries that no run writes: those of a mesh.
        look: at the arena of every variant when its run is over.
        more: makes for variants' arenas (v, arena) what computes further numbers of their rows (r, width, v), whose
            places are behind those of a row.
        share: of all variants that there will be, also in other processes: what is worth being compiled is so for all.
        memory: of other tasks, for texts of the same programs.
    """

    arena: Arena
    size: int
    begin: Beginnings
    variants: int
    width: int
    columns: Sequence[int]
    statistics: Collection[str]
    ticks: int
    varying: Index
    constant: tuple[int, int] = (0, 0)
    look: Callable[[FloatArray], None] | None = None
    more: Callable[[FloatArray], More] | None = None
    looking: Lock = field(default_factory=Lock)
    share: float = 1.0
    memory: PartMemory = field(default_factory=PartMemory)
    spent: float = 0.0  # on runs [s]
    done: int = 0  # variants that have run

    def count(self, members: Index) -> None:
        """Count variants that have run."""
        with self.looking:
            self.done += len(members)

    @property
    def work(self) -> float:
        """Ticks of all variants, also of those in other jobs."""
        return self.variants * self.ticks / self.share
