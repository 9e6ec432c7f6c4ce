"""Keys that may change in mid-run: by which names, to which values, and what is refused."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

import graspfx as gx
from graspfx.assembly.build import build
from graspfx.assembly.steering import Steering
from graspfx.errors import InputError, SceneError, UnknownNameError
from tests.support import foreign_parts
from tests.support.steering import KIP, TICKS, steered


def test_values_are_those_of_the_scene_and_of_what_was_set() -> None:
    live = [KIP, "finger.*.device.mass", "finger.1.hand.stiffness", "object.mass", "coupling.fade"]
    with gx.open("reference-1dof", live=live) as session:
        assert session.live == tuple(live)
        assert dict(session.values) == {KIP: 70.0, "finger.*.device.mass": 0.15, "finger.1.hand.stiffness": 33.0,
                                        "object.mass": 0.1, "coupling.fade": "auto"}  # fmt: skip
        session.set({KIP: 50.0, "finger.0.device.mass": 0.2})  # one of those that `*` stands for
        assert session.get(KIP) == 50.0 and session.get("finger.*.device.mass") == (0.2, 0.15)
        assert session.get("period") == 0.005
        session.step(2)
        assert [tuple(change) for change in session.recording.changes] == [
            (0, KIP, 50.0), (0, "finger.0.device.mass", 0.2),
        ]  # fmt: skip
        session.set({})
    assert session.recording.header.scene_table["coupling"]["internal"]["stiffness"] == 70.0


NAMES: dict[str, tuple[str, str, str, float, int]] = {  # scene, a key with a number, with a name, value, ticks
    "device": ("pick-and-place", "finger.0.device.mass", "finger.thumb.device.mass", 0.4, 150),
    "friction": ("carry-bar", "finger.0.friction", "finger.left-thumb.friction", 0.05, 300),
    "hand": ("two-objects", "hand.0.squeeze", "hand.left.squeeze", 0.03, 10),
    "object": ("mug", "object.0.viscosity", "object.object.viscosity", 3.0, 150),
}


@pytest.mark.parametrize("case", NAMES)
def test_a_name_stands_for_the_number_of_its_table(case: str) -> None:
    name, number, written, value, ticks = NAMES[case]
    runs = []
    for live, key in ((number, number), (number, written), (written, written), (number, None)):
        with gx.open(name, live=[live]) as session:
            session.step(ticks)
            if key is not None:
                session.set(key, value)
                assert session.get(written) == session.get(number) == value
            session.step(150)
        runs.append(session.recording)
    assert len({rec.rows.tobytes() for rec in runs[:3]}) == 1 and runs[0].rows.tobytes() != runs[3].rows.tobytes()
    assert [tuple(rec.changes[0]) for rec in runs[:3]] == [(ticks, number, value)] * 3


def test_a_table_has_one_value_by_its_name_and_its_number() -> None:
    with gx.open("pick-and-place", live=["finger.*.device.mass"]) as session:
        with pytest.raises(InputError, match=r"finger.thumb.device.mass: given 0.5, expected one value for finger.0"):
            session.set({"finger.0.device.mass": 0.4, "finger.thumb.device.mass": 0.5})
        assert not session.recording.changes


def test_an_update_that_would_change_nothing_is_refused() -> None:
    scene = gx.load("pick-and-place")
    key = "finger.0.device.mass"
    with build(scene, live=[key]) as servo:
        steering = Steering(servo, scene, [key])
        assert steering.update(scene.replace({key: 0.4}), {key: 0.4}).parts
        with pytest.raises(InputError, match="a key of a value in the run"):
            steering.update(scene.replace({key: 0.4}), {"finger.thumb.device.mass": 0.4})


def test_what_is_not_live_cannot_be_set() -> None:
    with gx.open("reference-1dof", live=[KIP]) as session:
        with pytest.raises(
            InputError,
            match=r"live keys are coupling.internal.stiffness: add it, as in gx.open\(scene, live=\['object.mass",
        ):
            session.set("object.mass", 0.2)
        with pytest.raises(InputError, match="a live key"):
            session.set({KIP: 50.0, "period": 0.001})
        assert session.get(KIP) == 70.0 and not session.recording.changes
    with gx.open("reference-1dof") as session, pytest.raises(InputError, match="there are no live keys: add it"):
        session.set(KIP, 50.0)


def test_a_value_that_a_scene_does_not_allow_changes_nothing() -> None:
    with gx.open("reference-1dof", {"engine": "interpreted"}, live=[KIP, "object.mass"]) as session:
        session.step(3)
        with pytest.raises(SceneError) as error:
            session.set({KIP: -1.0, "object.mass": "heavy"})
        assert {fault.key for fault in error.value.faults} == {KIP, "object.0.mass"}
        assert session.get(KIP) == 70.0 and not session.recording.changes
        session.step(TICKS - 3)
    plain = gx.run(gx.load("reference-1dof"), duration=TICKS * 0.005)
    assert session.recording.rows.tobytes() == plain.rows.tobytes()


FORM = "a value of the same form as at the start"
ABOVE = "coefficients of friction that are above zero for the same fingers"
REFUSALS: dict[str, tuple[str, Mapping[str, Any], str, Any, str]] = {  # scene, overrides, key, value, why
    "a number to matrices": ("paper-spring", {}, KIP, [[70.0]], FORM),
    "matrices to a number": ("paper-spring", {KIP: [[70.0]]}, KIP, 70.0, FORM),
    "no friction to some": ("paper-spring", {}, "coupling.friction", 0.5, ABOVE),
    "friction to none": ("sphere-three-fingers", {}, "coupling.friction", 0.0, ABOVE),
    "friction to stick": ("sphere-three-fingers", {}, "coupling.friction", "stick", ABOVE),
    "none to stick": ("paper-spring", {}, "coupling.friction", "stick", FORM),
    "one finger to none": ("sphere-three-fingers", {}, "finger.0.friction", 0.0, ABOVE),
    "steps of a squeeze": (
        "sphere-three-fingers", {}, "hand.squeeze",
        [{"to": 0.01, "begin": 0.1, "duration": 0.1}, {"to": 0.0, "begin": 1.0, "duration": 0.1}],
        "a fixed memory layout",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSALS)
def test_what_would_change_more_than_numbers_is_refused(case: str) -> None:
    name, overrides, key, value, why = REFUSALS[case]
    with gx.open(name, {**overrides, "engine": "interpreted"}, live=[key]) as session:
        for ticks in (0, 2):
            if ticks:
                session.step(ticks)
            with pytest.raises(InputError, match=why) as error:
                session.set(key, value)
            assert key in str(error.value) and not session.recording.changes


@pytest.mark.parametrize(
    ("name", "overrides", "key", "why"),
    [
        ("reference-1dof", {}, "period", "ticks are counted in periods"),
        ("reference-1dof", {}, "object.position", "objects and fingers continue from their present state"),
        ("reference-1dof", {}, "finger.0.start", "objects and fingers continue from their present state"),
        ("reference-1dof", {}, "object.shape.size", "which bodies exist"),
        ("reference-1dof", {}, "coupling.contact", "its value selects the computation of forces"),
        ("reference-1dof", {}, "coupling.passivity", "whether energy is observed or controlled"),
        ("reference-1dof", {}, "finger.*.radius", "the memory layout of contacts"),
        ("reference-1dof", {"coupling.passivity": "observe"}, "object.mass", "the energy ledger"),
        ("reference-1dof", {"coupling.metric": "mass"}, "finger.*.device.mass", "coupling.split = 'mass'"),
        ("paper-spring-arms", {}, "finger.*.device.mass", "only the mechanics of a simulated point"),
    ],
)
def test_keys_that_cannot_be_live(name: str, overrides: Mapping[str, Any], key: str, why: str) -> None:
    with pytest.raises(InputError, match=why) as error:
        gx.open(name, overrides, live=[key])
    assert f"given '{key}'" in str(error.value)


def test_a_hand_of_a_plug_in_that_has_its_directions_refuses_others(tmp_path: Path) -> None:
    """The implicit integrator meets fingers where viscosity takes the object: their normals are the hand's."""
    key = "object.viscosity"
    hand = {"name": "right", "kind": foreign_parts.write(tmp_path)["hands"], "called": True}
    scene = gx.load("sphere-three-fingers").replace({"hand": [hand]})
    moving = scene.replace({"object.integrator": "implicit", "object.velocity": [0.3, 0.0, 0.0]})
    with gx.open(moving, live=[key]) as session:
        with pytest.raises(InputError, match="a hand or a motion of a plug-in already uses the normals"):
            session.set(key, 30.0)
        assert not session.recording.changes
        session.step(2)
        session.set(key, 30.0)
    assert steered(scene, {0: {key: 30.0}}, 9).rows.tobytes() == (
        gx.run(scene.replace({key: 30.0}), duration=9 * scene.period).rows.tobytes()
    )


