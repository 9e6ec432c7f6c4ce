"""Tuned gains: against closed forms, python-control over a set of operators, and what cannot be met."""

from __future__ import annotations

import math
import tomllib
from typing import Any

import control
import numpy as np
import pytest

import graspfx as gx
from graspfx.certificate.judgement import Judge
from graspfx.certificate.operator_set import OperatorSet
from graspfx.errors import InputError, UnknownNameError

STIFFNESS, DAMPING = "finger.*.hand.stiffness", "finger.*.hand.damping"
DEVICE: dict[str, Any] = {"mass": 0.15, "damping": 0.2, "period": 0.005, "spring": 33.0}
CUBE: dict[str, Any] = {"object_mass": 0.1, "object_damping": 0.8, "integrator": "explicit"}


def test_the_wall_s_limit_over_the_margin() -> None:
    answer = gx.tune("reference-1dof", "internal.stiffness", "margin >= 1.3", operators="own")
    limit = gx.stability.wall_limit(**DEVICE)
    assert answer.values["coupling.internal.stiffness"] == pytest.approx(limit / 1.3, rel=2e-6)
    assert answer.feasible and answer.binding is not None and answer.binding.text == "margin >= 1.3"
    row = answer.binding.judgement.worst
    assert row is not None and row.limit.mode == "internal" and row.limit.limit == pytest.approx(limit)
    (check,) = answer.more
    assert check.broken is not None and check.broken.left == pytest.approx(1.3 / 1.01, rel=1e-5)
    assert answer.tuned.coupling.internal.stiffness == answer.values["coupling.internal.stiffness"]


def test_the_external_limit_over_the_margin() -> None:
    answer = gx.tune("paper-spring", "external.stiffness", "margin.external >= 1.5", operators="own")
    limit = gx.stability.external_limit(**DEVICE, **CUBE)
    assert answer.values["coupling.external.stiffness"] == pytest.approx(limit / 1.5, rel=2e-6)
    assert answer.binding is not None and answer.binding.row is not None
    assert answer.binding.row.limit.limit == pytest.approx(limit)
    (check,) = answer.more
    for text in (
        answer.reason.split("in the scene's own hand: ")[1],
        check.text.split("margin.external >= 1.5 is ")[1],
    ):
        assert "external " in text and "internal" not in text


def test_two_gains_reach_both_limits() -> None:
    answer = gx.tune(
        "paper-spring", "internal.stiffness + external.stiffness", "margin >= 1.25", operators="own",
        over=["internal.stiffness=5:500", "external.stiffness=5:500"],
    )  # fmt: skip
    limits = gx.stability.wall_limit(**DEVICE), gx.stability.external_limit(**DEVICE, **CUBE)
    assert list(answer.values.values()) == pytest.approx([limit / 1.25 for limit in limits], rel=1e-4)
    assert len(answer.more) == 2 and all(check.broken is not None for check in answer.more)


def wall_margin(spring: float, damping: float) -> float:
    """The gain of a wall at which python-control says that the sampled loop of a device in a hand is lost."""
    plant = control.c2d(control.tf([1.0], [0.15, 0.2 + damping, spring]), 0.005, "zoh")
    return float(control.stability_margins(plant, method="poly")[0])


def test_robust_gains_are_those_of_python_control() -> None:
    """The least gain margin over a grid of hands is the limit; the hand is the one where that is."""
    answer = gx.tune(
        "reference-1dof", "internal.stiffness", "margin.internal >= 1.4",
        operators={STIFFNESS: (50.0, 1000.0), DAMPING: (0.3, 3.0)},
    )  # fmt: skip
    hands = [(k, b) for k in np.geomspace(50.0, 1000.0, 25) for b in np.geomspace(0.3, 3.0, 9)]
    margins = [wall_margin(*hand) for hand in hands]
    worst = int(np.argmin(margins))
    assert answer.values["coupling.internal.stiffness"] == pytest.approx(margins[worst] / 1.4, rel=1e-4)
    assert answer.binding is not None
    found = answer.binding.judgement.values
    assert found[DAMPING] == pytest.approx(hands[worst][1])
    assert wall_margin(found[STIFFNESS], found[DAMPING]) == pytest.approx(margins[worst], rel=1e-4)
    assert "finger.*.hand.damping = 0.3" in answer.reason


def test_what_cannot_be_met_says_how_near_it_comes() -> None:
    answer = gx.tune("paper-waving", "internal.stiffness", "margin >= 1.3, grip >= 40", operators="own")
    assert not answer.feasible and answer.binding is None
    assert answer.sentence.startswith("NOT feasible in the scene's own hand: grip >= 40 cannot be satisfied: ")
    (best,) = answer.reach.values()
    # a stiff coupling squeezes with all of the hands' 60 N/m times 10 mm
    assert best == pytest.approx(8.2, abs=0.3)


