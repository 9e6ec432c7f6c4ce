"""Groups of variants that share a program: what their buffers hold, as what is the same in all and what is not."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.batch.columns import Column
from graspfx.loop.arena import Arena

if TYPE_CHECKING:
    from graspfx.loop.servo import Servo

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True)
class Program:
    """The program of variants that share it: a servo that was built for one of them, and its arena."""

    servo: Servo
    arena: Arena

    @cached_property
    def size(self) -> int:
        """Entries of the arena."""
        return self.arena.memory.used

    @cached_property
    def structure(self) -> frozenset[int]:
        """Entries of the arena that the program has folded in."""
        return frozenset(self.arena.structure())

    def fill(self, arena: FloatArray) -> None:
        """Fill a variant's arena into that of the servo."""
        self.arena.memory.floats[: self.size] = arena

    def check_activity(self, arena: FloatArray) -> None:
        """Warn like `gx.run` where matrices for gains, as a variant's arena holds them, can create energy."""
        self.fill(arena)
        for part in self.servo.objects:
            part.grasped.check_activity()


@dataclass(frozen=True)
class Built:
    """A variant that was built.

    Attributes:
        arena: its memory at the beginning.
        structure: a digest of what programs are made from; of two variants in which it is the same the program is.
    """

    arena: FloatArray
    structure: str


@dataclass
class Group:
    """Variants with the same programs.

    Attributes:
        program: that they share.
        base: what the buffers of one of them hold, (arena,).
        members: their numbers, (V,).
        factors: what differs: entries of the arena with a row of values for each choice, and the choice of each member.
    """

    program: Program
    base: FloatArray
    members: Index
    factors: list[tuple[Index, FloatArray, Index]] = field(default_factory=list)

    @cached_property
    def varying(self) -> Index:
        """Entries of the arena that are not the same in all members."""
        return np.unique(np.concatenate([np.empty(0, dtype=np.intp), *(entries for entries, _, _ in self.factors)]))

    def arenas(self, members: Any) -> FloatArray:
        """Give the buffers of some members, (v, arena)."""
        count = len(self.members[members])
        copies = np.repeat(self.base[None], count, axis=0)
        for entries, rows, choice in self.factors:
            copies[:, entries] = rows[choice[members]]
        return copies

    def add(self, columns: Iterable[Column]) -> None:
        """Add numbers of entries of the program's buffers, one for each member: those that are not the same in all."""
        numbers: dict[int, FloatArray] = {}
        for block, entry, values in columns:
            place = self.program.arena.place(block) + entry
            if (values.view(np.int64) != self.base[place : place + 1].view(np.int64)).any():
                numbers[place] = values
        entries = sorted(numbers)
        rows = np.stack([numbers[entry] for entry in entries], axis=1) if entries else np.empty((len(self.members), 0))
        self.factors.append((np.array(entries, dtype=np.intp), rows, np.arange(len(self.members))))

    def folds(self) -> bool:
        """Tell whether the program holds a number of an entry that is not the same in all members."""
        return not self.program.structure.isdisjoint(self.varying.tolist())
