"""A scene takes what it promises, refuses everything else with one fault each, and survives a round trip."""

from __future__ import annotations

import copy
import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import SceneError
from graspfx.objects import dynamics_table
from graspfx.scene.model import Scene, schema


def line() -> dict[str, Any]:
    """Two fingers on a line, attached: the least that a scene needs."""
    finger = {"device": {"name": "simulated", "mass": 0.15, "damping": 0.2}, "start": [0.002]}
    return {
        "dimensions": 1,
        "period": 0.005,
        "duration": 2.0,
        "object": {"mass": 0.1, "viscosity": 0.8},
        "coupling": {"contact": "attached", "external": {"stiffness": 30.0}, "internal": {"stiffness": 70}},
        "finger": [finger, copy.deepcopy(finger)],
    }


def plane() -> dict[str, Any]:
    """Two fingers on a box in the plane, unilateral, with rotation."""
    table = line()
    table["dimensions"] = 2
    table["object"] |= {"shape": {"kind": "box", "size": [0.05, 0.05]}, "rotational_viscosity": 3e-4}
    table["coupling"].pop("contact")
    for i, finger in enumerate(table["finger"]):
        finger["start"] = [0.03 - 0.06 * i, 0.0]
    return table


def space() -> dict[str, Any]:
    table = plane()
    table["dimensions"] = 3
    table["object"]["shape"] = {"kind": "sphere", "radius": 0.03}
    for finger in table["finger"]:
        finger["start"] = [*finger["start"], 0.0]
    return table


def put(table: dict[str, Any], key: str, value: Any) -> dict[str, Any]:
    *path, last = key.split(".")
    holder: Any = table
    for part in path:
        holder = holder[int(part)] if isinstance(holder, list) else holder.setdefault(part, {})
    holder[last] = value
    return table


def faults(table: dict[str, Any]) -> list[str]:
    """The keys and messages of a scene's faults."""
    try:
        Scene(**table)
    except SceneError as error:
        return [f"{fault.key}: {fault.message}" for fault in error.faults]
    return []


def test_defaults_are_those_of_the_reference() -> None:
    scene = Scene(**line())
    thing, coupling, finger = scene.object[0], scene.coupling, scene.finger[0]
    assert (thing.name, thing.dynamics, thing.integrator) == ("object", "native", "exact")
    assert (coupling.form, coupling.reaction, coupling.friction, coupling.absent) == (
        "literal",
        "fingertip",
        0.0,
        "fade",
    )
    assert (coupling.fade, coupling.blend) == ("auto", (0.00025, 0.001))
    assert (finger.channel, finger.model, finger.hand) == (0, "hard", None)
    assert finger.device.settings == {"mass": 0.15, "damping": 0.2}  # type: ignore[union-attr]
    assert scene.finger_names == ("finger0", "finger1")
    assert scene.finger_objects == (0, 0)


def test_whole_numbers_are_numbers_and_become_floats() -> None:
    stiffness = Scene(**line()).coupling.internal.stiffness
    assert stiffness == 70.0
    assert isinstance(stiffness, float)


def test_arrays_are_taken_as_lists() -> None:
    table = put(put(line(), "finger.0.start", np.array([0.002])), "coupling.external.stiffness", np.array([30.0, 30.0]))
    scene = Scene(**table)
    assert scene.finger[0].start == (0.002,)
    assert scene.coupling.external.stiffness == (30.0, 30.0)
    device = {"name": "simulated", "mass": np.float32(0.5), "damping": 0.2, "delay": np.int64(1)}
    [device, _] = Scene(**put(line(), "finger.0.device", device)).to_dict()["finger"]
    assert [type(device["device"][name]) for name in ("mass", "delay")] == [float, int]
    arms = gx.load("paper-waving", {"finger.*.device.base": np.array([0.0, 0.01])})
    assert all(finger["device"]["base"] == [0.0, 0.01] for finger in arms.to_dict()["finger"])


@pytest.mark.parametrize("make", [line, plane, space])
def test_round_trip_through_a_table_json_and_pickle(make: Any) -> None:
    scene = Scene(**make())
    table = scene.to_dict()
    assert json.loads(json.dumps(table)) == table
    assert Scene(**table) == scene
    assert pickle.loads(pickle.dumps(scene)) == scene
    assert table["finger"][0]["device"] == {"name": "simulated", "mass": 0.15, "damping": 0.2}


