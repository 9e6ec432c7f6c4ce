"""The engines compute the same bits, whatever a scene is made of, and whenever one takes over from another."""

from __future__ import annotations

import json
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx import plugins
from graspfx.bench.case import is_installed
from graspfx.build.build import build
from graspfx.compile import background
from graspfx.compile.child import start
from graspfx.compile.generic import kernel_name
from graspfx.errors import InputError, MissingPackageError
from graspfx.loop.foreign import foreign, looked_ahead
from graspfx.loop.recording.header import Header
from graspfx.loop.recording.recorder import Recorder
from graspfx.loop.tick import engine as engines
from graspfx.loop.tick.engine_text import whole_text
from graspfx.loop.tick.library import LIBRARY
from graspfx.loop.tick.programs import Compiled
from tests.support import foreign_parts
from tests.support.engines import TICKS, recorded, same
from tests.support.optional import require
from tests.support.small_scenes import LINE, line


@pytest.mark.optimised
@pytest.mark.parametrize("name", [name for name, origin in plugins.names("scenes").items() if "GraspFX" in origin])
def test_each_scene_of_the_shelf_is_the_same_run_in_every_engine(name: str) -> None:
    scene = gx.load(name)
    if any(thing.dynamics == "bullet" for thing in scene.object) and not is_installed("pybullet"):
        pytest.skip("PyBullet has no wheel for this Python")
    once = recorded(scene, "compiled")
    assert same(once, recorded(scene, "compiled", TICKS))
    assert same(once, recorded(scene, "interpreted"))
    for calls in (1, TICKS):
        generic = recorded(scene, "generic", calls)
        assert same(once, generic) and generic.outcome.engine == "generic"
    assert once.outcome.engine == "compiled" and np.ptp(once.finger_position) > 0.0


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
def test_each_kind_of_coupling_is_the_same_run_in_every_engine(changes: dict[str, Any]) -> None:
    scene = line(**changes)
    once = recorded(scene, "compiled")
    assert same(once, recorded(scene, "compiled", 7))
    assert same(once, recorded(scene, "interpreted"))
    assert same(once, recorded(scene, "generic"))
    assert once.finger_force.any()


@pytest.mark.optimised
def test_quick_code_and_good_code_compute_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Users' programs and those of most tests compute the same bits."""
    full = recorded(line(), "compiled"), recorded(line(), "compiled", TICKS)
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path))  # else the better program is taken from there
    monkeypatch.setitem(engines.ENGINES, "compiled", partial(Compiled, quick=True))
    quick = recorded(line(), "compiled"), recorded(line(), "compiled", TICKS)
    assert all(same(*pair) for pair in zip(full, quick, strict=True))


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
    for engine, calls in (("interpreted", 1), ("compiled", 1), ("compiled", TICKS), ("generic", 1), ("auto", TICKS)):
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
    "plant": "does not move",
    "object": "above coupling.force_bound",
}


@pytest.mark.parametrize(("kind", "says"), FAULTS.items(), ids=FAULTS)
def test_a_fault_is_the_same_in_every_engine(tmp_path: Path, kind: str, says: str) -> None:
    scene = failing(kind, foreign_parts.write(tmp_path))
    names = ("interpreted", "compiled", "generic")
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


# When which engine runs -------------------------------------------------------------------------------------------


NEVER = 10**12  # ticks


def judge_by(monkeypatch: pytest.MonkeyPatch, loading: int, specialising: int) -> None:
    """Let `auto` look for a specialised program, and have one made, from so many ticks on."""
    monkeypatch.setattr(engines, "LOADING", loading)
    monkeypatch.setattr(engines, "SPECIALISING", specialising)
    monkeypatch.setattr(engines, "LOOKING", 1)


@pytest.mark.parametrize("which", ["kernels", "device", "body", "guest"])
def test_auto_begins_with_generic_kernels_and_goes_over_in_mid_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, which: str
) -> None:
    if which == "guest" and not is_installed("pybullet"):
        pytest.skip("PyBullet has no wheel for this Python")
    files = foreign_parts.write(tmp_path)
    changes: dict[str, dict[str, Any]] = {
        "kernels": {},
        "device": {"finger__0__device": foreign_parts.device(files, "device", mass=0.15)},
        "body": {"object__dynamics": files["bodies"]},
        "guest": {"object__dynamics": "bullet"},
    }
    scene = line(**changes[which])
    known = recorded(scene, "interpreted")
    for calls in (1, 4, TICKS):
        stays = recorded(scene, "auto", calls)  # 60 ticks are worth nothing
        assert same(known, stays) and stays.outcome.engine == "generic"
    assert same(known, recorded(scene, "compiled"))  # and so it is in the cache
    judge_by(monkeypatch, 15, NEVER)
    for calls, name in ((1, "compiled"), (4, "compiled"), (TICKS, "compiled after 15 ticks")):
        changed = recorded(scene, "auto", calls)
        assert same(known, changed) and changed.outcome.engine == name


