"""A touch screen as a device: fingers that follow touches, give way when they are lifted, and feel nothing."""

from __future__ import annotations

import os
import signal
import time
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly import run_scene as whole_run
from graspfx.assembly.run_scene import run
from graspfx.certificate.plan import plan
from graspfx.devices import touch_screen
from graspfx.devices.touch_screen import emulator
from graspfx.devices.touch_screen.emulator import ScreenWire
from graspfx.errors import DeviceError, InputError
from graspfx.screen import touch_screen as screens
from graspfx.screen.touch_screen import Touches
from graspfx.testing import check_device, driver
from tests.support.hardware import VirtualClock
from tests.support.waiting import wait_until

pytest.importorskip("websockets", reason="the page's socket: pip install 'graspfx[touch]'")


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """A busy machine may be late to start the page's process: what is not served at all is what a test is about."""
    monkeypatch.setattr(screens, "PATIENCE", 600.0)
    monkeypatch.setattr(emulator, "PATIENCE", 600.0)


def connect(wire: ScreenWire, **settings: Any) -> Any:
    return driver("touch-screen").connect(**{"lag": 0.001, "speed": 5.0, **wire.settings, **settings})


class Page:
    """What a screen tells a driver, as a test wants it."""

    def __init__(self) -> None:
        self.fingers = np.zeros((2, 4))

    def touches(self) -> Touches:
        return Touches(0.0, np.zeros(5), self.fingers)

    def show(self, positions: np.ndarray, forces: np.ndarray) -> None:
        self.shown = positions.copy(), forces.copy()

    def open(self) -> None:
        pass

    def close(self) -> None:
        pass


def paged(**settings: Any) -> Any:
    """Connect a device to a page of its own, on a clock that `speeds` advances."""
    screen = driver("touch-screen").connect(**{"lag": 0.001, "speed": 5.0, **settings})
    screen.source, screen.now = Page(), VirtualClock().now
    screen.open(0.001)
    return screen


def speeds(screen: Any, count: int) -> list[float]:
    """Read every millisecond; give the speeds of the first finger."""
    found = []
    for _ in range(count):
        VirtualClock.time += 0.001
        found.append(float(np.linalg.norm(screen.read()[1][0])))
    return found


@pytest.mark.alone
def test_it_keeps_the_promises_of_a_device() -> None:
    with ScreenWire() as wire:
        report = check_device(lambda: connect(wire, lag=0.08), wire)
    assert "the motion of a finger is read" in report.checks
    assert "open hardware is refused to a second program, and the first one continues" in report.checks
    assert any("a failing wire (garbage) yields the previous sample" in each for each in report.checks)
    assert not any("force" in each.promise for each in (*report.not_visible, *report.needs_person))


def test_fingers_follow_touches_and_give_way_when_they_are_lost() -> None:
    """Two touches are two fingers and two switches; one that is lifted gives way to a force, at 0.1 m/s."""
    with paged() as screen:
        assert (screen.features.fingers, screen.features.switches, screen.switches) == (2, 2, 0)
        places = np.array([[-0.03, 0.01], [0.04, -0.02]])
        screen.source.fingers[:, 0], screen.source.fingers[:, 1:3] = 1.0, places
        speeds(screen, 100)
        assert screen.read()[0] == pytest.approx(places, abs=1e-9)
        assert screen.switches == 0b11
        assert screen.raw[5:].tolist() == [1.0, -0.03, 0.01, 1.0, 0.04, -0.02]
        forces = np.array([[-1.0, 0.0], [0.0, 2.0]])
        screen.write(forces)
        assert np.array_equal(screen.source.shown, [screen.read()[0], forces])
        screen.source.fingers[1, 0] = 0.0
        speeds(screen, 100)
        assert screen.switches == 0b01
        assert screen.read()[0] == pytest.approx(np.array([[-0.03, 0.01], [0.04, -0.01]]), abs=3e-4)
        screen.source.fingers[0, 0] = 0.0
        screen.write(np.zeros((2, 2)))
        speeds(screen, 50)
        assert screen.switches == 0
        last = screen.read()[0].copy()
        speeds(screen, 50)
        assert screen.read()[0] == pytest.approx(last, abs=1e-9)  # without a force they stay