def test_a_scene_cannot_be_changed_but_replaced() -> None:
    scene = Scene(**line())
    with pytest.raises(ValueError, match="frozen"):
        scene.period = 0.1
    other = scene.replace({"coupling.internal.stiffness": 50.0, "finger.*.device.mass": 0.3})
    assert (scene.coupling.internal.stiffness, other.coupling.internal.stiffness) == (70.0, 50.0)
    assert [finger.device.settings["mass"] for finger in other.finger] == [0.3, 0.3]  # type: ignore[union-attr]
    assert other.source.overrides == {"coupling.internal.stiffness": 50.0, "finger.*.device.mass": 0.3}
    assert other != scene


def test_objects_may_be_several_tables() -> None:
    table = line()
    table["object"] = [
        {"name": "left", "mass": 0.1, "viscosity": 0.8},
        {"name": "right", "mass": 0.2, "viscosity": 0.8},
    ]
    table["finger"][1]["object"] = "right"
    assert Scene(**table).finger_objects == (0, 1)


MATRIX = [[80.0, 10.0], [10.0, 40.0]]


@pytest.mark.parametrize("gain", [0.0, 30, [30, 40], MATRIX, [MATRIX, MATRIX], np.eye(4).tolist()])
def test_every_form_of_gain_is_taken(gain: Any) -> None:
    table = put(plane(), "coupling.contact", "attached")
    assert faults(put(table, "coupling.external.stiffness", gain)) == []


@pytest.mark.parametrize(
    ("gain", "message"),
    [
        (-1.0, "expected no less than 0; given -1.0"),
        ([30.0, -1.0], "expected no less than 0"),
        (float("nan"), "expected finite numbers"),
        (True, "expected a number, a list with one per finger"),
        ("30", "expected a number, a list with one per finger"),
        ([30.0], "expected 2 numbers for 2 fingers in 2 dimensions; given 1"),
        ([[1.0, 2.0], [3.0]], "expected a number, a list with one per finger"),
        (np.eye(3).tolist(), "expected 2 x 2 or 4 x 4 numbers for 2 fingers in 2 dimensions; given 3 x 3"),
        ([[1.0, 2.0], [0.0, 1.0]], "expected a symmetric matrix"),
        ([[1.0, 2.0], [2.0, 1.0]], "no negative eigenvalue; the smallest is -1"),  # eigenvalues 1 +- 2
    ],
)
def test_a_gain_in_none_of_its_forms_is_one_fault(gain: Any, message: str) -> None:
    [fault] = faults(put(plane(), "coupling.external.stiffness", gain))
    assert fault.startswith("coupling.external.stiffness: ")
    assert message in fault


def test_a_full_gain_needs_one_object() -> None:
    table = put(line(), "object", [{"name": name, "mass": 0.1, "viscosity": 0.8} for name in "ab"])
    [fault] = faults(put(table, "coupling.internal.stiffness", np.eye(2).tolist()))
    assert "expected a scene with one object" in fault


