"""Fingers that start along a direction: where the grasp itself finds the gap that was asked for."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.build import build
from graspfx.assembly.resolve import resolve
from graspfx.assembly.scene_cache import cached, keep, place
from graspfx.coupling.grasp_state import FingerState
from graspfx.errors import SceneError
from graspfx.scene.model import schema

RNG = np.random.default_rng(5)
TURNED = {2: 0.7, 3: [0.1, -0.2, 0.3, float(np.sqrt(1.0 - 0.14))]}
SHAPES: dict[str, tuple[int, Mapping[str, Any]]] = {
    "interval": (1, {"kind": "box", "size": [0.05]}),
    "square": (2, {"kind": "box", "size": [0.05, 0.03]}),
    "stadium": (2, {"kind": "capsule", "radius": 0.01, "length": 0.03}),
    "box": (3, {"kind": "box", "size": [0.05, 0.03, 0.04]}),
    "sphere": (3, {"kind": "sphere", "radius": 0.03}),
    "capsule": (3, {"kind": "capsule", "radius": 0.01, "length": 0.03}),
    "cylinder": (3, {"kind": "cylinder", "radius": 0.02, "length": 0.03}),
    "ellipsoid": (3, {"kind": "ellipsoid", "semi_axes": [0.03, 0.02, 0.01]}),
    "half-space": (3, {"kind": "half-space", "normal": [0.0, 0.0, 1.0]}),
    "plane": (3, {"kind": "plane", "normal": [0.0, 0.0, 1.0]}),
    "mesh": (3, {"mesh": "scenes/meshes/mug.ply", "scale": 0.001}),
}


WAYS = {  # that lead out of a half-space, and not out of an open mug
    "half-space": [[0.2, 0.3, 0.9], [0.5, 0.2, 0.8]],
    "mesh": [[1.0, 0.3, 0.1], [-1.0, 0.5, -0.2], [0.1, -1.0, 0.0]],
}


def scene(d: int, shape: Mapping[str, Any] | None, starts: list[Any], **changes: Any) -> gx.Scene:
    """Fingers on an object that stands away from the origin, turned."""
    thing: dict[str, Any] = {"mass": 0.1, "viscosity": 0.8, "position": [0.3, -0.2, 0.1][:d]}
    thing |= {} if shape is None else {"shape": shape}
    thing |= {} if d == 1 else {"rotational_viscosity": 1e-3, "orientation": TURNED[d]}
    thing |= {"inertia": 1e-4} if shape is not None and shape.get("kind") in ("half-space", "plane") else {}
    device = {"name": "simulated", "mass": 0.1, "damping": 0.5}
    table = {
        "dimensions": d, "period": 0.005, "duration": 0.05, "object": thing,
        "coupling": {"external": {"stiffness": 30.0}, "internal": {"stiffness": 70.0}},
        "finger": [{"start": start, "device": device, "hand": {"stiffness": 30.0}} for start in starts],
    }  # fmt: skip
    return gx.Scene(**table).replace(changes)


def gaps(made: gx.Scene) -> np.ndarray[Any, np.dtype[np.float64]]:
    with build(made) as servo:
        return np.concatenate([part.grasped.array(FingerState.gap).copy() for part in servo.objects])


def towards(d: int, count: int = 6) -> list[list[float]]:
    return RNG.normal(size=(count, d)).tolist()


@pytest.mark.parametrize("contact", ["unilateral", "attached"])
@pytest.mark.parametrize("name", SHAPES)
def test_the_grasp_finds_the_gap(name: str, contact: str) -> None:
    d, shape = SHAPES[name]
    ways = WAYS.get(name) or towards(d)
    for radius in (0.0, 0.007):
        starts = [{"toward": u, "gap": gap} for u in ways for gap in (0.0, 0.0013)]
        made = scene(d, shape, starts, **{"finger.*.radius": radius, "coupling.contact": contact})
        assert np.abs(gaps(made) - np.tile([0.0, 0.0013], len(ways))).max() < 1e-16


@pytest.mark.parametrize("name", ["interval", "square", "box"])
def test_it_is_on_the_ray_from_the_centre_in_world_axes(name: str) -> None:
    """Any length of the direction will do; twice the gap is farther out on the same ray."""
    d, shape = SHAPES[name]
    centre = np.array([0.3, -0.2, 0.1])[:d]
    for u in towards(d, 3):
        lengths = [1.0, 1e-30, 1e30]
        near, *others = resolve(scene(d, shape, [{"toward": [k * x for x in u]} for k in lengths])).start
        assert all(np.allclose(other, near, rtol=0, atol=1e-16) for other in others)
        away = near - centre
        assert np.allclose(away / np.linalg.norm(away), np.array(u) / np.linalg.norm(u), rtol=0, atol=1e-14)
        [far] = resolve(scene(d, shape, [{"toward": u, "gap": 0.01}])).start
        assert np.linalg.norm(far - centre) >= np.linalg.norm(away) + 0.01 - 1e-15


def test_the_centre_of_a_mesh_is_its_centre_of_mass() -> None:
    """Where the recorded object is, not where its file has the origin."""
    made = scene(3, SHAPES["mesh"][1], [{"toward": [-1.0, 0.0, 0.0]}])
    with build(made) as servo:
        centre = servo.objects[0].grasped.state.body.motion.position
    [start] = resolve(made).start
    away = start - np.array([centre.x, centre.y, centre.z])
    assert np.allclose(away / np.linalg.norm(away), [-1.0, 0.0, 0.0], rtol=0, atol=1e-13)


def test_a_scene_with_directions_is_the_scene_with_their_coordinates() -> None:
    """Resolved once: the run has the bits of a scene in which the numbers stand."""
    changes = {"finger.0.start": {"toward": [-1.0, 0.1], "gap": 0.001}, "finger.1.start": {"toward": [1.0, -0.2]}}
    made = gx.load("paper-waving", changes)
    numbers = {f"finger.{i}.start": start for i, start in enumerate(resolve(made).start.tolist())}
    other = gx.load("paper-waving", numbers)
    assert gx.run(made, duration=0.3).rows.tobytes() == gx.run(other, duration=0.3).rows.tobytes()
    assert made.to_dict()["finger"][0]["start"] == {"toward": [-1.0, 0.1], "gap": 0.001}
    assert gx.Scene(**made.to_dict()) == made


def test_two_objects_each_with_its_fingers() -> None:
    base = scene(2, SHAPES["square"][1], [{"toward": [1.0, 0.0]}, {"toward": [-1.0, 0.0]}]).to_dict()
    first = base.pop("object")[0]
    things = [{**first, "name": "a"}, {**first, "name": "b", "position": [1.0, 1.0], "orientation": 0.0}]
    base["finger"][1]["object"] = "b"
    made = gx.Scene(**base, object=things)
    assert np.allclose(resolve(made).start[1], [1.0 - 0.025, 1.0], rtol=0, atol=1e-16)
    assert np.abs(gaps(made)).max() < 1e-16


def test_the_plan_says_where_they_start() -> None:
    made = gx.load("paper-waving", {"finger.0.start": {"toward": [-1.0, 0.0], "gap": 0.002}, "finger.0.radius": 0.004})
    rows = {row.step: row.why for row in gx.check(made).plan if row.step.startswith("start")}
    assert rows == {"start thumb": "at -0.031, 0 m, 2 mm from the surface, a ball of 4 mm"}


TEXT = """dimensions = 2
period = 0.005
duration = 0.1
object = { mass = 0.1, viscosity = 0.8, rotational_viscosity = 1e-3, shape = { kind = "box", size = [0.05, 0.05] } }
coupling = { external = { stiffness = 30.0 }, internal = { stiffness = 70.0 } }

