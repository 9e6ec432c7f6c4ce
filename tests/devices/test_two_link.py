"""The two-link arm before a board: counts and torques by hand-worked numbers, limits, faults, and settings."""

from __future__ import annotations

import math
import re
import struct
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from graspfx import plugins, testing
from graspfx.errors import DeviceError, InputError
from graspfx.loop.device import SimulatedDevice

two_link: Any = plugins.load("devices", "two-link")

T = 0.005
L = 0.128
LEFT: dict[str, Any] = {"base": (-0.04, -0.18), "elbow": "left"}
RIGHT: dict[str, Any] = {"base": (0.04, -0.18), "elbow": "right"}


class FakeBoard:
    """Counts that a test sets; every call written down."""

    def __init__(self, *counts: int) -> None:
        self.now: tuple[float, ...] = counts
        self.torques: list[tuple[float, float]] = []
        self.calls: list[str] = []
        self.gone = False

    def open(self, period: float) -> None:
        self._live(f"open {period}")

    def counts(self) -> Any:
        self._live("counts")
        return self.now

    def torque(self, first: float, second: float) -> None:
        self._live("torque")
        self.torques.append((first, second))

    def close(self) -> None:
        self._live("close")

    def _live(self, call: str) -> None:
        self.calls.append(call)
        if self.gone:
            raise OSError("cable pulled")


class ClockedBoard(FakeBoard):
    """One that tells the times of its counts, set by a test."""

    time = 0.0


def opened(**settings: Any) -> Any:
    device = two_link.connect(**settings)
    device.open(T)
    return device


def test_velocity_is_by_the_true_interval() -> None:
    """30 counts more in 5 ms are 0.2 pi rad/s, in 10 ms half of it; without a new time the last sample stands."""
    board = ClockedBoard(15000, 0)
    device = opened(board=board)
    device.read()
    speeds = []
    for counts, time_of_counts in ((15030, T), (15060, 3.0 * T), (15990, 3.0 * T)):
        board.now, board.time = (counts, 0), time_of_counts
        position, velocity, told = device.read()
        speeds.append(float(np.linalg.norm(velocity)))
        assert told == time_of_counts
    assert speeds[0] == pytest.approx(0.0256 * math.pi, rel=1e-12)
    assert speeds[1] == pytest.approx(0.5 * speeds[0], rel=1e-12)
    assert speeds[2] == speeds[1]
    assert device.raw.tolist() == [15060, 0]
    angle = 60 * math.tau / 60000
    np.testing.assert_allclose(position, [[L - L * math.sin(angle), L * math.cos(angle)]], rtol=0, atol=1e-16)


def test_velocity_without_a_clock_of_the_board() -> None:
    """A board that tells no times is read at the host's: 300 counts, 0.0314 rad, over the time between two calls."""
    board = FakeBoard(15000, 0)
    device = opened(board=board)
    _, _, first = device.read()
    time.sleep(0.02)
    board.now = 15300, 0
    _, velocity, second = device.read()
    assert second - first >= 0.02
    assert float(np.linalg.norm(velocity)) == pytest.approx(L * 300 * math.tau / 60000 / (second - first), rel=1e-9)


def test_read_out_of_reach() -> None:
    """Links 0.01 rad from one line: 0.256 cos 0.005 = 0.2560 m from the base; folded, 0.256 sin 0.005 = 0.0013 m."""
    straight = round(0.01 * 60000 / math.tau)
    stretched = opened(board=FakeBoard(straight, 0))
    with pytest.raises(DeviceError, match=r"0\.2560 m from .* stretched posture.*closer to the base"):
        stretched.read()
    folded = opened(board=FakeBoard(30000 - straight, 0))
    with pytest.raises(DeviceError, match=r"0\.0013 m from .* folded posture.*away from the base"):
        folded.read()


def test_elbow_on_the_other_side() -> None:
    """Link 1 along x, link 2 along y: the elbow is to the right of the line to the finger."""
    assert opened(elbow="right", board=FakeBoard(0, 15000)).read()[0] == pytest.approx(np.array([[L, L]]))
    with pytest.raises(DeviceError, match=r"is on the right, expected on the left: .* `zero`"):
        opened(elbow="left", board=FakeBoard(0, 15000)).read()


def test_golden_values() -> None:
    """Worked by hand: 60 000 counts a turn; link 1 along y, link 2 along x; p = (l, l), J = [[-l, 0], [0, l]].

    f = (1, 2) N: J'f = (-0.128, 0.256) N m at the joints, a fifteenth at the motors. 30 counts more on encoder 1 in
    5 ms are 2 pi 30/60000/0.005 = 0.2 pi rad/s and turn link 1 by 0.001 pi: v = -0.0256 pi (cos, sin)(0.001 pi).
    """
    board = ClockedBoard(15000, 0)
    device = opened(board=board)
    assert board.calls == ["open 0.005"]
    position, velocity, _ = device.read()
    np.testing.assert_allclose(position, [[L, L]], rtol=0, atol=1e-16)
    np.testing.assert_array_equal(velocity, [[0.0, 0.0]])
    device.write(np.array([[1.0, 2.0]]))
    np.testing.assert_allclose(board.torques, [(-0.128 / 15, 0.256 / 15)], rtol=1e-14)
    board.now, board.time = (15030, 0), T
    position, velocity, _ = device.read()
    turn = 0.001 * math.pi
    np.testing.assert_allclose(position, [[L - L * math.sin(turn), L * math.cos(turn)]], rtol=0, atol=1e-16)
    np.testing.assert_allclose(
        velocity, [[-0.0256 * math.pi * math.cos(turn), -0.0256 * math.pi * math.sin(turn)]], rtol=1e-12
    )
    device.stop()
    assert board.torques[-1] == (0.0, 0.0)


