"""Adaptive staircases (QUEST+), and estimation of thresholds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError, MissingPackageError

if TYPE_CHECKING:
    from graspfx.experiment.experiment_table import Span, Staircase, Study

FloatArray = NDArray[np.float64]
GUESS = 0.5  # probability of a correct answer for two equal intervals


class Stair:
    """QUEST+ staircase of one condition: posterior of the threshold, with a uniform prior over its logarithm.

    The probability of a correct answer to an increment x is the Weibull function
    p(x) = 1 - l - (1/2 - l) exp(-(x/t)^s), with threshold t, slope s and lapse rate l; p(t) is 0.80 for l = 0.02.
    (A. B. Watson, QUEST+: a general multidimensional Bayesian adaptive psychometric method, J. Vision 17(3):10, 2017.)

    Args:
        table: Domains, slope and lapse rate.

    Raises:
        MissingPackageError: If questplus is not installed.
    """

    def __init__(self, table: Staircase) -> None:
        self.table = table
        self.increments, self.thresholds = span_values(table.increments), span_values(table.threshold)
        self._quest: Any = _quest_plus()(
            stim_domain={"intensity": self.increments},
            param_domain={
                "threshold": self.thresholds, "slope": [table.slope], "lower_asymptote": [GUESS],
                "lapse_rate": [table.lapse],
            },
            outcome_domain={"response": ["Yes", "No"]}, func="weibull", stim_scale="linear",
            stim_selection_method="min_entropy", param_estimation_method="mean",
        )  # fmt: skip
        self.trials = 0

    def increment(self) -> float:
        """Return the next relative increment."""
        return float(self._quest.next_stim["intensity"])

    def easiest(self, size: float | None) -> float:
        """Return the increment for practice: `size`, or the largest increment if `size` is None."""
        return float(self.increments[-1]) if size is None else size

    def update(self, increment: float, *, is_correct: bool) -> None:
        """Update the posterior with an answer to the increment of the domain that is nearest to `increment`."""
        nearest = self.increments[np.abs(self.increments - increment).argmin()]
        self._quest.update(stim={"intensity": nearest}, outcome={"response": "Yes" if is_correct else "No"})
        self.trials += 1

    def posterior(self) -> FloatArray:
        """Return the posterior probability of each value of `thresholds`."""
        return np.asarray(self._quest.posterior.sum(("slope", "lower_asymptote", "lapse_rate")).values)

    def threshold(self) -> tuple[float, float]:
        """Estimate the relative threshold: geometric mean of the posterior, and standard deviation of its logarithm."""
        log, weight = np.log(self.thresholds), self.posterior()
        mean = float(weight @ log)
        return float(np.exp(mean)), float(np.sqrt(weight @ (log - mean) ** 2))


def span_values(span: Span) -> FloatArray:
    """List the logarithmically spaced values of a span."""
    return np.geomspace(span.least, span.most, span.count)


def chance(increment: float, threshold: float, slope: float, lapse: float) -> float:
    """Compute the probability of a correct answer by the Weibull function of `Stair`."""
    return float(1.0 - lapse - (1.0 - GUESS - lapse) * np.exp(-((increment / threshold) ** slope)))


def information(increment: float, threshold: float, slope: float, lapse: float) -> float:
    """Compute the Fisher information p'^2 / (p (1 - p)) of one answer about log t, where p' = dp / d log t.

    Here t is the threshold, and p the probability of a correct answer (`chance`).
    """
    p = chance(increment, threshold, slope, lapse)
    ratio = (increment / threshold) ** slope
    change = -(1.0 - GUESS - lapse) * np.exp(-ratio) * ratio * slope  # dp / d log t
    return float(change * change / (p * (1.0 - p)))


def _quest_plus() -> Any:
    try:
        import questplus
    except ImportError as error:
        raise MissingPackageError.of_extra("questplus", "a staircase", "experiment") from error
    return questplus.QuestPlus


class Threshold(NamedTuple):
    """Just-noticeable difference.

    Attributes:
        condition: Name of the condition.
        value: Threshold t of `Stair`, relative to the reference; 80 % correct answers for a lapse rate of 0.02.
        spread: Posterior standard deviation of the threshold's natural logarithm.
        trials: Number of answered trials, without practice.
    """

    condition: str
    value: float
    spread: float
    trials: int

    def __str__(self) -> str:
        return f"{self.condition}: {100 * self.value:.1f} % (x/ {2.718281828**self.spread:.2f}), {self.trials} trials"


def thresholds(experiment: Study, rows: Sequence[Mapping[str, str]]) -> list[Threshold]:
    """Estimate the threshold of each condition that compares two intervals, with the staircase's model.

    Args:
        experiment: Experiment with a `[staircase]`, whose domain, slope and lapse rate define the model.
        rows: Rows of the table of trials, from `read_table`; practice trials are ignored.

    Raises:
        InputError: If the experiment has no staircase.
        MissingPackageError: If questplus is not installed.
    """
    table = experiment.table
    if table.staircase is None:
        raise InputError("experiment", table.name, "an experiment with a [staircase]")
    answers: dict[str, Stair] = {
        each.name: Stair(table.staircase) for each in table.condition if each.compare is not None
    }
    for row in rows:
        if row["trial_type"] == "test" and row["correct"] in ("true", "false") and row["condition"] in answers:
            answers[row["condition"]].update(float(row["increment"]), is_correct=row["correct"] == "true")
    return [Threshold(name, *stair.threshold(), stair.trials) for name, stair in answers.items()]
