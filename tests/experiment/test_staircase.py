"""Thresholds of simulated observers, against the information that their answers have; and stimuli as they are felt."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

import graspfx as gx
from graspfx.errors import InputError
from graspfx.experiment.experiment_table import Span, Staircase
from graspfx.experiment.simulated_observers import displayed_stiffness
from graspfx.experiment.staircase import Stair, chance, information
from tests.support.experiments import COMPARED, experiment, table_of

pytest.importorskip("questplus", reason="staircases: pip install 'graspfx[experiment]'")

SLOPE, LAPSE, TRUE = 3.5, 0.02, 0.15
TABLE = Staircase(
    increments=Span(least=0.02, most=0.8, count=20), threshold=Span(least=0.03, most=0.6, count=30), slope=SLOPE,
    lapse=LAPSE,
)  # fmt: skip
SESSIONS, TRIALS = 12, 40
RARE = 1e-4  # chance of a fixed seed that fails although all is right


def physical_chance(increment: float, noise: float, lapse: float) -> float:
    """Chance of a right answer of a physical observer: l + (1 - 2 l) F(x / (w sqrt(1 + (1 + x)^2))).

    It perceives the stiffnesses k and k (1 + x) with standard deviations w k and w k (1 + x); F is the normal
    distribution function.
    """
    perceived = increment / (noise * math.sqrt(1.0 + (1.0 + increment) ** 2))
    return lapse + (1.0 - 2.0 * lapse) * 0.5 * (1.0 + math.erf(perceived / math.sqrt(2.0)))


def test_the_information_is_that_of_the_chance() -> None:
    """The closed form is the one from differences: p'^2 / (p (1 - p)) over the log of the threshold."""
    for increment in (0.03, 0.1, 0.15, 0.3):
        step = 1e-5
        low, high = (chance(increment, TRUE * math.exp(sign * step), SLOPE, LAPSE) for sign in (-1.0, 1.0))
        p = chance(increment, TRUE, SLOPE, LAPSE)
        assert information(increment, TRUE, SLOPE, LAPSE) == pytest.approx(
            ((high - low) / (2.0 * step)) ** 2 / (p * (1.0 - p)), rel=1e-6
        )
    assert chance(TRUE, TRUE, SLOPE, LAPSE) == pytest.approx(0.98 - 0.48 / math.e)


def test_staircases_find_thresholds_as_well_as_the_answers_allow() -> None:
    """Errors of log thresholds, in units of 1/sqrt(sum of the information at each increment): mean 0, deviation 1."""
    rng, errors, shares = np.random.default_rng(5), [], []
    best = -minimize_scalar(
        lambda x: -information(x, TRUE, SLOPE, LAPSE), bounds=(0.05, 0.4), method="bounded"
    ).fun  # fmt: skip
    for _ in range(SESSIONS):
        stair, total = Stair(TABLE), 0.0
        for _ in range(TRIALS):
            increment = stair.increment()
            total += information(increment, TRUE, SLOPE, LAPSE)
            stair.update(increment, is_correct=rng.random() < chance(increment, TRUE, SLOPE, LAPSE))
        value, _ = stair.threshold()
        errors.append(math.log(value / TRUE) * math.sqrt(total))
        shares.append(total / (TRIALS * best))
    z = np.array(errors)
    assert abs(z.mean()) < 3.9 / math.sqrt(SESSIONS)
    low, high = (float(chi2.ppf(p, SESSIONS)) for p in (RARE, 1.0 - RARE))
    assert low < (z @ z) < high
    assert 0.5 < np.mean(shares) <= 1.0  # of the information that the best increment, always, would have


def test_the_stiffness_in_the_recording_is_the_one_that_was_asked_for(tmp_path: Path) -> None:
    """The stimulus path from end to end: by forces and places of two fingers, their mean and difference, in space."""
    text = COMPARED[: COMPARED.index("[staircase]")].replace("0 }", "0, increments = [0.01, 0.2] }")
    felt = experiment(
        text + '[observer]\nkind = "physical"\nweber = 0.0\nlapse = 0.0\n',
        ('"reference-1dof"', '"paper-waving"'), ("duration = 0.05", "duration = 0.2"),
        ("repetitions = 4", "repetitions = 1"),
    )  # fmt: skip
    rows = felt.run(tmp_path)
    assert len(rows) == 4 and all(row.is_correct for row in rows)  # nobody who feels without noise is ever wrong
    for row in rows:
        for place, values in zip(("first", "second"), row.trial.intervals, strict=True):
            recording = gx.Recording.load(table_of(tmp_path).parent / row.path / place)
            (asked,) = (value for key, value in values.items() if key.endswith("stiffness"))
            touch = recording.touching.all(axis=1)
            depth = (recording.finger_position - recording.contact_position)[touch]
            force = recording.finger_force[touch]
            mean = depth.mean(axis=1, keepdims=True), force.mean(axis=1, keepdims=True)
            e, f = mean if row.trial.condition == "external" else (depth - mean[0], force - mean[1])
            assert (e * f).sum() / (e * e).sum() == pytest.approx(asked, rel=1e-9)
            assert displayed_stiffness(recording, row.trial.condition) == pytest.approx(asked, rel=1e-9)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="'internal' or 'external'"):
        displayed_stiffness(recording, "all")  # type: ignore[arg-type]


def test_the_physical_observer_has_the_chance_of_its_formula() -> None:
    rng, noise, lapse, count = np.random.default_rng(1), 0.1, 0.02, 20_000
    for increment in (0.05, 0.15, 0.4):
        one, other = (
            1.0 + noise * rng.standard_normal(count),
            (1.0 + increment) * (1.0 + noise * rng.standard_normal(count)),
        )
        lapses = rng.random(count) < 2.0 * lapse
        right = np.where(lapses, rng.random(count) < 0.5, other > one).mean()
        expected = physical_chance(increment, noise, lapse)
        assert abs(right - expected) < 3.9 * math.sqrt(expected * (1.0 - expected) / count)
