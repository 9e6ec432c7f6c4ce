"""Sliders: which numbers a scene lets change, and in which range."""

from __future__ import annotations

import math

import pytest

import graspfx as gx
from graspfx.live.certifier import Certifier, MarginRow, Verdict
from graspfx.live.sliders import Slider, sliders, value_in, values_of, widened

FRICTION = "coupling.friction"
SCENES = (
    "reference-1dof",
    "paper-waving",
    "sphere-three-fingers",
    "mug",
    "knob",
    "soft-pads",
    "two-objects",
    "carry-bar",
)
GAINS = [f"coupling.{share}.{quantity}" for share in ("external", "internal") for quantity in ("stiffness", "damping")]


def of(scene: gx.Scene) -> dict[str, Slider]:
    return {slider.key: slider for slider in sliders(scene)}


@pytest.mark.parametrize("name", SCENES)
def test_every_slider_moves_a_number_of_a_run(name: str) -> None:
    """Both ends of each range, and the value in it, are taken by a session with all of them live."""
    scene = gx.load(name)
    each = of(scene)
    assert list(each)[:4] == GAINS
    for slider in each.values():
        assert 0.0 <= slider.least <= slider.value <= slider.most
        assert slider.least < slider.most
        assert 100 <= (slider.most - slider.least) / slider.step <= 500
    with gx.open(scene, live=list(each)) as session:
        session.step(3)
        for slider in each.values():
            for value in (slider.least, slider.most, slider.value):
                session.set(slider.key, value)
                session.step(1)
        assert not session.fault


def test_labels_have_words_letter_and_unit() -> None:
    texts = {slider.key: (slider.label, slider.unit) for slider in sliders(gx.load("sphere-three-fingers"))}
    assert texts[GAINS[0]] == ("external stiffness, k_ep", "N/m")
    assert texts[GAINS[3]] == ("internal damping, k_id", "N s/m")
    assert texts[FRICTION] == ("friction, µ", "")
    assert texts["object.mass"] == ("mass, m", "kg")
    assert texts["object.rotational_viscosity"] == ("rotational viscosity, b_w", "N m s/rad")


def test_what_cannot_change_has_no_slider() -> None:
    """Masses of objects on planes, or with a ledger; what other software moves; friction where there is none."""
    mug = of(gx.load("mug"))
    assert "object.density" not in mug and "object.viscosity" in mug
    two = of(gx.load("two-objects"))
    assert not {"object.0.mass", "object.1.viscosity"} & set(two)
    assert FRICTION not in of(gx.load("reference-1dof"))
    own = of(gx.load("sphere-three-fingers", {"finger.1.friction": 0.4}))
    assert own["finger.1.friction"].label == "friction of index, µ"
    assert "object.mass" in own
    assert "object.mass" not in of(gx.load("sphere-three-fingers", {"coupling.passivity": "observe"}))


def test_a_gain_that_is_no_number_has_no_slider() -> None:
    """A matrix, or a gain of each finger, is not moved by one slider: the others are there."""
    scene = gx.load("sphere-three-fingers", {GAINS[0]: [[200.0, 0.0, 0.0], [0.0, 300.0, 0.0], [0.0, 0.0, 250.0]]})
    assert GAINS[0] not in of(scene)
    assert GAINS[2] in of(scene)


@pytest.mark.parametrize("name", ["paper-waving", "sphere-three-fingers", "mug"])
def test_ranges_reach_beyond_limits(name: str) -> None:
    scene = gx.load(name)
    verdict = list(Certifier(scene).stages({}))[-1]
    limits = {row.mode: row.limit for row in verdict.rows}
    for slider in sliders(scene):
        wide = widened(slider, verdict)
        if slider.key in (GAINS[0], GAINS[2]):
            limit = limits[slider.key.split(".")[1]]
            assert math.isfinite(limit)
            assert wide.least <= wide.value <= limit < wide.most
            assert widened(wide, verdict) is wide
        else:
            assert wide is slider


def stiff(**more: object) -> gx.Scene:
    """The pinch of the paper with a stiffness of the object whose freedoms are coupled."""
    K = [[80.0, 5.0, 0.3], [5.0, 60.0, 0.1], [0.3, 0.1, 0.05]]
    return gx.load("paper-waving", {"coupling.external": {"object_stiffness": K}, **more})


def test_a_stiffness_of_the_object_has_two_factors() -> None:
    """On translation and rotation, at 1; both act together on K_o, whose coupling goes by the root of both."""
    scene = stiff()
    both = [slider for slider in sliders(scene) if slider.stiffness is not None]
    assert [slider.label for slider in both] == [
        f"stiffness of the object in {s}, factor" for s in ("translation", "rotation")
    ]
    assert [(slider.least, slider.value, slider.most) for slider in both] == [(0.1, 1.0, 5.0)] * 2
    values = {both[0].key: 4.0, both[1].key: 0.25}
    [(key, K)] = values_of(both[0], both, values).items()
    assert key == "coupling.external.object_stiffness"
    assert K == [[320.0, 20.0, 0.3], [20.0, 240.0, 0.1], [0.3, 0.1, 0.0125]]
    assert values_of(both[1], both, values) == {key: K}
    assert [value_in(slider, {key: K}) for slider in both] == [4.0, 0.25]
    assert value_in(both[0], {"coupling.friction": 0.3}) is None


def test_the_factors_move_a_run() -> None:
    """A run takes both ends of both factors."""
    scene = stiff()
    both = [slider for slider in sliders(scene) if slider.stiffness is not None]
    key = "coupling.external.object_stiffness"
    with gx.open(scene, live=[key]) as session:
        session.step(20)
        for slider in both:
            for value in (slider.least, slider.most, 1.0):
                session.set(key, values_of(slider, both, {each.key: 1.0 for each in both} | {slider.key: value})[key])
                session.step(5)
        assert not session.fault
        assert [change.key for change in session.recording.changes] == [key] * 6


def test_without_a_rotation_there_is_one_factor() -> None:
    scene = gx.load("reference-1dof", {"coupling.external": {"object_stiffness": 40.0}})
    assert [slider.key.rpartition(".")[2] for slider in sliders(scene) if slider.stiffness is not None] == [
        "translation"
    ]


def test_a_factor_is_widened_beyond_its_margin() -> None:
    """By the margin of its mode, times the factor that the margin is of; one within the range stays."""
    both = [slider for slider in sliders(stiff()) if slider.stiffness is not None]
    rows = [MarginRow("external translation", "object", math.nan, math.nan, 4.0, 5.0),
            MarginRow("external rotation", "object", math.nan, math.nan, math.inf, math.nan)]  # fmt: skip
    key, now = next(iter(values_of(both[0], both, {both[0].key: 2.0, both[1].key: 1.0}).items()))
    assert [widened(slider, Verdict(rows=tuple(rows))).most for slider in both] == [5.0, 5.0]
    twice = Verdict(values={key: now}, rows=tuple(rows))
    assert [widened(slider, twice).most for slider in both] == [20.0, 5.0]  # 1.5 x 2 x 4 = 12, rounded up
