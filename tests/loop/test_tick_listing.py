"""`graspfx check --tick` lists what the step did: each kernel that ran, and what was skipped by what the world says."""

from __future__ import annotations

import ast
import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.__main__ import main
from graspfx.assembly.build import build
from graspfx.compile.kernel import source_function
from graspfx.coupling import limit as limits
from graspfx.loop import step
from graspfx.loop.engine import Interpreted
from graspfx.loop.tick_listing import Used, listing, used
from tests.support import foreign_parts
from tests.support.small_scenes import LINE, line

ROOT = Path(gx.__file__).parents[1]
TICKS = 20


def seen(scene: gx.Scene, ticks: int = TICKS) -> Used:
    with build(scene, engine="interpreted") as servo:
        return used(servo, ticks)


def counts(found: Used) -> dict[str, int]:
    """Calls of kernels, wherever they were called from."""
    totals: dict[str, int] = {}
    for _, call in found.root.walk():
        totals[call.name] = totals.get(call.name, 0) + call.count
    return totals


def why(found: Used) -> dict[tuple[str, str], str]:
    return {(each.stage, each.name): each.why for each in found.skipped}


def test_each_kernel_is_listed_as_often_as_it_was_called() -> None:
    """Counted by the frames of the lowered kernels themselves, in ticks of another servo."""
    scene = line(coupling__passivity="observe", finger__1__device__force_limit=0.1)
    names = {f"<{f.__module__}.{f.__qualname__}, lowered>" for f in (limits.limit, step.copy, step.read, step.move)}
    totals = dict.fromkeys(names, 0)

    def note(frame: Any, event: str, _: Any) -> None:
        if event == "call" and frame.f_code.co_filename in totals and frame.f_code.co_name != "<module>":
            totals[frame.f_code.co_filename] += 1

    with build(scene, engine="interpreted") as servo:
        engine = Interpreted(servo.arena)
        engine.write_to(np.empty((TICKS, servo.layout.width)))
        before = sys.getprofile()
        sys.setprofile(note)
        try:
            engine.run(0, TICKS, 0)
        finally:
            sys.setprofile(before)
    found = seen(scene)
    for call in (limits.limit, step.copy):
        assert counts(found)[call.__name__] == totals[f"<{call.__module__}.{call.__qualname__}, lowered>"] > 0
    assert totals["<graspfx.loop.step.move, lowered>"] == TICKS == found.ticks


def test_stages_stand_in_the_order_in_which_they_run() -> None:
    found = seen(line())
    begin, end = found.root.calls.values()
    assert [call.name for call in begin.calls.values()] == [
        "take", "read", "predict", "couple_objects", "add_work", "display",
    ]  # fmt: skip
    assert [call.name for call in end.calls.values()] == ["record", "move", "advance"]
    assert all(call.count == TICKS for call in (*begin.calls.values(), *end.calls.values()))
    assert source_function(step.steps).__code__ is found.root.code


def test_each_kernel_is_where_the_listing_says_and_for_whom() -> None:
    with build(line(coupling__passivity="observe"), engine="interpreted") as servo:
        lines = listing(servo, TICKS)
    found = 0
    for text in lines[2 : lines.index("", 2)]:
        match = re.fullmatch(r" *(\w+) +\S+  .*  (\S+):(\d+)", text)
        assert match, text
        source = ast.parse((ROOT / match[2]).read_text("utf-8"))
        [node] = [
            f for f in ast.walk(source)
            if isinstance(f, ast.FunctionDef) and f.name == match[1]
            and min([f.lineno, *(d.lineno for d in f.decorator_list)]) == int(match[3])
        ]  # fmt: skip
        found += node.name == match[1]
    assert found > 30
    whom = {match[1]: match[2] for text in lines if (match := re.match(r" +(\w+) +\d\S* +(\w+(?:, \w+)*) ", text))}
    assert whom["sample"] == whom["watch"] == "object" and whom["displace"] == "finger0, finger1"


