"""Mouse and gamepad: events through a pipe, fingers that follow them, and no force."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
from functools import partial
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly import run_scene as whole_run
from graspfx.assembly.run_scene import run
from graspfx.certificate.plan import plan
from graspfx.devices import _inputs
from graspfx.devices._inputs import AXIS, AXIS_STATE, EVENT, GRAB, KEYS, READ, WRITE, EventPort, is_down, request
from graspfx.devices.mouse.emulator import EventWire
from graspfx.errors import DeviceError, InputError
from graspfx.testing import check_device, driver
from tests.support.hardware import LookedAtClock, VirtualClock

ABSOLUTE, RELATIVE, KEY, SYNC = 3, 2, 1, 0
LAG = 0.001  # a follower that arrives soon


def on_clock(kind: Any = "mouse", clock: VirtualClock | None = None) -> EventWire:
    return EventWire(kind, clock=clock or VirtualClock())


def connect(wire: EventWire, **settings: Any) -> Any:
    """Connect a device on the clock of its wire."""
    device = driver(wire.kind).connect(**{"lag": LAG, **wire.settings, **settings})
    device.source.now = wire.clock.now
    return device


def speeds(device: Any, count: int) -> list[float]:
    """Read every millisecond; give the speeds."""
    found = []
    for _ in range(count):
        VirtualClock.time += 0.001
        found.append(float(np.linalg.norm(device.read()[1])))
    return found


def settle(device: Any, duration: float = 0.05) -> np.ndarray:
    """Read until a follower has arrived."""
    speeds(device, round(1000 * duration))
    return device.read()[0][0].copy()


def test_requests_are_those_of_the_kernel() -> None:
    """EVIOCGABS(0), EVIOCGKEY(96) and EVIOCGRAB as <linux/input.h> makes them."""
    assert request(READ, AXIS, AXIS_STATE.size) == 0x80184540
    assert request(READ, KEYS, 96) == 0x80604518
    assert request(WRITE, GRAB, 4) == 0x40044590
    assert EVENT.size == (24 if sys.maxsize > 2**32 else 16)
    assert is_down(bytes([0, 0b10]), 9)
    assert not is_down(bytes([0, 0b10]), 8)


@pytest.mark.parametrize("kind", ["mouse", "gamepad"])
def test_they_keep_the_promises_of_a_device(kind: Any) -> None:
    with on_clock(kind, LookedAtClock()) as wire:
        report = check_device(lambda: connect(wire), wire)
    assert "the motion of a finger is read" in report.checks
    assert "open hardware is refused to a second program, and the first one continues" in report.checks
    assert (
        "a failing wire (unplugged) yields the previous sample or DeviceError, never a wrong position" in report.checks
    )
    assert not any("force" in each.promise for each in (*report.not_visible, *report.needs_person))


def test_a_mouse_goes_as_far_as_the_hand() -> None:
    """1000 counts of 1000 dpi are an inch; up is away from the user; the wheel is the third axis."""
    with on_clock() as wire, connect(wire, dimensions=3, wheel=0.002, speed=5.0) as mouse:
        mouse.open(0.001)
        wire.send((RELATIVE, 0, 1000), (RELATIVE, 1, -500), (RELATIVE, 8, 3))
        assert settle(mouse) == pytest.approx([0.0254, 0.0127, 0.006], abs=1e-9)
        wire.send((RELATIVE, 0, 10**6))
        wire.send((RELATIVE, 0, -100))
        assert settle(mouse, 0.1)[0] == pytest.approx(0.1 - 0.00254, abs=1e-9)  # from the wall back


def test_a_finger_is_no_faster_than_it_may_be() -> None:
    with on_clock() as wire, connect(wire, speed=0.5, start=[-0.1, 0.0]) as mouse:
        mouse.open(0.001)
        wire.send((RELATIVE, 0, 8000))
        assert 0.45 < max(speeds(mouse, 200)) <= 0.5


def test_reports_count_as_a_whole_and_lost_ones_not_at_all() -> None:
    with on_clock() as wire, connect(wire) as mouse:
        mouse.open(0.001)
        half = struct.pack("@llHHi", 0, 0, RELATIVE, 0, 400)
        os.write(wire._pipe, half[:7])
        assert not settle(mouse).any()
        os.write(wire._pipe, half[7:])
        assert not settle(mouse).any()  # the report has not come
        wire.send()
        assert settle(mouse)[0] == pytest.approx(0.01016, abs=1e-9)
        wire.fail("drop")
        wire.press(0)
        assert settle(mouse)[0] == pytest.approx(0.01016, abs=1e-9)
        assert mouse.switches == 1
        wire.fail("drop")
        mouse.read()
        assert mouse.switches == 0  # whether the button is down nobody knows


def test_buttons_are_switches() -> None:
    with on_clock("gamepad") as wire, connect(wire) as pad:
        pad.open(0.001)
        assert (pad.features.switches, pad.switches) == (15, 0)
        wire.press(0)
        wire.press(4)
        pad.read()
        assert pad.switches == 0b10001
        wire.press(0, down=False)
        pad.read()
        assert pad.switches == 0b10000
        pad.close()
        assert pad.switches == 0


def test_sticks_are_places() -> None:
    """From the start to the workspace's ends, both ways, without the dead part in the middle."""
    with on_clock("gamepad") as wire:
        box = [[-0.1, 0.0], [0.3, 0.2]]
        with connect(wire, workspace=box, start=[0.0, 0.05], speed=5.0) as pad:
            pad.open(0.001)
            wire.send((ABSOLUTE, 0, 32767), (ABSOLUTE, 1, 32767))
            assert settle(pad, 0.2) == pytest.approx([0.3, 0.0], abs=1e-9)
            wire.send((ABSOLUTE, 0, -32768), (ABSOLUTE, 1, -32768))
            assert settle(pad, 0.2) == pytest.approx([-0.1, 0.2], abs=1e-9)
            wire.send((ABSOLUTE, 0, 3000), (ABSOLUTE, 1, -3000))
            assert settle(pad, 0.2) == pytest.approx([0.0, 0.05], abs=1e-9)


