"""Scenes are read with every fault on its line, overridden by dotted key, and remember where they came from."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx import plugins
from graspfx.errors import InputError, SceneError, UnknownNameError
from graspfx.plugins import PluginError
from graspfx.scene.load import load, to_scene
from graspfx.scene.overrides import overridden
from graspfx.scene.toml_text import KeyLines

GOOD = """\
dimensions = 1
period = 0.005
duration = 2.0
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
start = [0.002]
"""

DRIVER = """\
from graspfx.loop.device import Features
class Device:
    features = Features(fingers=1, dimensions=1)
    effort = plant = ()
    def open(self, period): pass
    def read(self): pass
    def write(self, forces): pass
    def stop(self): pass
    def close(self): pass
    def __enter__(self): return self
    def __exit__(self, *exc): pass
def connect(mass=1.0):
    return Device()
"""

PYTHON = """\
import graspfx as gx

def scene(stiffness: float = 70.0, fingers: int = 2) -> gx.Scene:
    finger = {"device": {"name": "simulated", "mass": 0.15}, "start": [0.002]}
    return gx.Scene(
        dimensions=1, period=0.005, duration=2.0,
        object={"mass": 0.1, "viscosity": 0.8},
        coupling={"contact": "attached", "external": {"stiffness": 30.0}, "internal": {"stiffness": stiffness}},
        finger=[finger] * fingers,
    )
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(text: str, name: str = "scene.toml") -> Path:
    Path(name).write_text(text, encoding="utf-8")
    return Path(name)


def report(path: Path | str, overrides: dict[str, Any] | None = None) -> list[str]:
    with pytest.raises(SceneError) as caught:
        load(path, overrides)
    return str(caught.value).splitlines()


def test_seven_faults_are_seven_each_with_its_line() -> None:
    text = GOOD.replace("viscosity", "viscosty").replace("period = 0.005", "period = -1").replace("0.15", "nan", 1)
    text = text.replace("internal = { stiffness = 70.0 }", 'internal = { stiffness = "hard" }')
    text = text.replace("rest = [0.0]", "rest = [\n    0.0, 1.0]", 1).replace("mass = 0.15", "mss = 0.15", 1)
    text += "channel = -2\n"
    assert report(write(text)) == [
        "scene.toml:2: period: expected more than 0; given -1",
        "scene.toml:6: object.viscosty: unknown key; did you mean 'viscosity'?",
        "scene.toml:10: coupling.internal.stiffness: expected a number, a list with one per finger, a d x d matrix, "
        "one d x d matrix per finger or an m x m matrix; given 'hard'",
        "scene.toml:12: finger.0.device.mass: expected finite numbers; given nan",
        "scene.toml:13: finger.0.hand.rest: expected 1 number (dimensions = 1); given [0.0, 1.0]",
        "scene.toml:17: finger.1.device.mss: unknown setting of 'simulated'; did you mean 'mass'?",
        "scene.toml:20: finger.1.channel: expected no less than 0; given -2",
    ]


def test_faults_that_only_a_connected_device_shows_have_their_lines_too() -> None:
    text = GOOD.replace("mass = 0.15", "mass = -0.15", 1) + "channel = 5\n"
    assert report(write(text)) == [
        "scene.toml:12: finger.0.device.mass: given -0.15, expected a finite mass above zero [kg]",
        "scene.toml:19: finger.1.channel: expected less than 1: 'simulated' has 1 finger; given 5",
    ]


def test_a_start_out_of_reach_has_its_line() -> None:
    scene = load(write(GOOD.replace("damping = 0.2", "workspace = [[-1.0], [0.0]]", 1)))
    with pytest.raises(SceneError, match=r"scene\.toml:14: finger\.0\.start: outside the device's workspace"):
        scene.require_reach()
    with pytest.raises(SceneError, match=r"scene\.toml: finger\.0\.start: .* \(set by an override\)"):
        scene.replace({"finger.0.start": [0.5]}).require_reach()


def test_text_needs_quotes() -> None:
    [fault] = report(write(GOOD), {"title": 5})
    assert fault.endswith("expected text; given 5 (text needs quotes: --set 'title=\"5\"'; set by an override)")


