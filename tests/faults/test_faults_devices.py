"""Evil devices: whatever one does, it is a fault in words, and from there on no force; or it does no harm."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly import run_scene as whole_run
from graspfx.loop.realtime.pacing import decay_ticks
from tests.support.hardware import EVIL, LIMIT, VirtualClock, driver, fakes

DURATION = 0.15  # 30 ticks


def pinch(file: Path, evil: str) -> gx.Scene:
    """Two devices press a cart on a rail between them, 4 mm each: 0.28 N."""
    return gx.Scene(
        dimensions=1, period=0.005, duration=DURATION, engine="interpreted",
        object={"mass": 0.1, "viscosity": 0.8, "shape": {"kind": "box", "size": [0.05]}},
        coupling={
            "external": {"stiffness": 30.0, "damping": 0.1}, "internal": {"stiffness": 70.0, "damping": 0.1},
            "absent": "follow", "enter": "ramp",
        },
        finger=[
            {"start": [-0.025], "device": {"name": str(file), "position": [[-0.021]], "evil": evil}},
            {"start": [0.025], "device": {"name": str(file), "position": [[0.021]]}},
        ],
    )  # fmt: skip


def ball(file: Path, evil: str) -> gx.Scene:
    """One device of three fingers, and one beside it, around a ball in space."""
    tips = 0.022 * np.array([[1.0, 0.0, 0.0], [-0.5, 0.8, 0.0], [-0.5, -0.8, 0.0]])
    other = [[0.0, 0.0, 0.0235]]
    return gx.Scene(
        dimensions=3, period=0.005, duration=DURATION, engine="interpreted",
        object={"mass": 0.1, "viscosity": 0.5, "rotational_viscosity": 1e-4,
                "shape": {"kind": "sphere", "radius": 0.025}},
        coupling={
            "external": {"stiffness": 60.0, "damping": 0.1}, "internal": {"stiffness": 300.0, "damping": 0.1},
            "friction": 0.5, "enter": "ramp",
        },
        device=[
            {"name": str(file), "label": "three", "position": tips.tolist(), "evil": evil},
            {"name": str(file), "label": "one", "position": other},
        ],
        finger=[
            *({"start": tip.tolist(), "device": "three", "channel": c} for c, tip in enumerate(tips)),
            {"start": other[0], "device": "one"},
        ],
    )  # fmt: skip


SCENES = {"pinch": pinch, "ball": ball}


def require_safe(make: Any, kind: str, folder: Path) -> None:
    """Run a scene with one evil device, and require all that has to hold."""
    file, evil = driver(folder), EVIL[kind]
    out = folder / "out"
    rec = gx.run(make(file, kind), real_time=True, out=out)  # which raises nothing
    devices = [fake for fake in fakes(file) if fake.log]
    assert len(devices) == 2
    name = "finger0" if make is pinch else "finger0, finger1, finger2"
    first = devices[0].at + evil.patience
    if evil.says:
        fault = rec.faults[0]
        assert fault.tick == first, fault
        assert evil.says in fault.message, fault
        assert name in fault.message or "were skipped" in fault.message, fault
        assert not rec.finger_force[first:].any() and not rec.displayed_force[first:].any()
    else:
        assert not rec.faults
        assert rec.displayed_force[-1 - decay_ticks(0.005)].any()
        assert not rec.displayed_force[-1].any()
    assert rec.displayed_force[5:10].any(axis=(1, 2)).all()  # it was felt before
    assert len(rec) == round(DURATION / 0.005)
    for fake in devices:
        written = fake.forces
        assert all(np.isfinite(force).all() for _, force in written)
        assert max(np.linalg.norm(force, axis=1).max() for _, force in written) <= LIMIT * (1.0 + 1e-12)
        if evil.says:
            last = first if evil.write is fake.evil.write is not None and not evil.patience else first - 1
            assert written[-1][0] == last  # the one whose `write` fails is the only one that is told something
            count = sum(1 for _, what in fake.log if isinstance(what, str) and what == "stop")
            assert count >= 1 + (len(rec) - first if fake is devices[-1] else 0)  # in each tick, and at the end
    again = gx.Recording.load(out)
    assert again.faults == rec.faults


SOME = [
    "read raises OSError", "write raises ValueError", "read raises Unspeakable", "stop raises too", "nothing", "NaN",
    "a metre off", "a clock that stands", "a clock that runs back", "float32", "a row too many",
    "a hang of ten periods", "a hang of half a period", "views that change",
]  # fmt: skip


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no time pass but what a device takes."""
    monkeypatch.setattr(whole_run, "WallClock", VirtualClock)


@pytest.mark.parametrize("kind", SOME)
def test_some_evil_devices(kind: str, tmp_path: Path) -> None:
    require_safe(pinch, kind, tmp_path)


@pytest.mark.faults
@pytest.mark.parametrize("kind", EVIL)
@pytest.mark.parametrize("name", SCENES)
def test_all_evil_devices(name: str, kind: str, tmp_path: Path) -> None:
    require_safe(SCENES[name], kind, tmp_path)


def test_there_are_many_kinds_of_evil() -> None:
    assert len(EVIL) >= 45
