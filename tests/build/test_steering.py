"""A run that is steered and a run that is built with those values are the same, bit by bit."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.build.build import build
from graspfx.build.steering import Steering
from graspfx.compile.entry_names import name_of
from graspfx.compile.records import start_of
from graspfx.coupling.grasp_state import GraspState
from graspfx.coupling.two_forces import two_forces
from graspfx.errors import InputError, SceneError, UnknownNameError
from graspfx.loop.recording.header import Header
from graspfx.loop.recording.recorder import Recorder
from tests.support import foreign_parts
from tests.support.scenes import random_table
from tests.support.small_scenes import attached, line

KEP, KED, KIP, KID = (f"coupling.{a}.{b}" for a in ("external", "internal") for b in ("stiffness", "damping"))
TICKS = 90
CASES: dict[str, tuple[str, Mapping[str, Any], Mapping[str, Any]]] = {  # a scene, its overrides, other values
    "line, apart to equal": ("reference-1dof", {}, {KIP: 30.0}),
    "line, hands": (
        "reference-1dof", {},
        {"finger.*.hand.rest": [0.001], "finger.*.hand.stiffness": 40.0, "finger.0.hand.damping": 0.3},
    ),
    "line, devices": ("reference-1dof", {}, {"finger.*.device.mass": 0.2, "finger.0.device.damping": 0.5}),
    "line, object": ("reference-1dof", {}, {"object.mass": 0.15, "object.viscosity": 1.1}),
    "waving, apart to equal": ("paper-waving", {}, {KIP: 30.0}),
    "waving, equal to apart": ("paper-waving", {KIP: 30.0}, {KIP: 70.0}),
    "waving, undamped to damped": ("paper-waving", {}, {KED: 0.2, KID: 0.1}),
    "waving, arms": ("paper-waving", {}, {"finger.*.hand.stiffness": 50.0, "finger.*.hand.squeeze": 0.004}),
    "spring, equal to apart": ("paper-spring", {KIP: 30.0}, {KIP: 70.0}),
    "spring, damping depth": ("paper-spring", {}, {"coupling.damping_depth": 0.002, KID: 0.3}),
    "sphere, fade, blend": ("sphere-three-fingers", {}, {"coupling.fade": [0.0, 0.1], "coupling.blend": [0.02, 0.05]}),
    "spring, limited": ("paper-spring", {"finger.*.device.force_limit": 0.4, KIP: 30.0}, {KIP: 70.0}),
    "sphere, friction": ("sphere-three-fingers", {}, {KIP: 200.0, "coupling.friction": 0.2}),
    "sphere, coupled hand": ("sphere-three-fingers", {}, {"hand.grip.stiffness": 350.0, "hand.squeeze.0.to": 0.012}),
    "mug, object": ("mug", {}, {KEP: 150.0, "object.density": 2000.0, "gravity": [0.0, 0.0, -5.0]}),
    "pads": ("soft-pads", {}, {KEP: 700.0, "coupling.damping_depth": 0.002}),
    "implicit": ("paper-spring", {"object.integrator": "implicit", KID: 0.2}, {KEP: 60.0, "object.mass": 0.2}),
    "implicit, equal to apart": ("paper-waving", {"object.integrator": "implicit", KIP: 30.0}, {KIP: 70.0, KID: 0.1}),
    "implicit, viscosity at the start": (
        "sphere-three-fingers", {"object.integrator": "implicit", "object.velocity": [0.3, 0.0, 0.0]},
        {"object.viscosity": 30.0},
    ),
    "implicit, weight at the start": (
        "sphere-three-fingers", {"object.integrator": "implicit"}, {"gravity": [0.0, 0.0, -50.0], "object.mass": 0.2},
    ),
    "matrices": (
        "paper-waving",
        {KEP: [[60.0, 0.0], [0.0, 20.0]], KIP: [[60.0, 0.0], [0.0, 20.0]], "coupling.form": "symmetric"},
        {KIP: [[90.0, 5.0], [5.0, 60.0]]},
    ),
    "matrices of all together": ("paper-spring", {KIP: [[70.0, 1.0], [1.0, 70.0]]}, {KIP: [[90.0, 5.0], [5.0, 60.0]]}),
    "matrices per finger": (
        "sphere-three-fingers", {KEP: [150.0, 200.0, 250.0], "coupling.form": "symmetric"}, {KEP: [90.0, 260.0, 200.0]},
    ),
    "matrices, literal": ("paper-waving", {KIP: [60.0, 80.0]}, {KEP: 50.0, KID: 0.2}),
}  # fmt: skip


def scene_of(name: str, overrides: Mapping[str, Any], engine: str) -> gx.Scene:
    return gx.load(name, {**overrides, "engine": engine})


def steered(scene: gx.Scene, course: Mapping[int, Mapping[str, Any]], ticks: int = TICKS) -> gx.Recording:
    """A run with values changed at ticks."""
    live = {key for values in course.values() for key in values}
    with gx.open(scene, live=sorted(live)) as session:
        for tick in sorted(course):
            if tick > session.tick:
                session.step(tick - session.tick)
            session.set(course[tick])
        session.step(ticks - session.tick)
    return session.recording


def values_of(scene: gx.Scene, keys: Mapping[str, Any]) -> dict[str, Any]:
    with gx.open(scene, live=list(keys)) as session:
        return dict(session.values)


@pytest.mark.filterwarnings("ignore::graspfx.grasp.impedance.ActiveCouplingWarning")
@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
@pytest.mark.parametrize("case", CASES)
def test_changed_before_the_first_tick_is_built_so(case: str, engine: str) -> None:
    name, overrides, values = CASES[case]
    scene = scene_of(name, overrides, engine)
    plain, built = (
        gx.run(scene_of(name, each, "interpreted"), duration=TICKS * scene.period)
        for each in (overrides, {**overrides, **values})
    )
    assert steered(scene, {0: values}).rows.tobytes() == built.rows.tobytes()
    assert not np.array_equal(built.rows, plain.rows), "nothing was changed"


@pytest.mark.filterwarnings("ignore::graspfx.grasp.impedance.ActiveCouplingWarning")
@pytest.mark.parametrize("case", CASES)
def test_changed_in_mid_run_both_engines_compute_the_same(case: str) -> None:
    """To and fro: the program has both branches, and the interpreted tick looks at every entry each time."""
    name, overrides, values = CASES[case]
    old = values_of(scene_of(name, overrides, "interpreted"), values)
    course = {40: values, 60: old, 75: values}
    one, other = (steered(scene_of(name, overrides, engine), course) for engine in ("interpreted", "compiled"))
    assert one.rows.tobytes() == other.rows.tobytes()
    assert [change.tick for change in one.changes] == [tick for tick in course for _ in values]


@pytest.mark.filterwarnings("ignore::graspfx.grasp.impedance.ActiveCouplingWarning")
@pytest.mark.parametrize("case", CASES)
def test_changed_and_changed_back_is_not_changed(case: str) -> None:
    name, overrides, values = CASES[case]
    scene = scene_of(name, overrides, "interpreted")
    with gx.open(scene, live=list(values)) as session:
        old = dict(session.values)
        session.step(40)
        session.set(values)
        session.set(old)
        session.step(TICKS - 40)
    plain = gx.run(scene, duration=TICKS * scene.period)
    if name == "soft-pads":  # what is known of the pads' slopes is learned anew: the same forces to rounding
        assert np.allclose(session.recording.rows, plain.rows, rtol=0, atol=1e-11)
    else:
        assert session.recording.rows.tobytes() == plain.rows.tobytes()


@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
def test_the_law_is_the_new_one_from_the_tick_on(engine: str) -> None:
    """Attached fingers: their forces sum to n (kep mean e + ked mean e'), with the gains of their tick."""
    moves = {"object.velocity": [0.05, -0.03], "object.angular_velocity": 0.5, "engine": engine}
    rec = steered(attached(2, squeeze=0.004).replace(moves), {30: {KEP: 45.0, KED: 0.3}, 50: {KED: 0.0}}, 60)
    thing = rec.objects["object"]
    assert thing.angular_velocity is not None
    e = rec.finger_position - rec.contact_position
    arm = rec.finger_position - thing.position[:, None]
    turning = thing.angular_velocity[:, None, None] * np.stack([-arm[..., 1], arm[..., 0]], axis=-1)
    rate = rec.finger_velocity - thing.velocity[:, None] - turning
    kep = np.where(np.arange(60) < 30, 25.0, 45.0)[:, None]
    ked = np.where((np.arange(60) >= 30) & (np.arange(60) < 50), 0.3, 0.0)[:, None]
    expected = kep * e.sum(axis=1) + ked * rate.sum(axis=1)
    assert np.abs(rec.finger_force.sum(axis=1) - expected).max() < 1e-14 and np.abs(expected).max() > 1e-4


@pytest.mark.parametrize("seed", range(24))
def test_random_scenes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene = gx.Scene(**random_table(rng, 4)).replace({"engine": "interpreted"})
    gain = {key: float(rng.choice([0.0, 0.1, 0.4]) if "damping" in key else rng.choice([60.0, 150.0, 250.0]))
            for key in (KEP, KED, KIP, KID)}  # fmt: skip
    values: dict[str, Any] = {
        **gain,
        "object.mass": float(rng.uniform(0.05, 0.3)),
        "coupling.damping_depth": float(rng.choice([0.0, 0.001])),
        "coupling.fade": [0.001, 0.02],
        "coupling.blend": "off",
        "finger.*.hand.stiffness": float(rng.uniform(50.0, 200.0)),
    }
    other = scene.replace(values)
    assert steered(scene, {0: values}, 60).rows.tobytes() == gx.run(other).rows.tobytes()
    plain = steered(scene, {20: values, 40: values}, 60)
    assert steered(scene, {20: values}, 60).rows.tobytes() == plain.rows.tobytes()


def test_squeezes_and_forces_that_were_zero() -> None:
    """A squeeze of zero has a course of its own where it is live, and a program reads gains that are zero."""
    scene = line(**{"finger__*__hand__squeeze": 0.0, "coupling__internal__damping": 0.0, "engine": "compiled"})
    values = {"finger.*.hand.squeeze": 0.006, KID: 0.2}
    built = gx.run(scene.replace(values), duration=TICKS * scene.period)
    assert steered(scene, {0: values}).rows.tobytes() == built.rows.tobytes()
    assert steered(scene.replace(values), {0: {"finger.*.hand.squeeze": 0.0, KID: 0.0}}).rows.tobytes() == (
        gx.run(scene, duration=TICKS * scene.period).rows.tobytes()
    )


@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
@pytest.mark.parametrize("contact", ["attached", "unilateral"])
def test_the_books_balance_while_gains_change(contact: str, engine: str) -> None:
    """Energy that a change of gains puts in is where what is stored changes its form; nothing is left over."""
    overrides = {"coupling.passivity": "observe", "coupling.contact": contact, "engine": engine}
    scene = gx.load("paper-waving", overrides)
    rec = steered(scene, {100: {KEP: 60.0, KIP: 120.0}, 150: {KIP: 60.0}, 180: {KIP: 70.0, KEP: 30.0}}, 220)
    assert rec.summary()["ledger_gap"] < 1e-14
    reshaped = rec.energy["object"]["reshaped"].sum(axis=1)
    stored = rec.energy["object"]["stored"].sum(axis=1)
    assert reshaped[100] - reshaped[99] < -0.5 * stored[99]  # about as much comes in as is there: kip 70 to 120
    built = gx.run(scene.replace({KIP: 120.0}), duration=1.0)
    assert steered(scene, {0: {KIP: 120.0}}, 200).rows.tobytes() == built.rows.tobytes()


def test_derived_values_follow() -> None:
    """The automatic fade goes with the gains and the squeeze of the hands."""
    scene = gx.load("unequal-devices", {"engine": "interpreted"})
    with gx.open(scene, live=[KIP]) as session:
        state = session.servo.objects[0].grasped.state
        before = state.fade_start
        session.step(5)
        session.set(KIP, 150.0)
        with build(scene.replace({KIP: 150.0})) as servo:
            assert state.fade_start == servo.objects[0].grasped.state.fade_start != before
            assert state.fade_end == servo.objects[0].grasped.state.fade_end


@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
@pytest.mark.parametrize(
    ("name", "overrides", "key", "value"),
    [
        ("thin-plate", {}, "coupling.blend", [0.01, 0.5]),
        (  # a finger that is still on its way
            "sphere-three-fingers", {"finger.2.start": {"toward": [-0.5, -0.866, 0.0], "gap": 0.012}},
            "coupling.fade", [0.0001, 0.0002],
        ),
    ],
)  # fmt: skip
def test_forces_of_a_tick_divide_by_its_own_rule(
    name: str, overrides: Mapping[str, Any], key: str, value: Any, engine: str
) -> None:
    """Until the next tick what is seen is the last one, which was divided before the change."""
    with gx.open(name, {**overrides, "engine": engine}, live=[key]) as session:
        session.step(150)
        grasped = session.servo.objects[0].grasped
        old = session.get(key)
        seen, internal, block = session.external_force, session.internal_force, grasped.two_forces()
        assert np.abs(seen).max() > 0.001 and np.abs(block.external - seen).max() < 1e-15
        for each in (value, old, value):
            session.set(key, each)
            assert np.array_equal(session.external_force, seen) and np.array_equal(session.internal_force, internal)
            assert np.array_equal(session.recording.external_force[-1], seen)
            assert np.array_equal(grasped.two_forces().external, block.external)
        assert np.abs(two_forces(grasped.state).external - seen).max() > 0.001, "both rules divide alike"
        session.step()
        assert np.array_equal(session.external_force, session.recording.external_force[-1])
        assert np.abs(grasped.two_forces().external - session.external_force).max() < 1e-15
        table = session.servo.objects[0].grasped.split_rule.table()
        assert session.recording.outcome.changes[-1].key == "split" and list(value) in (table["blend"], table["fade"])


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
        with pytest.raises(InputError, match="a key that reaches a number of the run"):
            steering.update(scene.replace({key: 0.4}), {"finger.thumb.device.mass": 0.4})


def test_what_is_not_live_cannot_be_set() -> None:
    with gx.open("reference-1dof", live=[KIP]) as session:
        with pytest.raises(
            InputError, match=r"live are coupling.internal.stiffness: name it in gx.open\(scene, live=\['object.mass"
        ):
            session.set("object.mass", 0.2)
        with pytest.raises(InputError, match="a live key"):
            session.set({KIP: 50.0, "period": 0.001})
        assert session.get(KIP) == 70.0 and not session.recording.changes
    with gx.open("reference-1dof") as session, pytest.raises(InputError, match="no key is: name it"):
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


FORM = "a value of the form that it had at the start"
ABOVE = "a coefficient of friction above zero where there was one"
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
        "laid out at the start",
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
        ("reference-1dof", {}, "period", "time is counted in periods"),
        ("reference-1dof", {}, "object.position", "what moves goes on from where it is"),
        ("reference-1dof", {}, "finger.0.start", "what moves goes on from where it is"),
        ("reference-1dof", {}, "object.shape.size", "what bodies are made"),
        ("reference-1dof", {}, "coupling.contact", "a word that decides"),
        ("reference-1dof", {}, "coupling.passivity", "what is recorded"),
        ("reference-1dof", {}, "finger.*.radius", "how contacts are laid out"),
        ("reference-1dof", {"coupling.passivity": "observe"}, "object.mass", "the ledger"),
        ("reference-1dof", {"coupling.metric": "mass"}, "finger.*.device.mass", "coupling.metric = 'mass'"),
        ("paper-spring-arms", {}, "finger.*.device.mass", "unless it is a simulated point"),
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
        with pytest.raises(InputError, match="a hand or a motion of a plug-in has them already"):
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
    with pytest.raises(InputError, match=f"'{re.escape(key)}' stands for whole tables"):
        gx.open("reference-1dof", live=[key])


def test_keys_that_are_none() -> None:
    with pytest.raises(UnknownNameError, match=r"did you mean 'coupling.internal.stiffness'"):
        gx.open("reference-1dof", live="coupling.internal.stifness")
    with pytest.raises(UnknownNameError, match=r"known: coupling.blend"):
        gx.open("reference-1dof", live=["colour"])
    with pytest.raises(InputError, match="a key of the scene with dots"):
        gx.open("reference-1dof", live=[3])  # type: ignore[list-item]


# Writes past it ---------------------------------------------------------------------------------------------------


def entry(name: str) -> int:
    return start_of(GraspState, name)


@pytest.mark.parametrize("engine", ["interpreted", "compiled", "auto"])
def test_gains_that_are_moved_apart_in_the_block_raise(engine: str) -> None:
    """Built with kep = kip and then moved apart by hand a run computed forces that were wrong by 7.4 mN."""
    scene = gx.load("paper-waving", {KIP: 30.0})
    with build(scene, engine=engine) as servo, Recorder(servo.layout, Header(scene.period)) as recorder:
        servo.objects[0].grasped.block[entry("internal_stiffness")] = 70.0
        with pytest.raises(InputError, match="equal: given True, expected a switch that follows from the gains"):
            servo.run(1, recorder)
        assert servo.ticks == 0


@pytest.mark.parametrize("engine", ["compiled", "auto"])
@pytest.mark.parametrize(
    ("field", "value"), [("equal", 0.0), ("damped", 1.0), ("implicit", 1.0), ("count", 3.0), ("internal_damping", -0.0)]
)
def test_a_write_to_a_folded_entry_raises(engine: str, field: str, value: float) -> None:
    """Bit by bit: minus zero is not zero."""
    scene = gx.load("paper-waving", {KIP: 30.0})
    with build(scene, engine=engine, record=False) as servo:
        servo.run(2, None)
        block = servo.objects[0].grasped.block
        before = block[entry(field)]
        block[entry(field)] = value
        with pytest.raises(InputError, match=rf"{field}: given"):
            servo.run(1, None)
        assert servo.ticks == 2
        block[entry(field)] = before
        servo.run(1, None)
        assert servo.ticks == 3


def test_a_write_to_a_folded_entry_of_a_device_is_named() -> None:
    with build(gx.load("reference-1dof"), engine="compiled", record=False) as servo:
        servo.run(1, None)
        device: Any = servo.stations[0].device
        device.state[int(device.structure[0])] += 1.0
        with pytest.raises(InputError, match=r"device\[0\].fingers: given 2.0, expected 1.0, which the scene's"):
            servo.run(1, None)


MATRICES = {KEP: [[60.0, 0.0], [0.0, 20.0]], KIP: [[70.0, 0.0], [0.0, 90.0]]}
PAST: dict[str, tuple[str, Mapping[str, Any], str, float]] = {  # scene, overrides, a field, what is written there
    "a matrix": ("paper-waving", MATRICES, "matrices[3]", 45.0),
    "an arm of the blend": ("thin-plate", {}, "arm_low", 0.01),
    "a gap of the fade": ("sphere-three-fingers", {}, "fade_end", 0.02),
    "a share": ("sphere-three-fingers", {}, "fingers[0].share", 5.0),
    "a patch": ("soft-pinch", {}, "fingers[1].patch", 0.02),
    "where the reaction is": ("paper-waving", {}, "at_contact", 1.0),
    "a free direction": ("thin-plate", {}, "body.free_rotation.z", 0.0),
}


@pytest.mark.filterwarnings("ignore::graspfx.grasp.impedance.ActiveCouplingWarning")
@pytest.mark.parametrize("engine", ["interpreted", "compiled", "auto"])
@pytest.mark.parametrize("case", PAST)
def test_a_number_that_is_written_past_set_raises(case: str, engine: str) -> None:
    """Matrices had no effect, and a recording divided forces by numbers that were no longer the sample's own."""
    name, overrides, field, value = PAST[case]
    for ticks in (0, 20):
        with gx.open(name, {**overrides, "engine": engine}, live=[KEP]) as session:
            if ticks:
                session.step(ticks)
            block = session.servo.objects[0].grasped.block
            [k] = [
                k for k in session.servo.objects[0].grasped.watched_entries if name_of(GraspState, k, block) == field
            ]
            before, block[k] = block[k], value
            old = session.get(KEP)
            where = re.escape(re.sub(r"\[\d+\]", "", field.rpartition(".")[2]))
            for attempt in (session.step, lambda s=session, v=old: s.set(KEP, v)):
                with pytest.raises(InputError, match=rf"{where}.*: given {value}, expected {before}.*use session.set"):
                    attempt()
            assert session.tick == ticks and not session.recording.changes
            block[k] = before
            session.step()


def test_gains_that_fit_the_switches_may_be_written() -> None:
    with build(gx.load("paper-waving"), engine="interpreted", record=False) as servo:
        servo.run(3, None)
        for stiffness in (65.0, 75.0):
            servo.objects[0].grasped.block[entry("internal_stiffness")] = stiffness
            servo.run(3, None)
            assert servo.objects[0].grasped.state.internal_stiffness == stiffness
        servo.objects[0].grasped.block[entry("internal_stiffness")] = 30.0
        with pytest.raises(InputError, match="equal: given False"):
            servo.run(1, None)


def test_live_entries_are_not_folded() -> None:
    names = ["equal", "damped", "singular", "gradual", "rays", "internal_stiffness", "internal_damping"]
    scene = gx.load("paper-spring", {KIP: 30.0})
    with build(scene, live=[KIP, KID]) as servo, build(scene) as plain:
        live, folded = (set(each.objects[0].grasped.structure.tolist()) for each in (servo, plain))
    assert not live & {entry(name) for name in names} and {entry(name) for name in names[:5]} <= folded


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
            ("finger.0.device.resolution", "a setting that the scene gives; its driver's own value holds"),
            ("finger.0.hand.stiffness", "where a name stands for a table"),
            ("finger.*.hand.stiffness", "where a name stands for a table"),
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