def test_a_file_of_that_name_is_suggested() -> None:
    write(GOOD, "good.toml")
    with pytest.raises(UnknownNameError, match=r"there is a file good\.toml: give its name with the suffix"):
        load("good")
    with pytest.raises(UnknownNameError, match="unknown scene 'no-such-scene'"):
        load("no-such-scene")


def test_a_missing_key_has_the_line_of_its_table() -> None:
    assert report(write(GOOD.replace("mass = 0.1\n", ""))) == ["scene.toml:4: object.mass: required, but not given"]
    assert report(write(GOOD.replace("period = 0.005\n", ""))) == ["scene.toml: period: required, but not given"]


@pytest.mark.parametrize(
    ("text", "line"),
    [("a = 1\nb = = 2\n", 2), ("a = 1\na = 2\n", 2), ("[t]\nx = [1,\n", 3), ('s = "abc', 1), ("a = 1\n[[a]]\n", 2)],
)
def test_what_is_not_toml_has_its_line(text: str, line: int) -> None:
    [fault] = report(write(text))
    assert fault.startswith(f"scene.toml:{line}: not TOML: ")
    Path("scene.toml").write_bytes(GOOD.encode() + b"title = '\xe9'\n")
    assert report("scene.toml") == ["scene.toml:19: not UTF-8: byte 0xe9; save the file as UTF-8"]


def test_key_lines() -> None:
    text = """\
# a comment
title = "a"  # another
object.mass = 1

[coupling]  # a table
external.stiffness = [
    1.0,  # the first
    2.0,
]
internal = { stiffness = 3.0, "damp ing" = 4.0 }

[[finger]]
start = [0.0]
[finger.device]
name = "a"
[[finger]]
'device'.name = "b"
[[finger.device.part]]
size = 1
[[finger.device.part]]
size = 2
"""
    lines = KeyLines(text)
    expected: dict[tuple[str | int, ...], int | None] = {
        ("title",): 2,
        ("object", "mass"): 3,
        ("coupling",): 5,
        ("coupling", "external", "stiffness"): 6,
        ("coupling", "external", "stiffness", 0): 7,
        ("coupling", "external", "stiffness", 1): 8,
        ("coupling", "internal", "damp ing"): 10,
        ("finger",): 12,
        ("finger", 0): 12,
        ("finger", 0, "start"): 13,
        ("finger", 0, "device"): 14,
        ("finger", 0, "device", "name"): 15,
        ("finger", 1): 16,
        ("finger", 1, "device", "name"): 17,
        ("finger", 1, "device", "part", 0, "size"): 19,
        ("finger", 1, "device", "part", 1, "size"): 21,
        ("finger", 1, "missing", "deep"): 16,  # the table that lacks it
        ("nowhere",): None,
    }
    assert {key: lines[key] for key in expected} == expected


def test_overrides_by_dotted_key() -> None:
    scene = load(
        write(GOOD),
        {
            "coupling.internal.stiffness": 50,
            "finger.0.hand.stiffness": 10.0,
            "finger.*.device.mass": 0.2,
            "object.integrator": "explicit",  # not in the file
            "object.0.viscosity": 1.5,  # a lone table is a list of one
            "finger.1.start.0": 0.004,
        },
    )
    assert scene.coupling.internal.stiffness == 50.0
    assert [f.hand.stiffness for f in scene.finger] == [10.0, 33.0]  # type: ignore[union-attr]
    assert [f.device.settings["mass"] for f in scene.finger] == [0.2, 0.2]  # type: ignore[union-attr]
    assert (scene.object[0].integrator, scene.object[0].viscosity) == ("explicit", 1.5)
    assert [f.start for f in scene.finger] == [(0.002,), (0.004,)]
    assert scene.source.overrides["coupling.internal.stiffness"] == 50


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("coupling.internl.stiffness", 1.0, "coupling.internl: unknown key; did you mean 'internal'?"),
        ("copling.fade", 1.0, "copling: unknown key; did you mean 'coupling'?"),
        ("object.mss", 1.0, "object.mss: unknown key; did you mean 'mass'?"),
        ("object.mass", -1.0, "object.mass: expected more than 0; given -1.0"),
        ("finger.*.device.mss", 1.0, "finger.0.device.mss: unknown setting of 'simulated'; did you mean 'mass'?"),
    ],
)
def test_a_wrong_override_says_so_without_a_line(key: str, value: Any, message: str) -> None:
    assert report(write(GOOD), {key: value})[0] == f"scene.toml: {message} (set by an override)"


