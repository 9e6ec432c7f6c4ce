"""Plan of a session: cells of the design, order of trials, staircases."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError
from graspfx.experiment.experiment_table import Comparison, Condition, ExperimentTable, Factor
from graspfx.experiment.staircase import Stair
from graspfx.experiment.trial import FIRST, SECOND, Row, Trial

IntArray = NDArray[np.int64]


def random_of(seed: int, *words: str) -> np.random.Generator:
    """Return a random generator that depends only on the seed and the words, not on the machine."""
    text = "\n".join([str(seed), *words]).encode()
    return np.random.Generator(np.random.PCG64(int.from_bytes(sha256(text).digest(), "big")))


def williams_square(count: int) -> IntArray:
    """Return Williams' design (rows, count): one Latin square, or two Latin squares if `count` is odd.

    Each condition occurs once in every row, equally often in every position, and equally often after every other
    condition (E. J. Williams, Aust. J. Sci. Res. A 2, 149 (1949)). The first row is 0, 1, n-1, 2, n-2, ..., and each
    other row adds 1 modulo n to the previous row. If n is odd and above 1, the mirror image of the square follows.

    Args:
        count: Number of conditions, n.

    Raises:
        InputError: If the count is not a positive integer.
    """
    if type(count) is not int or count < 1:
        raise InputError("count", count, "a number of conditions, an integer of at least 1")
    first = [0]
    for k in range(1, count):
        first.append((k + 1) // 2 if k % 2 else count - k // 2)
    square = (np.array(first)[None] + np.arange(count)[:, None]) % count
    return np.concatenate([square, square[:, ::-1]]) if count % 2 and count > 1 else square


def trial_order(
    order: str, count: int, repetitions: int, rng: np.random.Generator, participant: str
) -> Sequence[tuple[int, int]]:
    """Return the order of trials, as pairs of a condition and its repetition, both counted from zero.

    Args:
        order: "fixed" repeats the conditions in the order of the file; "random" shuffles all trials; "blocks" shuffles
            the conditions and keeps the repetitions of each together; "latin-square" also keeps the repetitions
            together, with the conditions in the order of the participant's row of Williams' design.
        count: Number of conditions.
        repetitions: Number of repetitions of each condition.
        rng: Random generator of the session.
        participant: Label of the participant. For "latin-square", the label is a number that selects a row cyclically;
            1 selects the first row.

    Raises:
        InputError: If the order is "latin-square" and the participant is not a whole number of at least 1.
    """
    if order == "fixed":
        return [(condition, k) for k in range(repetitions) for condition in range(count)]
    if order == "random":
        drawn = rng.permutation(np.repeat(np.arange(count), repetitions)).tolist()
        return [(condition, drawn[:at].count(condition)) for at, condition in enumerate(drawn)]
    if order == "blocks":
        row = rng.permutation(count).tolist()
    else:
        if not participant.isdecimal() or int(participant) < 1:
            do = "the number selects a row of the Latin square"
            raise InputError("--participant", participant, "a whole number of at least 1", do)
        square = williams_square(count)
        row = square[(int(participant) - 1) % len(square)].tolist()
    return [(condition, k) for condition in row for k in range(repetitions)]


ALL = "all"  # name of the condition if an experiment has factors only


@dataclass(frozen=True)
class Cell:
    """One combination of a condition, a level of each factor and, in a comparison with given increments, an increment.

    Attributes:
        condition: Name of the condition.
        levels: Level of each factor, by the factor's name.
        values: Values of the scene, by dotted key.
        answer: Correct answer; empty if there is none, or if two intervals are compared.
        compare: Comparison of two intervals; None for one interval.
        increment: Relative increment of the comparison; NaN without a comparison, or if a staircase chooses it.
    """

    condition: str
    levels: Mapping[str, Any]
    values: Mapping[str, Any]
    answer: str = ""
    compare: Comparison | None = None
    increment: float = math.nan

    @property
    def is_adaptive(self) -> bool:
        """Whether a staircase chooses the increment."""
        return self.compare is not None and math.isnan(self.increment)

    def trial(self, number: int, repetition: int, place: int, increment: float, *, is_practice: bool = False) -> Trial:
        """Make a trial of this combination.

        Args:
            number: Number in the session, from 1.
            repetition: Repetition of the combination, from 1.
            place: Interval with the larger value, 0 or 1; ignored without a comparison.
            increment: Relative increment of the larger value; ignored unless a staircase chooses the increment.
            is_practice: Whether the trial is practice, which is not evaluated.
        """
        if self.compare is None:
            return Trial(
                number, self.condition, repetition, self.levels, [self.values], self.answer, is_practice=is_practice
            )
        size = increment if math.isnan(self.increment) else self.increment
        key, reference = self.compare.key, self.compare.reference
        each = [{**self.values, key: reference}, {**self.values, key: reference * (1.0 + size)}]
        intervals, answer = (each, SECOND) if place else (each[::-1], FIRST)
        return Trial(
            number, self.condition, repetition, self.levels, intervals, answer, reference, size, is_practice
        )  # fmt: skip


def levels_of(factor: Factor) -> Iterator[tuple[Any, Mapping[str, Any]]]:
    """List the levels of a factor, each with the scene values that it sets."""
    for value in factor.levels:
        yield value, {factor.key: value}
    yield from factor.level.items()


def cells(table: ExperimentTable) -> Sequence[Cell]:
    """Cross conditions, factors and increments; increments vary fastest, then the last factor."""
    crossed = []
    for condition in table.condition or (Condition(name=ALL),):
        for levels in product(*(levels_of(factor) for factor in table.factor)):
            names = {factor.name: level for factor, (level, _) in zip(table.factor, levels, strict=True)}
            values = {**table.set, **condition.set}
            for _, more in levels:
                values |= more
            compare = condition.compare
            for increment in (compare.increments if compare is not None else ()) or (math.nan,):
                crossed.append(Cell(condition.name, names, values, condition.answer, compare, increment))
    return crossed


@dataclass(frozen=True)
class Slot:
    """Entry of the plan: a cell, its repetition from 1, and, in a comparison, the interval with the larger value."""

    cell: Cell
    repetition: int
    place: int
    is_practice: bool = False


@dataclass
class SessionPlan:
    """Order of a session, with the present state of its staircases.

    Attributes:
        slots: Entries in order.
        stairs: Staircases by condition.
        easy: Relative increment of practice trials whose condition has a staircase; None for the largest increment.
        done: Number of trials that have a row.
    """

    slots: Sequence[Slot]
    stairs: Mapping[str, Stair]
    easy: float | None = None
    done: int = field(default=0, init=False)

    def trial(self) -> Trial | None:
        """Return the next trial, or None after the last trial."""
        if self.done >= len(self.slots):
            return None
        slot = self.slots[self.done]
        increment = math.nan
        if slot.cell.is_adaptive:
            stair = self.stairs[slot.cell.condition]
            increment = stair.easiest(self.easy) if slot.is_practice else stair.increment()
        return slot.cell.trial(self.done + 1, slot.repetition, slot.place, increment, is_practice=slot.is_practice)

    def take(self, row: Row) -> None:
        """Advance past a trial; unless the trial is practice, its response updates the staircase of its condition."""
        slot = self.slots[self.done]
        self.done += 1
        if slot.cell.is_adaptive and not slot.is_practice and row.is_correct is not None:
            self.stairs[slot.cell.condition].update(row.trial.increment, is_correct=row.is_correct)


def session_plan(table: ExperimentTable, participant: str, session: str) -> SessionPlan:
    """Plan a session. The plan depends only on the file, the participant and the session.

    Raises:
        InputError: If the order is "latin-square" and the participant is not a whole number of at least 1.
        MissingPackageError: If the experiment has a staircase, and questplus is not installed.
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