def test_golden_values_of_an_elbow_drive() -> None:
    """The second encoder sees -90 deg from link 1 in that posture, reversed by its gear, from a zero of -45 deg on.

    -45 deg are +7500 counts through a gear of -15. Joint 1 turns both links: tau = ((-l, l) . f, (0, l) . f)
    = (0.128, 0.256) N m.
    """
    board = FakeBoard(15000, 7500)
    device = opened(board=board, drive="elbow", gear=(15.0, -15.0), zero=(0.0, -math.pi / 4))
    np.testing.assert_allclose(device.read()[0], [[L, L]], rtol=0, atol=1e-16)
    device.write(np.array([[1.0, 2.0]]))
    np.testing.assert_allclose(board.torques, [(0.128 / 15, -0.256 / 15)], rtol=1e-14)


def test_torque_limit_keeps_the_direction() -> None:
    """10 times too much at motor 2 (0.6 for 0.06 N m): both torques a tenth; just below the limit nothing changes."""
    board = FakeBoard(15000, 0)
    device = opened(board=board)
    device.read()
    device.write(np.array([[20.0, 0.6 * 15 / L]]))
    np.testing.assert_allclose(board.torques[-1], (-20.0 * L / 150, 0.06), rtol=1e-13)
    device.write(np.array([[0.0, 0.0599 * 15 / L]]))
    np.testing.assert_allclose(board.torques[-1], (0.0, 0.0599), rtol=1e-13, atol=1e-16)
    rng = np.random.default_rng(4)
    board.now = 13000, -3000
    device.read()
    a1, a2 = 13000 * math.tau / 60000, -3000 * math.tau / 60000
    for f in rng.normal(0.0, 1e3, (200, 2)):
        device.write(f[None])
        torque = np.array(board.torques[-1])
        assert np.abs(torque).max() <= 0.06
        shown = np.linalg.solve(device.arm.jacobian(a1, a2).T, 15.0 * torque)
        assert shown @ f / np.linalg.norm(shown) / np.linalg.norm(f) == pytest.approx(1.0, abs=1e-12)
    device.write(np.array([[1e300, -1e300]]))
    assert np.abs(board.torques[-1]).max() == pytest.approx(0.06, rel=1e-15)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_forces_that_are_not_finite(bad: float) -> None:
    board = FakeBoard(15000, 0)
    device = opened(board=board)
    device.read()
    device.write(np.array([[1.0, 1.0]]))
    for f in ((bad, 0.0), (0.0, bad), (bad, bad)):
        with pytest.raises(DeviceError, match="cannot be displayed: the arm's motors are at zero torque"):
            device.write(np.array([f]))
        assert board.torques[-1] == (0.0, 0.0)


def test_a_board_that_goes() -> None:
    """OSError from the board is a DeviceError that says what; close returns with the board gone, and twice."""
    board = FakeBoard(15000, 0)
    device = opened(board=board)
    device.read()
    board.gone = True
    with pytest.raises(DeviceError, match="returns no counts: cable pulled"):
        device.read()
    with pytest.raises(DeviceError, match="accepts no torques: cable pulled"):
        device.write(np.array([[1.0, 0.0]]))
    board.calls.clear()
    device.close()
    device.close()
    assert board.calls == ["torque", "close"]
    with pytest.raises(DeviceError, match=r"not open: call open\(period\) first"):
        device.read()
    with pytest.raises(DeviceError, match="cannot be opened: cable pulled"):
        device.open(T)
    board.gone = False
    board.now = math.nan, 0
    device.open(T)
    with pytest.raises(DeviceError, match="returned the counts nan, 0: check encoders and cables"):
        device.read()


def test_a_context_closes_with_zero_torque() -> None:
    board = FakeBoard(15000, 0)
    device = two_link.connect(board=board)

    def session() -> None:
        with device:
            device.open(T)
            device.read()
            device.write(np.array([[1.0, 0.0]]))
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        session()
    assert board.torques[0] != (0.0, 0.0)
    assert board.torques[-1] == (0.0, 0.0)
    assert board.calls[-1] == "close"