def test_an_override_picks_a_table_by_its_name() -> None:
    text = GOOD.replace("[[finger]]", '[[finger]]\nname = "thumb"', 1)
    scene = load(write(text), {"finger.thumb.hand.stiffness": 10.0})
    assert [f.hand.stiffness for f in scene.finger] == [10.0, 33.0]  # type: ignore[union-attr]


@pytest.mark.parametrize("several", [False, True], ids=["one", "several"])
def test_a_name_leads_to_its_table_in_a_list_of_one_too(several: bool) -> None:
    others: list[dict[str, Any]] = [{"name": "else", "label": "else", "squeeze": 0.0, "gain": 1.0}] if several else []
    data = {
        "hand": [*others, {"name": "right", "squeeze": 0.0}],
        "device": [*others, {"name": "simulated", "label": "left", "mass": 0.1}],
        "object": [*others, {"name": "cube", "shape": {"size": [1.0]}}],
    }
    keys = {
        "hand.right.squeeze": 0.01,
        "hand.right.gain": 2.0,  # that the table has not yet, as a setting of a plug-in's
        "device.left.mass": 0.2,
        "object.cube.density": 500.0,
        "object.cube.shape.size.0": 2.0,
    }
    changed, replaced, faults = overridden(data, keys)
    i = len(others)
    assert faults == [] and ("hand", i, "squeeze") in replaced
    assert changed["hand"][i:] == [{"name": "right", "squeeze": 0.01, "gain": 2.0}]
    assert changed["device"][i:] == [{"name": "simulated", "label": "left", "mass": 0.2}]
    assert changed["object"][i:] == [{"name": "cube", "shape": {"size": [2.0]}, "density": 500.0}]
    assert all(changed[table][:i] == others for table in changed)
    table, _, _ = overridden(data, {"hand.right": {"name": "right", "squeeze": 0.5}})
    assert table["hand"][i:] == [{"name": "right", "squeeze": 0.5}]


def test_a_lone_table_needs_no_name_and_its_own_keys_come_first() -> None:
    data = {"hand": [{"name": "grip", "grip": {"stiffness": 1.0}}], "object": {"name": "cube", "mass": 0.1}}
    keys = {"hand.grip.stiffness": 2.0, "hand.grip.grip.damping": 3.0, "object.mass": 0.2, "object.cube.viscosity": 1.0}
    changed, _, _ = overridden(data, keys)
    assert changed["hand"][0]["grip"] == {"stiffness": 2.0, "grip": {"damping": 3.0}}
    assert changed["object"] == {"name": "cube", "mass": 0.2, "viscosity": 1.0}
    _, replaced, _ = overridden({"coupling": {"name": "soft"}}, {"coupling.soft.stiffness": 1.0})
    assert replaced == {("coupling", "soft")}  # no list of tables: a key that is for the checks to refuse


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("finger.7.start", "finger has 2 entries; the last is finger.1"),
        ("finger.start", "finger is a list of 2: select one by its number or name, or all with '*'"),
        ("period.x", "period is a value and has no parts"),
        ("object..mass", "an override needs a key between its dots"),
    ],
)
def test_an_override_that_leads_nowhere(key: str, message: str) -> None:
    [fault] = report(write(GOOD), {key: 1.0})
    assert fault.endswith(f"{key}: {message}")


def test_an_override_through_a_name_points_at_its_table() -> None:
    _, replaced, faults = overridden({"finger": [{"device": "left"}]}, {"finger.0.device.mass": 1.0})
    assert replaced == set()
    assert [fault.message for fault in faults] == [
        "finger.0.device is the name 'left': override the table of that name"
    ]