@pytest.mark.parametrize(
    ("name", "key", "why"),
    [
        ("reference-1dof", "hand.*.stiffness", r"did you mean 'finger.\*.hand.stiffness'"),
        ("reference-1dof", "finger.9.friction", r"did you mean 'finger.\*.friction'"),
        ("reference-1dof", "finger.*.hand.grip.stiffness", r"did you mean 'finger.\*.hand.stiffness'"),
        ("sphere-three-fingers", "finger.*.hand.stiffness", "this scene has no such value"),
        ("sphere-three-fingers", "hand.*.stiffness", "this scene has no such value"),
        ("paper-waving", "finger.*.hand.motion.1.amplitude", "this scene has no such value"),
    ],
)
def test_keys_that_a_scene_does_not_have(name: str, key: str, why: str) -> None:
    with pytest.raises(UnknownNameError, match=why) as error:
        gx.open(name, live=[key])
    assert f"unknown live key {key!r}" in str(error.value)


@pytest.mark.parametrize("key", ["finger.*.hand.motion.0.amplitude", "finger.0.hand.motion.amplitude"])
def test_a_lone_motion_may_be_counted(key: str) -> None:
    runs = []
    for live in (key, "finger.*.hand.motion.amplitude"):
        with gx.open("paper-waving", {"engine": "interpreted"}, live=[live]) as session:
            assert session.get(key) == 0.05
            session.step(250)
            session.set(live if live == key else key.replace(".0.amplitude", ".amplitude"), 0.03)
            assert session.get(key) == 0.03
            session.step(50)
        runs.append(session.recording.rows.tobytes())
    assert runs[0] == runs[1]