[[finger]]
device = { name = "simulated", mass = 0.1, damping = 0.5 }
hand = { stiffness = 30.0 }
start = START
"""


@pytest.mark.parametrize(
    ("start", "key", "message"),
    [
        ("{ toward = [0.0, 0.0] }", "finger.0.start.toward", "expected a direction; given zeros"),
        ("{ toward = [1.0] }", "finger.0.start.toward", "expected 2 numbers (dimensions = 2); given [1.0]"),
        ("{ toward = [1.0, 0.0], gap = -0.001 }", "finger.0.start.gap", "expected no less than 0; given -0.001"),
        ("{ toward = [1.0, nan] }", "finger.0.start.toward.1", "expected a finite number; given nan"),
        ("{ gap = 0.001 }", "finger.0.start.toward", "required, but not given"),
        ("{ toward = [1.0, 0.0], gp = 0.001 }", "finger.0.start.gp", "unknown key; did you mean 'gap'?"),
        ("3.0", "finger.0.start", "expected a list; given 3.0"),
    ],
)
def test_faults_have_their_lines(start: str, key: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text(TEXT.replace("START", start), encoding="utf-8")
    with pytest.raises(SceneError) as error:
        gx.load(file)
    [fault] = error.value.faults
    assert (fault.key, fault.message, fault.line) == (key, message, 10)


def test_directions_that_lead_nowhere() -> None:
    with pytest.raises(
        SceneError, match=r"finger.0.start: expected coordinates, because 'object' has no shape from which"
    ):
        scene(1, None, [{"toward": [1.0]}], **{"coupling.contact": "attached"})
    with pytest.raises(SceneError, match=r"start.toward: 'object' has no surface along \[0.0, 0.0, 1.0\] from its"):
        scene(3, SHAPES["mesh"][1], [{"toward": [0.0, 0.0, 1.0]}], **{"object.orientation": [0.0, 0.0, 0.0, 1.0]})
    with pytest.raises(SceneError, match=r"start.toward: 'object' has no surface along"):  # out of the open mug
        scene(3, SHAPES["half-space"][1], [{"toward": [0.0, 0.0, -1.0]}])
    with pytest.raises(SceneError) as error:  # its shape has the fault, and the finger none
        scene(2, {"kind": "box", "size": [0.05]}, [{"toward": [1.0, 0.0]}])
    assert [fault.key for fault in error.value.faults] == ["object.shape.size"]


def test_hands_that_close_on_their_mean_take_directions() -> None:
    hand = {"name": "right", "arm": {"stiffness": 30.0}, "grip": {"stiffness": 30.0}, "closing": "centre",
            "squeeze": 0.002}  # fmt: skip
    starts = [{"toward": [-1.0, 0.0]}, {"toward": [1.0, 0.0]}]
    made = scene(2, SHAPES["square"][1], starts, **{"finger.*.hand": "right", "hand": [hand]})
    assert gx.run(made).touching.any()


def test_a_scene_from_the_cache_starts_there_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path / "cache"))
    file = tmp_path / "own.toml"
    file.write_text(TEXT.replace("START", "{ toward = [1.0, 0.3], gap = 0.001 }"), encoding="utf-8")
    made, where = gx.load(file), place(str(file), {})
    assert where is not None
    keep(where, made, [])
    entry = cached(where)
    assert entry is not None
    assert resolve(entry[0]).start.tobytes() == resolve(made).start.tobytes()


def test_the_schema_has_both_forms() -> None:
    text = json.dumps(schema())
    assert '"toward"' in text and '"gap"' in text