WRONG: list[tuple[Any, str, Any, str]] = [
    # fields
    (line, "dimensions", 4, "dimensions: expected 1, 2 or 3"),
    (line, "dimensions", True, "dimensions: expected 1, 2 or 3; given 'true'"),
    (line, "period", 0.0, "period: expected more than 0; given 0.0"),
    (line, "period", "5 ms", "period: expected a number; given '5 ms'"),
    (line, "period", True, "period: expected a number; given True"),
    (line, "duration", float("inf"), "duration: expected a finite number"),
    (line, "object.mass", 0, "object.mass: expected more than 0; given 0"),
    (line, "object.viscosity", -0.1, "object.viscosity: expected no less than 0"),
    (
        line,
        "object.integrator",
        "euler",
        "object.integrator: expected 'explicit', 'semi-implicit', 'exact' or 'implicit'",
    ),
    (line, "object.name", "a b", "object.name: expected a name of letters"),
    (line, "object.free", [1], "object.free.0: expected true or false; given 1"),
    (plane, "object.shape", {"kind": "bxo", "size": [1, 1]}, "object.shape.kind: unknown kind of shape 'bxo'; did you"),
    (plane, "object.shape", {"kind": "sphere"}, "object.shape.radius: required"),
    (plane, "object.shape", "box", "object.shape: expected a table; given 'box'"),
    (plane, "coupling.friction", -0.3, "coupling.friction: expected a finite coefficient of friction, 0 or more"),
    (plane, "coupling.friction", "slick", "coupling.friction: expected a finite coefficient"),
    (line, "coupling.fade", [0.1], "coupling.fade"),
    (line, "finger.0.model", "soft", "finger.0.model: a soft finger has torsion, which requires three dimensions"),
    (line, "finger.0.model", "full", "finger.0.model: expected 'hard' or 'soft': 'full' is a contact for analysis"),
    (line, "finger.0.patch", 0.005, "finger.0.patch: only soft fingers have this setting"),
    (
        line,
        "finger.0.friction",
        0.5,
        "finger.0.friction: attached contacts (coupling.contact = 'attached') do not slip",
    ),
    (line, "coupling.metric", "weight", "coupling.metric: expected 'equal' or 'mass'"),
    (line, "finger.0.channel", -1, "finger.0.channel: expected no less than 0"),
    (line, "finger.0.channel", 0.5, "finger.0.channel"),
    (line, "finger.0.device", 3, "finger.0.device: expected a table"),
    (line, "finger.0.hand", {"stiffness": [-1]}, "finger.0.hand.stiffness: expected no less than 0"),
    (line, "finger.0.hand", {"stifness": 1}, "finger.0.hand.stifness: unknown key; did you mean 'stiffness'?"),
    (line, "finger", [], "finger: expected at least one"),
    (line, "object", [], "object: expected at least one"),
    (line, "coupling.kep", 30.0, "coupling.kep: unknown key; use external.stiffness instead"),
    (plane, "finger.0.start", {"position": [0, 0]}, "finger.0.start.position: unknown key; use start = "),
    (line, "objct", {}, "objct: unknown key; did you mean 'object'?"),
    # relations
    (line, "gravity", [0.0, -9.81], "gravity: expected 1 number (dimensions = 1); given [0.0, -9.81]"),
    (line, "object.position", [0, 0], "object.position: expected 1 number"),
    (line, "finger.1.start", [0, 0], "finger.1.start: expected 1 number"),
    (plane, "object.shape.size", [0.05], "object.shape.size: expected 2 numbers"),
    (plane, "object.shape", None, "object.shape: required for unilateral contact"),
    (
        plane,
        "object.free",
        [True, True],
        "object.free: expected 3 values, true or false (two translations, one rotation)",
    ),
    (plane, "object.rotational_viscosity", None, "object.rotational_viscosity: required if a rotation is free"),
    (plane, "object.orientation", [0, 0, 0, 1], "object.orientation: expected a number in the plane"),
    (line, "object.orientation", 0.1, "object.orientation: an object in one dimension does not rotate"),
    (line, "object.inertia", 0.1, "object.inertia: an object in one dimension does not rotate"),
    (space, "object.orientation", [0, 0, 0, 2], "object.orientation: expected a unit quaternion; its norm is 2"),
    (space, "object.orientation", 0.1, "object.orientation: expected a quaternion of 4 numbers x, y, z, w"),
    (space, "object.angular_velocity", [1, 2], "object.angular_velocity: expected 3 numbers"),
    (space, "object.inertia", [1, 2], "object.inertia: expected a number or 3 numbers"),
    (plane, "object.inertia", -1.0, "object.inertia: expected more than 0"),
    (plane, "coupling.internal.stiffness", 0.0, "coupling.internal.stiffness: unilateral contact requires more than 0"),
    (
        plane,
        "coupling.external.stiffness",
        1e9,
        "coupling.internal.stiffness: unilateral contact requires at least 1e-06 times coupling.external.stiffness",
    ),
    (
        plane,
        "coupling",
        {"external": {"stiffness": 30.0, "damping": 1e-7}, "internal": {"stiffness": 30.0, "damping": 0.5}},
        "coupling.external.damping: unilateral contact requires at least 1e-06 times coupling.internal.damping "
        "(5e-07 N s/m), or 0; given 1e-07",
    ),
    (plane, "coupling.fade", [0.01, 0.01], "coupling.fade: expected [h1, h2] with 0 <= h1 < h2"),
    (plane, "coupling.blend", [0.0, 0.01], "coupling.blend: expected [l1, l2] with 0 < l1 < l2"),
    (line, "finger.0.object", "objct", "finger.0.object: no [[object]] has the name 'objct'; did you mean 'object'?"),
    (line, "finger.0.device", "left", "finger.0.device: no [[device]] has the label 'left'"),
    (line, "finger.0.hand", "left", "finger.0.hand: no [[hand]] has the name 'left'"),
    (line, "finger.0.name", "finger1", "finger.1.name: 'finger1' is the name of an earlier finger"),
    (
        line,
        "hand",
        [{"name": "a", "arm": {"stiffness": 1}, "grip": {"stiffness": 1}}],
        "hand.0.name: no finger refers to 'a'",
    ),
    (line, "finger.0.hand", {"stiffness": 1, "rest": [0, 0]}, "finger.0.hand.rest: expected 1 number"),
    (plane, "finger.0.hand", {"stiffness": [1, 2, 3]}, "finger.0.hand.stiffness: expected 2 numbers"),
    # drivers
    (line, "finger.0.device.mss", 0.1, "finger.0.device.mss: unknown setting of 'simulated'; did you mean 'mass'?"),
    (line, "finger.0.device", {"name": "simulated"}, "finger.0.device.mass: required by 'simulated', but not given"),
    (line, "finger.0.device.name", "simulatd", "finger.0.device.name: unknown device 'simulatd'; did you mean 'simul"),
    (line, "finger.0.device.mass", float("nan"), "finger.0.device.mass: expected finite numbers"),
    (line, "finger.0.device.dimensions", 2, "finger.0.device.dimensions: expected 1, the scene's dimensions"),
    # drivers connected
    (line, "finger.0.device.mass", -1, "finger.0.device.mass: given -1, expected a finite mass above zero"),
    (line, "finger.0.device.fingers", 0, "finger.0.device.fingers: given 0, expected an integer from 1 to"),
    (line, "finger.0.device.fingers", 2, "finger.0.device: expected a finger on each channel of a simulated device"),
    (line, "finger.1.channel", 1, "finger.1.channel: expected less than 1: 'simulated' has 1 finger; given 1"),
    (plane, "finger.0.device", {"name": "two-link", "elbow": "up"}, "finger.0.device.elbow: given 'up', expected"),
    (plane, "finger.0.device", {"name": "two-link", "links": [0.1]}, "finger.0.device.links: given [0.1], expected"),
    (plane, "finger.0.device", {"name": "two-link", "counts": 0}, "finger.0.device.counts: given 0, expected"),
    (line, "finger.0.device", {"name": "two-link"}, "finger.0.device.name: expected a device of 1 dimensions; this"),
    # bodies filled
    (
        plane,
        "object",
        {
            "mass": 0.1,
            "viscosity": 0.1,
            "rotational_viscosity": 1e-3,
            "free": [True, False, True],
            "velocity": [0, 1],
            "shape": {"kind": "sphere", "radius": 1},
        },
        "object.velocity: given (0.0, 1.0), expected zero",
    ),
    (
        space,
        "object.inertia",
        [1.0, 1.0, 3.0],
        "object.inertia: given (1.0, 1.0, 3.0), expected moments, none of which",
    ),
]


