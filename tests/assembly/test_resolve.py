"""A scene is resolved once: a run or a check connects each device once and reads each mesh once; runs share none."""

from __future__ import annotations

import copy
import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx import plugins
from graspfx.__main__ import main
from graspfx.assembly import bodies, meshes
from graspfx.assembly import run_scene as whole_run
from graspfx.assembly.build import build
from graspfx.assembly.resolve import resolve
from graspfx.errors import NoRestError, SceneError
from tests.support.hardware import VirtualClock

COUNTED = '''
"""The simulated device, and in `log` a line for each call of connect and of open."""
from pathlib import Path
from graspfx import plugins

def connect(*, log, dimensions, fingers=1, mass=0.1, damping=0.3):
    device = plugins.load("devices", "simulated").connect(
        mass=mass, damping=damping, dimensions=dimensions, fingers=fingers, workspace=([-1.0], [1.0])
    )
    own = device.open
    def open(period):
        with Path(log).open("a") as file: file.write("open\\n")
        own(period)
    device.open = open
    with Path(log).open("a") as file: file.write("connect\\n")
    return device
'''


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """The file in which the devices of `table` write."""
    (tmp_path / "counted.py").write_text(COUNTED)
    return tmp_path / "log"


def table(log: Path) -> dict[str, Any]:
    """Three devices, one of them with two fingers, on a line."""
    device = {"name": str(log.parent / "counted.py"), "log": str(log)}
    both = [{"start": [0.026], "device": "both", "channel": channel} for channel in (0, 1)]
    return {
        "dimensions": 1,
        "period": 0.005,
        "duration": 0.1,
        "object": {"mass": 0.1, "viscosity": 1.0, "shape": {"kind": "box", "size": [0.05]}},
        "coupling": {"external": {"stiffness": 50.0}, "internal": {"stiffness": 60.0}},
        "device": [{"label": "both", **device, "fingers": 2}],
        "finger": [
            {"start": [-0.026], "device": device, "hand": {"stiffness": 40.0, "squeeze": 0.002}},
            {"start": [-0.027], "device": device},
            *both,
        ],
    }


def calls(log: Path) -> tuple[int, int]:
    """How often devices were connected and opened since the last time that this was asked."""
    lines = log.read_text().split() if log.exists() else []
    log.unlink(missing_ok=True)
    return lines.count("connect"), lines.count("open")


def test_a_device_is_connected_once_for_a_run_and_once_for_a_check(log: Path, tmp_path: Path) -> None:
    given = tmp_path / "scene.json"
    (tmp_path / "counted_scene.py").write_text(
        "import json\nfrom pathlib import Path\nimport graspfx as gx\n"
        f"def scene():\n    return gx.Scene(**json.loads(Path({str(given)!r}).read_text()))\n"
    )
    given.write_text(json.dumps(table(log)))
    gx.run(gx.Scene(**table(log)))
    assert calls(log) == (3, 3)
    assert "finger1, finger2, finger3 do not touch" in gx.check(gx.Scene(**table(log))).verdict  # nobody leads them
    assert calls(log) == (3, 3)
    with build(gx.Scene(**table(log))):
        assert calls(log) == (3, 3)
    with pytest.raises(NoRestError):
        gx.certify(gx.Scene(**table(log)))
    assert calls(log) == (3, 0)
    # a Python scene is made by its file, and once more with the overrides and the file's name
    assert main(["run", str(tmp_path / "counted_scene.py"), "--no-figure", "--out", str(tmp_path / "out")]) == 0
    assert calls(log) == (6, 3)


def test_a_second_run_opens_its_devices_again_and_gives_the_same_bits(log: Path) -> None:
    scene = gx.Scene(**table(log))
    first = gx.run(scene)
    assert calls(log) == (3, 3)
    second = gx.run(scene)
    assert calls(log) == (0, 3)
    assert first.finger_force.tobytes() == second.finger_force.tobytes()
    with build(scene) as one, build(scene) as other:
        assert not {id(each.device) for each in one.stations} & {id(each.device) for each in other.stations}


def test_a_copy_of_a_scene_shares_no_device_with_it(log: Path) -> None:
    scene = gx.Scene(**table(log))
    devices = {id(wire.device) for wire in resolve(scene).wires}
    others = (
        copy.copy(scene),
        copy.deepcopy(scene),
        pickle.loads(pickle.dumps(scene)),
        scene.model_copy(update={"engine": "interpreted"}),
        scene.replace({"object.mass": 0.2}),
    )
    assert others[0] == others[1] == others[2] == scene
    for other in others:
        assert not devices & {id(wire.device) for wire in resolve(other).wires}
        assert resolve(other).scene is other and resolve(other) is resolve(other)
    assert {id(wire.device) for wire in resolve(scene).wires} == devices


def test_a_finger_out_of_reach_is_told_with_its_key_by_runs_checks_and_builds(log: Path) -> None:
    far = gx.Scene(**table(log)).replace({"finger.1.start": [-1.5]})
    for each in (gx.run, gx.Scene.require_reach, lambda scene: build(scene).__enter__()):
        with pytest.raises(SceneError) as raised:
            each(far)
        assert [fault.key for fault in raised.value.faults] == ["finger.1.start"]
    assert "outside the device's workspace" in gx.check(far).faults[0].message


def test_a_mesh_is_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    entries: list[str] = []
    read = meshes.scene_mesh

    def counted(table: Any, folder: Path | None) -> Any:
        entries.append(table.name)
        return read(table, folder)

    monkeypatch.setattr(bodies, "scene_mesh", counted)
    scene = gx.load("mug", {"duration": 0.01})
    gx.run(scene)
    gx.check(scene)
    assert sorted(entries) == sorted([scene.object[0].name, *(each.name for each in scene.obstacle)])


def test_warnings_of_a_law_are_each_run_s_own(log: Path) -> None:
    part = resolve(gx.Scene(**table(log))).objects[0]
    assert part.law is not part.law and part.grasped().law is not part.grasped().law


def test_a_real_device_is_never_opened_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A device that may be opened once in its life, as one that holds a port: every run has another."""
    monkeypatch.setattr(whole_run, "WallClock", VirtualClock)
    (tmp_path / "once.py").write_text(
        "from graspfx import plugins\n"
        "import numpy as np\n"
        "class Once:\n"
        "    def __init__(self): self.features = plugins.load('devices', 'simulated').connect("
        "mass=0.1, dimensions=1).features; self.opened, self.time = 0, 0.0\n"
        "    def open(self, period):\n"
        "        self.opened += 1\n"
        "        assert self.opened == 1\n"
        "    def read(self): self.time += 0.01; return np.zeros((1, 1)), np.zeros((1, 1)), self.time\n"
        "    def write(self, forces): pass\n"
        "    def stop(self): pass\n"
        "    def close(self): pass\n"
        "    def __enter__(self): return self\n"
        "    def __exit__(self, *exc): self.close()\n"
        "def connect(): return Once()\n"
    )
    finger = {"start": [0.0], "device": {"name": str(tmp_path / "once.py")}}
    scene = gx.Scene(
        dimensions=1, period=0.01, duration=0.05, object={"mass": 0.1, "viscosity": 1.0},
        coupling={"contact": "attached", "external": {"stiffness": 5.0}, "internal": {"stiffness": 7.0}},
        finger=[finger, finger],
    )  # fmt: skip
    for _ in range(2):
        assert not gx.run(scene, real_time=True).faults
    first, second = resolve(scene).wires
    assert first.device.opened == second.device.opened == 1  # type: ignore[attr-defined]
    assert np.isclose(first.features.mass or 0.0, 0.1) and plugins.names("devices")