SKIPPED: dict[str, tuple[dict[str, Any], tuple[str, str], str]] = {
    "no ledger": ({}, ("couple_objects", "watch"), "no grasp has a ledger"),
    "no chain": ({}, ("couple_objects", "keep_pace"), "the world has no pace"),
    "no chain of an object": ({}, ("couple_objects", "couple_safely"), "no grasp has a safety"),
    "no limit": ({}, ("couple_objects", "limit"), "no grasp is limited"),
    "limits": ({"finger__1__device__force_limit": 0.1}, ("couple_objects", "sample"), "every grasp is limited"),
    "no guest": ({}, ("take", "body.taking"), "no body is guest"),
    "explicit": ({}, ("predict", "body.predicting"), "no body has a predicting"),
    "still hands": ({}, ("advance", "ask"), "plant.hand_kind != STILL: never"),
    "no exchange": ({}, ("steps", "exchange"), "the world is not exchanging"),
    "no fault": ({}, ("end", "stop"), "the servo is not faulted"),
}


@pytest.mark.parametrize("name", SKIPPED)
def test_what_a_scene_skips_has_the_reason_of_its_world(name: str) -> None:
    changes, key, reason = SKIPPED[name]
    still = {f"finger__{i}__hand__squeeze": 0.0 for i in range(2)}
    found = seen(line(**still, **changes))
    assert why(found)[key] == reason


RUN: dict[str, tuple[dict[str, Any], str, str]] = {
    "ledger": ({"coupling__passivity": "observe"}, "couple_objects", "watch"),
    "limit": ({"finger__1__device__force_limit": 0.1}, "couple_objects", "limit"),
    "chain": ({"safety__force": 1.0}, "couple_objects", "couple_safely"),
    "implicit": ({"object__integrator": "implicit"}, "predict", "body.predicting"),
    "a hand that moves": ({}, "advance", "ask"),
    "a fault": ({"finger__0__device__workspace": [[-0.03], [-0.0251]]}, "end", "stop"),
}


@pytest.mark.parametrize("name", RUN)
def test_what_a_scene_has_is_not_among_what_it_skips(name: str) -> None:
    changes, stage, kernel = RUN[name]
    found = seen(line(**changes))
    assert (stage, kernel) not in why(found)
    assert "." in kernel or kernel in found.kernels | found.stages


def test_what_ran_and_what_was_skipped_is_all_that_the_step_calls() -> None:
    """No call of a stage that ran is missing, and none is in both lists."""
    found = seen(line())
    source = ast.parse(Path(step.__file__).read_text("utf-8"))
    stages = {f.name: f for f in source.body if isinstance(f, ast.FunctionDef)}
    codes = {source_function(getattr(step, name)).__code__ for name in stages}
    below = [call for _, call in found.root.walk() if call.code in codes]
    ran = {(call.name, each.name) for call in below for each in call.calls.values()}
    skipped = {(each.stage, each.name) for each in found.skipped}
    assert len(below) > 10 and not ran & skipped
    kernels = {*stages, "watch", "limit", "sample", "couple", "conclude", "keep_pace"}
    for call in below:
        nodes = [node.func for node in ast.walk(stages[call.name]) if isinstance(node, ast.Call)]
        called = {node.id for node in nodes if isinstance(node, ast.Name)} & kernels
        assert {(call.name, callee) for callee in called} <= ran | skipped, call.name


def test_guests_and_plain_python_are_watched_too(tmp_path: Path) -> None:
    files = foreign_parts.write(tmp_path)
    changes: dict[str, Any] = {"finger.0.device": foreign_parts.device(files, "device", mass=0.15)}
    found = seen(gx.Scene(**LINE).replace(changes))
    assert counts(found)["begin"] == counts(found)["end"] == TICKS
    pytest.importorskip("mujoco")
    assert {"take_from_joints", "hand_over"} <= seen(line(object__dynamics="mujoco"), 3).kernels


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


def test_hardware_is_neither_opened_nor_read(tmp_path: Path) -> None:
    (tmp_path / "real.py").write_text(REAL)
    finger = {"start": [-0.025], "device": {"name": str(tmp_path / "real.py")}}
    found = seen(gx.Scene(**{**LINE, "finger": [finger, LINE["finger"][1]]}))
    assert counts(found)["begin"] == counts(found)["end"] == TICKS and "couple_safely" in found.stages


def test_the_command_prints_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "reference-1dof", "--tick"]) == 0
    printed = capsys.readouterr().out
    assert "steps" in printed and "no grasp has a ledger; couple_objects:" in printed
    assert main(["check", "reference-1dof", "--tick", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"tick": printed.splitlines()}