@pytest.mark.parametrize("live", [5, None, 1.0])
def test_live_keys_that_are_no_list(live: Any) -> None:
    with pytest.raises(InputError, match="a list of keys of the scene"):
        gx.open("reference-1dof", live=live)


@pytest.mark.parametrize("key", ["finger", "finger.*", "object.0", "hand"])
def test_whole_tables_are_not_live(key: str) -> None:
    with pytest.raises(InputError, match=f"'{re.escape(key)}' denotes whole tables"):
        gx.open("reference-1dof", live=[key])


def test_keys_that_are_none() -> None:
    with pytest.raises(UnknownNameError, match=r"did you mean 'coupling.internal.stiffness'"):
        gx.open("reference-1dof", live="coupling.internal.stifness")
    with pytest.raises(UnknownNameError, match=r"known: coupling.blend"):
        gx.open("reference-1dof", live=["colour"])
    with pytest.raises(InputError, match="a dotted key of the scene"):
        gx.open("reference-1dof", live=[3])  # type: ignore[list-item]


@pytest.mark.parametrize(
    ("key", "value"), [("hand.right.arm.stiffness", 150.0), ("object.knob.viscosity", 3.0), ("hand.arm.damping", 2.0)]
)
def test_a_live_key_by_the_name_of_a_lone_table(key: str, value: float) -> None:
    scene = gx.load("knob", {"engine": "interpreted"})
    with gx.open(scene, live=[key]) as session:
        session.set(key, value)
        assert session.get(key) == value
        session.step(8)
    built = scene.replace({key: value})
    assert built != scene
    assert session.recording.rows.tobytes() == gx.run(built, duration=8 * scene.period).rows.tobytes()


@pytest.mark.parametrize(
    ("key", "says"),
    [
        ("x", r"unknown key 'x' \(known: coupling, device, dimensions, "),
        ("perod", "unknown key 'perod'; did you mean 'period'"),
        ("replace", "unknown key 'replace'"),
        ("coupling.internal.stifness", "unknown key of coupling.internal 'stifness'; did you mean 'stiffness'"),
        ("object.mss", "unknown key of object.0 'mss'; did you mean 'mass'"),
        ("finger.nobody.friction", r"unknown name or number of finger 'nobody' \(known: 0, 1, 2, 3, .*thumb"),
        ("finger.9.friction", "unknown name or number of finger '9'"),
        ("finger.0.device.mas", "unknown key of finger.0.device 'mas'; did you mean 'mass'"),
    ],
)
def test_a_key_that_is_none_is_told_with_one_that_comes_close(key: str, says: str) -> None:
    with gx.open("knob", {"engine": "interpreted"}, live=[KIP]) as session:
        with pytest.raises(UnknownNameError, match=says):
            session.get(key)
        with pytest.raises(UnknownNameError, match=says):
            session.set(key, 1.0)
        assert not session.recording.changes


def test_keys_without_a_value_here() -> None:
    with gx.open("knob", {"engine": "interpreted"}, live=[KIP]) as session:
        for key, says in (
            ("finger.0.device.resolution", "a setting that is in the scene; the driver's default applies"),
            ("finger.0.hand.stiffness", "if a finger refers to a table by its name"),
            ("finger.*.hand.stiffness", "if a finger refers to a table by its name"),
            ("period.x", "period is a value and has no parts"),
        ):
            with pytest.raises(InputError, match=says):
                session.get(key)
            with pytest.raises(InputError, match="a live key"):
                session.set(key, 1.0)
        assert session.get("hand.motion.0.duration") == session.get("hand.right.motion.duration") == 0.2
        assert session.get("finger.thumb.start.0") == session.get("finger.0.start")[0] == -0.041
        with pytest.raises(UnknownNameError, match=r"unknown live key 'x' \(known: coupling.internal.stiffness\)"):
            session.values["x"]