def test_a_finger_is_no_faster_than_it_may_be() -> None:
    with paged(speed=0.5) as screen:
        screen.source.fingers[0, :3] = 1.0, 0.1, 0.1
        assert 0.45 < max(speeds(screen, 100)) <= 0.5


def is_down(screen: Any) -> bool:
    """Read, and tell whether the first finger is on the screen."""
    screen.read()
    return bool(screen.switches)


@pytest.mark.alone
def test_silence_lifts_fingers_and_a_dead_server_is_a_fault() -> None:
    """A page that says nothing for half a second while it is touched counts as lost."""
    with ScreenWire() as wire, connect(wire) as screen:
        screen.open(0.001)
        wire.touch(0, 0.0, 0.0)
        wait_until(lambda: is_down(screen) and screen.raw[0])
        assert screen.raw[:4].tolist() == [1.0, 0.0, 0.0, 1.0]
        began = time.monotonic()
        wait_until(lambda: not is_down(screen))
        assert 0.3 < time.monotonic() - began < 2.0
        wire.touch(0, 0.0, 0.0)
        wait_until(lambda: is_down(screen))
        wire.leave()
        wait_until(lambda: not is_down(screen))
        wire.touch(0, 0.0, 0.0)
        wait_until(lambda: is_down(screen))
        assert screen.raw[2] == 0.0  # no order is lost
        os.kill(screen.source._process.pid, signal.SIGSTOP)  # a server that hangs is a screen that is lost
        wait_until(lambda: not is_down(screen))
        os.kill(screen.source._process.pid, signal.SIGKILL)
        with pytest.raises(DeviceError, match="has ended"):
            wait_until(lambda: screen.read() is None)
        screen.close()


def test_a_port_in_use_is_refused() -> None:
    with ScreenWire() as wire, connect(wire) as one, connect(wire) as two:
        one.open(0.001)
        with pytest.raises(DeviceError, match="cannot be served: port: "):
            two.open(0.001)
        assert np.isfinite(one.read()[0]).all()


@pytest.mark.parametrize(
    ("setting", "text"),
    [
        ({"dimensions": 3}, "a screen has no depth"),
        ({"fingers": 0}, "fingers"),
        ({"fingers": 3, "start": [[0.0, 0.0]]}, r"shape \(3, 2\)"),
        ({"start": [[0.0, 0.0], [1.0, 0.0]]}, "within the workspace"),
        ({"port": -1}, "port"),
        ({"lan": 1}, "true or false"),
        ({"speed": 0.0}, "speed"),
    ],
)
def test_settings_are_refused_by_their_names(setting: dict[str, Any], text: str) -> None:
    with pytest.raises(InputError, match=text):
        driver("touch-screen").connect(**setting)


def test_a_cube_is_squeezed_on_a_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two touches 5 mm inside squeeze with the internal stiffness alone: f = k s = 70 N/m 5 mm = 0.35 N.

    The fingers are where the touches are, so that no hand is in series. When they are lifted the fingers give way.
    """
    page = Page()
    monkeypatch.setattr(whole_run, "WallClock", VirtualClock)
    monkeypatch.setattr(touch_screen, "TouchScreen", lambda **settings: page)
    monkeypatch.setattr(touch_screen.TouchFingers, "now", lambda _: VirtualClock().now())
    device = {"name": "touch-screen", "label": "screen", "start": [[-0.025, 0.0], [0.025, 0.0]]}
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
        depth = 0.005 * min(1.0, (tick - 20) / 30)
        page.fingers[:, 0] = 20 <= tick < 420
        page.fingers[:, 1] = depth - 0.025, 0.025 - depth
        return tick > 620

    rec = run(scene, duration=6.0, real_time=True, stop=act)
    assert not rec.faults
    force = rec.finger_force[:, 0, 0]
    raw = rec.raw["thumb"]  # by the first of its fingers
    touched = np.flatnonzero(raw[:, 5] > 0.0)
    assert force[touched[-1]] == pytest.approx(0.35, rel=1e-3)
    assert np.abs(rec.finger_force[-1]).max() == 0.0  # they have given way
