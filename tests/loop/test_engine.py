"""The two engines compute the same bits, whatever a scene is made of, and with which parts of others."""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx import plugins
from graspfx.assembly.build import build
from graspfx.bench.timing import is_installed
from graspfx.compile import native
from graspfx.errors import InputError, MissingPackageError
from graspfx.loop.engine import Compiled, machine_codes
from graspfx.loop.servo import foreign, looked_ahead
from graspfx.recording.header import Header
from graspfx.recording.recorder import Recorder
from tests.support import foreign_parts
from tests.support.engines import TICKS, dressed, recorded, same
from tests.support.optional import require
from tests.support.small_scenes import LINE, line

SHELF = [name for name, origin in plugins.names("scenes").items() if "GraspFX" in origin]


def shelf(name: str) -> gx.Scene:
    scene = gx.load(name)
    if any(thing.dynamics == "bullet" for thing in scene.object) and not is_installed("pybullet"):
        pytest.skip("PyBullet has no wheel for this Python")
    return scene


@pytest.mark.parametrize("name", SHELF)
def test_each_scene_of_the_shelf_is_the_same_run_in_both_engines(name: str) -> None:
    scene = shelf(name)
    once = recorded(scene, "compiled")
    assert same(once, recorded(scene, "compiled", TICKS))
    assert same(once, recorded(scene, "interpreted"))
    assert once.outcome.engine == "compiled" and np.ptp(once.finger_position) > 0.0


