"""Cells of an experiment's design: conditions crossed with factors, and with increments that are fixed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from graspfx.experiment.experiment_table import Comparison, Condition, ExperimentTable, Factor
from graspfx.experiment.trial import FIRST, SECOND, Trial

ALL = "all"  # name of the condition of an experiment of factors alone


@dataclass(frozen=True)
class Cell:
    """One combination of a condition and a level of each factor.

    Attributes:
        condition: its name.
        levels: of each factor, by its name.
        values: of the scene, by dotted key.
        answer: that is right; empty where none is, or where two intervals are compared.
        compare: the comparison; None for one interval.
        increment: of a comparison, relative; nan where a staircase chooses.
    """

    condition: str
    levels: Mapping[str, Any]
    values: Mapping[str, Any]
    answer: str = ""
    compare: Comparison | None = None
    increment: float = math.nan

    @property
    def is_adaptive(self) -> bool:
        """Whether a staircase chooses its increments."""
        return self.compare is not None and math.isnan(self.increment)

    def trial(self, number: int, repetition: int, place: int, increment: float, *, is_practice: bool = False) -> Trial:
        """Make a trial.

        Args:
            number: in the session.
            repetition: of the condition.
            place: of two intervals the one with the larger value, 0 or 1.
            increment: of the larger value, where a staircase chooses it.
            is_practice: whether it counts for nothing.
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
    """List the levels of a factor, each with the values of the scene that it stands for."""
    for value in factor.levels:
        yield value, {factor.key: value}
    yield from factor.level.items()


def cells(table: ExperimentTable) -> Sequence[Cell]:
    """Cross the conditions with all factors, the last of which changes first, and with increments."""
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