def test_a_real_arm_is_not_a_simulated_one() -> None:
    """A board of one's own makes a device that no plant moves, and whose mass is unknown until all of it is given."""
    board = FakeBoard(15000, 0)
    real = two_link.connect(board=board)
    with pytest.raises(InputError, match=r"devices: .* simulated two-link arm"):
        type(two_link.connect()).plant([real])
    assert not isinstance(real, SimulatedDevice)
    assert isinstance(two_link.connect(), SimulatedDevice)
    assert real.features.mass is real.features.friction is real.features.delay is None
    assert real.features.resolution == pytest.approx(1.34e-5, rel=1e-3)
    with pytest.raises(InputError, match="masses and damping"):
        real.effective_mass((0.1, 0.1))
    known = two_link.connect(board=board, **two_link.PRESET)
    assert known.features.mass == pytest.approx(0.1498, abs=1e-4)
    assert board.calls == []


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"links": (0.1, -0.1)}, "links: .* above zero"),
        ({"links": (0.1, 0.1, 0.1)}, "links: .* two finite numbers"),
        ({"base": (math.nan, 0.0)}, "base: .* two finite numbers"),
        ({"elbow": "up"}, 'elbow: .* "left" or "right"'),
        ({"drive": "belt"}, 'drive: .* "base" or "elbow"'),
        ({"margin": 0.2}, "margin: .* the shorter link, 0.128 m"),
        ({"gear": (15.0, 0.0)}, "gear: .* other than zero"),
        ({"counts": 0}, "counts: .* above zero"),
        ({"torque_limit": math.inf}, "torque_limit: .* two finite numbers"),
        ({"joint_damping": -1.0}, "joint_damping: .* zero or more"),
        ({"link_masses": 0.0, "link_inertias": 0.0, "rotor_inertias": 0.0}, "link_masses: .* in every posture"),
        ({"delay": -1}, "delay: .* an integer from"),
        ({"delay": 1, "board": FakeBoard(0, 0)}, "delay: .* only a simulated arm"),
        ({"velocity_window": 0}, "velocity_window: .* an integer from 1 to"),
        ({"velocity_window": 2.5}, "velocity_window: .* an integer from"),
        ({"margin": "wide"}, "margin: .* finite"),
        ({"margin": (0.01, 0.02)}, "margin: .* a finite length"),
        ({"gear": "ab"}, "gear: .* two finite numbers"),
        ({"counts": True}, "counts: .* two finite numbers"),
    ],
)
def test_settings_that_cannot_be(settings: dict[str, Any], text: str) -> None:
    with pytest.raises(InputError, match=text):
        two_link.connect(**settings)


def test_conformance() -> None:
    """Efforts are torques: the report does not say that newtons were seen."""
    report = testing.check_device(lambda: two_link.connect(**LEFT), start=(-0.025, 0.0))
    assert any("in newtons" in each.promise for each in report.not_visible)
    testing.check_device(lambda: two_link.connect(**RIGHT, delay=1, drive="elbow"), start=(0.025, 0.0))
    testing.check_device(lambda: two_link.connect(board=FakeBoard(15000, 0)))


def test_write_wants_one_finger() -> None:
    device = opened(**LEFT)
    with pytest.raises(InputError, match=r"forces: .* shape \(1, 2\)"):
        device.write(np.zeros((2, 2)))


def test_the_driver_of_the_how_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The page's driver, from its text: loaded by path, asked for counts and given torques in the bytes that it states.

    Gear 12: 12000 counts of 48000 are a quarter turn; 1 N along y is 0.128/12 N m at motor 2.
    """
    page = Path(__file__).parents[2] / "docs" / "how-to" / "device.md"
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    (driver,) = [block for block in blocks if not block.startswith(">>>")]
    (tmp_path / "our_arm.py").write_text(driver, encoding="utf-8")

    class Serial:
        sent: ClassVar[list[bytes]] = []
        answer = struct.pack("<2i", 12000, 0)

        def __init__(self, port: str, timeout: float) -> None:
            assert (port, timeout) == ("/dev/ttyACM0", 0.001)

        def write(self, data: bytes) -> None:
            self.sent.append(data)

        def read(self, size: int) -> bytes:
            return self.answer[:size]

        def close(self) -> None:
            self.sent.append(b"")

    monkeypatch.setitem(sys.modules, "serial", SimpleNamespace(Serial=Serial))
    module = plugins.load("devices", "our_arm.py", tmp_path)
    with module.connect(port="/dev/ttyACM0", base=(0.0, 0.0), elbow="left") as device:
        device.open(T)
        np.testing.assert_allclose(device.read()[0], [[L, L]], rtol=0, atol=1e-16)
        device.write(np.array([[0.0, 1.0]]))
        Serial.answer = b"\x00" * 3
        with pytest.raises(DeviceError, match="returns no counts: 3 of 8 bytes"):
            device.read()
    zero = b"t" + struct.pack("<2f", 0.0, 0.0)
    kept = [data for data in Serial.sent if data != b"c"]
    first, second = struct.unpack("<2f", kept[1][1:])
    assert kept[0] == zero
    assert (abs(first) < 1e-9, second) == (True, pytest.approx(0.128 / 12, rel=1e-6))
    assert kept[2:] == [zero, b""]
