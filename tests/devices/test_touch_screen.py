"""A touch screen as a device: fingers that follow touches, give way when they are lifted, and feel nothing."""

from __future__ import annotations

import os
import signal
import time
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.build.run import run
from graspfx.certificate.plan import plan
from graspfx.errors import DeviceError, InputError
from graspfx.testing import check_device, driver
from graspfx.testing.wire import ScreenWire

pytestmark = pytest.mark.alone

pytest.importorskip("websockets", reason="the page's socket: pip install 'graspfx[touch]'")


def connect(wire: ScreenWire, **settings: Any) -> Any:
    return driver("touch-screen").connect(**{"lag": 0.001, "speed": 5.0, **wire.settings, **settings})


def settle(device: Any, until: Any, longest: float = 3.0) -> Any:
    """Read until something is so."""
    end = time.monotonic() + longest
    while True:
        position = device.read()[0].copy()
        if until(position) or time.monotonic() > end:
            return position
        time.sleep(0.001)


def test_it_keeps_the_promises_of_a_device() -> None:
    with ScreenWire() as wire:
        report = check_device(lambda: connect(wire, lag=0.08), wire)
    assert "a moving finger is seen" in report.checks
    assert "hardware that is open is refused to a second program, and the first one goes on" in report.checks
    assert "a wire that fails (garbage) is a sample that stands or a DeviceError, never another place" in report.checks
    assert not any("force" in each.promise for each in (*report.not_visible, *report.needs_person))


def test_fingers_follow_touches_and_give_way_when_they_are_lost() -> None:
    """Two touches are two fingers and two switches; a socket that is gone lifts both, and they give way to a force."""
    with ScreenWire() as wire, connect(wire) as screen:
        screen.open(0.001)
        assert (screen.features.fingers, screen.features.switches, screen.switches) == (2, 2, 0)
        wire.touch(0, -0.03, 0.01)
        wire.touch(1, 0.04, -0.02)
        there = settle(screen, lambda p: np.allclose(p, [[-0.03, 0.01], [0.04, -0.02]], rtol=0.0, atol=1e-9))
        assert there == pytest.approx(np.array([[-0.03, 0.01], [0.04, -0.02]]), abs=1e-9)
        assert screen.switches == 0b11
        assert screen.raw[:4].tolist() == [2.0, 0.0, 0.0, 2.0]
        screen.write(np.array([[-1.0, 0.0], [0.0, 2.0]]))
        wire.lift(1)
        settle(screen, lambda p: screen.switches == 0b01)
        away = settle(screen, lambda p: p[1, 1] > -0.015)
        assert away[1] == pytest.approx([0.04, away[1, 1]]) and away[1, 1] > -0.015
        assert away[0] == pytest.approx([-0.03, 0.01], abs=1e-9)  # which is touched
        wire.leave()
        settle(screen, lambda p: screen.switches == 0)
        assert screen.switches == 0
        screen.write(np.zeros((2, 2)))
        last = settle(screen, lambda p: False, 0.05)
        assert settle(screen, lambda p: False, 0.05) == pytest.approx(last, abs=1e-6)  # without a force they stay


def test_a_finger_is_no_faster_than_it_may_be() -> None:
    with ScreenWire() as wire, connect(wire, speed=0.5) as screen:
        screen.open(0.001)
        wire.touch(0, 0.1, 0.1)
        speeds: list[float] = []
        while len(speeds) < 100:
            speeds.append(float(np.linalg.norm(screen.read()[1][0])))
            time.sleep(0.001)
        assert 0.3 < max(speeds) < 0.6


def test_silence_lifts_fingers_and_a_dead_server_is_a_fault() -> None:
    """A page that says nothing for half a second while it is touched counts as lost."""
    with ScreenWire() as wire, connect(wire) as screen:
        screen.open(0.001)
        wire.touch(0, 0.0, 0.0)
        settle(screen, lambda p: screen.switches == 1)
        began = time.monotonic()
        settle(screen, lambda p: screen.switches == 0)
        assert 0.3 < time.monotonic() - began < 2.0
        assert screen.switches == 0
        wire.touch(0, 0.0, 0.0)
        settle(screen, lambda p: screen.switches == 1)
        os.kill(screen.screen._process.pid, signal.SIGSTOP)  # a server that hangs is a screen that is lost
        settle(screen, lambda p: screen.switches == 0)
        assert screen.switches == 0
        os.kill(screen.screen._process.pid, signal.SIGKILL)
        with pytest.raises(DeviceError, match="has ended"):
            settle(screen, lambda p: False)
        screen.close()


def test_a_port_in_use_is_refused() -> None:
    with ScreenWire() as wire, connect(wire) as one, connect(wire) as two:
        one.open(0.001)
        with pytest.raises(DeviceError, match="not served: port: "):
            two.open(0.001)
        assert np.isfinite(one.read()[0]).all()


@pytest.mark.parametrize(
    ("setting", "text"),
    [
        ({"dimensions": 3}, "a screen has no depth"),
        ({"fingers": 0}, "fingers"),
        ({"fingers": 3, "start": [[0.0, 0.0]]}, "places of 3 fingers"),
        ({"start": [[0.0, 0.0], [1.0, 0.0]]}, "within the workspace"),
        ({"port": -1}, "port"),
        ({"lan": 1}, "true or false"),
        ({"speed": 0.0}, "speed"),
    ],
)
def test_settings_are_refused_by_their_names(setting: dict[str, Any], text: str) -> None:
    with pytest.raises(InputError, match=text):
        driver("touch-screen").connect(**setting)


def test_a_cube_is_squeezed_on_a_screen_in_real_time() -> None:
    """Two touches 5 mm inside squeeze with the internal stiffness alone: f = k s = 70 N/m 5 mm = 0.35 N.

    The fingers are where the touches are, so that no hand is in series. When they are lifted the fingers give way.
    """
    with ScreenWire() as wire:
        device = {"name": "touch-screen", "label": "screen", **wire.settings, "start": [[-0.025, 0.0], [0.025, 0.0]]}
        scene = gx.load("paper-waving", {"period": 0.005, "engine": "interpreted"})
        table = scene.to_dict()
        table["device"] = [device]
        table["finger"] = [
            {"name": name, "start": start, "device": "screen", "channel": channel}
            for channel, (name, start) in enumerate((("thumb", [-0.025, 0.0]), ("forefinger", [0.025, 0.0])))
        ]
        scene = gx.Scene(**table)
        steps = {row.step: row for row in plan(scene)}
        assert steps["display"].why.startswith("no force is displayed by")
        ticks = iter(range(10**6))

        def act() -> bool:
            tick = next(ticks)
            if 20 <= tick < 120:
                depth = 0.005 * min(1.0, (tick - 20) / 30)
                wire.touch(0, -0.025 + depth, 0.0)
                wire.touch(1, 0.025 - depth, 0.0)
            elif tick == 120:
                wire.leave()
            return tick > 220

        rec = run(scene, duration=6.0, real_time=True, stop=act)
    assert not rec.faults
    force = rec.finger_force[:, 0, 0]
    raw = rec.raw["thumb"]  # by the first of its fingers
    touched = np.flatnonzero(raw[:, 5] > 0.0)
    assert force[touched[-1]] == pytest.approx(0.35, rel=1e-3)
    assert np.abs(rec.finger_force[-1]).max() == 0.0  # they have given way
    assert raw[:, 2].max() == 0.0  # no order is lost