@pytest.mark.parametrize("name", SHELF)
def test_nothing_is_compiled_for_a_scene_of_the_shelf(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """All its kernels are in the program of all scenes, which is there; so it is with other numbers and switches."""
    scene = shelf(name)
    recorded(line(), "compiled")

    def made(*_: Any, **__: Any) -> Any:
        raise AssertionError("compiled")

    monkeypatch.setattr(native, "emitted", made)
    for changed in (scene, scene.replace({"coupling.internal.stiffness": 31.0, "coupling.internal.damping": 0.0})):
        assert recorded(changed, "compiled", ticks=3).outcome.engine == "compiled"
    with build(scene, engine="compiled") as servo:
        assert not machine_codes(servo.arena)


@pytest.mark.parametrize("seed", range(20))
def test_random_scenes_are_the_same_run_in_both_engines(seed: int) -> None:
    agree(seed)


@pytest.mark.stress
@pytest.mark.parametrize("seed", range(20, 300))
def test_more_random_scenes_are_the_same_run_in_both_engines(seed: int) -> None:
    agree(seed)


def agree(seed: int) -> None:
    scene = dressed(seed)
    for thing in scene.object:
        if thing.dynamics != "native" and not is_installed({"bullet": "pybullet"}.get(thing.dynamics, "mujoco")):
            pytest.skip(f"no {thing.dynamics} for this Python")
    once = recorded(scene, "interpreted", ticks=40)
    assert same(once, recorded(scene, "compiled", ticks=40))
    assert same(once, recorded(scene, "compiled", 7, ticks=40))


CHANGES: dict[str, dict[str, Any]] = {
    "matrix gains": {"coupling__external__stiffness": [30.0, 45.0], "coupling__form": "symmetric"},
    "equal gains": {"coupling__internal__stiffness": 30.0, "coupling__internal__damping": 0.0},
    "implicit": {"object__integrator": "implicit"},
    "observed": {"coupling__passivity": "observe"},
    "controlled": {"coupling__passivity": "control"},
    "friction": {"coupling__friction": 0.5},
    "no external damping": {"coupling__external__damping": 0.0, "coupling__internal__damping": 0.3},
    "no internal damping": {"coupling__external__damping": 0.3, "coupling__internal__damping": 0.0},
    "encoders, delay and limit": {
        "finger__0__device__resolution": 1e-5, "finger__0__device__delay": 2, "finger__1__device__force_limit": 0.1,
    },
}  # fmt: skip


@pytest.mark.parametrize("changes", CHANGES.values(), ids=CHANGES)
def test_each_kind_of_coupling_is_the_same_run_in_both_engines(changes: dict[str, Any]) -> None:
    scene = line(**changes)
    once = recorded(scene, "compiled")
    assert same(once, recorded(scene, "compiled", 7))
    assert same(once, recorded(scene, "interpreted"))
    assert once.finger_force.any()


def test_several_objects(tmp_path: Path) -> None:
    """Two of ours, then one of ours beside one that is called, each with fingers of its own."""
    files = foreign_parts.write(tmp_path)
    things = [{**LINE["object"], "name": name, "velocity": [v]} for name, v in (("first", 0.02), ("second", -0.01))]
    fingers = [{**finger, "object": name} for name in ("first", "second") for finger in LINE["finger"]]
    scene = gx.Scene(**{**LINE, "object": things, "finger": fingers})
    once = recorded(scene, "compiled")
    mixed = scene.replace({"object.second.dynamics": files["bodies"]})
    for each, engine in ((scene, "interpreted"), (mixed, "compiled"), (mixed, "interpreted")):
        assert same(once, recorded(each, engine))
    assert np.ptp(once.objects["first"].position) > 0.0 < np.ptp(once.objects["second"].position)


def held(files: dict[str, str], called: bool) -> dict[str, Any]:
    """Both fingers in one hand of others' making."""
    fingers = [{**finger, "hand": "own"} for finger in LINE["finger"]]
    return {**LINE, "finger": fingers, "hand": [{"name": "own", "kind": files["hands"], "called": called}]}


MIXES = [{"device"}, {"plant"}, {"hand"}, {"body"}, {"device", "hand"}, {"device", "plant", "body"}]


@pytest.mark.parametrize("which", MIXES, ids=lambda which: "+".join(sorted(which)))
def test_parts_that_are_no_kernels_run_as_those_that_are(tmp_path: Path, which: set[str]) -> None:
    files = foreign_parts.write(tmp_path)
    table = held(files, called="hand" in which) if "hand" in which else dict(LINE)
    ours = gx.Scene(**held(files, called=False)) if "hand" in which else gx.Scene(**LINE)
    changes: dict[str, Any] = {"object.dynamics": files["bodies"]} if "body" in which else {}
    settings = {"mass": 0.15, "damping": 0.2}
    for number, kind in enumerate(sorted(which & {"device", "plant"})):
        changes[f"finger.{number}.device"] = foreign_parts.device(files, kind, **settings)
    if {"device", "hand"} <= which:  # a hand holds devices of one kind
        changes["finger.1.device"] = changes["finger.0.device"]
    theirs = gx.Scene(**table).replace(changes)
    known = recorded(ours, "compiled")
    for engine, calls in (("interpreted", 1), ("compiled", 1), ("compiled", TICKS), ("auto", 7)):
        assert same(known, recorded(theirs, engine, calls)), engine
    with build(theirs) as servo:
        named = " ".join([*foreign(servo), *looked_ahead(servo)])
        assert all(f"the {kind} of" in named for kind in which - ({"hand"} if "device" in which else set())), named
    with build(ours) as servo:
        assert not foreign(servo) and not looked_ahead(servo)


FAULTS = {
    "reading": "outside its workspace",
    "called device": "the cable is out",
    "called plant": "the finger is stuck",
    "called body": "the object broke",
    "plant": "cannot move",
    "object": "above coupling.force_bound",
}


@pytest.mark.parametrize(("kind", "says"), FAULTS.items(), ids=FAULTS)
def test_a_fault_is_the_same_in_both_engines(tmp_path: Path, kind: str, says: str) -> None:
    scene = failing(kind, foreign_parts.write(tmp_path))
    names = ("interpreted", "compiled")
    runs = [recorded(scene, engine, calls) for engine in names for calls in (1, TICKS)]
    [fault] = runs[0].faults
    assert 0 < fault.tick < TICKS - 1 and says in fault.message
    assert not runs[0].displayed_force[fault.tick :].any()
    assert all(same(run, runs[0]) for run in runs[1:])


def failing(kind: str, files: dict[str, str]) -> gx.Scene:
    settings = {"mass": 0.15, "damping": 0.2, "fails": 20}
    away = {"stiffness": 60.0, "motion": {"kind": "reach", "displacement": [-0.03], "duration": 0.2}}
    if kind == "plant":
        table = held(files, called=True)
        return gx.Scene(**{**table, "hand": [{**table["hand"][0], "ends": 0.1}]})
    changes: dict[str, dict[str, Any]] = {
        "reading": {"finger__0__device__workspace": [[-0.03], [0.0]], "finger__0__hand": away},
        "called device": {"finger__0__device": foreign_parts.device(files, "device", **settings)},
        "called plant": {"finger__0__device": foreign_parts.device(files, "plant", **settings)},
        "called body": {"object__dynamics": files["breaking"]},
        "object": {
            "coupling__contact": "attached",
            "coupling__external__stiffness": 1e12,
            "coupling__force_bound": 1e40,
        },
    }
    return line(**changes[kind])


# What an engine is told, and tells ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("engine", "calls", "ticks"), [("interpreted", 33, 33), ("compiled", 2, 128), ("auto", 2, 128)]
)
def test_a_run_is_stopped_before_the_call_that_says_so(engine: str, calls: int, ticks: int) -> None:
    asked = iter([*[False] * calls, True])
    stopped = gx.run(line(engine=engine), duration=1.0, stop=lambda: next(asked))
    assert len(stopped) == ticks and not stopped.outcome.complete
    assert stopped.rows.tobytes() == gx.run(line(engine="compiled"), duration=1.0).rows[:ticks].tobytes()