def test_overriding_leaves_the_original_alone() -> None:
    data = {"coupling": {"gains": [1.0, 2.0]}}
    changed, replaced, faults = overridden(data, {"coupling.gains.*": 3.0})
    assert (data, changed) == ({"coupling": {"gains": [1.0, 2.0]}}, {"coupling": {"gains": [3.0, 3.0]}})
    assert (replaced, faults) == ({("coupling", "gains", 0), ("coupling", "gains", 1)}, [])


def test_the_source_is_kept_verbatim(folder: Path) -> None:
    text = "# ünïcode\n" + GOOD
    scene = load(write(text))
    assert (scene.source.text, scene.source.path, scene.source.folder) == (text, folder / "scene.toml", folder)


def test_paths_in_a_scene_are_relative_to_its_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Path("deep").mkdir()
    write("t,x\n0,0\n1,0.01\n", "deep/path.csv")
    write(DRIVER, "deep/mine.py")
    motion = 'rest = [0.0], motion = { kind = "path", file = "path.csv" }'
    write(
        GOOD.replace("rest = [0.0]", motion).replace('"simulated", mass = 0.15, damping = 0.2', '"mine.py"'),
        "deep/s.toml",
    )
    monkeypatch.chdir("/")
    scene = load(folder / "deep" / "s.toml")
    assert scene.finger[0].hand.motion.file == "path.csv"  # type: ignore[union-attr]
    write("t,x,y\n0,0,0\n1,0.01,0\n", str(folder / "deep/path.csv"))
    assert report(folder / "deep" / "s.toml")[0].endswith(
        "expected 1 number (dimensions = 1) after the time in each row; given 2"
    )


def test_python_scenes_take_parameters_then_dotted_keys() -> None:
    path = write(PYTHON, "mine.py")
    scene = load(path, {"stiffness": 55.0, "fingers": 3, "object.mass": 0.3, "period": 0.001})
    assert scene.coupling.internal.stiffness == 55.0
    assert (len(scene.finger), scene.object[0].mass, scene.period) == (3, 0.3, 0.001)
    assert scene.source.text == PYTHON
    assert report(path, {"stifness": 1.0}) == [
        "mine.py: stifness: unknown key; did you mean 'stiffness'? (set by an override)"
    ]
    assert report(path, {"stiffness": -1.0}) == [
        "mine.py: coupling.internal.stiffness: expected no less than 0; given -1.0"
    ]


def test_python_scenes_with_open_parameters_and_required_ones() -> None:
    path = write(
        PYTHON.replace("stiffness: float = 70.0, fingers: int = 2", "stiffness, **rest") + "    # rest\n", "o.py"
    )
    path.write_text(path.read_text().replace("* fingers", "* rest.get('fingers', 2)"))
    assert len(load(path, {"stiffness": 1.0, "fingers": 4, "period": 0.002}).finger) == 4
    assert report(path) == ["o.py: stiffness: required by scene(), but not given"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x = 1\ndef scene(:\n", r"mine\.py:2: SyntaxError: "),
        ("import nowhere_to_be_found\n", r"mine\.py:1: ModuleNotFoundError: No module named"),
        ("def scene():\n    return 1 / 0\n", r"mine\.py:2: ZeroDivisionError: division by zero$"),
        ("import math\ndef scene():\n    return math.sqrt(-1)\n", r"mine\.py:3: ValueError: "),
        (
            "import graspfx as gx\ndef scene():\n    return gx.Impedance(-1.0)\n",
            r"mine\.py:3: stiffness: given -1\.0, expected",
        ),
    ],
)
def test_what_a_python_scene_raises_has_its_line(text: str, says: str) -> None:
    with pytest.raises(PluginError, match=f"^{says}") as caught:
        load(write(text, "mine.py"))
    assert caught.value.__cause__ is not None


def test_a_parameter_that_does_not_exist_is_said_before_the_scene_is_made() -> None:
    path = write("def scene(mass=1.0):\n    raise AssertionError('called')\n", "mine.py")
    assert report(path, {"m": 3, "objct.mass": 1.0}) == [
        "mine.py: m: unknown key; scene() takes mass (set by an override)",
        "mine.py: objct.mass: unknown key; did you mean 'object'? (set by an override)",
    ]


