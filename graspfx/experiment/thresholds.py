"""Thresholds from the table of a session: what a staircase says of each condition after the last answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from graspfx.errors import InputError
from graspfx.experiment.staircase_of_condition import Stair

if TYPE_CHECKING:
    from graspfx.experiment.experiment import Experiment


class Threshold(NamedTuple):
    """A just-noticeable difference.

    Attributes:
        condition: its name.
        value: relative to the reference, at 80 % right answers.
        spread: deviation of its logarithm, over the posterior.
        trials: that were answered.
    """

    condition: str
    value: float
    spread: float
    trials: int

    def __str__(self) -> str:
        return f"{self.condition}: {100 * self.value:.1f} % (x/ {2.718281828**self.spread:.2f}), {self.trials} trials"


def thresholds(experiment: Experiment, rows: Sequence[Mapping[str, str]]) -> list[Threshold]:
    """Estimate the threshold of each condition that compares two intervals, by the experiment's staircase.

    Args:
        experiment: with a `[staircase]`, whose domain, slope and lapse rate are the model.
        rows: of the table of trials, as `read_table` gives them; practice counts for nothing.

    Raises:
        InputError: an experiment without a staircase.
        MissingPackageError: questplus is not installed.
    """
    table = experiment.table
    if table.staircase is None:
        raise InputError("experiment", experiment.name, "one with a [staircase]")
    answers: dict[str, Stair] = {
        each.name: Stair(table.staircase) for each in table.condition if each.compare is not None
    }
    for row in rows:
        if row["trial_type"] == "test" and row["correct"] in ("true", "false") and row["condition"] in answers:
            answers[row["condition"]].update(float(row["increment"]), is_correct=row["correct"] == "true")
    return [Threshold(name, *stair.threshold(), stair.trials) for name, stair in answers.items()]
