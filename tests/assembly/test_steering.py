"""A run that is steered and a run that is built with those values are the same, bit by bit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.build import build
from tests.support.divisions import external_force
from tests.support.scenes import random_table
from tests.support.small_scenes import attached, line
from tests.support.steering import KED, KEP, KID, KIP, TICKS, steered

pytestmark = pytest.mark.filterwarnings("ignore::graspfx.grasp.impedance.ActiveCouplingWarning")

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
    "sphere, fade, blend": (  # a symmetric grasp does not turn
        "sphere-three-fingers",
        {"finger.0.start": [0.03, 0.004, 0.0]},
        {"coupling.fade": [0.0, 0.1], "coupling.blend": [0.02, 0.05]},
    ),
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


def values_of(scene: gx.Scene, keys: Mapping[str, Any]) -> dict[str, Any]:
    with gx.open(scene, live=list(keys)) as session:
        return dict(session.values)


@pytest.mark.parametrize("case", CASES)
def test_changed_before_the_first_tick_is_built_so(case: str) -> None:
    name, overrides, values = CASES[case]
    scenes = [scene_of(name, overrides, engine) for engine in ("interpreted", "compiled")]
    plain, built = (
        gx.run(scene_of(name, each, "interpreted"), duration=TICKS * scenes[0].period)
        for each in (overrides, {**overrides, **values})
    )
    for scene in scenes:
        assert steered(scene, {0: values}).rows.tobytes() == built.rows.tobytes()
    assert not np.array_equal(built.rows, plain.rows), "nothing was changed"


@pytest.mark.parametrize("case", CASES)
def test_changed_in_mid_run_both_engines_compute_the_same(case: str) -> None:
    """To and fro: the program has both branches, and the interpreted tick looks at every entry each time."""
    name, overrides, values = CASES[case]
    old = values_of(scene_of(name, overrides, "interpreted"), values)
    course = {40: values, 60: old, 75: values}
    one, other = (steered(scene_of(name, overrides, engine), course) for engine in ("interpreted", "compiled"))
    assert one.rows.tobytes() == other.rows.tobytes()
    assert [change.tick for change in one.changes] == [tick for tick in course for _ in values]


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


@pytest.mark.parametrize("seed", range(12))
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
        rule, seen, internal = grasped.split_rule, session.external_force, session.internal_force
        assert np.abs(seen).max() > 0.001 and np.abs(external_force(grasped.state) - seen).max() < 1e-15
        for each in (value, old, value):
            session.set(key, each)
            assert np.array_equal(session.external_force, seen) and np.array_equal(session.internal_force, internal)
            assert np.array_equal(session.recording.external_force[-1], seen)
            assert np.abs(external_force(grasped.state, rule) - seen).max() < 1e-15
        assert np.abs(external_force(grasped.state) - seen).max() > 0.001, "both rules divide alike"
        session.step()
        assert np.array_equal(session.external_force, session.recording.external_force[-1])
        assert np.abs(external_force(grasped.state) - session.external_force).max() < 1e-15
        table = session.servo.objects[0].grasped.split_rule.table()
        assert session.recording.outcome.changes[-1].key == "split" and list(value) in (table["blend"], table["fade"])
