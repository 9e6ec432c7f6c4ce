"""Faults of others' kernels are errors with their file and line, in the first ticks of a run and before."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import graspfx as gx
from graspfx.__main__ import main
from graspfx.assembly.build import build
from graspfx.errors import KernelError
from graspfx.loop.engine import FIRST, Compiled
from tests.support.engines import TICKS, recorded, same
from tests.support.small_scenes import LINE

DEVICE = '''
"""A point device of another's making: its kernel adds nothing to the forces, or has a fault."""
from graspfx.devices import simulated
from graspfx.devices.simulated import point_device
from graspfx.devices.simulated.point_device import PointDeviceState
from graspfx.protocols import kernel

@kernel
def share(device: PointDeviceState, i: int) -> float:
    return device.command[i]

@kernel
def writing(device: PointDeviceState) -> int:
    {fault}
    return point_device.write(device)

class Other(simulated.PointDevice):
    writing = staticmethod(writing)

def connect(*, mass, dimensions):
    return Other(mass=mass, damping=0.2, fingers=1, dimensions=dimensions, resolution=0.0, velocity_window=1, delay=0,
                 force_limit=None, workspace=None)
'''
LINE_OF_FAULT = DEVICE[: DEVICE.index("{fault}")].count("\n") + 1
LINE_OF_SHARE = DEVICE[: DEVICE.index("return device")].count("\n") + 1


def scene_with(folder: Path, fault: str) -> tuple[gx.Scene, str]:
    """The line's scene with a device from a file, and the file."""
    file = folder / "other.py"
    file.write_text(DEVICE.replace("{fault}", fault))
    changes: dict[str, Any] = {"finger.0.device": {"name": str(file), "mass": 0.15}}
    return gx.Scene(**LINE).replace(changes), str(file)


@pytest.mark.parametrize("engine", ["auto", "compiled", "interpreted"])
@pytest.mark.parametrize(
    ("fault", "line", "says"),
    [
        ("device.effort[100_000] = 1.0", LINE_OF_FAULT, "entry 1"),
        ("device.effort[device.delay - 90_000] = 1.0", LINE_OF_FAULT, "entry -"),
        ("push = share(device, 50_000 + device.delay)", LINE_OF_SHARE, "entry 5"),
        ("device.effort[-1] = 1.0", LINE_OF_FAULT, "negative index"),
        (
            "if device.delay > 3:\n        push = 1.0\n    device.effort[0] = push",
            LINE_OF_FAULT + 2,
            "assign to 'push' before",
        ),
    ],
)
def test_a_fault_names_file_and_line(tmp_path: Path, engine: str, fault: str, line: int, says: str) -> None:
    scene, file = scene_with(tmp_path, fault)
    with pytest.raises(KernelError, match=says) as caught:
        recorded(scene, engine)
    assert str(caught.value).startswith(f"{file}:{line}: ")


def test_a_fault_is_the_same_error_in_a_run_and_in_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    scene, file = scene_with(tmp_path, "device.effort[100_000] = 1.0")
    place = f"{file}:{LINE_OF_FAULT}: "
    with pytest.raises(KernelError) as caught:
        gx.run(scene)
    assert str(caught.value).startswith(place)
    device = f'finger.*.device={{name = "{file}", mass = 0.15}}'
    for command in (["run"], ["check", "--tick"], ["run", "--set", "engine=interpreted"]):
        assert main([command[0], "reference-1dof", *command[1:], "--set", device, "--trust"]) == 2, command
        assert place in capsys.readouterr().err


@pytest.mark.parametrize("engine", ["auto", "compiled", "interpreted"])
@pytest.mark.parametrize("calls", [1, TICKS])
def test_a_kernel_without_a_fault_runs_as_ours(tmp_path: Path, engine: str, calls: int) -> None:
    ours = gx.Scene(**LINE).replace({"finger.0.device": {"name": "simulated", "mass": 0.15, "damping": 0.2}})
    theirs, _ = scene_with(tmp_path, "push = share(device, 0)")
    assert same(recorded(ours, "interpreted"), recorded(theirs, engine, calls))


def test_only_scenes_with_kernels_of_others_are_checked(tmp_path: Path) -> None:
    theirs, _ = scene_with(tmp_path, "pass")
    for scene, checked in ((gx.Scene(**LINE), False), (theirs, True)):
        with build(scene, engine="compiled", record=False) as servo:
            servo.run(1, None)
            assert isinstance(servo.engine, Compiled)
            assert servo.engine.is_checking is checked


def test_machine_code_takes_over_after_the_first_ticks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From then on nothing is checked, and ticks are as quick as ours; however they are called."""
    scene, _ = scene_with(tmp_path, "pass")
    for calls in ([FIRST + 5], [1] * (FIRST + 5), [FIRST - 1, 6]):
        with build(scene, engine="compiled", record=False) as servo:
            engine = servo.engine
            assert isinstance(engine, Compiled) and engine._first is not None
            run = engine._first.run
            interpreted: list[int] = []

            def noted(k: int, count: int, row: int, run: Any = run, interpreted: Any = interpreted) -> int:
                interpreted.append(count)
                return int(run(k, count, row))

            monkeypatch.setattr(engine._first, "run", noted)
            for count in calls:
                servo.run(count, None)
            assert sum(interpreted) == FIRST and servo.ticks == FIRST + 5 and not engine.is_checking