@pytest.mark.parametrize(
    ("make", "key", "value", "message"), WRONG, ids=[f"{key}={value}" for _, key, value, _ in WRONG]
)
def test_one_slip_is_one_fault(make: Any, key: str, value: Any, message: str) -> None:
    found = faults(put(make(), key, value))
    assert len(found) == 1
    assert found[0].startswith(message)


def test_a_key_that_is_given_is_meant_only_by_one_very_near() -> None:
    assert faults(put(plane(), "object.shape.sides", 4)) == ["object.shape.sides: unknown key"]  # not 'size'
    assert faults(put(plane(), "object.shape.sze", 4)) == ["object.shape.sze: unknown key; did you mean 'size'?"]


MOTIONS: list[tuple[dict[str, Any], str | None]] = [
    ({"kind": "rest"}, None),
    ({"kind": "sine", "amplitude": 0.05, "frequency": 0.5, "axis": 1, "begin": 0.5, "ramp": 1.0}, None),
    ({"kind": "sine", "amplitude": 0.05, "frequency": 0.5, "axis": "y"}, None),
    (
        {"kind": "sine", "amplitude": 0.05, "frequency": 0.5, "axis": "z"},
        "motion.axis: expected an axis of 2 dimensions",
    ),
    ({"kind": "sine", "amplitude": 0.05, "frequency": 0.0}, "motion.frequency: expected more than 0"),
    ({"kind": "reach", "displacement": [0.1, 0.0], "duration": 1.0}, None),
    ({"kind": "reach", "displacement": [0.1], "duration": 1.0}, "motion.displacement: expected 2 numbers"),
    ({"kind": "path", "times": [0, 1], "positions": [[0, 0], [1, 1]]}, None),
    (
        {"kind": "path", "times": [0, 0], "positions": [[0, 0], [1, 1]]},
        "motion.times: expected at least two times in increasing order",
    ),
    (
        {"kind": "path", "times": [0, 1], "positions": [[0, 0]]},
        "motion.positions: expected one position for each of the 2 times",
    ),
    ({"kind": "path", "times": [0, 1], "positions": [[0], [1]]}, "motion.positions.0: expected 2 numbers"),
    ({"kind": "path", "times": [0, 1]}, "motion: expected a file, or times and positions"),
    ({"kind": "path", "file": "nowhere.csv"}, "motion.file: given"),
    ({"kind": "sinus"}, "motion.kind: unknown kind of motion 'sinus'; did you mean 'sine'?"),
]


