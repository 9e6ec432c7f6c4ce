"""The check's word on the engine, and scenes compiled beforehand."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

import graspfx as gx
from graspfx.__main__ import main
from graspfx.build import warm
from graspfx.build.build import build
from graspfx.certificate.plan import plan
from graspfx.certificate.prospect import engine_plan, kernels
from tests.support import foreign_parts
from tests.support.small_scenes import LINE


def said(scene: gx.Scene) -> dict[str, str]:
    return {row.step: row.why for row in engine_plan(scene)}


def test_a_scene_of_kernels_is_one_call_and_its_program_is_where_warmup_puts_it(
    new_cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = gx.load("reference-1dof")
    before = said(scene)
    assert "one call for many ticks" in before["calls"]
    assert f"not in {new_cache} yet" in before["program"] and "graspfx warmup" in before["program"]
    for state in ("compiled", "was there"):
        assert main(["warmup", "reference-1dof"]) == 0
        kernels_, line, last = capsys.readouterr().out.splitlines()
        assert kernels_.startswith("kernels of all scenes") and kernels_.endswith(" kB")
        assert (
            line.split()[0] == "reference-1dof" and state in line and line.endswith(" kB") and last == f"in {new_cache}"
        )
    assert f"kB in {new_cache}" in said(scene)["program"]
    assert main(["warmup", "reference-1dof", "--set", "coupling.internal.stiffness=30.0"]) == 0
    assert "compiled" in capsys.readouterr().out  # equal gains are another program


def test_parts_that_are_no_kernels_are_named_with_what_they_cost(tmp_path: Path) -> None:
    files = foreign_parts.write(tmp_path)
    called = foreign_parts.device(files, "device", mass=0.15)
    one = said(gx.Scene(**LINE).replace({"finger.0.device": called}))["calls"]
    assert "two calls for each tick" in one and "the device of finger0 (Called) is no kernel" in one
    more = said(gx.Scene(**LINE).replace({"finger.0.device": called, "object.dynamics": files["bodies"]}))["calls"]
    assert "the device of finger0 (Called), the body of object (Called) are no kernels" in more
    body = said(gx.Scene(**LINE).replace({"object.dynamics": files["bodies"]}))["calls"]
    assert body.startswith("one call for each tick")


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
    assert "the device of finger0 (Real) is no kernel" in found["calls"]
    assert "kernels compiled for all scenes, for 60 ticks" in found["engine"]


@pytest.mark.parametrize(
    ("engine", "duration", "says"),
    [
        ("auto", 0.1, "kernels compiled for all scenes, for 20 ticks; from 10000000 on"),
        ("auto", 1e5, "kernels compiled for all scenes, for 20000000 ticks, until a program is specialised"),
        ("generic", 0.1, "kernels compiled for all scenes, as the scene says"),
        ("compiled", 0.1, "compiled, before the first tick, as the scene says"),
        ("interpreted", 0.1, "interpreted, as the scene says"),
    ],
)
def test_what_the_key_engine_makes_of_a_duration(new_cache: Path, engine: str, duration: float, says: str) -> None:
    assert says in said(gx.Scene(**{**LINE, "engine": engine, "duration": duration}))["engine"]


def test_without_llvm(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    found = engine_plan(gx.Scene(**LINE))
    assert all("pip install llvmlite" in row.why for row in found[1:])
    assert main(["warmup", "reference-1dof"]) == 2
    assert "pip install llvmlite" in capsys.readouterr().err


def test_a_folder_that_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path / "file" / "cache"))
    assert main(["warmup", "reference-1dof"]) == 2
    assert "GRASPFX_CACHE" in capsys.readouterr().err


def test_a_scene_that_cannot_be_compiled_is_told_and_the_others_are(
    new_cache: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(warm, "processors", lambda: 1)
    assert main(["warmup", "nosuch", "reference-1dof"]) == 2
    _, first, second, _ = capsys.readouterr().out.splitlines()
    assert "cannot" in first and "unknown scene 'nosuch'" in first
    assert "compiled" in second


def test_scenes_are_compiled_side_by_side(new_cache: Path) -> None:
    names = ["reference-1dof", "nosuch"]
    made: list[Any] = list(warm.warm_all(names, {}))
    assert [each.scene for each in made] == names
    assert [each.state for each in made] == ["compiled", "cannot"]
    assert made[0].size > 0 and any(path.suffix == ".machine" for path in new_cache.iterdir())


def test_the_plan_of_a_scene_in_space_is_its_program() -> None:
    scene = gx.load("pick-and-place")
    with build(scene) as servo:
        held = kernels(servo)
    rows = [row for row in plan(scene) if row.kernel]
    assert {row.step for row in rows} >= {"split", "fade", "energy", "torsion", "turn", "meet", "predict"}
    assert all((row.kernel in held) is row.runs for row in rows)
