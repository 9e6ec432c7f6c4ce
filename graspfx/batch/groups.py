"""Groups of variants that share a program: common and varying contents of their buffers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.batch.varied_entries import Column
from graspfx.loop.arena import Arena

if TYPE_CHECKING:
    from graspfx.loop.servo import Servo

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True)
class Program:
    """Shared program of variants: a servo that was built for one variant, and its arena."""

    servo: Servo
    arena: Arena

    @cached_property
    def size(self) -> int:
        """Number of entries of the arena."""
        return self.arena.memory.used

    def fill(self, arena: FloatArray) -> None:
        """Copy a variant's arena into that of the servo."""
        self.arena.memory.floats[: self.size] = arena

    def check_activity(self, arena: FloatArray) -> None:
        """Warn, as `gx.run` does, if matrix gains in a variant's arena can generate energy."""
        self.fill(arena)
        for part in self.servo.objects:
            part.grasped.check_activity()


@dataclass(frozen=True)
class Built:
    """A built variant.

    Attributes:
        arena: Initial memory of the variant.
        layout: Digest of the arena's layout; variants with equal digests run in one servo.
    """

    arena: FloatArray
    layout: str


@dataclass
class Group:
    """Variants with the same program.

    Attributes:
        program: Shared program.
        base: Buffer contents of one variant, (arena,).
        members: Indices of the variants, (V,).
        factors: Differences: entries of the arena, a row of values for each choice, and the choice of each member.
    """

    program: Program
    base: FloatArray
    members: Index
    factors: list[tuple[Index, FloatArray, Index]] = field(default_factory=list)

    @cached_property
    def varying(self) -> Index:
        """Entries of the arena that differ between members."""
        return np.unique(np.concatenate([np.empty(0, dtype=np.intp), *(entries for entries, _, _ in self.factors)]))

    def arenas(self, members: Any) -> FloatArray:
        """Return the buffers of some members, (v, arena)."""
        count = len(self.members[members])
        copies = np.repeat(self.base[None], count, axis=0)
        for entries, rows, choice in self.factors:
            copies[:, entries] = rows[choice[members]]
        return copies

    def add(self, columns: Iterable[Column]) -> None:
        """Add a factor with the members' values of the buffer entries that differ from the base."""
        numbers: dict[int, FloatArray] = {}
        for block, entry, values in columns:
            place = self.program.arena.place(block) + entry
            if (values.view(np.int64) != self.base[place : place + 1].view(np.int64)).any():
                numbers[place] = values
        entries = sorted(numbers)
        rows = np.stack([numbers[entry] for entry in entries], axis=1) if entries else np.empty((len(self.members), 0))
        self.factors.append((np.array(entries, dtype=np.intp), rows, np.arange(len(self.members))))
