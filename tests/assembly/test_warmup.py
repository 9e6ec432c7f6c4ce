"""The check's word on the engine, and kernels compiled beforehand."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

import graspfx as gx
from graspfx import progress
from graspfx.__main__ import main
from graspfx.assembly.build import build
from graspfx.assembly.warm import warm
from graspfx.certificate.plan import engine_plan
from graspfx.compile import native
from graspfx.loop import engine as engines
from graspfx.loop.tick_listing import used
from tests.support import foreign_parts
from tests.support.plan_kernels import rows_with_kernels
from tests.support.small_scenes import LINE


def said(scene: gx.Scene) -> dict[str, str]:
    return {row.step: row.why for row in engine_plan(scene)}


def test_a_scene_of_kernels_is_one_call_by_the_program_where_warmup_puts_it(
    new_cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = said(gx.load("reference-1dof"))
    assert found["calls"] == "all parts are kernels: one call for many ticks"
    assert (
        found["engine"].startswith("compiled, by the program of all scenes") and f"kB in {new_cache}" in found["engine"]
    )
    assert main(["warmup", "reference-1dof", "knob"]) == 0
    kernels, *scenes, last = capsys.readouterr().out.splitlines()
    assert kernels.startswith("kernels of all scenes") and "was there" in kernels and kernels.endswith(" kB")
    assert [each.split()[:2] for each in scenes] == [["reference-1dof", "nothing"], ["knob", "nothing"]]
    assert last == f"in {new_cache}"


def test_without_the_program_the_first_tick_waits_for_it_with_a_line_of_progress(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is compiled to say so; the program's own compiler is not waited for here."""
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path))
    monkeypatch.setattr(engines, "kept_program", lambda: None)
    monkeypatch.setattr("graspfx.certificate.plan.kept_program", lambda: None)
    assert (
        f"compiled before the first tick, once per version and machine (`graspfx warmup`), into {tmp_path}"
        in (said(gx.Scene(**LINE))["engine"])
    )
    heard: list[str] = []

    class Listener:
        def begin(self, wait: progress.Wait) -> None:
            heard.append(wait.text)

        def end(self, wait: progress.Wait) -> None: ...

        def clear(self) -> None: ...

    def compiled(text: str) -> Any:
        assert heard[-1:] == ["compiling kernels, once per version and machine"]
        raise RuntimeError("compiles")

    monkeypatch.setattr(native, "compiled", compiled)
    monkeypatch.setattr(engines, "source", lambda: "")
    engines.program.cache_clear()
    with progress.listening(Listener()), pytest.raises(RuntimeError, match="compiles"):
        gx.run(gx.Scene(**LINE))
    engines.program.cache_clear()


def test_parts_that_are_no_kernels_are_named_with_what_they_cost(tmp_path: Path) -> None:
    files = foreign_parts.write(tmp_path)
    called = foreign_parts.device(files, "device", mass=0.15)
    one = said(gx.Scene(**LINE).replace({"finger.0.device": called}))["calls"]
    assert "two calls for each tick" in one and "the device of finger0 (Called) is not a kernel" in one
    more = said(gx.Scene(**LINE).replace({"finger.0.device": called, "object.dynamics": files["bodies"]}))["calls"]
    assert "the device of finger0 (Called), the body of object (Called) are not kernels" in more
    body = said(gx.Scene(**LINE).replace({"object.dynamics": files["bodies"]}))["calls"]
    assert body.startswith("one call for each tick")
    hand = {"name": "own", "kind": files["hands"], "called": True}
    fingers = [each | {"hand": "own"} for each in LINE["finger"]]
    ahead = said(gx.Scene(**{**LINE, "finger": fingers, "hand": [hand]}))["calls"]
    assert ahead.startswith(
        "one call for many ticks; the targets of the hand of finger0, finger1 (Called) are computed"
    )
    assert ahead.endswith("computed in advance, because it is not a kernel")


REAL = """
from graspfx.loop.device import Features

class Real:
    features = Features(fingers=1, dimensions=1)
    def open(self, period): raise AssertionError("moved")
    def __enter__(self): raise AssertionError("moved")
    def read(self): raise AssertionError("read")
    def write(self, forces): raise AssertionError("written to")
    def stop(self): raise AssertionError("stopped")
    def close(self): raise AssertionError("closed")
    def __exit__(self, *exc): raise AssertionError("left")

def connect():
    return Real()
"""


