"""Operators who are not springs in a scene: their tables, engines, batches, replays, and values that are live."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import InputError, SceneError

PARTS: dict[str, Any] = {
    "limb": {"mass": 0.15, "stiffness": [150.0, 120.0], "damping": 2.0},
    "stiffening": {"stiffness": 120.0, "damping": 0.6, "lag": 0.03},
    "reaction": {"delay": 0.03, "stiffness": 15.0, "damping": 0.4, "force": 0.1},
    "tremor": {"amplitude": 2e-4, "seed": 3},
    "noise": {"share": 0.03, "cutoff": 12.0, "lag": 0.1, "seed": 4},
}


def scene(parts: dict[str, Any] | None = None, **others: Any) -> gx.Scene:
    """A disc between two fingers on the x axis, each in a hand of its own."""
    hand = {"stiffness": 200.0, "damping": 2.0, "squeeze": 0.008, **(PARTS if parts is None else parts)}
    table: dict[str, Any] = {
        "dimensions": 2,
        "period": 0.002,
        "duration": 0.3,
        "object": [
            {"mass": 0.1, "viscosity": 0.8, "rotational_viscosity": 2e-4, "shape": {"kind": "sphere", "radius": 0.025}}
        ],
        "coupling": {"external": {"stiffness": 100.0}, "internal": {"stiffness": 200.0}, "friction": "stick"},
        "finger": [
            {"device": {"name": "simulated", "mass": 0.1, "damping": 0.2}, "start": [x, 0.0], "hand": hand}
            for x in (-0.026, 0.026)
        ],
    }
    return gx.Scene(**(table | others))


def test_noise_and_tremor_of_one_seed_have_random_numbers_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Missing words of a seed count as zeros: (0, 0) and (0, 0, 0) are the same one."""
    states: list[bytes] = []
    whole = np.random.SeedSequence

    def draw(entropy: list[int]) -> np.random.SeedSequence:
        states.append(whole(entropy).generate_state(4).tobytes())
        return whole(entropy)

    monkeypatch.setattr(np.random, "SeedSequence", draw)
    gx.open(scene({"tremor": {"amplitude": 2e-4, "seed": 0}, "noise": {**PARTS["noise"], "seed": 0}})).close()
    assert len(set(states)) == 2 * (2 + 1)  # of each finger the tremor's axes and the noise


def test_engines_batches_and_replays_give_the_same_bits(tmp_path: Path) -> None:
    base = scene()
    runs = [gx.run(base.replace({"engine": engine})) for engine in ("interpreted", "compiled")]
    for name in ("finger_position", "finger_force", "object_position", "device_energy"):
        assert np.array_equal(getattr(runs[0], name), getattr(runs[1], name)), name
    assert np.abs(runs[0].finger_force).max() > 0.3
    values: dict[str, Any] = {"finger.*.hand.noise.seed": [0, 1, 2], "finger.*.hand.reaction.delay": [0.02, 0.03, 0.06]}
    batch = gx.run_batch(base, values, zip=True, measure=["finger_position"], statistics=["last"])
    for k in range(3):
        single = gx.run(base.replace({key: each[k] for key, each in values.items()})).finger_position
        assert np.array_equal(batch["finger_position"]["last"][k].ravel(), single[-1].ravel()), k
    path = tmp_path / "run.npz"
    runs[1].save(path)
    again = gx.replay(path)
    assert np.array_equal(again.finger_position, runs[1].finger_position)
    assert np.array_equal(again.finger_force, runs[1].finger_force)


def test_hands_of_several_fingers_have_operators_too() -> None:
    own = {name: PARTS[name] for name in ("limb", "stiffening", "reaction", "noise", "tremor")}
    hand = {"name": "right", "arm": {"stiffness": 300.0, "damping": 4.0}, "grip": {"stiffness": 200.0, "damping": 2.0}}
    fingers = [each | {"hand": "right"} for each in scene({}).to_dict()["finger"]]
    held = scene({}, hand=[{**hand, "squeeze": 0.008, **own}], finger=fingers)
    rec = gx.run(held)
    assert rec.touching[-1].all()
    assert gx.stability.spectral_radius(held) < 1.0
    assert "tremor" in " ".join(row.why for row in gx.check(held).plan if row.step == "hand")


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("limb.mass", 0.0, "more than 0"),
        ("limb.stiffness", [1.0, 2.0, 3.0], "2 numbers"),
        ("reaction.delay", 30.0, "at most 10000 periods"),
        ("stiffening", {"stiffness": 1.0}, "required"),
        ("tremor.width", 20.0, "less than twice the frequency"),
        ("noise.seed", -1, "0"),
        ("nois", {}, "did you mean 'noise'"),
    ],
)
def test_faults_stand_where_they_are(key: str, value: Any, text: str) -> None:
    with pytest.raises(SceneError) as error:
        scene().replace({f"finger.0.hand.{key}": value})
    assert any(text in fault.message for fault in error.value.faults), [str(each) for each in error.value.faults]


def test_other_simulations_than_points_are_refused_and_say_what_to_do() -> None:
    with pytest.raises(SceneError, match="use the device 'simulated'"):
        gx.load("paper-waving", {"finger.*.hand.limb": {"mass": 0.1, "stiffness": 100.0}})
    gx.load("paper-waving", {"finger.*.hand.tremor": {"amplitude": 1e-4}})


def test_live_values_are_those_of_a_scene_that_has_them_from_then_on() -> None:
    quiet = {name: PARTS[name] for name in ("limb", "stiffening", "reaction")}
    keys = ["finger.*.hand.limb.mass", "finger.*.hand.stiffening.stiffness", "finger.*.hand.reaction.stiffness"]
    with gx.open(scene(quiet), live=keys) as session:
        session.step(100)
        for key, value in zip(keys, (0.3, 300.0, 25.0), strict=True):
            session.set(key, value)
        session.step(2900)
        force = session.force.copy()
    steady = scene(quiet).replace({**dict(zip(keys, (0.3, 300.0, 25.0), strict=True)), "duration": 6.0})
    assert force == pytest.approx(gx.run(steady).finger_force[-1], rel=1e-5, abs=1e-5)
    for key, text in (("reaction.delay", "stiffness, damping and force"), ("noise.cutoff", "only the share")):
        with pytest.raises(InputError, match=text):
            gx.open(scene(), live=[f"finger.0.hand.{key}"])


def test_the_work_of_an_operator_balances_with_what_fingers_and_object_take() -> None:
    """Forces on both sides are equal and opposite: the device's work is minus that on the fingertips' way."""
    rec = gx.run(scene())
    assert rec.true_position is not None
    assert rec.device_energy is not None
    way = np.diff(rec.true_position, axis=0)
    work = -np.cumsum((rec.finger_force[:-1] * way).sum(axis=2), axis=0)
    assert rec.device_energy[1:] == pytest.approx(work, abs=1e-12)
