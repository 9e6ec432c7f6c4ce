"""Obstacles in scenes: faults in what meets what, the plan's words, and a run of objects on a floor."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.certificate.plan import plan
from graspfx.errors import SceneError
from tests.support.carriers import CARRIERS, require

FLOOR = {"name": "floor", "shape": {"kind": "half-space", "normal": [0.0, 0.0, 1.0]}}
BLOCK = {"name": "block", "shape": {"kind": "box", "size": [0.1, 0.1, 0.1]}, "position": [0.3, 0.0, 0.05]}


def thing(name: str = "box", x: float = 0.0, **changes: Any) -> dict[str, Any]:
    return {
        "name": name,
        "mass": 0.1,
        "viscosity": 0.2,
        "rotational_viscosity": 2e-5,
        "shape": {"kind": "box", "size": [0.05, 0.05, 0.05]},
        "position": [x, 0.0, 0.025],
        **changes,
    }


def finger(x: float, sign: float, **changes: Any) -> dict[str, Any]:
    hand = {"stiffness": 500.0, "damping": 12.0, **changes}
    device = {"name": "simulated", "mass": 0.1, "damping": 1.0}
    return {"start": [x - 0.03 * sign, 0.0, 0.025], "device": device, "hand": hand}


def table(*things: dict[str, Any], **changes: Any) -> dict[str, Any]:
    objects = things or (thing(),)
    fingers = [
        finger(each.get("position", [0.0])[0], sign) | {"object": each["name"]}
        for each in objects
        for sign in (1.0, -1.0)
    ]
    return {
        "dimensions": 3,
        "period": 0.002,
        "duration": 0.5,
        "gravity": [0.0, 0.0, -9.81],
        "object": list(objects),
        "coupling": {
            "external": {"stiffness": 500.0, "damping": 1.0},
            "internal": {"stiffness": 800.0, "damping": 1.0},
            "friction": "stick",
        },
        "finger": fingers,
        "obstacle": [FLOOR],
        **changes,
    }


def faults(*things: dict[str, Any], **changes: Any) -> list[str]:
    with pytest.raises(SceneError) as caught:
        gx.Scene(**table(*things, **changes))
    return [f"{fault.key}: {fault.message}" for fault in caught.value.faults]


def row(scene: gx.Scene, step: str) -> Any:
    [found] = [each for each in plan(scene) if each.step == step]
    return found


LYING: dict[str, Any] = {"name": "rod", "shape": {"kind": "half-space", "normal": [0.0, 0.0, 1.0]}, "inertia": 1e-5}
CASES: list[tuple[list[dict[str, Any]], dict[str, Any], str]] = [
    ([], {"obstacle": [FLOOR, BLOCK]}, "obstacle.1.shape.kind: box with native dynamics can collide only with"),
    ([], {"world": {"restitution": 0.5}}, "world.restitution: box with native dynamics does not bounce"),
    ([], {"world": {"restitution": 1.5}}, "world.restitution: expected no more than 1; given 1.5"),
    ([], {"world": {"friction": -1.0}}, "world.friction: expected no less than 0"),
    (
        [],
        {"obstacle": [FLOOR, FLOOR]},
        "obstacle.1.name: 'floor' is the name of an earlier obstacle; expected a different name",
    ),
    ([], {"obstacle": [FLOOR | {"position": [0.0]}]}, "obstacle.0.position: expected 3 numbers"),
    (
        [],
        {"obstacle": [FLOOR | {"orientation": [0.0, 0.0, 0.0, 2.0]}]},
        "obstacle.0.orientation: expected a unit quaternion",
    ),
    ([], {"obstacle": [FLOOR | {"shape": {"kind": "half-space", "normal": [1.0]}}]}, "obstacle.0.shape.normal: expec"),
    ([], {"obstacle": [{"name": "floor"}]}, "obstacle.0.shape: required, but not given"),
    ([thing(position=[0.0, 0.0, 0.02])], {}, "object.0.position: the object starts 5 mm inside the obstacle 'floor'"),
    (
        [thing(**LYING)],
        {},
        "object.0.shape.kind: a half-space is unbounded and cannot move: lock all its degrees of freedom",
    ),
    ([thing(), thing("b", 0.2)], {"world": {"collide": True}}, "object.0.dynamics: native objects do not collide with"),
]


@pytest.mark.parametrize(("things", "changes", "said"), CASES)
def test_faults_say_what_cannot_meet(things: list[dict[str, Any]], changes: dict[str, Any], said: str) -> None:
    assert any(fault.startswith(said) for fault in faults(*things, **changes)), faults(*things, **changes)


def flat(dynamics: str, *obstacles: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """A box on the ground in the plane: the object, and the other tables."""
    ground = {"name": "ground", "shape": {"kind": "half-space", "normal": [0.0, 1.0]}}
    fingers = [each | {"start": each["start"][::2]} for each in table()["finger"]]
    plane = {"dimensions": 2, "gravity": [0.0, -9.81], "finger": fingers, "obstacle": [ground, *obstacles]}
    return thing(dynamics=dynamics, shape={"kind": "box", "size": [0.05, 0.05]}, position=[0.0, 0.025]), plane


def test_bullet_worlds_are_in_space_and_whole() -> None:
    pytest.importorskip("pybullet", reason="pybullet has no wheel for this Python or platform")
    [fault] = faults(thing(dynamics="bullet", free=[True, True, True, False, False, False]))
    assert fault.startswith("object.0.free: PyBullet cannot lock single degrees of freedom of a body with contacts")
    things, changes = flat("bullet")
    [fault] = faults(things, **changes)
    assert fault.startswith("object.0.dynamics: a PyBullet world has three dimensions, given 2: set")
    assert "or use dynamics = 'mujoco', or 'native' with obstacles that are half-spaces or planes" in fault


def test_mujoco_worlds_are_flat_or_partly_locked_too() -> None:
    require("mujoco")
    step = {"name": "step", "shape": {"kind": "box", "size": [0.02, 0.02]}, "position": [0.3, 0.01]}
    things, changes = flat("mujoco", step)
    rec = gx.run(gx.Scene(**table(things, **changes)), duration=0.1)
    assert not rec.faults and abs(rec.object_position[-1][1] - 0.025) < 1e-6
    partly = gx.Scene(**table(thing(dynamics="mujoco", free=[True, True, True, False, False, False])))
    rec = gx.run(partly, duration=0.1)
    assert not rec.faults and abs(rec.object_position[-1][2] - 0.025) < 1e-6
    [fault] = faults(thing(dynamics="mujoco", free=[True, True, True, True, True, False]))
    assert fault.startswith("object.0.free: MuJoCo has no joint for")


def test_the_plan_says_what_each_object_meets() -> None:
    scene = gx.Scene(**table(world={"friction": 0.3}))
    assert row(scene, "meet").runs
    assert row(scene, "meet").why == "floor, friction 0.3, 100000 N/m per point; with its corners"
    assert "fingers pass through" in row(scene, "fingers on obstacles").why
    two = gx.Scene(**table(thing(), thing("b", 0.2)))
    assert (
        "passes through other objects (it collides with them if dynamics = 'bullet' or 'mujoco')"
        in row(two, "meet b").why
    )
    alone = gx.Scene(**table(thing(), thing("b", 0.2), obstacle=[]))
    assert not row(alone, "meet b").runs
    assert not any(each.step.startswith("meet") for each in plan(gx.Scene(**table(obstacle=[]))))


@pytest.mark.parametrize("dynamics", CARRIERS)
def test_the_plan_names_a_world(dynamics: str) -> None:
    require(dynamics)
    label = {"bullet": "PyBullet", "mujoco": "MuJoCo"}[dynamics]
    egg = {"kind": "ellipsoid", "semi_axes": [0.025, 0.025, 0.02]}
    scene = gx.Scene(**table(thing(dynamics=dynamics), thing("b", 0.2, dynamics=dynamics, shape=egg)))
    assert row(scene, "meet box").why == f"floor, b, friction 0.5, restitution 0, in one {label} world"
    assert row(scene, "meet b").why.endswith("as its convex hull") == (dynamics == "bullet")


@pytest.mark.parametrize("dynamics", ["native", *CARRIERS])
def test_a_box_is_lifted_and_put_down(dynamics: str) -> None:
    """Squeezed by two fingers, lifted by 30 mm, put down again and let go: it rests within 0.1 mm of where it was."""
    require(dynamics)
    times = [0.0, 0.3, 0.6, 0.9, 1.2, 1.5, 1.8]
    close = [0.0, 0.015, 0.015, 0.015, 0.015, -0.01, -0.01]
    up = [0.0, 0.0, 0.03, 0.03, 0.0, 0.0, 0.0]
    fingers = []
    for sign in (1.0, -1.0):
        path = [[sign * c, 0.0, z] for c, z in zip(close, up, strict=True)]
        fingers.append(finger(0.0, sign, motion={"kind": "path", "times": times, "positions": path}))
    rec = gx.run(gx.Scene(**table(thing(dynamics=dynamics), finger=fingers, duration=1.8)))
    assert not rec.faults
    height = rec.object_position[:, 2]
    assert height.max() > 0.045 and rec.touching[450].all() and not rec.touching[-1].any()
    np.testing.assert_allclose(rec.object_position[-1], [0.0, 0.0, 0.025], rtol=0.0, atol=1e-4)
    assert np.abs(rec.object_position[-1] - rec.object_position[-50]).max() < 1e-12
    assert np.abs(rec.object_velocity[-1]).max() < 1e-12


@pytest.mark.parametrize("dynamics", CARRIERS)
def test_objects_in_one_world_run_equally_twice_and_push_one_another(dynamics: str) -> None:
    """A box pushed along the floor pushes the next one."""
    require(dynamics)
    motion = {"kind": "reach", "displacement": [0.04, 0.0, 0.0], "duration": 0.3}
    scene = table(thing(dynamics=dynamics), thing("b", 0.06, dynamics=dynamics))
    pushing = finger(0.0, 1.0, motion=motion) | {"object": "box"}
    idle = finger(0.06, 1.0) | {"object": "b", "start": [0.06, 0.1, 0.025]}
    given = gx.Scene(**(scene | {"finger": [pushing, idle]}))
    first, second = gx.run(given), gx.run(given)
    assert np.array_equal(first.finger_force, second.finger_force)
    assert all(np.array_equal(first.objects[name].position, second.objects[name].position) for name in ("box", "b"))
    assert first.objects["b"].position[-1][0] > 0.065


def test_a_flying_object_does_not_feel_a_far_floor() -> None:
    """The recording is that without obstacles, bit by bit."""
    far = FLOOR | {"position": [0.0, 0.0, -10.0]}
    with_floor = gx.run(gx.Scene(**table(obstacle=[far])), duration=0.2)
    without = gx.run(gx.Scene(**table(obstacle=[])), duration=0.2)
    assert np.array_equal(with_floor.object_position, without.object_position)
    assert np.array_equal(with_floor.finger_force, without.finger_force)


PLUGIN = """
from graspfx.objects.body import NativeBody

