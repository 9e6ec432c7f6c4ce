"""The conformance kit for scenes: one that is sound passes, each that breaks a promise is told which."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.compile.kernel import kernel, source_function
from graspfx.coupling.grasp_state import GraspState
from graspfx.coupling.sample import conclude
from graspfx.errors import InputError
from graspfx.loop.step import couple_objects
from graspfx.recording.record import Recording
from graspfx.testing import ConformanceError, check_scene
from graspfx.testing.scene_promises import _check_recording, _check_wrench

G = 9.81


def scene(d: int = 3, n: int = 3, away: float = 0.028, **changes: Any) -> gx.Scene:
    """n fingers 2 mm inside a ball or disc of 30 mm, which they hold against gravity; on a line two, without it."""
    n = 2 if d == 1 else n
    angle = 2.0 * np.pi * np.arange(n) / n
    start = away * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])[:, :d]
    down = {1: None, 2: [0.0, -G], 3: [0.0, 0.0, -G]}[d]
    table: dict[str, Any] = {
        "dimensions": d,
        "period": 0.002,
        "duration": 0.1,
        "object": {"mass": 0.05, "viscosity": 1.0, "shape": {"kind": "sphere", "radius": 0.03}}
        | ({} if d == 1 else {"rotational_viscosity": 2e-4}),
        "coupling": {
            "external": {"stiffness": 300.0, "damping": 0.5},
            "internal": {"stiffness": 500.0, "damping": 0.5},
            "friction": "stick",
        },
        "finger": [
            {
                "start": each.tolist(),
                "device": {"name": "simulated", "mass": 0.1, "damping": 0.5},
                "hand": {"stiffness": 300.0, "damping": 3.0, "squeeze": 0.006},
            }
            for each in start
        ],
    } | ({} if down is None else {"gravity": down})
    return gx.Scene(**table).replace(changes)


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize(
    ("integrator", "reaction"),
    [("explicit", "fingertip"), ("semi-implicit", "contact"), ("exact", "fingertip"), ("implicit", "contact")],
)
def test_sound_scenes_pass(d: int, integrator: str, reaction: str) -> None:
    check_scene(scene(d).replace({"object.integrator": integrator, "coupling.reaction": reaction}), duration=0.06)


def test_a_name_a_path_and_a_maker_are_scenes(tmp_path: Path) -> None:
    check_scene("reference-1dof", duration=0.1)
    check_scene(lambda: scene(2), duration=0.1)
    assert len(check_scene(scene(2), duration=0.1)) == 50
    with pytest.raises(ConformanceError, match="the scene loads and has a plan; found: UnknownNameError"):
        check_scene("reference-2dof")
    with pytest.raises(ConformanceError, match="expected a scene"):
        check_scene(3.0)  # type: ignore[arg-type]


def test_the_weight_is_carried() -> None:
    """When all is at rest the fingers carry m g, 0.05 kg times 9.81 m/s^2, and nothing sideways."""
    still = scene(3, n=4)
    check_scene(
        still,
        duration=0.5,
        number=[(lambda recording: recording.wrench[-1, :3], [0.0, 0.0, 0.05 * G], 1e-4), ("faults", 0, 0)],
    )


def spike(recording: Recording) -> Any:
    """One of many numbers is another."""
    ticks = np.arange(len(recording))
    return np.stack([ticks == 31, np.zeros(len(ticks))], axis=1)


def test_a_number_that_is_another() -> None:
    with pytest.raises(ConformanceError, match=r"ticks is 7, within 0; found: 50"):
        check_scene(scene(2), duration=0.1, number=("ticks", 7, 0))
    with pytest.raises(ConformanceError, match=r"finger_distance_mean is 0\.05, within 1; found: None"):
        check_scene(scene(2), duration=0.1, number=("finger_distance_mean", 0.05, 1))
    with pytest.raises(ConformanceError, match="a key of the summary") as caught:
        check_scene(scene(2), duration=0.1, number=("tikcs", 7, 0))
    with pytest.raises(ConformanceError, match=r"found: 1\.0 at \[31, 0\], the largest error of 100"):
        check_scene(scene(2), duration=0.1, number=(spike, 0.0, 0.5))
    assert isinstance(caught.value.__cause__, InputError)


BODY = """
from graspfx.objects import body
from graspfx.objects import integrators
class Strange:
    def __init__(self, state):
        self.real, self.state = body.create(state), state
        self.steps = 0
    def free_motion(self, T): self.real.free_motion(T)
    def step(self, T):
        self.steps += 1
        {step}