@pytest.mark.parametrize("text", ["x = 1\n", "scene = 3\n", "def scene(): return {}\n"])
def test_a_python_file_without_a_scene(text: str) -> None:
    with pytest.raises(InputError, match="Scene"):
        load(write(text, "mine.py"))


def test_a_scene_without_faults_needs_no_parser_of_lines(folder: Path) -> None:
    write(GOOD)
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parents[2])!r})\n"
        "from graspfx.scene.load import load\n"
        "load('scene.toml')\n"
        "heavy = {'tree_sitter', 'scipy', 'h5py', 'matplotlib', 'rich', 'pybullet', 'llvmlite', 'trimesh'}\n"
        "print(sorted(heavy & sys.modules.keys()))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_scene_a_name_and_a_path_are_one_scene() -> None:
    scene = load("reference-1dof")
    assert to_scene(scene) is scene and to_scene(scene, {}) is scene
    assert to_scene("reference-1dof") == scene
    assert scene.source.path is not None and to_scene(scene.source.path) == scene
    changed = {"coupling.internal.stiffness": 50.0}
    assert to_scene(scene, changed) == to_scene("reference-1dof", changed) == load("reference-1dof", changed)
    assert to_scene(scene, changed) != scene


def test_a_scene_that_is_none() -> None:
    with pytest.raises(InputError, match="a scene"):
        to_scene(3.0)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="values by dotted key"):
        to_scene(load("reference-1dof"), ["mass"])  # type: ignore[arg-type]


# Settings under their former names ------------------------------------------------------------------------------------

FORMER = GOOD.replace("damping = 0.2", "friction = 0.2")


def test_a_former_name_runs_the_same_and_is_noted() -> None:
    now, former = load(write(GOOD)), load(write(FORMER))
    assert np.array_equal(gx.run(now, duration=0.1).rows, gx.run(former, duration=0.1).rows)
    assert not any("is now called" in note for note in gx.check(now).notes)
    assert [note for note in gx.check(former).notes if "is now called" in note] == [
        f"finger.{i}.device.friction is now called 'damping'; the old name is still accepted" for i in (0, 1)
    ]


@pytest.mark.parametrize("written", [GOOD, FORMER])
@pytest.mark.parametrize("key", ["finger.*.device.friction", "finger.*.device.damping"])
def test_an_override_replaces_either_name(written: str, key: str) -> None:
    scene = load(write(written), {key: 0.5})
    assert [finger.device.settings["damping"] for finger in scene.finger] == [0.5, 0.5]  # type: ignore[union-attr]
    assert scene.replace({"finger.0.device.friction": 0.7}).finger[0].device.settings["damping"] == 0.7  # type: ignore[union-attr]


def test_both_names_are_a_fault() -> None:
    with pytest.raises(
        SceneError, match=r"friction: a former name of 'damping', which is also given: remove 'friction'"
    ):
        load(write(GOOD.replace("damping = 0.2", "damping = 0.2, friction = 0.2", 1)))


def test_a_fault_of_the_value_names_the_setting() -> None:
    with pytest.raises(SceneError, match=r"damping.*expected a finite damping of zero or more \[N s/m\]"):
        load(write(FORMER.replace("friction = 0.2", "friction = -0.2", 1)))


def test_connect_itself_takes_the_former_name_with_a_warning() -> None:
    connect = plugins.load("devices", "simulated").connect
    with pytest.warns(FutureWarning, match="'friction' is called 'damping' now"):
        device = connect(mass=0.1, friction=0.2, dimensions=1)
    assert device.features.friction == 0.2
    with pytest.raises(InputError, match="its former name"):
        connect(mass=0.1, friction=0.2, damping=0.2, dimensions=1)
    with pytest.warns(FutureWarning, match="'joint_friction' is called 'joint_damping' now"):
        plugins.load("devices", "two-link").connect(joint_friction=1e-3)
