"""Every key of a hand that may change in mid-run takes effect, or is refused: none is taken and does nothing."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.live import GUIDE, OF_HANDS
from graspfx.errors import GraspFXError, InputError, UnknownNameError

OWN = {"stiffness": 200.0, "damping": 2.0}
SHARED = {
    "name": "right",
    "arm": {"stiffness": 200.0, "damping": 2.0},
    "grip": {"stiffness": 200.0, "damping": 2.0},
    "share": [1.0, 1.0],
}
PARTS: dict[str, Any] = {
    "motion": {"kind": "sine", "amplitude": 0.004, "frequency": 1.0, "axis": "x"},
    "turn": {"kind": "sine", "amplitude": 0.1, "frequency": 1.0},
    "squeeze": 0.008,
    "squeeze_ramp": 0.2,
    "limb": {"mass": 0.15, "stiffness": 150.0, "damping": 2.0},
    "stiffening": {"stiffness": 120.0, "damping": 0.6, "lag": 0.03},
    "reaction": {"delay": 0.01, "stiffness": 15.0, "damping": 0.4, "force": 0.1},
    "tremor": {"amplitude": 2e-4},
    "noise": {"share": 0.03, "cutoff": 12.0, "lag": 0.1},
    "guide": {"lag": 0.02},
}
OTHER: dict[str, Any] = {  # values that are not those above
    "stiffness": 300.0,
    "damping": 4.0,
    "rest": [0.001, 0.002],
    "squeeze": 0.012,
    "squeeze_ramp": 0.05,
    "motion": PARTS["motion"] | {"amplitude": 0.006},
    "turn": PARTS["turn"] | {"amplitude": 0.2},
    "arm": {"stiffness": 300.0, "damping": 2.0},
    "grip": {"stiffness": 300.0, "damping": 2.0},
    "share": [1.0, 0.5],
    "limb": PARTS["limb"] | {"mass": 0.3},
    "stiffening": PARTS["stiffening"] | {"stiffness": 240.0},
    "reaction.stiffness": 30.0,
    "reaction.damping": 0.8,
    "reaction.force": 0.3,
    "tremor": {"amplitude": 8e-4},
    "noise.share": 0.3,
    "guide.offset": [0.002, 0.0],
    "guide.squeeze": 0.004,
}
TICKS = 40


def scene(kind: str, parts: dict[str, Any], **others: Any) -> gx.Scene:
    """A disc between two fingers, in a hand of each one's own or in the hand `right`."""
    hand: Any = OWN | parts if kind == "finger.*.hand" else "right"
    table: dict[str, Any] = {
        "dimensions": 2,
        "period": 0.002,
        "duration": 1.0,
        "engine": "interpreted",
        "object": [
            {"mass": 0.1, "viscosity": 0.8, "rotational_viscosity": 2e-4, "shape": {"kind": "sphere", "radius": 0.025}}
        ],
        "coupling": {"external": {"stiffness": 100.0}, "internal": {"stiffness": 200.0}, "friction": "stick"},
        "finger": [
            {"device": {"name": "simulated", "mass": 0.1, "damping": 0.2}, "start": [x, 0.0], "hand": hand}
            for x in (-0.0245, 0.0245)
        ],
    }
    if kind != "finger.*.hand":
        table["hand"] = [SHARED | parts]
    return gx.Scene(**(table | others))


def ends(built: gx.Scene, key: str = "", value: Any = None, before: int = TICKS) -> np.ndarray:
    """Give where fingers are at the end of a run with a key that changes."""
    with gx.open(built, live=[key] if key else []) as session:
        if before:
            session.step(before)
        if key:
            session.set(key, value)
        session.step(2 * TICKS)
        return session.recording.finger_position[-1].copy()


@cache
def left_alone(kind: str, before: int) -> np.ndarray:
    """Give where fingers of a hand with all its parts are at the end of a run without a change."""
    return ends(scene(kind, PARTS), before=before)


def has(kind: str, name: str) -> bool:
    absent = ("arm", "grip", "share") if kind == "finger.*.hand" else ("stiffness", "damping", "rest")
    return name not in absent


NAMES = [*OF_HANDS, *sorted({key.split(".hand.")[-1].removeprefix("hand.*.") for key in GUIDE})]


