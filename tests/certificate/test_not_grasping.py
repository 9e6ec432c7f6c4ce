"""Scenes whose fingers touch nothing: the verdict is that there is no grasp, with the nearest finger's distance."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

import graspfx as gx
from graspfx.__main__ import main

GAP = 0.0127  # [m]
SHAPES = [
    {"kind": "sphere", "radius": 0.03},
    {"kind": "box", "size": [0.06, 0.05, 0.05]},
    {"kind": "capsule", "radius": 0.01, "length": 0.04},
    {"kind": "ellipsoid", "semi_axes": [0.03, 0.02, 0.02]},
]


def apart(gap: float = GAP, shape: dict[str, Any] | None = None, **hand: Any) -> gx.Scene:
    """Two fingers beside an object of 60 mm, each at a gap from it."""
    point = {"name": "simulated", "mass": 0.1, "damping": 0.5}
    return gx.Scene(
        dimensions=3,
        period=0.001,
        duration=0.02,
        object={
            "mass": 0.1,
            "viscosity": 0.5,
            "rotational_viscosity": 1e-3,
            "shape": {"kind": "box", "size": [0.06, 0.05, 0.05]} if shape is None else shape,
        },
        coupling={"external": {"stiffness": 100.0}, "internal": {"stiffness": 200.0}, "friction": "stick"},
        finger=[
            {"device": point, "hand": {"stiffness": 200.0, **hand}, "start": [side * (0.03 + gap), 0.0, 0.0]}
            for side in (1.0, -1.0)
        ],
    )


@pytest.mark.parametrize("absent", ["fade", "follow"])
def test_fingers_out_of_reach_are_no_grasp(absent: str) -> None:
    scene = apart().replace({"coupling.absent": absent})
    report = gx.check(scene)
    assert report.verdict.startswith("not grasping: nearest finger 12.7 mm away from object")
    assert not report.ok
    for certificates in (gx.certify(scene), gx.certify(scene, quick=True), gx.certify(scene, recording=gx.run(scene))):
        (one,) = certificates
        assert not certificates.stable and not one.stable and math.isnan(one.spectral_radius) and not one.limits
        assert one.gap == pytest.approx(GAP, abs=1e-9)
        assert "not grasping" in repr(certificates) and "not grasping" in repr(one)
        assert json.loads(json.dumps(certificates.to_dict(), allow_nan=False))["stable"] is False


def test_hands_that_open_let_go() -> None:
    """It was stable by its contacts at the start, which nobody keeps."""
    scene = gx.load("paper-waving").replace({"finger.*.hand.squeeze": -0.02})
    assert gx.certify(scene)[0].verdict.startswith("not grasping: nearest finger 20 mm away from object")


def test_strict_refuses_a_scene_without_a_grasp(capsys: pytest.CaptureFixture[str]) -> None:
    changes = ["--set", "finger.0.start=[-0.05]", "--set", "finger.1.start=[0.05]"]
    changes += ["--set", "finger.0.hand.rest=[-0.05]", "--set", "finger.1.hand.rest=[0.05]"]
    assert main(["check", "paper-spring", "--brief", "--strict", *changes]) == 1
    assert capsys.readouterr().out.startswith("not grasping: nearest finger ")


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape["kind"])
def test_the_distance_is_that_of_the_nearest_finger_with_the_hands_closed(shape: dict[str, Any]) -> None:
    far = gx.check(apart(GAP, shape)).certificates[0].gap
    closed = gx.check(apart(GAP, shape, squeeze=0.002)).certificates[0].gap
    assert far > 0.0 and closed == pytest.approx(far - 0.002, abs=1e-6)


def test_hands_that_close_on_the_object_grasp_it() -> None:
    (one,) = gx.certify(apart(0.001, squeeze=0.006))
    assert one.stable and one.at == "squeezed" and math.isnan(one.gap)
    assert gx.check(apart(0.001, squeeze=0.006)).verdict.startswith("stable: ")


def test_of_two_objects_the_one_that_is_not_touched_leads() -> None:
    scene = gx.load("two-objects")
    second = scene.object[1].name
    moved = [dict(table) for table in scene.to_dict()["object"]]
    moved[1]["position"] = [x + 0.5 for x in moved[1].get("position", [0.0] * scene.dimensions)]
    report = gx.check(gx.Scene(**{**scene.to_dict(), "object": moved}))
    assert report.verdict.startswith("not grasping: nearest finger ") and second in report.verdict and not report.ok


def test_no_figure_is_taken_from_fingers_that_touch_nothing() -> None:
    with pytest.raises(gx.errors.InputError, match=r"nearest finger 12\.7 mm away"):
        gx.stability.spectral_radius(apart())
    operators = {"finger.*.hand.stiffness": (100.0, 300.0)}
    answer = gx.certify_operators(apart(), operators, samples=2)
    assert not answer.stable and "brings no finger to an object" in answer.sentence
    assert any("the scene's own: not grasping" in line for line in answer.lines())


def spare(kep: float, kip: float, fingers: int = 3) -> gx.Scene:
    """Two fingers squeeze a disc; a third one stays 4 mm above it."""
    table: list[dict[str, Any]] = []
    for x, y in ((0.03, 0.0), (-0.03, 0.0), (0.0, 0.034))[:fingers]:
        hand = {"stiffness": 300.0, "damping": 1.0, "squeeze": 0.0 if y else 0.005}
        table.append({"device": {"name": "simulated", "mass": 0.15, "damping": 0.2}, "hand": hand, "start": [x, y]})
    thing = {"mass": 0.1, "viscosity": 0.8, "rotational_viscosity": 1e-3, "shape": {"kind": "sphere", "radius": 0.03}}
    gains = {"external": {"stiffness": kep, "damping": 0.05}, "internal": {"stiffness": kip, "damping": 0.05}}
    coupling = {"friction": "stick", **gains}
    return gx.Scene(dimensions=2, period=0.004, duration=1.0, object=thing, coupling=coupling, finger=table)


def test_a_finger_that_stays_away_leaves_a_grasp_not_judged() -> None:
    """It counted as if it touched: radius 1.0046, NOT STABLE, where the two that hold the disc have 0.9986."""
    scene = spare(170.0, 250.0)
    report = gx.check(scene)
    assert report.verdict.startswith("not judged: object: ") and "finger2 does not touch the object" in report.verdict
    assert "omit them" in report.verdict and not report.ok and report.certificates == ()
    recording = gx.run(scene)
    assert recording.touching[-1].tolist() == [True, True, False]
    ways: list[dict[str, Any]] = [{}, {"quick": True}, {"recording": recording}]
    for how in ways:
        with pytest.raises(gx.errors.NoRestError, match=r"finger2 does not touch the object; .*omit them"):
            gx.certify(scene, **how)
    (two,) = gx.certify(spare(170.0, 250.0, 2))
    assert two.stable and two.at == "squeezed" and recording.summary()["growth"] == []
    operators = gx.certify_operators(scene, {"finger.*.hand.stiffness": (100.0, 300.0)}, samples=2)
    assert not operators.stable and any("do not come to rest" in line for line in operators.lines())
    assert any(line.startswith("  the scene's own: no rest") for line in operators.lines())


@pytest.mark.parametrize(("scene", "why"), [(apart(), "nearest finger 12.7 mm"), (spare(170.0, 250.0), "finger2 does")])
def test_gains_of_what_is_no_grasp_are_not_tuned_without_a_reason(scene: gx.Scene, why: str) -> None:
    """It said that the margin comes to 0 at best, and no more; or ended in an error after all judgements."""
    answer = gx.tune(
        scene, "internal.stiffness", "margin >= 1.3", over={"internal.stiffness": (150.0, 300.0)}, operators="own"
    )
    assert not answer.feasible and "cannot be judged" in answer.reason and why in answer.reason


def test_values_in_the_place_of_quick_are_refused() -> None:
    """They were taken for `quick=True`: a provisional answer for the scene without them."""
    with pytest.raises(gx.errors.InputError, match=r"quick: .*expected True or False; .*gx\.load\(scene, values\)"):
        gx.certify("paper-waving", {"coupling.internal.stiffness": 600.0})  # type: ignore[arg-type]
