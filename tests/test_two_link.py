"""The two-link arm as a device: counts and torques by hand-worked numbers, limits, faults, reach, and the preset."""

from __future__ import annotations

import math
import re
import struct
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray

from graspfx import plugins, testing
from graspfx.errors import DeviceError, InputError
from graspfx.loop.device import SimulatedDevice
from graspfx.loop.hand import Hand
from graspfx.loop.motion import Sine

two_link: Any = plugins.load("devices", "two-link")
FloatArray = NDArray[np.float64]

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


def opened(**settings: Any) -> Any:
    device = two_link.connect(**settings)
    device.open(T)
    return device


def test_preset_figures() -> None:
    """The figures of the module's text; with a right-angled elbow M = diag(2.45196, 2.4575) g m^2, l = 0.128 m."""
    for side, x in ((LEFT, -0.025), (RIGHT, 0.025)):
        device = two_link.connect(**side)
        mirror = 1.0 if x < 0 else -1.0
        mass, friction = device.effective_mass((x, 0.0)), device.effective_friction((x, 0.0))
        np.testing.assert_allclose(mass, [[0.1503, -0.0003 * mirror], [-0.0003 * mirror, 0.1493]], atol=6e-5)
        np.testing.assert_allclose(friction, [[0.2011, -0.0001 * mirror], [-0.0001 * mirror, 0.1993]], atol=6e-5)
        for wave in np.linspace(-0.065, 0.065, 27):
            at = (x + wave, 0.0)
            masses, frictions = (np.linalg.eigvalsh(f(at)) for f in (device.effective_mass, device.effective_friction))
            assert masses.min() > 0.130
            assert masses.max() < 0.178
            assert frictions.min() > 0.169
            assert frictions.max() < 0.246
            assert np.linalg.cond(device.arm.jacobian(*device.arm.angles(*at))) < 1.21
    f = device.features
    assert f.mass == pytest.approx(math.sqrt(0.00245196 * 0.0024575) / L**2, rel=1e-12)
    assert f.friction == pytest.approx(3.28e-3 / L**2, rel=1e-12)
    assert f.resolution == pytest.approx(L * math.tau / 60000, rel=1e-12)  # 13.4 um
    assert f.peak_force == pytest.approx(0.06 * 15 / L, rel=1e-12)  # 7.03 N
    assert (f.fingers, f.dimensions, f.delay) == (1, 2, 0)
    np.testing.assert_allclose(f.workspace, [[0.04 - 0.246, -0.18 - 0.246], [0.04 + 0.246, -0.18 + 0.246]], rtol=1e-12)


@pytest.mark.parametrize(
    ("finger", "text"),
    [
        (
            (-0.04, 0.08),
            "finger at (-0.0400, 0.0800) m, 0.2600 m from the arm's base at (-0.0400, -0.1800) m: the arm works from "
            "0.0100 to 0.2460 m (links of 0.128 and 0.128 m, 0.01 m short of the stretched posture); move the finger "
            "closer to the base, or the base itself",
        ),
        (
            (-0.04, -0.175),
            "finger at (-0.0400, -0.1750) m, 0.0050 m from the arm's base at (-0.0400, -0.1800) m: the arm works from "
            "0.0100 to 0.2460 m (links of 0.128 and 0.128 m, 0.01 m short of the folded posture); move the finger "
            "away from the base, or the base itself",
        ),
    ],
)
def test_out_of_reach(finger: tuple[float, float], text: str) -> None:
    """Beyond the reach and within it: a sentence with the figures, from `place` and from `effective_mass`."""
    device = two_link.connect(**LEFT)
    plant = type(device).plant([device])
    with pytest.raises(DeviceError) as placed:
        plant.place(np.array([finger]))
    assert str(placed.value) == text
    with pytest.raises(DeviceError, match="m from the arm's base"):
        device.effective_mass(finger)


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
    board = FakeBoard(15000, 0)
    device = opened(board=board)
    assert board.calls == ["open 0.005"]
    position, velocity, _ = device.read()
    np.testing.assert_allclose(position, [[L, L]], rtol=0, atol=1e-16)
    np.testing.assert_array_equal(velocity, [[0.0, 0.0]])
    device.write(np.array([[1.0, 2.0]]))
    np.testing.assert_allclose(board.torques, [(-0.128 / 15, 0.256 / 15)], rtol=1e-14)
    board.now = 15030, 0
    position, velocity, _ = device.read()
    turn = 0.001 * math.pi
    np.testing.assert_allclose(position, [[L - L * math.sin(turn), L * math.cos(turn)]], rtol=0, atol=1e-16)
    np.testing.assert_allclose(
        velocity, [[-0.0256 * math.pi * math.cos(turn), -0.0256 * math.pi * math.sin(turn)]], rtol=1e-12
    )
    device.stop()
    assert board.torques[-1] == (0.0, 0.0)


