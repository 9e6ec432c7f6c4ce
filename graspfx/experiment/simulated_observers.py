"""Simulated observers: with a psychometric function, with noisy perception of the displayed stiffness, or guessing.

They test an experiment, its staircase and its stimuli; they do not predict people's results.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from graspfx.errors import InputError
from graspfx.experiment.displayed_stiffness import SHARES, displayed_stiffness
from graspfx.experiment.experiment_table import ExperimentTable, Observer
from graspfx.experiment.session_plan import random_of
from graspfx.experiment.staircase import chance
from graspfx.experiment.trial import FIRST, SECOND, Presentation

Respond = Callable[[Presentation], str]


def simulated_observer(table: ExperimentTable, participant: str, session: str) -> Respond:
    """Return the observer of an experiment; without a table [observer], it guesses.

    Random numbers depend only on the seed, the participant, the session and the trial, so a resumed session gets the
    same answers as an uninterrupted session.
    """
    observer = table.observer or Observer(kind="guess")
    keys = {condition.name: condition.compare.key for condition in table.condition if condition.compare is not None}
    answers = list(table.question.keys.values()) if table.question is not None else []
    if not answers:
        raise InputError("question", None, "a [question] with keys", "without a question there are no answers")

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
    """Return the value for a condition, from one value per condition or one for all."""
    return float(value.get(condition, otherwise)) if isinstance(value, Mapping) else float(value)