@pytest.mark.parametrize(("motion", "message"), MOTIONS)
@pytest.mark.parametrize("shared", [False, True])
def test_motions_of_own_and_of_shared_hands(motion: dict[str, Any], message: str | None, shared: bool) -> None:
    table = plane()
    if shared:
        spring = {"stiffness": [33.0, 20.0], "damping": 0.5}
        table["hand"] = [{"name": "right", "arm": spring, "grip": spring, "motion": motion, "squeeze": 0.004}]
        table["finger"][0]["hand"] = table["finger"][1]["hand"] = "right"
    else:
        table["finger"][0]["hand"] = {"stiffness": 33.0, "rest": [0.0, 0.0], "motion": motion, "squeeze_ramp": 0.1}
    key = "hand.0." if shared else "finger.0.hand."
    found = faults(table)
    assert len(found) == (message is not None)
    assert message is None or found[0].startswith(key + message)


@pytest.mark.parametrize(
    ("integrator", "ok"), [("explicit", False), ("semi-implicit", False), ("exact", True), ("implicit", True)]
)
def test_viscosity_that_would_blow_up_is_refused_with_its_figure(integrator: str, ok: bool) -> None:
    # b T / m = 40 * 0.005 / 0.1 = 2, the limit of stability of v += T (-b/m) v
    found = faults(put(put(line(), "object.viscosity", 40.0), "object.integrator", integrator))
    assert (found == []) == ok
    assert ok or "viscosity * period / mass is 2, " in found[0]


@pytest.mark.parametrize(("make", "inertia"), [(plane, 0.1 / 12 * 2 * 0.05**2), (space, 0.4 * 0.1 * 0.03**2)])
@pytest.mark.parametrize("given", [False, True])
def test_rotational_viscosity_is_judged_by_the_inertia_of_the_shape_too(make: Any, inertia: float, given: bool) -> None:
    # solid box in the plane: m (a^2 + b^2)/12; solid sphere: 2 m r^2/5; the limit is bw T/I = 2
    table = put(make(), "object.integrator", "semi-implicit")
    if given:
        put(table, "object.inertia", inertia)
    assert faults(put(table, "object.rotational_viscosity", 1.99 * inertia / 0.005)) == []
    [found] = faults(put(table, "object.rotational_viscosity", 2.01 * inertia / 0.005))
    assert found.startswith("object.rotational_viscosity: rotational_viscosity * period / inertia is 2.01, ")


REAL = """
from graspfx.loop.device import Features

class Real:
    features = Features(fingers=1, dimensions=2)
    def open(self, period): raise AssertionError("checking a scene opened the device")
    def read(self): raise AssertionError("read")
    def write(self, forces): raise AssertionError("written to")
    def stop(self): raise AssertionError("stopped")
    def close(self): raise AssertionError("closed")
    def __enter__(self): raise AssertionError("entered")
    def __exit__(self, *exc): raise AssertionError("left")

def connect():
    return Real()
"""


