"""Guides of hands in a scene: their table, goals that are live, and where hands come to rest."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.build import build
from graspfx.assembly.grasps import most_forces, still_hands
from graspfx.assembly.resolve import resolve
from graspfx.certificate.certify import certificates
from graspfx.errors import InputError, SceneError, UnknownNameError

SPHERE, WAVING = "sphere-three-fingers", "paper-waving"
GOALS: dict[str, Any] = {"offset": [[0.0, 0.0, 0.001], [0.0, 0.002, 0.0], [0.003, 0.0, 0.0]], "squeeze": 0.002}


@pytest.mark.parametrize(
    ("guide", "key", "text"),
    [
        ({"lag": 0.0}, "lag", "expected more than 0"),
        ({"offset": [0.1]}, "offset", "expected 3 numbers"),
        ({"offset": [[0.0, 0.0, 0.0]] * 2}, "offset", "one offset for each of the 3 fingers; given 2"),
        ({"offset": [[0.0] * 3, [0.0] * 2, [0.0] * 3]}, "offset.1", "expected 3 numbers"),
        ({"offset": [0.0, 0.0, float("nan")]}, "offset.2", "a finite number"),
        ({"ofset": [0.0]}, "ofset", "did you mean 'offset'"),
        ({"squeeze": "a"}, "squeeze", "expected a number"),
    ],
)
def test_a_guide_that_is_none_is_a_fault_with_its_place(guide: dict[str, Any], key: str, text: str) -> None:
    with pytest.raises(SceneError) as error:
        gx.load(SPHERE, {"hand.0.guide": guide})
    assert [fault.key for fault in error.value.faults] == [f"hand.0.guide.{key}"]
    assert text in error.value.faults[0].message


def test_a_hand_rests_where_its_guide_has_led_it_and_fades_where_it_closes_itself() -> None:
    plain, guided = (resolve(gx.load(SPHERE, changes)) for changes in ({}, {"hand.0.guide": GOALS}))
    inward = -plain.start / np.linalg.norm(plain.start, axis=1)[:, None]
    [own], [led] = (list(still_hands(parts, inward)) for parts in (plain, guided))
    there = own.hand.target(own.closed)[0] + np.array(GOALS["offset"]) + GOALS["squeeze"] * inward
    assert led.hand.target(led.closed)[0] == pytest.approx(there, abs=1e-15)
    one, other = (most_forces(parts, inward, parts.start) for parts in (plain, guided))
    assert np.array_equal(one, other)
    [none] = still_hands(guided, inward, guided=False)
    assert np.array_equal(none.hand.target(none.closed)[0], own.hand.target(own.closed)[0])


def test_a_guide_without_goals_leaves_certificates_as_they_are_and_one_with_goals_does_not() -> None:
    guide = "finger.*.hand.guide"
    tables: tuple[dict[str, Any], ...] = ({}, {guide: {}}, {guide: {"offset": [0.0, 0.03]}})
    plain, guided, led = (repr(certificates(gx.load(WAVING, table))) for table in tables)
    assert plain == guided
    assert plain != led, "the arms stand elsewhere, with other masses there"


def test_goals_are_live_and_lead_to_where_the_scene_with_them_comes_to_rest() -> None:
    """A squeeze that is set, and one that stands in the file: the same forces once the followers have settled."""
    key = "finger.*.hand.guide.squeeze"
    still = {"finger.*.hand.motion": {"kind": "rest"}, "finger.*.hand.guide": {}}
    with gx.open(gx.load(WAVING, still), live=[key, "finger.0.hand.guide.offset"]) as session:
        session.step(100)
        session.set(key, 0.004)
        with pytest.raises(InputError, match="a live key"):
            session.set("finger.0.hand.stiffness", 50.0)
        with pytest.raises(SceneError):
            session.set("finger.0.hand.guide.offset", [0.0])
        session.step(500)
        force = session.force
    built = gx.run(gx.load(WAVING, still | {key: 0.004}), duration=3.0)
    assert force == pytest.approx(built.finger_force[-1], abs=1e-4)
    assert np.linalg.norm(force, axis=1) == pytest.approx(0.014 * 60.0 * 70.0 / 130.0, rel=1e-3)
    replayed = gx.replay(session.recording)
    assert np.array_equal(replayed.finger_force, session.recording.finger_force)


@pytest.mark.parametrize(
    ("live", "text"),
    [
        ("hand.0.guide.lag", "of a guide, only offset and squeeze can change"),
        ("hand.0.guide", "of a guide, only offset and squeeze can change"),
        ("hand.0.guide.offset", "this scene has no such value"),
    ],
)
def test_what_no_goal_is_does_not_change(live: str, text: str) -> None:
    with pytest.raises((InputError, UnknownNameError), match=text):
        gx.open(SPHERE, live=[live])


def test_variants_of_goals_run_side_by_side_as_one_by_one() -> None:
    scene, key = gx.load(SPHERE, {"hand.0.guide": {}}), "hand.0.guide.squeeze"
    values = [-0.002, 0.0, 0.003]
    batch = gx.run_batch(scene, {key: values}, duration=0.3, keep="recordings")
    assert batch.recordings is not None
    for value, one in zip(values, batch.recordings.tolist(), strict=True):
        alone = gx.run(scene.replace({key: value}), duration=0.3)
        assert np.array_equal(one.finger_force, alone.finger_force), value


def test_goals_alone_make_no_plant_live() -> None:
    scene = gx.load(SPHERE, {"hand.0.guide": {}})
    for live, expected in ((["hand.0.guide.offset"], False), (["hand.0.squeeze"], True)):
        with build(scene, live=live) as servo:
            plant: Any = servo.plants[0].plant
            assert plant.live is expected
