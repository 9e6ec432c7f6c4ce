"""The tick as it is written and as it is unfolded are one tick; its listing names what stands where."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import graspfx as gx
from graspfx import plugins
from graspfx.__main__ import main
from graspfx.build.build import build
from graspfx.compile.records import Record
from graspfx.loop.device import FusedDevice
from graspfx.loop.tick import tick as stages
from graspfx.loop.tick.names import Names, columns
from graspfx.loop.tick.script import Script, Tick
from graspfx.loop.tick.text import write
from graspfx.loop.tick.tick import begin, end
from graspfx.loop.tick.tick_listing import listing
from graspfx.loop.tick.wire_parts import Wirer
from graspfx.spatial import Vector
from tests.support import foreign_parts
from tests.support.small_scenes import LINE, line

ROOT = Path(gx.__file__).parents[1]


def as_it_stands(scene: gx.Scene, ticks: int) -> NDArray[np.float64]:
    """Rows of ticks that Python runs as they are written, on numpy's own numbers."""
    with build(scene) as servo:
        tick = Tick(Script())
        wiring = Wirer(servo.parts, tick).wire(record=True)
        rows = np.zeros((ticks, wiring.width))
        for k in range(ticks):
            begin(wiring, k)
            end(wiring, k, k, rows.reshape(-1))
            for i in tick.guests:
                if not wiring.bodies[i].stuck[0]:
                    servo.movers[i].body.exchange()
        assert not tick.ports
        assert not tick.tables
        return rows


SINE = {"kind": "sine", "amplitude": 0.002, "frequency": 4.0, "axis": [1.0]}
SCENES: dict[str, gx.Scene] = {
    "line": line(),
    "limits": line(finger__1__device__force_limit=0.1, finger__0__device__resolution=1e-5),
    "a ledger": line(coupling__passivity="control"),
    "implicit": line(object__integrator="implicit", coupling__friction=0.5),
    "a fault": line(finger__0__device__workspace=[[-0.0252], [-0.0249]], finger__0__hand__squeeze=0.02),
    "hands that move": line(finger__0__hand__motion=SINE, finger__1__hand__motion=SINE),
    "reference-1dof": gx.load("reference-1dof"),
    "paper-spring-arms": gx.load("paper-spring-arms"),
    "knob": gx.load("knob"),
}


@pytest.mark.parametrize("name", SCENES)
def test_the_tick_as_it_stands_and_unfolded_gives_the_same_bits(name: str) -> None:
    scene = SCENES[name].replace({"engine": "interpreted"})
    ticks = 40 if scene.dimensions == 1 else 4
    recording = gx.run(scene, duration=ticks * scene.period)
    rows = as_it_stands(scene, ticks)
    assert rows.tobytes() == recording.rows.tobytes()
    assert np.ptp(recording.finger_position) > 0.0
    assert bool(recording.outcome.faults) == (name == "a fault")


def test_guests_move_between_two_ticks() -> None:
    pytest.importorskip("pybullet")
    scene = gx.load("two-objects", {"engine": "interpreted"})
    recording = gx.run(scene, duration=4 * scene.period)
    assert as_it_stands(scene, 4).tobytes() == recording.rows.tobytes()


# The listing ----------------------------------------------------------------------------------------------------------


def listed(scene: gx.Scene) -> list[str]:
    with build(scene) as servo:
        return listing(servo.parts)


def test_all_that_the_tick_itself_does_has_a_name() -> None:
    lines = listed(gx.load("reference-1dof"))
    tick = "\n".join(lines[: lines.index("")])
    assert re.search(r"^ +finger\[1\]\.position\.x = device\[1\]\.position\b", tick, re.MULTILINE)
    assert re.search(r"^ +row\.finger_force\[0\] = finger\[0\]\.force\.x\b", tick, re.MULTILINE)
    assert re.search(r"^ +finger\[0\]\.displayed = -finger\[0\]\.force\.x\b", tick, re.MULTILINE)
    assert not re.search(r"[a-z]\d+\[|\]\[\d|rows\[", tick)