def test_golden_values_of_an_elbow_drive() -> None:
    """The same posture: the second encoder sees -90 deg from link 1, reversed by its gear, from a zero of -45 deg on.

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


def test_counts_are_whole_and_positions_quantised() -> None:
    """Encoders round: read and true position differ by no more than half a count of each joint, l pi/60000 each."""
    device = opened(**LEFT)
    plant = type(device).plant([device])
    rng = np.random.default_rng(5)
    bound = math.hypot(L, L) * math.pi / 60000
    worst = 0.0
    for p in rng.uniform((-0.09, -0.02), (0.04, 0.02), (100, 2)):
        plant.place(p[None])
        first, second = device.board.counts()
        assert isinstance(first, int)
        a1, a2 = device.arm.angles(*p)
        assert abs(first - a1 * 60000 / math.tau) <= 0.5
        assert abs(second - a2 * 60000 / math.tau) <= 0.5
        error = np.abs(device.read()[0] - plant.position).max()
        assert error <= bound
        worst = max(worst, error)
    assert worst > bound / 4


def test_velocity_comes_from_counts() -> None:
    """Waving at up to 0.157 m/s, a count in 5 ms being 2.7 mm/s: off by less than four of them, but not by nothing.

    Read twice in a tick it is the same; after `place` it starts anew.
    """
    device = opened(**LEFT)
    plant = type(device).plant([device])
    plant.place(np.array([[-0.025, 0.0]]))
    hand = Hand([[-0.025, 0.0]], 2000.0, 40.0, motion=Sine(0.05, 0.5, (1.0, 0.0)))
    errors = []
    for _ in range(400):
        _, velocity, taken = device.read()
        assert taken == plant.time
        errors.append(np.abs(velocity - plant.velocity).max())
        again = device.read()  # within one tick: the same sample, not a standstill
        assert again[1] is velocity
        plant.advance(device.effort, hand, T)
    assert max(errors[40:]) < 2 * 2 * L * math.tau / 60000 / T
    assert np.median(errors) > 1e-5
    plant.place(np.array([[0.0, 0.0]]))
    assert device.read()[2] == 0.0
    np.testing.assert_array_equal(device.read()[1], [[0.0, 0.0]])  # no jump from where it was before


def test_delay_and_stop() -> None:
    """With a delay of two samples the third write brings the first one's torque; `stop` empties the line."""
    device = opened(**LEFT, delay=2)
    device.read()
    device.write(np.array([[1.0, 0.0]]))
    device.write(np.array([[2.0, 0.0]]))
    assert not device.effort.any()
    device.write(np.array([[3.0, 0.0]]))
    a = device.arm.angles(-0.04, -0.18 + L * math.sqrt(2.0))  # at home
    expected = device.arm.jacobian(*a).T @ [1.0, 0.0]
    np.testing.assert_allclose(device.effort[0], expected, rtol=1e-3)  # by the encoders' posture, in whole counts
    device.stop()
    assert not device.effort.any()
    device.write(np.array([[0.0, 0.0]]))
    device.write(np.array([[0.0, 0.0]]))
    assert not device.effort.any()
    assert device.features.delay == 2