def create(state): return Strange(state)
"""
FAULTS = {
    "energy: a body that gains 0.2 % of its speed a sample": (
        "self.real.step(T); self.state[integrators.VELOCITY:integrators.VELOCITY + 3] *= 1.002",
        "the objects gain at most the work of",
    ),
    "finite: a body that is lost": (
        "self.state[integrators.POSITION] = float('nan')",
        "a run is complete and has no faults",
    ),
    "random: a body that throws dice": (
        "import random; self.real.step(T); self.state[integrators.POSITION] += random.random() * 1e-12",
        "two runs are identical, bit for bit",
    ),
    "memory: a body that counts all of its kind": (
        "import sys; sys.steps = getattr(sys, 'steps', 0) + 1; self.real.step(T)\n"
        "        self.state[integrators.POSITION] += 1e-9 * (sys.steps > {runs} and self.steps < 5)",
        "two servos that run alternately each give the result of a single servo",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_body_that_breaks_a_promise(fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.steps", 0, raising=False)
    step, promise = FAULTS[fault]
    driver = tmp_path / "strange.py"
    driver.write_text(BODY.format(step=step.replace("{runs}", str(2 * 50))))
    light: dict[str, Any] = {
        "object.viscosity": 0.0,
        "object.velocity": [0.1, 0.0],
    }  # and free: nothing near it to give it energy
    with pytest.raises(ConformanceError, match=promise):
        check_scene(scene(2, away=0.07).replace({"object.dynamics": str(driver)} | light), duration=0.1)


@kernel
def conclude_twice(grasp: GraspState, fault: int) -> int:
    """Give the object twice the wrench of the forces."""
    code = conclude(grasp, fault)
    grasp.body.force = 2.0 * grasp.body.force
    grasp.body.moment = 2.0 * grasp.body.moment
    return code


def test_a_coupling_that_creates_energy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forces computed from twice the distance they are told of: half of what the object gets comes from nowhere."""
    names = source_function(couple_objects).__globals__
    monkeypatch.setitem(names, "conclude_k", source_function(conclude_twice))
    monkeypatch.setattr("graspfx.testing.scene_promises._check_wrench", lambda *_: None)
    waved = gx.load("paper-waving", {"engine": "interpreted"})
    with pytest.raises(ConformanceError, match="the coupling delivers at most the fingers' work"):
        check_scene(waved, duration=2.5)
    check_scene(waved, duration=0.5, energy=None)


def doctored(column: str, change: Callable[[Any], Any], **changes: Any) -> tuple[gx.Scene, Recording]:
    made = scene(3, **changes)
    recording = gx.run(made, duration=0.1)
    rows = recording.rows.copy()
    where = recording.layout.columns[column].where
    rows[:, where] = change(rows[:, where])
    return made, Recording(rows, recording.layout, recording.header, recording.outcome)


@pytest.mark.parametrize("reaction", ["fingertip", "contact"])
def test_a_wrench_that_is_not_the_forces(reaction: str) -> None:
    turn = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1e-9])
    for change, unit in ((turn, "N m"), (turn[::-1], "N")):
        made, recording = doctored("objects/object/wrench", partial(np.add, change), **{"coupling.reaction": reaction})
        with pytest.raises(ConformanceError, match=f"a difference of [-+.e\\d]+ {unit} on object"):
            _check_wrench(made, recording)


def test_recordings_that_cannot_be() -> None:
    with pytest.raises(ConformanceError, match="finite; found: gap is not finite at tick 0"):
        _check_recording(*doctored("gap", lambda gap: gap * np.nan))
    with pytest.raises(ConformanceError, match="J in a sample"):
        _check_recording(*doctored("device_energy", lambda energy: -energy))