@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
def test_a_servo_without_recorder_moves_the_same(engine: str) -> None:
    known = recorded(line(), engine)
    with build(line(), engine=engine, record=False) as servo:
        servo.run(TICKS, None)
        block = servo.objects[0].grasped
        assert np.array_equal(block.finger_position, known.finger_position[-1])
        assert np.array_equal(block.force, known.finger_force[-1])
        with Recorder(servo.layout, Header(servo.period)) as recorder, pytest.raises(InputError, match="record=False"):
            servo.run(1, recorder)


def test_which_engine_ran_is_in_the_file_and_in_the_summary(tmp_path: Path) -> None:
    gx.run(line(engine="compiled"), out=tmp_path)
    read = gx.Recording.load(tmp_path)
    assert read.outcome.engine == read.summary()["engine"] == "compiled"


def test_without_llvm_ticks_are_interpreted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    assert gx.run(line()).outcome.engine == "interpreted"
    with pytest.raises(MissingPackageError, match="pip install llvmlite"):
        gx.run(line(engine="compiled"))


def test_the_engine_of_earlier_scenes_is_read_as_compiled() -> None:
    assert line(engine="generic").engine == "compiled"


# Kernels of others, by their addresses --------------------------------------------------------------------------------

DRIVER = '''
"""A point device, its plant and a hand, each with a kernel of its own that does {what} ours does."""
from graspfx.devices import simulated
from graspfx.devices.simulated import point_device, points
from graspfx.devices.simulated.point_device import PointDeviceState
from graspfx.devices.simulated.points import PointPlantState
from graspfx.protocols import kernel

@kernel
def reading(device: PointDeviceState) -> int:
    return point_device.read(device)

@kernel
def writing(device: PointDeviceState) -> int:
    code = point_device.write(device)
    device.effort[0] *= {factor}
    return code

@kernel
def stopping(device: PointDeviceState) -> int:
    return point_device.stop(device)

@kernel
def moving(plant: PointPlantState) -> int:
    return points.advance(plant)

class Plant(points.PointPlant):
    kernel = staticmethod(moving)

class Other(simulated.PointDevice):
    reading, writing, stopping = staticmethod(reading), staticmethod(writing), staticmethod(stopping)

    @staticmethod
    def plant(devices):
        made = simulated.PointDevice.plant(devices)
        made.__class__ = Plant
        return made

def connect(*, mass, dimensions):
    return Other(mass=mass, damping=0.2, fingers=1, dimensions=dimensions, resolution=0.0, velocity_window=1, delay=0,
                 force_limit=None, workspace=None)
'''

HAND = '''
"""A hand that waves by a kernel of its own."""
from graspfx.loop import hand
from graspfx.loop.motion.motion import Sine
from graspfx.loop.motion.state import HandState
from graspfx.loop.motion.targets import target
from graspfx.protocols import kernel

@kernel
def aim(own: HandState, t: float) -> None:
    target(own, t)

def hold(rest, inward):
    made = hand.Hand(rest, 60.0, 0.5, Sine(0.01, 1.5, [1.0]), squeeze=0.004, inward=inward)
    made.kernel = aim
    return made
'''

BODY = '''
"""The native body, moved by kernels of its own."""
from graspfx.objects import integrators
from graspfx.objects.body import NativeBody
from graspfx.objects.integrators import BodyState
from graspfx.protocols import Record, kernel

@kernel
def moving(body: BodyState, beside: Record, T: float) -> int:
    integrators.step(body, T)
    return 0

@kernel
def expecting(body: BodyState, beside: Record, T: float) -> None:
    integrators.predict(body, T)

class Own(NativeBody):
    stepping, predicting = staticmethod(moving), staticmethod(expecting)

def create(state):
    return Own(state)
'''