@pytest.mark.parametrize("kind", ["finger.*.hand", "hand.*", "hand.right"])
@pytest.mark.parametrize("name", NAMES)
def test_a_live_key_takes_effect(name: str, kind: str) -> None:
    built = scene(kind, PARTS)
    if not has(kind, name):
        with pytest.raises(UnknownNameError):
            gx.open(built, live=[f"{kind}.{name}"])
        return
    key = f"{kind}.{name}"
    for before in (0, TICKS):
        assert np.abs(ends(built, key, OTHER[name], before) - left_alone(kind, before)).max() > 1e-9


@pytest.mark.parametrize("kind", ["finger.*.hand", "finger.1.hand", "hand.right"])
@pytest.mark.parametrize("name", ["limb", "stiffening", "tremor"])
@pytest.mark.parametrize("before", [0, TICKS])
def test_a_part_that_a_plain_hand_has_not_is_refused_with_what_to_do(name: str, kind: str, before: int) -> None:
    built = scene("finger.*.hand" if kind.startswith("finger") else kind, {"squeeze": 0.008})
    key = f"{kind}.{name}"
    if kind == "finger.1.hand" and name != "tremor":  # also where the other finger's hand has a part
        built = built.replace({f"finger.0.hand.{name}": PARTS[name]})
    with gx.open(built, live=[key]) as session:
        if before:
            session.step(before)
        with pytest.raises(InputError, match="start a run with") as error:
            session.set(key, PARTS[name])
        assert key.replace("right", "0") in str(error.value)
        assert not session.recording.changes
        assert session.get(key) is None
        session.step(2 * TICKS)
        assert np.array_equal(session.recording.finger_position[-1], ends(built, before=before))


@pytest.mark.parametrize("name", ["reaction.stiffness", "noise.share", "limb.mass", "guide.squeeze"])
def test_a_number_of_a_part_that_is_not_there_is_no_key(name: str) -> None:
    for kind in ("finger.*.hand", "hand.right"):
        with pytest.raises(GraspFXError):
            gx.open(scene(kind, {}), live=[f"{kind}.{name}"])


@pytest.mark.parametrize("name", ["limb", "stiffening"])
def test_the_last_part_of_a_hand_is_not_taken_away_in_mid_run(name: str) -> None:
    with gx.open(scene("hand.right", {name: PARTS[name]}), live=[f"hand.right.{name}"]) as session:
        session.step(TICKS)
        with pytest.raises(InputError, match="limb, stiffening, reaction, noise either always or never"):
            session.set(f"hand.right.{name}", None)


@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
@pytest.mark.parametrize("name", ["limb", "stiffening"])
def test_beside_a_part_that_does_nothing_others_come_and_go(name: str, engine: str) -> None:
    """The forces, after what the error says to do, are those of a scene that has the part, once all is at rest."""
    idle = {"noise": {"share": 0.0, "cutoff": 5.0, "lag": 0.1}, "squeeze": 0.008, "squeeze_ramp": 0.1}
    bare, whole = scene("hand.right", idle), scene("hand.right", idle | {name: PARTS[name]})
    forces = []
    for built in (bare, whole):
        rec = gx.run(built.replace({"engine": "compiled", "duration": 5.0}))
        forces.append(rec.finger_force[-1])
    assert np.abs(forces[0] - forces[1]).max() > 0.01
    with gx.open(bare.replace({"engine": engine}), live=[f"hand.right.{name}"]) as session:
        session.step(500)
        session.set(f"hand.right.{name}", PARTS[name])
        session.step(2500)
        assert session.force == pytest.approx(forces[1], abs=1e-4)
        session.set(f"hand.right.{name}", None)
        session.step(2500)
        assert session.force == pytest.approx(forces[0], abs=1e-4)


def test_a_limb_that_comes_in_mid_run_begins_at_the_intention() -> None:
    """Without a limb y is r, so that no force jumps; from where fingers began it would be 3 cm away."""
    reach = {"kind": "reach", "displacement": [0.03, 0.0], "duration": 0.3}
    idle = {"stiffening": {"stiffness": 0.0, "lag": 0.1}, "motion": reach}
    with gx.open(scene("finger.*.hand", idle), live=["finger.*.hand.limb"]) as session:
        session.step(600)
        session.set("finger.*.hand.limb", PARTS["limb"])
        session.step(30)
        steps = np.diff(session.recording.finger_velocity[590:], axis=0)
    assert np.abs(steps).max() < 1e-3  # [m/s] per sample; 200 N/m on 3 cm would give 0.1
