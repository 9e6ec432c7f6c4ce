"""Simulated observers, and the displayed stiffness of a recording, which the physical observer perceives.

Simulated observers test an experiment, its staircase and its stimuli; they do not predict people's results.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Literal

import numpy as np

from graspfx.errors import InputError
from graspfx.experiment.experiment_table import ExperimentTable, Observer
from graspfx.experiment.session_plan import random_of
from graspfx.experiment.staircase import chance
from graspfx.experiment.trial import FIRST, SECOND, Presentation

if TYPE_CHECKING:
    from graspfx.recording.record import Recording

Share = Literal["internal", "external"]
SHARES: dict[str, Share] = {"coupling.internal.stiffness": "internal", "coupling.external.stiffness": "external"}
Respond = Callable[[Presentation], str]


def simulated_observer(table: ExperimentTable, participant: str, session: str) -> Respond:
    """Return the simulated observer of an experiment; without a table [observer], the observer guesses.

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
    """Return the value for a condition.

    `value` is one value for all conditions, or a table of values by condition, in which `otherwise` replaces a missing
    value.
    """
    return float(value.get(condition, otherwise)) if isinstance(value, Mapping) else float(value)


def displayed_stiffness(recording: Recording, share: Share) -> float:
    """Estimate the displayed stiffness k = sum f.e / sum e.e [N/m] over the rows in which a finger touches.

    Here f is the internal or external part of the forces of the fingers on the object, and e is the same part of the
    displacements of the fingers from the contacts. For a spring without damping, k is its stiffness to rounding.

    Args:
        recording: Recording with forces, positions and contacts.
        share: Part of the force, "internal" or "external".

    Raises:
        InputError: If `share` is unknown, or if this part of the displacements is zero whenever fingers touch.
    """
    if share not in SHARES.values():
        raise InputError("share", share, "'internal' or 'external'")
    force = getattr(recording, f"{share}_force")
    displacement = getattr(recording, f"{share}_displacement")
    felt = recording.touching.any(axis=1)
    f, e = np.nan_to_num(force[felt]), np.nan_to_num(displacement[felt])
    size = float((e * e).sum())
    if not size > 0.0:
        raise InputError("recording", recording.header.scene, f"a recording with {share} displacements")
    return float((f * e).sum()) / size
