"""Arguments that a user mistakes: names, paths, indices, counts, times; each is an error of GraspFX that names it."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import GraspFXError

POINTS = np.array([[0.05, 0.0, 0.0], [-0.02, 0.04, 0.0], [-0.02, -0.04, 0.01]])
STIFFNESS = "coupling.internal.stiffness"
PLAIN: dict[str, Any] = {"engine": "interpreted", "duration": 0.05}
Call = Callable[[Any], object]


@pytest.fixture(scope="module")
def rec() -> gx.Recording:
    return gx.run("sphere-three-fingers", PLAIN)


def refused(call: Call, name: str, *wrong: Any) -> None:
    for value in wrong:
        with pytest.raises(GraspFXError) as caught:
            call(value)
        assert name in str(caught.value), value


GRASPS: dict[str, tuple[Call, str, tuple[Any, ...]]] = {
    "kind": (lambda v: gx.divide(gx.Grasp(POINTS), np.zeros(9), v), "kind of split", (np.ones(3), None, "mas")),
    "kind of a split": (lambda v: gx.Split(gx.Grasp(POINTS), kind=v), "kind of split", (np.ones(3), [1.0])),
    "pairs": (lambda v: gx.Grasp(POINTS).virtual_linkage(v).coordinates, "pairs",
              (3, "ab", [0, 1], [(0, 1, 2)], [(0.5, 1)], [(0, 3)], [(-1, 0)], [(1, 1)], [None], [(0, 1), (2,)])),
    "R": (gx.Coupling(gx.Impedance(np.eye(3)), gx.Impedance(70.0)).turned, "R", (None, "a", np.zeros(3), POINTS[:2])),
    "R of an object": (gx.ObjectImpedance(np.eye(6)).turned, "R", (None, "a", np.eye(2), [[1.0]])),
    "origin": (gx.ObjectImpedance(np.eye(6), point=np.zeros(3)).about, "origin", (None, "a", [0.0, 0.0], 1.0)),
    "fingers": (lambda v: gx.PointCoupling(gx.Impedance(1.0), gx.Impedance(1.0), v), "fingers",
                (None, "a", 1.5, math.nan, math.inf, [3], True)),
    "engine": (lambda v: gx.PointCoupling(gx.Impedance(1.0), gx.Impedance(1.0), 3, engine=v), "engine", (None, 1, [2])),
    "grasp": (gx.least_friction, "grasp", (None, gx.grasp_matrix(POINTS), "a")),
    "margin": (lambda v: gx.stability.least_wall_friction(0.1, 0.001, 100.0, margin=v), "margin",
               (-1.0, 0.0, math.nan, math.inf, None, "a", [1.0, 2.0])),
    "period": (lambda v: gx.stability.least_friction(0.1, v, 0.1, 0.8, 100.0), "period", (0.0, -1.0, None, "a")),
    "points": (lambda v: gx.Feedback().update(v, POINTS, 1.0), "points", ("a", [[1.0], [1.0, 2.0]], {}, None)),
    "time": (lambda v: gx.Feedback().update(POINTS, POINTS, v), "time", (None, "a", [1.0], math.nan)),
    "push_gain": (gx.Feedback, "push_gain", ([[]], np.ones((2, 3)), "a", [1.0, 1.0])),
    "timeout": (lambda v: gx.Feedback().connect("nobody", timeout=v), "timeout", (None, "a", math.nan, [1.0])),
    "at": (gx.load("reference-1dof").linearise, "None", (None,)),
}  # fmt: skip


@pytest.mark.parametrize("case", GRASPS)
def test_of_a_grasp(case: str) -> None:
    call, name, wrong = GRASPS[case]
    refused(call, name, *wrong)


def test_of_a_recording(rec: gx.Recording, tmp_path: Path) -> None:
    refused(lambda v: rec.part(v, 5), "first", None, "a", 1.5, -1, math.nan)
    refused(lambda v: rec.part(0, v), "stop", None, "a", 1.5, -1, math.nan)
    refused(lambda v: rec.read(v, 0, 5), "column", "finger_positoin", None, [])
    refused(lambda v: rec.read("finger_position", v, 5), "first", -1, "a")
    refused(rec.grip_margin_of, "fingers", None, "a", [3], [-1], [0.5], 0, [[0]], [[0], [1, 2]])
    refused(rec.save, "path", "")
    refused(lambda v: rec.plot(titles=v), "titles", 1, ["one", "two"], [1])
    refused(lambda v: rec.plot(width=v), "width", ["page"], "pge", None)
    refused(lambda v: gx.replay(rec, out=v), "out", 1, ["a"], b"a")
    assert not list(tmp_path.iterdir())


def test_a_part_ends_within_the_recording(rec: gx.Recording) -> None:
    N = len(rec)
    part = rec.part(N - 3, N + 10)
    assert np.array_equal(part.time, rec.time[-3:])
    assert np.array_equal(rec.read("finger_position", N - 3, N + 10), rec.finger_position[-3:])
    assert not len(rec.part(5, 2))


def test_of_a_scene_and_its_sessions(tmp_path: Path) -> None:
    scene = gx.load("paper-waving", PLAIN)
    refused(gx.Session, "scene", "paper-waving", Path("paper-waving"))
    with gx.open(scene, live=[STIFFNESS]) as session:
        refused(lambda v: session.set(v, 60.0), "key", [STIFFNESS], None, 1)
    with gx.open(scene, live=[STIFFNESS], real_time=True) as session:
        assert isinstance(session, gx.RealTimeSession)
        refused(session.wait, "seconds", None, "a", math.nan, [1.0])
        assert session.wait(-1.0)
    for presets in (None, "a", {"soft": 1.0}, {"soft": {STIFFNESS: "a"}}):
        refused(lambda v: scene.to_html(tmp_path / "a.html", presets=v), "presets", presets)
    assert not list(tmp_path.iterdir())


def test_of_a_table_of_trials(tmp_path: Path) -> None:
    table = tmp_path / "sub-01_beh.tsv"
    table.write_text("trial\tresponse\n1\tfirst\n", "utf-8")
    assert gx.experiment.read_table(str(table)) == [{"trial": "1", "response": "first"}]
    refused(gx.experiment.read_table, "path", None, "no_beh.tsv", 1, tmp_path)


def test_of_operators_and_sweeps() -> None:
    scene = gx.load("paper-spring", {"coupling.external.stiffness": 40.0, STIFFNESS: 40.0})
    refused(lambda v: gx.certify_operators(scene, v, samples=2), "operators", [1], [None], [["a"]])
    refused(lambda v: gx.tune(scene, subject_to=v), "subject_to", None, 1.5, [1], [["margin >= 1"]])
    answer = gx.certify_operators(scene, {"finger.*.hand.stiffness": (50.0, 100.0)}, samples=2)
    refused(lambda v: answer.gains(v), "points", None, "a", 1, 2.5, math.nan)
    refused(lambda v: answer.gains(2, v), "span", None, "a", math.inf, [4.0])
    refused(lambda v: answer.region(points=v), "points", None, "a", 1, 2.5)
    refused(lambda v: answer.region(v), "keys", 1, [1], [["a"]])
    sweep = gx.sweep(scene, {STIFFNESS: [40.0, 50.0]}, duration=0.01)
    assert sweep.overrides(1) == {STIFFNESS: 50.0}
    refused(sweep.overrides, "variant", 2, -1, None, "a", 0.5)
    refused(sweep.reasons, "most", "a", 1.5, -1)