calls = []

class World:
    def __init__(self, members):
        self.bodies = [NativeBody(member.state) for member in members]
    def step(self, T):
        for body in self.bodies:
            body.step(T)

def create(state):
    return NativeBody(state)

def create_world(members, obstacles, meeting):
    calls.append(([member.shape for member in members], [o.name for o in obstacles], meeting))
    return World(members)
"""


def test_dynamics_of_others_get_the_world_through_create_world(tmp_path: Any) -> None:
    file = tmp_path / "mine.py"
    file.write_text(PLUGIN)
    both = (thing(dynamics=str(file)), thing("b", 0.2, dynamics=str(file)))
    scene = gx.Scene(**table(*both, world={"friction": 0.7}))
    rec = gx.run(scene, duration=0.02)
    assert not rec.faults
    from graspfx import plugins

    [(shapes, names, meeting)] = plugins.load("dynamics", str(file)).calls
    assert len(shapes) == 2 and names == ["floor"] and meeting.friction == 0.7
    file.write_text(PLUGIN.split("def create_world")[0])
    for changes in ({}, {"obstacle": [], "world": {"collide": True}}):
        with pytest.raises(gx.errors.SceneError, match=r"object\.0\.dynamics: .* no create_world"):
            gx.Scene(**table(*both, **changes))
    assert not gx.run(gx.Scene(**table(*both, obstacle=[])), duration=0.02).faults


def test_a_fault_in_a_world_names_its_objects_and_stops_them_alone(tmp_path: Any) -> None:
    """The world of a and b fails at its tenth step; c, on a native floor, goes on."""
    file = tmp_path / "failing.py"
    failing = "        from graspfx.errors import GraspFXError\n        self.n = getattr(self, 'n', 0) + 1\n"
    failing += "        if self.n == 10:\n            raise GraspFXError('the spring broke')\n        for body"
    file.write_text(PLUGIN.replace("        for body", failing))
    objects = (thing("a", dynamics=str(file)), thing("b", 0.2, dynamics=str(file)), thing("c", 0.4))
    rec = gx.run(gx.Scene(**table(*objects, gravity=[0.0, 0.1, 0.0])), duration=0.06)
    [fault] = rec.faults
    assert "a, b: the spring broke" in fault.message
    y = {name: rec.objects[name].position[:, 1] for name in "abc"}
    assert np.ptp(y["a"][10:]) == 0.0 and np.ptp(y["b"][10:]) == 0.0 and (np.diff(y["c"][10:]) > 0.0).all()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x = 1", "object.0.dynamics: the dynamics .* has no function create"),
        ("import nowhere_at_all", "object.0.dynamics: .* cannot be imported: .*own.py:1: ModuleNotFoundError"),
        ("def create(state):\n    raise ValueError('no')", "own.py:2: ValueError: no"),
    ],
)
def test_dynamics_that_make_no_body_say_which_file_and_why(tmp_path: Any, text: str, said: str) -> None:
    file = tmp_path / "own.py"
    file.write_text(text)
    with pytest.raises(gx.errors.GraspFXError, match=said):
        gx.run(gx.Scene(**table(thing(dynamics=str(file)), obstacle=[])), duration=0.02)