def test_each_stage_and_each_kernel_is_where_the_listing_says() -> None:
    """Every line that the listing names lies in its function, kernels on records among them."""
    lines = listed(line(coupling__passivity="observe", finger__1__device__force_limit=0.1))
    names, inside, checked = set(), range(0), 0
    for text in lines:
        if match := re.search(r"^def (\w+?)(?:_\d+)?\(.*# (\S+):(\d+)$", text):
            inside = extent(ROOT / match[2], match[1], int(match[3]))
            names.add(match[1])
        elif match := re.search(r"# (\w+), (graspfx/loop/tick/tick\.py)$", text):
            stage = getattr(stages, match[1])
            inside = extent(ROOT / match[2], match[1], stage.__code__.co_firstlineno)
            names.add(match[1])
        elif match := re.search(r"  # line (\d+)$", text):
            assert int(match[1]) in inside, text
            checked += 1
    assert names >= {"read", "couple_objects", "add_work", "display", "record", "move", "advance"}
    assert names >= {"couple", "limit", "conclude", "watch", "react"}
    assert checked > 500


def extent(file: Path, name: str, first: int) -> range:
    """The lines of the function of that name whose decorators or definition begin at a line."""
    functions = [node for node in ast.walk(ast.parse(file.read_text("utf-8"))) if isinstance(node, ast.FunctionDef)]
    [node] = [
        f for f in functions if f.name == name and min([f.lineno, *(d.lineno for d in f.decorator_list)]) == first
    ]
    assert node.end_lineno is not None
    return range(first, node.end_lineno + 1)


def test_a_kernel_that_serves_two_objects_says_so() -> None:
    things = [{**LINE["object"], "name": name} for name in ("first", "second")]
    fingers = [{**finger, "object": thing["name"]} for thing in things for finger in LINE["finger"]]
    text = "\n".join(listed(gx.Scene(**{**LINE, "object": things, "finger": fingers})))
    assert "code = sample(object[0])" in text
    assert "code = sample(object[1])" in text
    assert re.search(r"^def sample\(object\):", text, re.MULTILINE)
    assert "finger[3].velocity.x = device[3].velocity" in text
    assert "object.fingers[1].gap" in text
    assert "object[1].body.motion.position.x" in text


class Reading(Record):
    """The first entries of a block."""

    fingers: int
    pose: Vector


def test_a_part_may_say_which_record_its_memory_is(monkeypatch: pytest.MonkeyPatch) -> None:
    with build(gx.load("reference-1dof")) as servo:
        tick = write(servo.parts)
        monkeypatch.setattr(type(servo.stations[0].device), "declaration", Reading, raising=False)
        names = Names(servo.parts, tick)
        second = servo.stations[1].device
        assert isinstance(second, FusedDevice)
        device = next(name for name, array in tick.script.arrays.items() if array is second.state)
    assert [names.entry(device, k) for k in (0, 3)] == ["device[1].fingers", "device[1].pose.z"]
    assert names.shared(device, 3) == "device.pose.z"
    assert names.entry(device, second.ports.position) == "device[1].position"  # beyond the record, by the port
    assert names.entry(device, len(second.state) - 1).startswith("device[1][")


@pytest.mark.parametrize("name", ["knob", "paper-waving"])
def test_all_entries_of_our_parts_have_names(name: str) -> None:
    with build(gx.load(name)) as servo:
        tick = write(servo.parts)
        names = Names(servo.parts, tick)
        for array, memory in tick.script.arrays.items():
            if array.rstrip("0123456789") in ("servo", "device", "plant", "hand", "ledger"):
                entries = [names.entry(array, k) for k in range(len(memory))]
                assert [entry for entry in entries if entry.startswith(f"{names.memories[array]}[")] == []


@pytest.mark.parametrize("name", [n for n, origin in plugins.names("scenes").items() if "GraspFX" in origin])
def test_each_number_of_a_row_has_a_name_of_its_own(name: str) -> None:
    with build(gx.load(name)) as servo:
        names = columns(servo.layout)
        assert sorted(names) == list(range(servo.layout.width))
        assert len(set(names.values())) == servo.layout.width


def test_the_command_prints_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "reference-1dof", "--tick"]) == 0
    printed = capsys.readouterr().out
    assert main(["check", "reference-1dof", "--tick", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"tick": printed.splitlines()}


def test_a_device_in_plain_python_has_two_programs(tmp_path: Path) -> None:
    files = foreign_parts.write(tmp_path)
    changes: dict[str, Any] = {"finger.0.device": foreign_parts.device(files, "device", mass=0.15)}
    text = listed(gx.Scene(**LINE).replace(changes))
    programs = [each.partition("(")[0] for each in text if re.match(r"def (run|begin|end)\(", each)]
    assert programs == ["def begin", "def end"]
    assert any(re.match(r" +finger\[0\]\.position\.x = port\[0\]\.position\b", each) for each in text)
