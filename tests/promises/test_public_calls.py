"""Public calls with arguments that cannot be: each is refused by an error of ours that names the argument."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx import passivity
from graspfx.errors import GraspFXError, InputError, UnknownNameError

VALUES = {"object.mass": [0.1, 0.2]}


@pytest.fixture(scope="module")
def scene() -> gx.Scene:
    return gx.load("reference-1dof")


def batch(**arguments: Any) -> Callable[[gx.Scene], Any]:
    return lambda scene: gx.run_batch(**{"scene": scene, "values": VALUES, "duration": 0.1, **arguments})


def run(**arguments: Any) -> Callable[[gx.Scene], Any]:
    return lambda scene: gx.run(scene, **{"duration": 0.05, **arguments})


def assign(key: str, at: Callable[[gx.Scene], Any]) -> Callable[[gx.Scene], Any]:
    return lambda scene: setattr(at(scene), key, 3.0)


CALLS: dict[str, tuple[Callable[[gx.Scene], Any], str]] = {
    "batch of 10^21 ticks": (batch(duration=9.5e18), "duration: given 9.5e+18, expected at most 9.01e"),
    "run of 10^21 ticks": (run(duration=9.5e18), "this machine's memory has room for"),
    "batch of nothing": (batch(scene=None), "scene: given None, expected a scene"),
    "batch over a list": (batch(values=[1.0]), "values: given [1.0], expected lists by dotted key"),
    "batch over a number": (batch(values={"object.mass": 3.0}), "values['object.mass']: given 3.0, expected a list"),
    "batch of measures": (batch(measure=3), "measure: given 3, expected a list of names"),
    "batch of threads": (batch(threads="two"), "threads: given 'two', expected "),
    "worst motion": (lambda _: passivity.worst_motion(1.0, 0.2, 1e-3, 10**6), "samples: given 1000000, expected at"),
    "run of nothing": (lambda _: gx.run(None), "scene: given None, expected a scene; gx.load(name)"),  # type: ignore[arg-type] # which is no scene
    "run with a list": (run(overrides=["x"]), "overrides: given ['x'], expected values by dotted key"),
    "run with two times": (run(overrides=0.1), "overrides: given 0.1, expected values by dotted key"),
    "run in real time": (run(real_time="yes"), "real_time: given 'yes', expected True for the wall clock, or False"),
    "check of a number": (lambda _: gx.check(3), "scene: given 3, expected a scene; gx.load(name)"),  # type: ignore[arg-type] # likewise
    "certify nothing": (lambda _: gx.certify(None), "scene: given None, expected a scene"),  # type: ignore[arg-type] # likewise
    "run into an array": (run(out=np.zeros(3)), "out: given an array of shape (3,), expected the path of a folder"),
    "run into a number": (run(out=3), "out: given 3, expected the path of a folder"),
    "run into NUL": (run(out="a\0b"), "remove the NUL character"),
    "run until text": (run(stop="x"), "stop: given 'x', expected a function"),
    "key of a scene": (assign("period", lambda scene: scene), "Scene.period: given 3.0, expected no assignment"),
    "key of a part": (assign("mass", lambda scene: scene.object[0]), "Object.mass: given 3.0, expected no assignment"),
    "key of a driver": (assign("mass", lambda scene: scene.finger[0].device), "Device.mass: given 3.0"),
    "new key": (assign("novel", lambda scene: scene), "Scene.novel: given 3.0, expected no assignment"),
    "deletion": (lambda scene: delattr(scene, "period"), "Scene.period: given nothing, expected no assignment"),
    "scene from a table": (
        lambda scene: gx.Scene(scene.to_dict()),  # type: ignore[arg-type] # a table in place of keys
        "expected keys and values: Scene(dimensions=1",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("call", "says"), CALLS.values(), ids=CALLS)
def test_an_argument_that_cannot_be_is_one_error_of_ours(
    call: Callable[[gx.Scene], Any], says: str, scene: gx.Scene
) -> None:
    with pytest.raises(InputError) as caught:
        call(scene)
    assert says in str(caught.value).replace("'nothing'", "nothing")
    assert "pydantic" not in str(caught.value) and "\n" not in str(caught.value)


def test_a_column_that_is_not_there_comes_with_those_that_are(scene: gx.Scene) -> None:
    recording = gx.run(scene, duration=0.05)
    with pytest.raises(UnknownNameError, match="unknown column 'finger_pos'; did you mean 'finger_position'"):
        recording.array("finger_pos")
    with pytest.raises(UnknownNameError, match="unknown column"):
        recording.array(["x"])  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match=r"unknown object 'x' .*known: object"):
        recording.described_pose("x")


def test_a_lone_measure_is_a_list_of_one(scene: gx.Scene) -> None:
    alone = gx.run_batch(scene, VALUES, 0.1, measure="finger_force", statistics="rms")
    assert np.array_equal(alone["finger_force"]["rms"], gx.run_batch(scene, VALUES, 0.1)["finger_force"]["rms"])


def test_a_refused_call_leaves_nothing_behind(scene: gx.Scene, tmp_path: Path) -> None:
    with pytest.raises(GraspFXError):
        gx.run(scene, duration=0.05, out=tmp_path / "out", stop="x")  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())
    assert gx.load("reference-1dof") == scene


@pytest.mark.parametrize("name", ["paper-waving", "own.toml"])
def test_a_name_and_a_path_are_scenes(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every function that takes a scene takes these, with the same values replaced and the same answer."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.toml").write_text(gx.load("paper-waving").source.text, encoding="utf-8")
    changes = {"coupling.internal.stiffness": 60.0}
    scene, changed = gx.load(name), gx.load(name, changes)
    assert np.array_equal(gx.run(name, changes, duration=0.2).rows, gx.run(changed, duration=0.2).rows)
    assert np.array_equal(gx.run(scene, changes, duration=0.2).rows, gx.run(changed, duration=0.2).rows)
    assert np.array_equal(gx.run(Path(name), duration=0.05).rows, gx.run(scene, duration=0.05).rows)
    assert gx.check(name, changes).verdict == gx.check(scene, changes).verdict == gx.check(changed).verdict
    assert gx.certify(name).to_dict() == gx.certify(scene).to_dict()
    assert gx.stability.spectral_radius(name) == gx.stability.spectral_radius(scene)
    assert np.array_equal(gx.stability.loop_matrix(name), gx.stability.loop_matrix(scene))
    masses = {"object.mass": [0.1, 0.2]}
    batches = [gx.run_batch(each, masses, 0.1)["finger_force"]["rms"] for each in (name, scene)]
    assert np.array_equal(batches[0], batches[1])
    assert np.array_equal(gx.testing.check_scene(name, duration=0.1).rows, gx.run(scene, duration=0.1).rows)


def test_a_number_after_the_scene_is_still_its_duration(scene: gx.Scene) -> None:
    with pytest.warns(FutureWarning, match=r"write run\(scene, duration=0.05\)"):
        recording = gx.run(scene, 0.05)
    assert np.array_equal(recording.rows, gx.run(scene, duration=0.05).rows)