def with_kernels(folder: Path, which: str, ours: gx.Scene, factor: float = 1.0) -> gx.Scene:
    """The scene with a part whose kernels are of a file in the folder."""
    file = folder / f"own_{which}.py"
    text = {"device": DRIVER, "hand": HAND, "body": BODY}[which]
    file.write_text(text.replace("{what}", "what").replace("{factor}", str(factor)))
    if which == "device":
        return ours.replace({"finger.0.device": {"name": str(file), "mass": 0.15}})
    if which == "body":
        return ours.replace({"object.dynamics": str(file)})
    table = ours.to_dict()
    for finger in table["finger"]:
        finger["hand"] = "own"
    return gx.Scene(**{**table, "hand": [{"name": "own", "kind": str(file)}]})


@pytest.mark.parametrize(("which", "count"), [("device", 4), ("body", 1)])
def test_a_kernel_of_others_is_called_from_the_step(tmp_path: Path, which: str, count: int) -> None:
    """All ticks of a call are one call also with it, and the bits are those of our own part."""
    theirs = with_kernels(tmp_path, which, line())
    known = recorded(line(), "interpreted")
    for engine, calls in (("interpreted", 1), ("compiled", 1), ("compiled", TICKS)):
        assert same(known, recorded(theirs, engine, calls)), engine
    with build(theirs, engine="compiled") as servo:
        assert not foreign(servo) and not servo.arena.world.pauses
        assert len(servo.arena.foreign) == count


def test_the_kernel_of_a_hand_of_others_is_called_from_the_step(tmp_path: Path) -> None:
    theirs = with_kernels(tmp_path, "hand", line())
    once = recorded(theirs, "interpreted")
    assert same(once, recorded(theirs, "compiled", TICKS)) and same(once, recorded(theirs, "compiled"))
    assert np.ptp(once.finger_position) > 1e-3
    with build(theirs, engine="compiled") as servo:
        [own] = servo.arena.foreign
        assert own.parameters == ("t",) and not looked_ahead(servo)


def test_the_step_has_the_address_of_a_kernel_of_others(tmp_path: Path) -> None:
    """After the ticks that are checked: what stands in the world is where the machine code is."""
    with build(with_kernels(tmp_path, "device", line()), engine="compiled", record=False) as servo:
        servo.run(20, None)
        engine, arena = servo.engine, servo.arena
        assert isinstance(engine, Compiled) and not engine.is_checking
        device = next(each for each in arena.world.devices if not each.plain)
        [own] = [native for each, native in engine._machine if each.kernel.__name__ == "reading"]
        assert device.reading == own.entry
        call = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64)(own.entry)
        assert call(arena.memory.floats.ctypes.data, device.state) == 0


def test_a_kernel_of_ones_own_is_compiled_anew_when_its_file_changes(tmp_path: Path) -> None:
    """The force displayed is half, then a quarter of the coupling's."""
    ran = []
    for factor in (0.5, 0.25):
        scene = with_kernels(tmp_path, "device", line(), factor)
        ran.append(recorded(scene, "compiled"))
        assert same(ran[-1], recorded(scene, "interpreted"))
    assert not np.array_equal(require(ran[0].true_position), require(ran[1].true_position))


def test_a_cache_that_cannot_be_written_costs_no_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = with_kernels(tmp_path, "device", line())
    recorded(line(), "compiled")  # the program of all scenes is loaded
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path / "file" / "cache"))
    assert same(recorded(scene, "compiled"), recorded(scene, "interpreted"))


def test_a_spoilt_cache_costs_no_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = with_kernels(tmp_path, "device", line())
    recorded(line(), "compiled")
    folder = tmp_path / "cache"
    monkeypatch.setenv("GRASPFX_CACHE", str(folder))
    known = recorded(scene, "compiled")
    entries = list(folder.iterdir())
    assert entries
    for entry in entries:
        content = bytearray(entry.read_bytes())
        content[len(content) // 2] ^= 1
        entry.write_bytes(content)
    assert same(known, recorded(scene, "compiled"))
    assert set(entries) <= set(folder.iterdir())  # written anew
