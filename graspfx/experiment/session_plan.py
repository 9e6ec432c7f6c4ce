"""The plan of a participant's session: which trial comes when, decided before the first of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from graspfx.experiment.cell import Cell, cells
from graspfx.experiment.experiment_table import ExperimentTable
from graspfx.experiment.staircase_of_condition import Stair
from graspfx.experiment.trial import Row, Trial
from graspfx.experiment.trial_order import random_of, trial_order


@dataclass(frozen=True)
class Slot:
    """A place in the order: which cell, which repetition, and in which of two intervals there is more."""

    cell: Cell
    repetition: int
    place: int
    is_practice: bool = False


@dataclass
class SessionPlan:
    """The order of a session, and its staircases as far as it has come.

    Attributes:
        slots: in their order.
        stairs: by condition.
        easy: increment of practice; None for the largest.
    """

    slots: Sequence[Slot]
    stairs: Mapping[str, Stair]
    easy: float | None = None
    done: int = field(default=0, init=False)

    def trial(self) -> Trial | None:
        """Make the next trial; None after the last."""
        if self.done >= len(self.slots):
            return None
        slot = self.slots[self.done]
        increment = math.nan
        if slot.cell.is_adaptive:
            stair = self.stairs[slot.cell.condition]
            increment = stair.easiest(self.easy) if slot.is_practice else stair.increment()
        return slot.cell.trial(self.done + 1, slot.repetition, slot.place, increment, is_practice=slot.is_practice)

    def take(self, row: Row) -> None:
        """Go on after a trial with its row; a response moves the staircase of its condition."""
        slot = self.slots[self.done]
        self.done += 1
        if slot.cell.is_adaptive and not slot.is_practice and row.is_correct is not None:
            self.stairs[slot.cell.condition].update(row.trial.increment, is_correct=row.is_correct)


def session_plan(table: ExperimentTable, participant: str, session: str) -> SessionPlan:
    """Plan a session: the same for the same file, participant and session.

    Raises:
        InputError: a Latin square for a participant who is no number.
        MissingPackageError: a staircase without questplus.
    """
    design = cells(table)
    rng = random_of(table.seed, table.name, participant, session)
    order = trial_order(table.order, len(design), table.repetitions, rng, participant)
    places = rng.integers(0, 2, len(order)).tolist()
    slots = [Slot(design[cell], k + 1, place) for (cell, k), place in zip(order, places, strict=True)]
    count = table.practice.trials if table.practice is not None else 0
    picks, sides = rng.integers(0, len(design), count).tolist(), rng.integers(0, 2, count).tolist()
    practice = [Slot(design[cell], k + 1, side, True) for k, (cell, side) in enumerate(zip(picks, sides, strict=True))]
    adaptive = dict.fromkeys(cell.condition for cell in design if cell.is_adaptive)
    stairs = {name: Stair(table.staircase) for name in adaptive} if table.staircase is not None else {}
    easy = table.practice.increment if table.practice is not None else None
    return SessionPlan([*practice, *slots], stairs, easy)