def test_a_real_device_is_neither_opened_nor_timed(tmp_path: Path) -> None:
    (tmp_path / "real.py").write_text(REAL)
    finger = {"start": [-0.025], "device": {"name": str(tmp_path / "real.py")}}
    found = said(gx.Scene(**{**LINE, "finger": [finger, LINE["finger"][1]]}))
    assert "the device of finger0 (Real) is not a kernel" in found["calls"]
    assert "by the program of all scenes" in found["engine"]


@pytest.mark.parametrize(
    ("engine", "says"),
    [
        ("auto", "compiled, by the program of all scenes: "),
        ("generic", "compiled, as the scene requires, by the program of all scenes: "),
        ("compiled", "compiled, as the scene requires, by the program of all scenes: "),
        ("interpreted", "interpreted, as the scene requires"),
    ],
)
def test_what_the_key_engine_makes_of_a_scene(engine: str, says: str) -> None:
    assert said(gx.Scene(**{**LINE, "engine": engine}))["engine"].startswith(says)


def test_without_llvm(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    [_, row] = engine_plan(gx.Scene(**LINE))
    assert row.runs and row.why == "interpreted: llvmlite is not installed: run `pip install llvmlite`"
    [_, row] = engine_plan(gx.Scene(**LINE).replace({"engine": "compiled"}))
    assert not row.runs and "cannot be compiled, although the scene requires it: llvmlite is not installed" in row.why
    assert main(["warmup", "reference-1dof"]) == 2
    assert "pip install llvmlite" in capsys.readouterr().err


def test_a_folder_that_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path / "file" / "cache"))
    assert main(["warmup", "reference-1dof"]) == 2
    assert "GRASPFX_CACHE" in capsys.readouterr().err


OWN = """
from graspfx.devices import simulated
from graspfx.devices.simulated import point_device
from graspfx.devices.simulated.point_device import PointDeviceState
from graspfx.protocols import kernel

@kernel
def writing(device: PointDeviceState) -> int:
    device.effort[0] = 0.0
    return point_device.write(device)

class Other(simulated.PointDevice):
    writing = staticmethod(writing)

def connect(*, mass, dimensions):
    return Other(mass=mass, damping=0.2, fingers=1, dimensions=dimensions, resolution=0.0, velocity_window=1, delay=0,
                 force_limit=None, workspace=None)
"""


def own(folder: Path, text: str) -> gx.Scene:
    (folder / "own.py").write_text(text)
    return gx.Scene(**LINE).replace({"finger.0.device": {"name": str(folder / "own.py"), "mass": 0.15}})


def test_kernels_that_a_scene_brings_are_compiled_beforehand(
    new_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = own(tmp_path, OWN)
    monkeypatch.setattr("graspfx.assembly.warm.load", lambda *_, **__: scene)
    before = set(new_cache.iterdir())
    assert [warm("own", {}).state for _ in range(2)] == ["compiled", "was there"]
    assert warm("own", {}).size > 0 and len(set(new_cache.iterdir()) - before) >= 1


def test_a_kernel_that_cannot_be_compiled_is_interpreted_with_the_reason(tmp_path: Path) -> None:
    """A plain function that Python runs, with a list, which machine code has not."""
    head, tail = OWN.index("@kernel"), OWN.index("class Other")
    plain = "def writing(S, o):\n    S[o] = sorted([S[o]])[0]\n    return point_device.write(S, o)\n\n"
    scene = own(tmp_path, OWN[:head] + plain + OWN[tail:])
    [_, row] = engine_plan(scene)
    assert row.runs and row.why.startswith("interpreted: ") and "own.py" in row.why
    assert gx.run(scene).outcome.engine == "interpreted"
    [_, row] = engine_plan(scene.replace({"engine": "compiled"}))
    assert not row.runs and row.why.startswith("cannot be compiled, although the scene requires it: ")


def test_a_scene_that_cannot_be_built_is_told_and_the_others_are(
    new_cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["warmup", "nosuch", "reference-1dof"]) == 2
    _, first, second, _ = capsys.readouterr().out.splitlines()
    assert "cannot" in first and "unknown scene 'nosuch'" in first
    assert "nothing" in second


def test_the_plan_of_a_scene_in_space_is_what_its_ticks_run() -> None:
    scene = gx.load("pick-and-place")
    with build(scene, engine="interpreted") as servo:
        ran = used(servo).kernels
    rows = [*rows_with_kernels(scene)]
    assert {row.step for row, _ in rows} >= {"split", "fade", "energy", "torsion", "turn", "meet", "predict"}
    assert [row for row, kernel in rows if (kernel in ran) is not row.runs] == []
