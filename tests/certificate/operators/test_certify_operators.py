"""Certificates over sets of operators: against closed forms, operator by operator, worst case, share and regions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.certificate.certify_operators import share_of
from graspfx.certificate.judgement import Judge
from graspfx.certificate.operator_set import OperatorRange, operator_set, radical_inverse, usual_law
from graspfx.errors import InputError, SceneError, UnknownNameError
from graspfx.show import certificate_figures

STIFFNESS = "finger.*.hand.stiffness"
CUBE = {"mass": 0.15, "damping": 0.2, "period": 0.005, "object_mass": 0.1, "object_damping": 0.8}


def external_limit(spring: float, **changes: Any) -> float:
    return gx.stability.external_limit(**{**CUBE, "integrator": "explicit", **changes}, spring=spring)


def wall_limit(spring: float) -> float:
    return gx.stability.wall_limit(0.15, 0.2, 0.005, spring=spring)


@pytest.fixture(scope="module")
def answer() -> gx.OperatorCertificate:
    """Give the certificate of a cube whose limit dips between soft and stiff hands: 38.9 N/m at 216, 50.3 at 50."""
    scene = gx.load("paper-spring", {"coupling.external.stiffness": 40.0, "coupling.internal.stiffness": 40.0})
    return gx.certify_operators(scene, {STIFFNESS: (50.0, 1000.0)}, samples=40)


def test_each_operator_has_the_closed_form_s_margin(answer: gx.OperatorCertificate) -> None:
    for one in answer.population[:20]:
        (spring,) = one.values.values()
        assert one.margin_of("external") == pytest.approx(external_limit(spring) / 40.0, rel=1e-9)
        assert one.margin_of("internal") == pytest.approx(wall_limit(spring) / 40.0, rel=1e-9)
        assert one.stable == (min(external_limit(spring), wall_limit(spring)) > 40.0)


def test_the_worst_operator_is_inside_the_box(answer: gx.OperatorCertificate) -> None:
    springs = np.array([50.0, *np.linspace(200.0, 235.0, 351), 1000.0])
    limits = np.array([external_limit(spring) for spring in springs])
    (worst,) = answer.worst.values.values()
    assert worst == pytest.approx(springs[limits.argmin()], rel=0.02)
    assert answer.worst.margin == pytest.approx(limits.min() / 40.0, rel=1e-5)
    assert answer.worst.margin < min(limits[0], limits[-1]) / 40.0 - 0.05  # no corner has it


def test_the_share_is_that_of_the_closed_form(answer: gx.OperatorCertificate) -> None:
    exact = sum(
        min(external_limit(*one.values.values()), wall_limit(*one.values.values())) > 40.0 for one in answer.population
    )
    assert 0 < exact < 40
    assert (answer.share.count, answer.share.total) == (exact, 40)
    assert answer.sentence.startswith(f"stable in {100 * exact / 40:.3g} % (95 % confidence")
    assert not answer.stable and not answer.is_passive
    assert "NOT in all" in str(answer) and "sampled" in answer.guarantee


def test_the_same_seed_gives_the_same_answer(answer: gx.OperatorCertificate) -> None:
    set_ = answer.operators
    assert set_.population(40, 0) == [dict(one.values) for one in answer.population]
    assert set_.population(5, 1) != set_.population(5, 2)


def test_a_region_has_the_closed_form_s_limits(answer: gx.OperatorCertificate) -> None:
    region = answer.region(points=5)
    assert region.margin == pytest.approx([min(external_limit(x), wall_limit(x)) / 40.0 for x in region.values[0]])
    assert region.stable.tolist() == (region.margin > 1.0).tolist()
    with pytest.raises(UnknownNameError, match="key of the operators"):
        answer.region(("object.mass",))


def test_a_misspelt_mode_has_no_margins(answer: gx.OperatorCertificate) -> None:
    """It had the margins inf, as a mode without a limit has."""
    with pytest.raises(UnknownNameError, match="did you mean 'external'"):
        answer.margins("extrenal")
    assert np.isfinite(answer.margins("external")).all()
    assert np.isinf(answer.margins("external rotation")).all()


def test_a_map_of_gains_counts_the_hands(answer: gx.OperatorCertificate) -> None:
    region = answer.gains(points=4, span=4.0)
    springs = [next(iter(one.values.values())) for one in answer.population]
    external, internal = (np.array([f(spring) for spring in springs]) for f in (external_limit, wall_limit))
    for i, kep in enumerate(region.external):
        for j, kip in enumerate(region.internal):
            assert region.share[i, j] == pytest.approx(np.mean((external > kep) & (internal > kip)))
    assert 0.0 < region.share.mean() < 1.0


def test_passive_gains_are_guaranteed() -> None:
    answer = gx.certify_operators("reference-1dof", [f"{STIFFNESS}=50:1000"], samples=3)
    assert answer.is_passive and "guaranteed" in answer.guarantee and "by passivity" in answer.sentence


REACTION = {"delay": 0.02, "stiffness": 25.0, "damping": 0.8, "force": 0.1}  # ten samples


@pytest.fixture(scope="module")
def passive() -> gx.Scene:
    """Give a scene that is passive with every hand."""
    fingers = [
        {
            "device": {"name": "simulated", "mass": 0.1, "damping": 0.2},
            "start": [x],
            "hand": {"stiffness": 60.0, "damping": 1.0, "squeeze": 0.01, "closing": [-x]},
        }
        for x in (-0.025, 0.025)
    ]
    scene = gx.Scene(
        dimensions=1,
        period=0.002,
        duration=1.0,
        object=[{"mass": 0.1, "viscosity": 0.8}],
        coupling={"contact": "attached", "external": {"stiffness": 20.0}, "internal": {"stiffness": 20.0}},
        finger=fingers,
    )
    assert gx.certify_operators(scene, {"finger.*.hand.stiffness": (30.0, 500.0)}, samples=2).is_passive
    return scene


@pytest.mark.parametrize(
    ("changes", "ranges"),
    [
        ({"finger.*.hand.reaction": REACTION}, {"finger.*.hand.reaction.stiffness": (1.0, 400.0)}),
        ({"finger.*.hand.reaction": REACTION}, {"finger.*.hand.stiffness": (50.0, 100.0)}),
        ({"finger.*.hand.stiffening": {"stiffness": 300.0, "lag": 0.03}}, {"finger.*.hand.stiffness": (50.0, 100.0)}),
        ({"coupling.external.stiffness": 120.0}, {"finger.*.device.damping": (0.001, 0.2)}),
        ({"coupling.external.stiffness": 120.0}, {"object.viscosity": (0.0, 0.8, "uniform")}),
        ({"coupling.external.stiffness": 120.0}, {"coupling.external.stiffness": (100.0, 150.0)}),
        ({}, {"period": (0.002, 0.02)}),
        ({}, {"finger.*.device.mass": (0.01, 0.1)}),
    ],
    ids=["reaction varies", "reaction", "stiffening", "device", "object", "gain", "period", "mass"],
)
def test_passivity_guarantees_nothing_for_sets_that_are_not_of_hands_alone(
    passive: gx.Scene, changes: dict[str, Any], ranges: dict[str, Any]
) -> None:
    answer = gx.certify_operators(passive.replace(changes), ranges, samples=2)
    assert not answer.is_passive
    assert "guaranteed:" not in answer.guarantee and "by passivity" not in answer.sentence


@pytest.mark.parametrize("seed", [-1, 1.5, "a", None])
def test_a_seed_is_a_whole_number(seed: Any) -> None:
    with pytest.raises(InputError, match="seed"):
        gx.certify_operators("reference-1dof", [f"{STIFFNESS}=50:1000"], samples=1, seed=seed)


@pytest.mark.parametrize(("low", "high"), [(0.01, 1.0), (0.3, 3.0), (50.0, 1000.0), (0.0, 0.1)])
def test_ranges_end_where_they_say(low: float, high: float) -> None:
    one = OperatorRange("a", low, high, usual_law(low))
    assert one.between(np.array([0.0, 1.0])).tolist() == [low, high]
    assert (one.between(np.linspace(0.0, 1.0, 1001)) <= high).all()


def test_two_keys_have_a_region_drawn(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(certificate_figures, "POINTS", 5)
    ranges = {STIFFNESS: (50.0, 400.0), "finger.*.device.mass": (0.1, 0.2, "uniform")}
    scene = gx.load("paper-spring", {"coupling.external.stiffness": 45.0})
    answer = gx.certify_operators(scene, ranges, samples=8)
    drawing = answer.plot(tmp_path / "operators.png")
    assert (tmp_path / "operators.png").stat().st_size > 10_000
    left, right = drawing.figure.axes[:2]
    assert left.get_xscale() == "log" and left.get_yscale() == "linear"
    assert {line.get_label() for line in right.get_lines()} >= {"internal", "external"}


def test_ranges_and_their_laws() -> None:
    assert OperatorRange.read("a.b=50:1000") == OperatorRange("a.b", 50.0, 1000.0, "log")
    assert OperatorRange.read("a.b=-1:1:normal") == OperatorRange("a.b", -1.0, 1.0, "normal")
    assert OperatorRange.read("a=0:1").law == "uniform"
    middle = np.array([0.5])
    assert OperatorRange("a", 50.0, 1000.0).quantile(middle) == pytest.approx(math.sqrt(50_000.0))
    assert OperatorRange("a", 2.0, 4.0, "normal").quantile(middle) == pytest.approx(3.0)
    assert OperatorRange("a", 1.0, 4.0, "lognormal").quantile(middle) == pytest.approx(2.0)
    ends = OperatorRange("a", 2.0, 4.0, "normal").quantile(np.array([0.0, 1.0]))
    assert ends == pytest.approx([2.0, 4.0])
    # half of the cut bell is within 0.6357 standard deviations, and 1.96 reach the ends
    assert OperatorRange("a", 2.0, 4.0, "normal").quantile(np.array([0.25])) == pytest.approx(
        3.0 - 0.6357 / 1.95996, abs=1e-4
    )
    for text in ("a", "a=1", "a=x:2", "a=2:1", "a=1:inf", "=1:2", "a=-1:1:log"):
        with pytest.raises(InputError):
            OperatorRange.read(text)
    with pytest.raises(UnknownNameError, match="did you mean 'normal'"):
        OperatorRange.read("a=1:2:norml")


def test_points_fill_the_box() -> None:
    assert [radical_inverse(k, 2) for k in (1, 2, 3, 4)] == [0.5, 0.25, 0.75, 0.125]
    set_ = operator_set(gx.load("paper-waving"))
    assert set_.keys == (STIFFNESS, "finger.*.hand.damping") and len(set_.corners()) == 4
    points = np.array(set_.spread(64))
    counts = np.histogram2d(points[:, 0], points[:, 1], bins=4, range=[[0, 1], [0, 1]])[0]
    assert counts.min() >= 2


def test_the_interval_of_clopper_and_pearson() -> None:
    """Their table, and 1 - 0.025^(1/n) where none, or all, are."""
    assert share_of(10, 10).low == pytest.approx(0.6915, abs=1e-4) and share_of(10, 10).high == 1.0
    assert share_of(0, 200).high == pytest.approx(1.0 - 0.025 ** (1.0 / 200.0))
    middle = share_of(5, 10)
    assert [middle.low, middle.high] == pytest.approx([0.1871, 0.8129], abs=1e-4)


def test_a_scene_states_its_operators() -> None:
    table = gx.load("paper-spring").to_dict() | {
        "operators": {STIFFNESS: [50.0, 400.0], "finger.*.device.mass": {"low": 0.1, "high": 0.2, "law": "normal"}}
    }
    scene = gx.Scene(**table)
    set_ = operator_set(scene)
    assert set_.source == "of the scene"
    assert [each.text for each in set_.ranges] == [f"{STIFFNESS}=50:400:log", "finger.*.device.mass=0.1:0.2:normal"]
    assert gx.Scene(**scene.to_dict()) == scene
    for bad in ([5.0, 1.0], [1.0], {"low": 1.0, "high": 2.0, "law": "flat"}, [0.0, 1.0, "log"], 3.0):
        with pytest.raises(SceneError, match="operators"):
            gx.Scene(**(table | {"operators": {STIFFNESS: bad}}))


def test_what_is_no_set_is_refused() -> None:
    scene = gx.load("paper-spring")
    for bad in ([], "a=1:2", {STIFFNESS: 3.0}, {STIFFNESS: ("a", 2.0)}, [f"{STIFFNESS}=1:2", f"{STIFFNESS}=1:3"]):
        with pytest.raises(InputError):
            operator_set(scene, bad)
    with pytest.raises(SceneError, match="did you mean 'hand'"):
        operator_set(scene, ["finger.*.hnd.stiffness=1:2"])
    with pytest.raises(InputError, match="samples"):
        gx.certify_operators(scene, [f"{STIFFNESS}=50:60"], samples=0)


def test_grip_is_the_squeeze_over_the_least_that_carries() -> None:
    """Two fingers with friction 0.5 hold a weight between them: 2 mu f_n / (m g), and with an upward jerk less."""
    finger = {"device": {"name": "simulated", "mass": 0.1, "damping": 0.5}}
    hand = {"stiffness": 400.0, "damping": 4.0, "squeeze": 0.01, "squeeze_ramp": 0.2}
    scene = gx.Scene(
        dimensions=2, period=0.002, duration=2.0, gravity=[0.0, -9.81],
        object={
            "mass": 0.05, "viscosity": 0.0, "shape": {"kind": "box", "size": [0.05, 0.05]}, "free": [True, True, False],
        },
        coupling={"external": {"stiffness": 200.0}, "internal": {"stiffness": 400.0}, "friction": 0.5},
        finger=[
            {**finger, "hand": hand, "start": [-0.025, 0.0]},
            {**finger, "hand": hand, "start": [0.025, 0.0]},
        ],
    )  # fmt: skip
    one = Judge(scene, grips=True).judge({})
    assert one.squeeze == pytest.approx(2.0, rel=1e-3)  # two springs in series, 10 mm
    assert one.grip == pytest.approx(2 * 0.5 * one.squeeze / (0.05 * 9.81), rel=1e-6)
    assert one.displayed == pytest.approx(400.0, rel=1e-6)
    sine = {"kind": "sine", "amplitude": 0.01, "frequency": 2.0, "axis": "y"}
    jerked = Judge(scene, grips=True).judge({"finger.*.hand.motion": sine})
    most = 0.01 * (2 * math.pi * 2.0) ** 2
    assert jerked.grip == pytest.approx(2 * 0.5 * one.squeeze / (0.05 * (9.81 + most)), rel=5e-3)
