"""Simulated observers: one who follows a psychometric function, one who feels what recordings display, one who guesses.

They check an experiment, its staircase and the way of its stimuli; of people they say nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from graspfx.errors import InputError
from graspfx.experiment.displayed_stiffness import SHARES, displayed_stiffness
from graspfx.experiment.experiment_table import ExperimentTable, Observer
from graspfx.experiment.session_plan import random_of
from graspfx.experiment.staircase import chance
from graspfx.experiment.trial import FIRST, SECOND, Presentation

Respond = Callable[[Presentation], str]


def simulated_observer(table: ExperimentTable, participant: str, session: str) -> Respond:
    """Make the observer of an experiment's table, or one who guesses where it has none.

    Its random numbers follow from the seed, the participant, the session and the trial, so that a session that is
    resumed has the answers that it would have had.
    """
    observer = table.observer or Observer(kind="guess")
    keys = {condition.name: condition.compare.key for condition in table.condition if condition.compare is not None}
    answers = list(table.question.keys.values()) if table.question is not None else []
    if not answers:
        raise InputError("question", None, "a [question] with keys", "an experiment without one asks nobody")

    def respond(presentation: Presentation) -> str:
        trial = presentation.trial
        rng = random_of(table.seed, "observer", participant, session, str(trial.number))
        if observer.kind == "guess" or rng.random() < 2.0 * observer.lapse * (observer.kind == "physical"):
            return answers[int(rng.integers(len(answers)))]
        if observer.kind == "psychometric":
            threshold = value_for(observer.threshold, trial.condition, 0.15)
            is_right = rng.random() < chance(trial.increment, threshold, observer.slope, observer.lapse)
            return trial.answer if is_right else (SECOND if trial.answer == FIRST else FIRST)
        noise = value_for(observer.weber, trial.condition, 0.1)
        felt = [
            displayed_stiffness(rec, SHARES[keys[trial.condition]]) * (1.0 + noise * float(rng.standard_normal()))
            for rec in presentation.load()
        ]
        return FIRST if felt[0] > felt[1] else SECOND

    return respond


def value_for(value: float | Mapping[str, float], condition: str, otherwise: float) -> float:
    """Give a number of a condition, where there is one for each or one for all."""
    return float(value.get(condition, otherwise)) if isinstance(value, Mapping) else float(value)


def physical_chance(increment: float, noise: float, lapse: float) -> float:
    """Give the chance that the physical observer is right: l + (1 - 2 l) F(x / (w sqrt(1 + (1 + x)^2))).

    The stiffnesses k and k (1 + x) are felt with deviations w k and w k (1 + x), F is the normal distribution.

    Args:
        increment: x.
        noise: w, the Weber fraction of one stiffness.
        lapse: l.
    """
    from math import erf, sqrt

    return float(
        lapse
        + (1.0 - 2.0 * lapse)
        * 0.5
        * (1.0 + erf(increment / (noise * np.sqrt(1.0 + (1.0 + increment) ** 2) * sqrt(2.0))))
    )