def test_a_long_run_is_specialised_by_another_process_and_goes_over_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = recorded(line(), "interpreted")
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path))
    judge_by(monkeypatch, 10, 10)
    with build(line(), engine="auto") as servo, Recorder(servo.layout, Header(servo.period), block=TICKS) as recorder:
        servo.run(20, recorder)
        assert servo.engine.name == "generic"
        other = servo.engine._process  # type: ignore[attr-defined]
        assert other.wait(timeout=300) == 0
        servo.run(TICKS - 20, recorder)
        ran = recorder.finish(engine=servo.engine.name)
    assert same(known, ran) and ran.outcome.engine == "compiled after 20 ticks"
    again = recorded(line(), "auto")
    assert same(known, again) and again.outcome.engine == "compiled"  # from the first tick, as it is there now


def test_the_process_that_specialises_ends_with_the_one_that_started_it() -> None:
    """It reads from a pipe that nobody else holds; this scene's program takes seconds."""
    with build(gx.load("pick-and-place"), engine="interpreted") as servo:
        tick = servo.script
    script = tick.script
    numbers = [(array, k, value.hex()) for (array, k), value in script.frozen.items()]
    kernels = {name: [kernel.__module__, kernel.__qualname__, ""] for name, kernel in script.kernels.items()}
    request = [[whole_text(tick), kernels, [*script.arrays, "rows"], numbers]]
    child = start(background.MODULE, answers=False)
    assert child.stdin is not None
    child.stdin.write(json.dumps(request).encode() + b"\n")
    child.stdin.flush()
    child.stdin.close()
    assert child.wait(timeout=60) == 1


@pytest.mark.parametrize(
    ("engine", "calls", "ticks"), [("interpreted", 33, 33), ("compiled", 2, 128), ("auto", 2, 128)]
)
def test_a_run_is_stopped_before_the_call_that_says_so(engine: str, calls: int, ticks: int) -> None:
    asked = iter([*[False] * calls, True])
    stopped = gx.run(line(engine=engine), duration=1.0, stop=lambda: next(asked))
    assert len(stopped) == ticks and not stopped.outcome.complete
    assert stopped.rows.tobytes() == gx.run(line(engine="compiled"), duration=1.0).rows[:ticks].tobytes()


@pytest.mark.parametrize("engine", ["interpreted", "compiled", "generic"])
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
    for engine in ("compiled", "generic"):
        with pytest.raises(MissingPackageError, match="pip install llvmlite"):
            gx.run(line(engine=engine))


def test_a_cache_that_cannot_be_written_costs_no_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path / "file" / "cache"))
    assert same(recorded(line(), "compiled"), recorded(line(), "interpreted"))


def test_a_spoilt_cache_costs_no_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path))
    known = recorded(line(), "compiled")
    entries = list(tmp_path.iterdir())
    for entry in entries:
        content = bytearray(entry.read_bytes())
        content[len(content) // 2] ^= 1
        entry.write_bytes(content)
    assert same(known, recorded(line(), "compiled"))
    assert set(entries) == set(tmp_path.iterdir())  # written anew


DRIVEN = '''
"""A point device that writes through a kernel of its own."""
from graspfx.devices import simulated
from graspfx.devices.simulated.point_sample import write
from graspfx.loop.device import Features

def weaker(S, o):
    code = write(S, o)
    S[o + {effort}] *= 0.5
    return code

class Weak(simulated.PointDevice):
    writing = staticmethod(weaker)

def connect(*, mass, dimensions):
    return Weak(mass=mass, damping=0.2, fingers=1, dimensions=dimensions, resolution=0.0, velocity_window=1, delay=0,
                force_limit=None, workspace=None)
'''


def test_a_kernel_of_ones_own_is_compiled_anew_when_its_file_changes(tmp_path: Path) -> None:
    """The force displayed is half, then a quarter of the coupling's: by the recording's work at the port."""
    file = tmp_path / "weak.py"
    effort = plugins.load("devices", "simulated").connect(mass=1.0, dimensions=1).ports.effort
    text = DRIVEN.replace("{effort}", str(effort)).replace("\\n", "\n")
    ran = []
    for factor in ("0.5", "0.25"):
        file.write_text(text.replace("0.5", factor, 1))
        scene = line(finger__0__device={"name": str(file), "mass": 0.15})
        with build(scene) as servo:
            assert not foreign(servo)
        ran.append(recorded(scene, "compiled"))
        assert same(ran[-1], recorded(scene, "interpreted"))
    assert not np.array_equal(require(ran[0].true_position), require(ran[1].true_position))


def test_kernels_that_cannot_be_imported_by_name_stay_generic(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "local.py"
    effort = plugins.load("devices", "simulated").connect(mass=1.0, dimensions=1).ports.effort
    file.write_text(DRIVEN.replace("{effort}", str(effort)))
    judge_by(monkeypatch, NEVER, 10)
    scene = line(finger__0__device={"name": str(file), "mass": 0.15})
    ran = recorded(scene, "auto", 2)
    assert ran.outcome.engine == "generic" and same(ran, recorded(scene, "interpreted"))


@pytest.mark.parametrize("name", [name for name, origin in plugins.names("scenes").items() if "GraspFX" in origin])
def test_every_kernel_of_the_package_that_a_tick_calls_is_compiled_beforehand(name: str) -> None:
    with build(gx.load(name), engine="interpreted") as servo:
        called = {kernel_name(kernel) for kernel in servo.script.script.kernels.values()}
    assert called and called <= set(LIBRARY)