def test_an_answer_that_fails_in_a_fresh_hand_says_where_and_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hand that the search never saw has less damping than its set: what it found is not called impossible."""
    odd = {STIFFNESS: 300.0, DAMPING: 0.01}
    monkeypatch.setattr(OperatorSet, "population", lambda self, count, seed: [odd] * count)
    answer = gx.tune(
        "reference-1dof", "internal.stiffness", "margin.internal >= 1.4",
        operators={STIFFNESS: (250.0, 350.0), DAMPING: (0.9, 1.1)}, seed=7,
    )  # fmt: skip
    (unmet,) = answer.constraints
    value = answer.values["coupling.internal.stiffness"]
    assert unmet.left == pytest.approx(wall_margin(300.0, 0.01) / value, rel=1e-3)
    assert not answer.feasible and answer.reach == {} and unmet.left < 1.4
    assert answer.sentence.startswith("NOT verified in every hand of the set: the search satisfied all ")
    hand = f"in the hand of {STIFFNESS} = 300, {DAMPING} = 0.01, one of 32 random hands (seed 7): tighten"
    assert f"margin.internal >= 1.4 has a left side of {unmet.left:.5g} {hand}" in answer.obstacle
    assert answer.to_dict()["refutation"] == answer.obstacle == answer.reason
    assert "cannot be satisfied" not in str(answer) and "no values satisfy all" not in str(answer)


def test_all_judgements_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    judge, calls = Judge.judge, []

    def counted(self: Judge, *given: Any, **more: Any) -> Any:
        calls.append(given)
        return judge(self, *given, **more)

    monkeypatch.setattr(Judge, "judge", counted)
    answer = gx.tune("reference-1dof", "internal.stiffness", "margin.external >= 4", operators="own")
    assert answer.reach and answer.judged == len(calls)


def test_constraints_that_exclude_one_another() -> None:
    text = "internal.stiffness >= 100, margin.internal >= 1.2"
    answer = gx.tune("reference-1dof", "internal.stiffness", text, operators="own")
    assert not answer.feasible and answer.reach == {} and answer.obstacle.startswith("no values satisfy all: ")


def test_the_end_of_a_range_is_a_reason() -> None:
    answer = gx.tune(
        "reference-1dof", "internal.stiffness", "margin >= 1.1", over=["internal.stiffness=10:50"], operators="own"
    )
    assert answer.values == {"coupling.internal.stiffness": 50.0} and answer.feasible
    assert "end of its range" in answer.reason


def test_a_measure_may_be_the_objective_and_another_may_bind() -> None:
    """A spring of 33 N/m, 10 mm inside the face, squeezes with 0.33 N k/(33 + k): 0.19 N at 44.8 N/m."""
    answer = gx.tune(
        "paper-spring", "displayed.stiffness", "margin.internal >= 1.6, squeeze <= 0.19",
        over=["internal.stiffness=5:200"], operators="own",
    )  # fmt: skip
    assert answer.value == pytest.approx(0.19 * 33.0 / (0.33 - 0.19), rel=1e-4)
    assert answer.values["coupling.internal.stiffness"] == pytest.approx(answer.value, rel=1e-6)
    assert answer.binding is not None and answer.binding.text == "squeeze <= 0.19"


def test_what_to_paste() -> None:
    answer = gx.tune("reference-1dof", "internal.stiffness", "margin >= 1.5", operators="own")
    value = answer.values["coupling.internal.stiffness"]
    assert answer.set_line == f"--set coupling.internal.stiffness={value}"
    table = tomllib.loads(answer.toml)
    scene = gx.Scene(**(gx.load("reference-1dof").to_dict() | table))
    assert scene.preset["tuned"].set == {"coupling.internal.stiffness": value}
    data = answer.to_dict()
    assert data["feasible"] and data["values"] == answer.values and data["certificates"][0]["stable"]
    assert "limited by" in str(answer) and math.isfinite(data["value"])


def test_what_is_no_problem_is_refused() -> None:
    with pytest.raises(UnknownNameError, match=r"did you mean 'internal\.stiffness'"):
        gx.tune("reference-1dof", "internal.stifness")
    with pytest.raises(UnknownNameError, match="did you mean 'margin'"):
        gx.tune("reference-1dof", "internal.stiffness", "marginn >= 1")
    with pytest.raises(InputError, match="is a measure"):
        gx.tune("reference-1dof", "internal.stiffness", over=["margin=1:2"])
    with pytest.raises(InputError, match="a key whose value is a number"):
        gx.tune("reference-1dof", "object.0.shape")
    with pytest.raises(InputError, match="does not vary with the operator"):
        gx.tune("reference-1dof", STIFFNESS, over=[f"{STIFFNESS}=10:20"], operators=[f"{STIFFNESS}=10:20"])
    with pytest.raises(InputError, match="operators"):
        gx.tune("reference-1dof", operators="mine")
    with pytest.raises(InputError, match="over"):
        gx.tune("reference-1dof", over=[])
