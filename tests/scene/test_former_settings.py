"""Settings under their former names: the same scene, with a note; given twice, a fault."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import graspfx as gx
from graspfx import plugins
from graspfx.errors import InputError, SceneError

NOW = """dimensions = 1
period = 0.005
duration = 0.1
[object]
mass = 0.1
viscosity = 0.8
[coupling]
contact = "attached"
external = { stiffness = 30.0 }
internal = { stiffness = 70.0 }
[[finger]]
device = { name = "simulated", mass = 0.15, damping = 0.2 }
hand = { stiffness = 33.0, rest = [0.0] }
start = [0.002]
[[finger]]
device = { name = "simulated", mass = 0.15, damping = 0.2 }
hand = { stiffness = 33.0, rest = [0.0] }
start = [-0.002]
"""
FORMER = NOW.replace("damping = 0.2", "friction = 0.2")


def write(text: str) -> str:
    """Write a scene into the test's folder and give its path."""
    Path("scene.toml").write_text(text, encoding="utf-8")
    return "./scene.toml"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in a folder of the test's own."""
    monkeypatch.chdir(tmp_path)


def test_a_former_name_runs_the_same_and_is_noted() -> None:
    now, former = gx.load(write(NOW)), gx.load(write(FORMER))
    assert np.array_equal(gx.run(now).rows, gx.run(former).rows)
    assert not any("is called" in note for note in gx.check(now).notes)
    assert [note for note in gx.check(former).notes if "is called" in note] == [
        f"finger.{i}.device.friction is called 'damping' now: the old name is still read" for i in (0, 1)
    ]


@pytest.mark.parametrize("written", [NOW, FORMER])
@pytest.mark.parametrize("key", ["finger.*.device.friction", "finger.*.device.damping"])
def test_an_override_replaces_either_name(written: str, key: str) -> None:
    scene = gx.load(write(written), {key: 0.5})
    assert [finger.device.settings["damping"] for finger in scene.finger] == [0.5, 0.5]  # type: ignore[union-attr]
    assert scene.replace({"finger.0.device.friction": 0.7}).finger[0].device.settings["damping"] == 0.7  # type: ignore[union-attr]


def test_both_names_are_a_fault() -> None:
    with pytest.raises(SceneError, match=r"friction: the former name of 'damping', which is there too: leave it out"):
        gx.load(write(NOW.replace("damping = 0.2", "damping = 0.2, friction = 0.2", 1)))


def test_a_fault_of_the_value_names_the_setting() -> None:
    with pytest.raises(SceneError, match=r"damping.*expected a finite damping of zero or more \[N s/m\]"):
        gx.load(write(FORMER.replace("friction = 0.2", "friction = -0.2", 1)))


def test_connect_itself_takes_the_former_name_with_a_warning() -> None:
    connect = plugins.load("devices", "simulated").connect
    with pytest.warns(FutureWarning, match="'friction' is called 'damping' now"):
        device = connect(mass=0.1, friction=0.2, dimensions=1)
    assert device.features.friction == 0.2
    with pytest.raises(InputError, match="its former name"):
        connect(mass=0.1, friction=0.2, damping=0.2, dimensions=1)
    with pytest.warns(FutureWarning, match="'joint_friction' is called 'joint_damping' now"):
        plugins.load("devices", "two-link").connect(joint_friction=1e-3)
