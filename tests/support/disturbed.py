"""A run of hardware that goes wrong in many ways on a clock without a wall, with keys that change while it goes on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx import environment
from graspfx.build.build import build
from graspfx.build.hardware import at_hardware
from graspfx.build.live import keys_of, numbered
from graspfx.build.resolve import resolve
from graspfx.build.run_header import header_of
from graspfx.build.steering import Steering
from graspfx.loop.recording.recorder import Recorder
from tests.support.hardware import EVIL, SETTLING, Evil, Fake, VirtualClock, driver

T = 0.005
CART: dict[str, Any] = {
    "dimensions": 1, "period": T, "duration": 1.5, "engine": "interpreted",
    "object": {"mass": 0.1, "viscosity": 0.8, "shape": {"kind": "box", "size": [0.05]}},
    "coupling": {
        "external": {"stiffness": 30.0, "damping": 0.1}, "internal": {"stiffness": 70.0, "damping": 0.2},
        "absent": "follow", "enter": "ramp", "passivity": "observe",
    },
    "safety": {"force": 0.3, "rate": 40.0, "soft_start": 0.2, "speed": 1.0},
}  # fmt: skip
BALL: dict[str, Any] = {
    "dimensions": 3, "period": T, "duration": 1.0, "engine": "interpreted",
    "object": {
        "mass": 0.1, "viscosity": 0.8, "rotational_viscosity": 0.001, "shape": {"kind": "sphere", "radius": 0.03},
    },
    "coupling": {
        "external": {"stiffness": 30.0}, "internal": {"stiffness": 70.0}, "friction": 0.6, "absent": "follow",
        "enter": "ramp",
    },
}  # fmt: skip
SLIDER = ("coupling.internal.stiffness", "coupling.external.stiffness")
TURNS = {120: {SLIDER[0]: 400.0}, 160: {SLIDER[1]: 15.0, SLIDER[0]: 90.0}, 190: {SLIDER[0]: 900.0}}

Deed = Callable[[Fake, int], float | None]  # of a fake at a tick: the time of its reading, None for that of the reading


def samples(deed: Deed, jam: int | None = None) -> Evil:
    """Make fingers that move, and a deed of theirs from the first tick on; from tick `jam` on no force is taken."""

    def read(fake: Fake, p: Any, v: Any, t: float) -> Any:
        k = fake.tick
        phase = 2.0 * np.pi * k * T
        position = p * (1.0 - 0.02 * (1.0 - np.cos(phase)))
        velocity = -p * 0.02 * 2.0 * np.pi * np.sin(phase)
        told = deed(fake, k) if k >= 0 else None
        return position, velocity, t if told is None else told

    def write(fake: Fake, forces: Any) -> None:
        if jam is not None and fake.tick >= jam:
            raise OSError("jammed")

    return Evil(read=read, write=write)


def hold(fake: Fake, k: int) -> float | None:
    """Bring no new sample three times in a row, and once five times, so that forces begin to decay."""
    held = k % 40 in (7, 8, 9) or 140 <= k < 145
    if not held:
        fake.new = k  # type: ignore[attr-defined]
        return None
    return (fake.new + SETTLING + 1) * fake.period  # type: ignore[attr-defined]


def skip(fake: Fake, k: int) -> None:
    """Take so long that periods are left out."""
    VirtualClock.time += {50: 2.4, 90: 1.3, 91: 3.1}.get(k, 0.0) * T


def both(fake: Fake, k: int) -> float | None:
    skip(fake, k)
    return hold(fake, k)


def watchdog(fake: Fake, k: int) -> float | None:
    VirtualClock.time += 9.5 * T if k == 200 else 0.0
    return both(fake, k)


def unplug(fake: Fake, k: int) -> float | None:
    if k == 210:
        raise OSError("unplugged")
    return both(fake, k)


def fall_silent(fake: Fake, k: int) -> float | None:
    """Bring no new sample any more."""
    return (200 + SETTLING) * fake.period if k >= 200 else both(fake, k)


DEEDS: dict[str, tuple[Evil, str]] = {  # with words of the fault
    "held samples, periods left out": (samples(both), ""),
    "a watchdog": (samples(watchdog), "periods of 0.005 s in a row were left out"),
    "an unplugged device": (samples(unplug), "cannot be read: OSError: unplugged"),
    "a jammed device": (samples(both, 205), "cannot be written: OSError: jammed"),
    "a device that falls silent": (samples(fall_silent), "no new reading"),
}


def disturb(monkeypatch: pytest.MonkeyPatch, deed: str) -> str:
    """Let the first fake of a scene do a deed, and the others move; give words of the fault, nothing for none."""
    monkeypatch.setenv(environment.VARIABLE, "1")  # as the driver is elsewhere than the scene
    monkeypatch.setattr(VirtualClock, "time", 0.0)
    monkeypatch.setitem(EVIL, "moving", samples(lambda fake, k: None))
    evil, words = DEEDS[deed]
    monkeypatch.setitem(EVIL, "disturbed", evil)
    return words


def cart(folder: Path, **changes: Any) -> gx.Scene:
    """Squeeze a cart between a fake and a simulated finger."""
    fake = {"start": [-0.03], "device": _fake(folder, [[-0.02]], "disturbed")}
    partner = {
        "start": [0.025], "device": {"name": "simulated", "mass": 0.15, "damping": 0.2},
        "hand": {"stiffness": 60.0, "damping": 0.5},
    }  # fmt: skip
    return gx.Scene(**{**CART, "finger": [fake, partner]}).replace(changes)


def ball(folder: Path, **changes: Any) -> gx.Scene:
    """Hold a ball between four fakes."""
    way = np.array([[1.0, 0.3, 0.1], [-1.0, 0.2, -0.1], [0.0, -1.0, 0.2], [0.1, 0.2, -1.0]])
    places = 0.0285 * way / np.linalg.norm(way, axis=1)[:, None]
    evil = ["disturbed", *3 * ["moving"]]
    fingers = [
        {"start": (1.1 * p).tolist(), "device": _fake(folder, [p.tolist()], each)}
        for p, each in zip(places, evil, strict=True)
    ]
    return gx.Scene(**{**BALL, "finger": fingers}).replace(changes)


def _fake(folder: Path, position: Any, evil: str) -> dict[str, Any]:
    return {"name": str(driver(folder)), "position": position, "evil": evil, "at": -SETTLING}


def steered(scene: gx.Scene, ticks: int, changes: Mapping[int, Mapping[str, Any]]) -> gx.Recording:
    """Run a scene's hardware with keys that change before ticks."""
    keys = [numbered(scene, key) for key in keys_of(SLIDER)]
    parts, left = resolve(scene), dict(changes)
    with ExitStack() as stack:
        servo = stack.enter_context(build(scene, live=keys, real_time=True))
        steering, now = Steering(servo, scene, keys), [scene]
        hardware = stack.enter_context(at_hardware(servo, parts, VirtualClock()))
        recorder = stack.enter_context(Recorder(servo.layout, hardware.header(header_of(parts, servo.objects))))

        def look() -> bool:
            values = left.pop(servo.ticks, None)
            if values is not None:
                now[0] = now[0].replace(values)
                servo.write(steering.update(now[0], values), recorder)
            return False

        hardware.run(ticks, recorder, look)
        return recorder.finish(engine=servo.engine.name, **hardware.outcome, **servo.coupling)
