"""Objects that no finger names: fingers hold one object, and what it meets is moved by it alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.__main__ import main
from graspfx.errors import SceneError

POINT = {"name": "simulated", "mass": 0.1, "damping": 0.5}
SIDE = 0.04  # [m]
NATIVE = ["explicit", "semi-implicit", "exact", "implicit"]


def two_blocks(d: int, **changes: Any) -> gx.Scene:
    """Two fingers squeeze the first of two blocks in a row; nobody holds the second."""
    turning = {"rotational_viscosity": 1e-3} if d > 1 else {}
    blocks = [
        {
            "name": name,
            "mass": 0.1,
            "viscosity": 0.5,
            "shape": {"kind": "box", "size": [SIDE] * d},
            "position": [x] + [0.0] * (d - 1),
            **turning,
        }
        for name, x in (("held", 0.0), ("free", 0.0405))
    ]
    axis = min(d - 1, 1)  # across the row, where there is an across
    hand = {"stiffness": 200.0, "squeeze": 0.004, "squeeze_ramp": 0.01}
    fingers = [
        {"device": POINT, "object": "held", "hand": hand, "start": (side * SIDE / 2 * np.eye(d)[axis]).tolist()}
        for side in (-1.0, 1.0)
    ]
    coupling = {"external": {"stiffness": 100.0}, "internal": {"stiffness": 200.0}, "friction": "stick"}
    scene = gx.Scene(dimensions=d, period=0.001, duration=0.03, object=blocks, coupling=coupling, finger=fingers)
    return scene.replace({key.replace("__", "."): value for key, value in changes.items()})


def alone(scene: gx.Scene) -> gx.Scene:
    """The same scene without the block that nobody holds."""
    table = scene.to_dict()
    return gx.Scene(**{**table, "object": table["object"][:1]})


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("integrator", NATIVE)
def test_a_native_object_without_fingers_changes_nothing(d: int, integrator: str) -> None:
    """Native objects pass through one another: the grasp has the bits, and the certificate, of the scene without it."""
    scene = two_blocks(d).replace({"object.*.integrator": integrator, "object.1.velocity": [0.1] * d})
    with_it, without = gx.run(scene), gx.run(alone(scene))
    assert not with_it.faults and with_it.touching[-1].all()
    np.testing.assert_array_equal(with_it.finger_force, without.finger_force)
    np.testing.assert_array_equal(with_it.objects["held"].position, without.objects["held"].position)
    assert with_it.objects["free"].position[-1, 0] > 0.0405 + 0.0025  # 0.1 m/s for 30 ms, slowed by its viscosity
    report = gx.check(scene)
    assert report.ok and report.verdict == gx.check(alone(scene)).verdict
    assert [each.object for each in report.certificates] == ["held"]


@pytest.mark.parametrize(
    "changes",
    [
        {"coupling__metric": "mass"},
        {
            "coupling__internal__stiffness": [200.0, 210.0],
            "coupling__internal__damping": [0.1, 0.11],
            "coupling__form": "symmetric",
        },
        {"coupling__friction": 0.5},
        {"coupling__passivity": "control"},
        {"coupling__contact": "attached"},
        {"coupling__absent": "follow"},
        {"safety": {"force": 3.0}},
        {"finger__*__pad": {"kind": "hertz", "stiffness": 2e4}},
        {"finger__*__friction": 0.5, "coupling__friction": 0.4},
    ],
    ids=lambda changes: "+".join(changes),
)
def test_every_rule_of_the_coupling_takes_an_object_without_fingers(changes: dict[str, Any]) -> None:
    scene = two_blocks(2, **changes)
    with_it, without = gx.run(scene), gx.run(alone(scene))
    assert not with_it.faults
    np.testing.assert_array_equal(with_it.finger_force, without.finger_force)
    assert gx.check(scene).verdict == gx.check(alone(scene)).verdict


@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
def test_engines_replays_batches_and_pages_take_it(engine: str, tmp_path: Path) -> None:
    scene = two_blocks(2, engine=engine, duration=0.01)
    recording = gx.run(scene)
    again = gx.replay(recording)
    np.testing.assert_array_equal(again.finger_force, recording.finger_force)
    recording.save(tmp_path / "blocks.h5")
    back = gx.Recording.load(tmp_path / "blocks.h5")
    np.testing.assert_array_equal(back.objects["free"].position, recording.objects["free"].position)
    recording.to_html(tmp_path / "blocks.html")
    batch = gx.run_batch(scene, {"object.1.mass": [0.1, 0.2]})
    assert len(batch) == 2
    with gx.open(scene, live=["object.1.mass", "coupling.internal.stiffness"]) as session:
        session.set({"object.1.mass": 0.2})
        session.step(3)


def test_one_block_pushes_another() -> None:
    pytest.importorskip("mujoco")
    hand = {"stiffness": 200.0, "motion": {"kind": "reach", "displacement": [0.05], "duration": 0.1}}
    table = two_blocks(1, duration=0.2).to_dict() | {"world": {"collide": True}}
    table["object"] = [{**each, "dynamics": "mujoco"} for each in table["object"]]
    table["finger"] = [{**table["finger"][0], "hand": hand}]
    recording = gx.run(gx.Scene(**table))
    held, free = (recording.objects[name].position[:, 0] for name in ("held", "free"))
    assert free[-1] > 0.06 and (free - held).min() > SIDE - 5e-4


TOWARD = {"toward": [1.0, 0.0], "gap": 0.001}


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"start": TOWARD},
        {"pad": {"kind": "hertz", "stiffness": 2e4}},
        {"model": "soft", "patch": 0.004, "start": [0.02, 0.0, 0.0]},
    ],
    ids=lambda more: "+".join(more),
)
def test_an_object_that_is_not_there_is_a_fault_of_the_scene(more: dict[str, Any]) -> None:
    table = two_blocks(3 if "model" in more else 2, coupling__contact="attached").to_dict()
    table["finger"] = [{"device": POINT, "start": [0.02, 0.0], **more}]
    with pytest.raises(SceneError, match="object: expected at least one"):
        gx.Scene(**{**table, "object": []})
    table["finger"][0]["object"] = "nobody"
    with pytest.raises(SceneError, match="has the name 'nobody'"):
        gx.Scene(**table)


def test_check_tells_of_an_empty_list_of_objects(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "paper-spring", "--set", "object=[]"]) == 2
    assert "object: expected at least one" in capsys.readouterr().err