def test_two_arms_do_not_know_each_other() -> None:
    """Writing to one leaves the other's torque; each runs as it does alone, to the bit."""

    def run(which: list[dict[str, Any]]) -> list[FloatArray]:
        devices = [opened(**side) for side in which]
        plants = [type(d).plant([d]) for d in devices]
        for plant in plants:
            plant.place(np.array([[0.0, 0.0]]))
        for k in range(50):
            for i, (plant, device) in enumerate(zip(plants, devices, strict=True)):
                device.read()
                device.write(np.array([[0.3 * math.sin(0.1 * k), 0.1]]) * (1 if which[i] is LEFT else -1))
                plant.advance(device.effort, Hand([[0.0, 0.0]], 50.0), T)
        return [plant.position.copy() for plant in plants]

    both = run([LEFT, RIGHT])
    np.testing.assert_array_equal(both[0], run([LEFT])[0])
    np.testing.assert_array_equal(both[1], run([RIGHT])[0])
    assert both[0][0, 0] != both[1][0, 0]


def test_a_board_that_goes() -> None:
    """OSError from the board is a DeviceError that says what; close returns with the board gone, and twice."""
    board = FakeBoard(15000, 0)
    device = opened(board=board)
    device.read()
    board.gone = True
    with pytest.raises(DeviceError, match="gives no counts: cable pulled"):
        device.read()
    with pytest.raises(DeviceError, match="takes no torques: cable pulled"):
        device.write(np.array([[1.0, 0.0]]))
    board.calls.clear()
    device.close()
    device.close()
    assert board.calls == ["torque", "close"]
    with pytest.raises(DeviceError, match=r"not open: call open\(period\) first"):
        device.read()
    with pytest.raises(DeviceError, match="does not open: cable pulled"):
        device.open(T)
    board.gone = False
    board.now = math.nan, 0
    device.open(T)
    with pytest.raises(DeviceError, match="counts nan, 0: check encoders and cables"):
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
    with pytest.raises(InputError, match=r"devices: .* simulated two-link arms"):
        type(two_link.connect()).plant([real])
    assert not isinstance(real, SimulatedDevice)
    assert isinstance(two_link.connect(), SimulatedDevice)
    assert real.features.mass is real.features.friction is real.features.delay is None
    assert real.features.resolution == pytest.approx(1.34e-5, rel=1e-3)
    with pytest.raises(InputError, match="masses and friction"):
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
        ({"joint_friction": -1.0}, "joint_friction: .* zero or more"),
        ({"link_masses": 0.0, "link_inertias": 0.0, "rotor_inertias": 0.0}, "link_masses: .* inertia in every posture"),
        ({"delay": -1}, "delay: .* whole number"),
        ({"delay": 1, "board": FakeBoard(0, 0)}, "delay: .* only a simulated arm"),
        ({"velocity_window": 0}, "velocity_window: .* 1 or more"),
        ({"velocity_window": 2.5}, "velocity_window: .* whole number"),
        ({"margin": "wide"}, "margin: .* finite"),
        ({"gear": "ab"}, "gear: .* two finite numbers"),
        ({"counts": True}, "counts: .* two finite numbers"),
    ],
)
def test_settings_that_cannot_be(settings: dict[str, Any], text: str) -> None:
    with pytest.raises(InputError, match=text):
        two_link.connect(**settings)


def test_conformance() -> None:
    testing.check_device(lambda: two_link.connect(**LEFT), start=(-0.025, 0.0))
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
    page = Path(__file__).parents[1] / "docs" / "how-to" / "real-board.md"
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
        with pytest.raises(DeviceError, match="gives no counts: 3 of 8 bytes"):
            device.read()
    zero = b"t" + struct.pack("<2f", 0.0, 0.0)
    kept = [data for data in Serial.sent if data != b"c"]
    first, second = struct.unpack("<2f", kept[1][1:])
    assert kept[0] == zero
    assert (abs(first) < 1e-9, second) == (True, pytest.approx(0.128 / 12, rel=1e-6))
    assert kept[2:] == [zero, b""]