@pytest.mark.parametrize("name", ["open", "read", "write", "stop", "close", "__enter__", "__exit__"])
def test_a_device_that_lacks_a_method_is_a_fault_of_its_table(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = "".join(line for line in REAL.splitlines(keepends=True) if f"def {name}(" not in line)
    Path("part.py").write_text(text)
    [fault] = faults(put(plane(), "finger.0.device", {"name": "part.py"}))
    assert fault.startswith(f"finger.0.device: the device of part.py lacks {name}(): add them to Real; ")
    table = plane()
    table["device"] = [{"label": "board", "name": "part.py"}]
    table["finger"][0] = {"start": [-0.03, 0.0], "device": "board"}
    [fault] = faults(table)
    assert fault.startswith("device.0: the device of part.py lacks")
    Path("bare.py").write_text(
        "from graspfx.protocols import Features\nclass Bare:\n    features = Features(1, 2)\n    stop = 3\n"
        "def connect(): return Bare()\n"
    )
    [fault] = faults(put(plane(), "finger.0.device", {"name": "bare.py"}))
    assert "lacks open(), read(), write(), stop(), close(), __enter__(), __exit__(): add" in fault


@pytest.mark.parametrize("name", ["stiffness", "damping", "target"])
def test_a_hand_that_lacks_something_is_a_fault_of_its_table(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("part.py").write_text(
        "import numpy as np\nclass Part:\n    stiffness = damping = np.ones((2, 1, 1))\n"
        "    def target(self, time): return np.zeros((1, 2)), np.zeros((1, 2))\n"
        f"    {name} = property()\ndef hold(): return Part()\n"
    )
    [fault] = faults(put(plane(), "finger.0.hand", {"kind": "part.py"}))
    assert fault.startswith("finger.0.hand: hold(): given ")
    assert f"add {name} to the hand of part.py; graspfx.protocols.Hand documents hands" in fault


def test_hands_hold_simulated_devices_of_one_kind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("real.py").write_text(REAL)
    table = put(plane(), "finger.0.device", {"name": "real.py"})
    assert faults(table) == []
    held = put(copy.deepcopy(table), "finger.0.hand", {"stiffness": 1.0})
    assert faults(held) == [
        "finger.0.hand: a person's hand holds a real device: remove the simulated hand of this finger"
    ]
    table["finger"][0]["device"] = {"name": "two-link", "base": [0.0, -0.2]}
    table["hand"] = [{"name": "right", "arm": {"stiffness": 1}, "grip": {"stiffness": 1}}]
    for finger in table["finger"]:
        finger["hand"] = "right"
    [found] = faults(table)
    assert found.startswith(
        "finger.1.hand: a hand holds devices of one kind; 'right' would hold SimulatedTwoLink and P"
    )


def test_reach_is_asked_for_when_a_scene_is_to_run() -> None:
    """The arm works from 0.01 to 0.246 m; a workspace is a box. Both are told per finger, together."""
    table = plane()
    table["finger"][0] |= {"device": {"name": "two-link", "base": [0.0, -0.4]}}
    table["finger"][1]["device"]["workspace"] = [[0.0, 0.0], [1.0, 1.0]]
    scene = Scene(**table)
    with pytest.raises(SceneError) as caught:
        scene.require_reach()
    first, second = caught.value.faults
    assert (first.key, second.key) == ("finger.0.start", "finger.1.start")
    assert "the arm works from 0.0100 to 0.2460 m" in first.message
    assert second.message.startswith("outside the device's workspace, [0.0, 0.0] to [1.0, 1.0] m; given [-0.03, 0.0]")
    Scene(**plane()).require_reach()


@pytest.mark.parametrize(("name", "package"), [("bullet", "pybullet"), ("mujoco", "mujoco")])
def test_dynamics_without_their_package_say_what_to_install(
    name: str, package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where PyBullet has no wheel there are two ways out: to have it built, and MuJoCo."""
    monkeypatch.setattr(dynamics_table, "find_spec", lambda name: None)
    [fault] = faults(put(line(), "object.dynamics", name))
    assert fault.startswith(f"object.dynamics: {name!r} needs the package {package}, which is not installed: pip insta")
    assert ("built from source where it has no wheel); or dynamics = 'mujoco'" in fault) == (name == "bullet")


def test_a_driver_that_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("empty.py").write_text("")
    Path("broken.py").write_text("import nowhere_to_be_found\n")
    Path("slip.py").write_text("x = 1\ndef connect(:\n")
    Path("open.py").write_text("def connect(**settings): ...\n")
    Path("bad.py").write_text("def connect(**settings):\n    return settings['port']\n")
    names = ("empty.py", "broken.py", "slip.py", "open.py", "bad.py", "none.py")
    found = [faults(put(line(), "finger.0.device", {"name": name})) for name in names]
    assert found[0] == ["finger.0.device.name: the driver 'empty.py' has no function connect(**settings)"]
    assert "cannot be imported: broken.py:1: ModuleNotFoundError: No module named 'nowhere_to_be" in found[1][0]
    assert "cannot be imported: slip.py:2: SyntaxError: " in found[2][0]
    [nothing] = found[3]
    assert nothing.startswith("finger.0.device.name: expected connect() of 'open.py' to return a device ")
    assert nothing.endswith("; given None")
    assert found[4] == ["finger.0.device: 'bad.py' cannot be connected: bad.py:2: KeyError: 'port'"]
    missing = "finger.0.device.name: given 'none.py', expected the path of a file; there is no file "
    assert found[5][0].startswith(missing)
    assert all(len(each) == 1 for each in found)


def test_every_fault_at_once_and_nothing_is_judged_by_what_is_wrong() -> None:
    table = plane()
    table["dimensions"] = "two"  # so that no length can be judged
    table["gravity"] = [1.0]
    table["finger"][0]["device"] = {"name": "simulated", "mss": 1.0}
    table["coupling"]["fade"] = [0.2, 0.1]
    assert [fault.split(":")[0] for fault in faults(table)] == ["dimensions", "finger.0.device.mss", "coupling.fade"]


def test_schema_knows_every_table() -> None:
    described = schema()
    assert {"dimensions", "period", "object", "coupling", "finger", "device", "hand"} <= described["properties"].keys()
    assert described["additionalProperties"] is False
    assert set(described["required"]) == {"dimensions", "period", "duration", "finger"}
    assert described["anyOf"] == [{"required": ["object", "coupling"]}, {"required": ["host"]}]
    json.dumps(described, allow_nan=False)


def test_an_endless_floor_that_does_not_turn_needs_no_inertia() -> None:
    """A half-space has no moments: none are asked for where nothing turns, and a clear fault says so where it could."""
    floor = put(line(), "object.shape", {"kind": "half-space", "normal": [1.0]})
    assert faults(floor) == []


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("hand", ["left"], "hand.0: expected a table; given 'left'"),
        ("obstacle", [{"shape": None}], "obstacle.0.shape: expected a table; given None"),
        ("finger.0.hand.closing", {}, "expected a number or a word or a list; given {}"),
        ("object.shape.kind", np.zeros(2), "unknown kind of shape"),
        ("coupling.friction", np.zeros(2), "expected a finite coefficient of friction, 0 or more"),
        ("coupling.friction", 10**400, "expected a finite coefficient of friction, 0 or more"),
        ("finger.0.model", np.zeros(2), "finger.0.model: expected 'hard' or 'soft'"),
        ("coupling.external.stiffness", 10**400, "coupling.external.stiffness: expected finite numbers"),
        ("coupling.internal.damping", [-(10**400), 0], "coupling.internal.damping: expected finite numbers"),
    ],
)
def test_faults_speak_of_values_and_not_of_validators(key: str, value: Any, message: str) -> None:
    table = plane()
    for finger in table["finger"]:
        finger["hand"] = {"stiffness": 100.0}
    with pytest.raises(SceneError) as caught:
        Scene(**put(table, key, value))
    assert message in str(caught.value)
    assert not any(word in str(caught.value) for word in ("Input tag", "Value error", "ambiguous"))


def test_devices_with_several_fingers() -> None:
    table = line()
    table["device"] = [{"label": "left", "name": "simulated", "mass": 0.1, "fingers": 3}]
    for i, finger in enumerate(table["finger"]):
        finger |= {"device": "left", "channel": 5 * i}
    assert faults(table) == ["finger.1.channel: expected less than 3: 'simulated' has 3 fingers; given 5"]
    table["finger"][1]["channel"] = 2
    [found] = faults(table)
    assert found.startswith("device.0: expected a finger on each channel of a simulated device: ")
    table["device"][0]["fingers"], table["finger"][1]["channel"] = 2, 1
    assert faults(table) == []
    table["finger"][1]["channel"] = 0
    assert faults(table) == ["finger.1.channel: channel 0 of 'left' is already used by finger 0"]
    table["device"].append({"label": "left", "name": "simulated", "mass": 0.1})
    assert "device.1.label: 'left' is the name of an earlier device; expected a different name" in faults(table)
