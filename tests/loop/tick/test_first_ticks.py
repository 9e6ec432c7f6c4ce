"""Faults of others' kernels are errors with their file and line, in the first ticks of a run and before."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import graspfx as gx
from graspfx.build.build import build
from graspfx.errors import KernelError
from graspfx.loop.tick import engine as engines
from graspfx.loop.tick.first_ticks import FIRST, FirstTicks
from graspfx.loop.tick.programs import Interpreted
from graspfx.loop.tick.script import Tick
from tests.support.engines import TICKS, recorded, same
from tests.support.small_scenes import LINE

DEVICE = '''
"""A point device of another's making: its kernel adds nothing to the forces, or has a fault."""
from graspfx.devices import simulated
from graspfx.devices.simulated import point_sample
from graspfx.devices.simulated.point_sample import PointDeviceState
from graspfx.protocols import kernel

@kernel
def share(device: PointDeviceState, i: int) -> float:
    return device.command[i]

@kernel
def writing(device: PointDeviceState) -> int:
    {fault}
    return point_sample.write(device)

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


@pytest.mark.parametrize("engine", ["auto", "interpreted"])
@pytest.mark.parametrize(
    ("fault", "line", "says"),
    [
        ("device.effort[100_000] = 1.0", LINE_OF_FAULT, "entry 1"),
        ("device.effort[device.delay - 90_000] = 1.0", LINE_OF_FAULT, "entry -"),
        ("push = share(device, 50_000 + device.delay)", LINE_OF_SHARE, "entry 5"),
        ("device.effort[-1] = 1.0", LINE_OF_FAULT, "before the first"),
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


def test_a_fault_that_only_the_specialised_program_shows(tmp_path: Path) -> None:
    """The delay is structure: which entry it is is known when the program is specialised."""
    scene, file = scene_with(tmp_path, "device.effort[device.delay - 90_000] = 1.0")
    with pytest.raises(KernelError, match="before the buffer's first") as caught:
        recorded(scene, "compiled")
    assert str(caught.value).startswith(f"{file}:{LINE_OF_FAULT}: ")


@pytest.mark.parametrize("engine", ["auto", "generic", "compiled", "interpreted"])
@pytest.mark.parametrize("calls", [1, TICKS])
def test_a_kernel_without_a_fault_runs_as_ours(tmp_path: Path, engine: str, calls: int) -> None:
    ours = gx.Scene(**LINE).replace({"finger.0.device": {"name": "simulated", "mass": 0.15, "damping": 0.2}})
    theirs, _ = scene_with(tmp_path, "push = share(device, 0)")
    assert same(recorded(ours, "interpreted"), recorded(theirs, engine, calls))


def test_only_scenes_with_kernels_of_others_are_checked(tmp_path: Path) -> None:
    theirs, _ = scene_with(tmp_path, "pass")
    for scene, checked in ((gx.Scene(**LINE), False), (theirs, True)):
        with build(scene, engine="interpreted", record=False) as servo:
            servo.run(1, None)
            assert isinstance(servo._engine, FirstTicks) is checked


class Counted(Interpreted):
    """An engine that counts its ticks."""

    def __init__(self, tick: Tick) -> None:
        super().__init__(tick)
        self.calls: list[tuple[int, int]] = []

    def run(self, k: int, count: int, row: int) -> int:
        self.calls.append((k, count))
        return super().run(k, count, row)


def test_the_engine_takes_over_after_the_first_ticks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From then on nothing is checked, and ticks are as quick as ours."""
    scene, _ = scene_with(tmp_path, "pass")
    made: list[Counted] = []

    def counted(tick: Tick) -> Counted:
        made.append(Counted(tick))
        return made[-1]

    monkeypatch.setitem(engines.ENGINES, "interpreted", counted)
    with build(scene, engine="interpreted", record=False) as servo:
        servo.run(FIRST + 5, None)
    [engine] = made
    assert engine.calls == [(FIRST, 5)]