def test_sticks_are_speeds() -> None:
    with on_clock("gamepad") as wire, connect(wire, mode="rate", speed=0.5, lag=0.01) as pad:
        pad.open(0.001)
        wire.send((ABSOLUTE, 0, 32767), (ABSOLUTE, 1, -32768))
        assert 0.45 < max(speeds(pad, 200)) <= 0.5  # also along the diagonal
        wire.send((ABSOLUTE, 0, 0), (ABSOLUTE, 1, 0))
        there = settle(pad, 0.2)
        assert (there > 0.005).all()
        assert settle(pad) == pytest.approx(there, abs=1e-6)  # it stays where it was left


def test_unplugged_is_a_fault_at_once_and_close_returns() -> None:
    with on_clock() as wire, connect(wire) as mouse:
        mouse.open(0.001)
        mouse.read()
        wire.fail("unplugged")
        with pytest.raises(DeviceError, match=r"is disconnected"):
            mouse.read()
        mouse.close()
        with pytest.raises(DeviceError, match="cannot be opened"):
            mouse.open(0.001)


def test_a_second_program_is_refused() -> None:
    text = "import sys; from graspfx.testing import driver; driver('mouse').connect(port=sys.argv[1]).open(0.001)"
    with on_clock() as wire, connect(wire) as mouse:
        mouse.open(0.001)
        other = subprocess.run([sys.executable, "-c", text, wire.settings["port"]], capture_output=True, text=True)
        assert "is taken by another program" in other.stderr
        mouse.read()


@pytest.mark.parametrize(
    ("kind", "setting", "text"),
    [
        ("mouse", {"dpi": 0.0}, "dpi"),
        ("mouse", {"workspace": [[0.0, 0.0], [0.0, 1.0]]}, "each of the first corner below"),
        ("mouse", {"start": [1.0, 0.0]}, "within the workspace"),
        ("mouse", {"dimensions": 4}, "from 1 to 3"),
        ("mouse", {"grab": 1}, "true or false"),
        ("gamepad", {"mode": "speed"}, "'position' or 'rate'"),
        ("gamepad", {"sticks": ["x"]}, "a stick for each of 2 axes"),
        ("gamepad", {"sticks": ["x", "--y"]}, "one of x, y, z, rx"),
        ("gamepad", {"dead": 1.0}, "dead"),
    ],
)
def test_settings_are_refused_by_their_names(kind: str, setting: dict[str, Any], text: str) -> None:
    with pytest.raises(InputError, match=text):
        driver(kind).connect(port="/dev/input/event0", **setting)


def test_a_ball_is_pushed_by_a_mouse(monkeypatch: pytest.MonkeyPatch) -> None:
    """A scene runs at the device's pace; the object is pushed, `check` says that no force is displayed."""
    monkeypatch.setattr(whole_run, "WallClock", VirtualClock)
    monkeypatch.setattr(_inputs, "EventPort", partial(EventPort, now=VirtualClock().now))
    with on_clock() as wire:
        scene = gx.Scene(
            dimensions=2, period=0.002, duration=0.3, engine="interpreted",
            object={
                "mass": 0.1, "viscosity": 0.8, "rotational_viscosity": 1e-3,
                "shape": {"kind": "sphere", "radius": 0.02},
            },
            coupling={"external": {"stiffness": 100.0}, "internal": {"stiffness": 100.0}},
            finger=[{
                "start": [-0.021, 0.0],
                "device": {"name": "mouse", **wire.settings, "start": [-0.021, 0.0], "speed": 0.05, "lag": 0.005},
            }],
        )  # fmt: skip
        steps = {row.step: row for row in plan(scene)}
        assert steps["display"].why.startswith("no force is displayed by finger0 (Mouse)")
        assert "private limit" not in steps

        def push() -> bool:
            wire.send((RELATIVE, 0, 10))
            return False

        rec = run(scene, real_time=True, stop=push)
        assert not rec.faults
        assert rec.finger_position[-1, 0, 0] > -0.0205
        assert rec.object_position[-1, 0] > 0.0
        assert np.abs(rec.finger_force).max() > 0.001
