"""The Haply 2DIY: golden frames, its linkage, a board that fails, and torques that stay when a program dies."""

from __future__ import annotations

import math
import os
import pty
import struct
from collections.abc import Iterator

import numpy as np
import pytest

from graspfx.devices import haply_2diy
from graspfx.devices.haply_2diy import FiveBar, angles_in, setup_frame, torque_frame
from graspfx.devices.haply_2diy.emulator import DiyWire
from graspfx.errors import DeviceError, InputError
from graspfx.protocols import QuenchableDriver, SerialPort
from graspfx.testing import driver
from tests.support.hardware import Line, VirtualClock

PERIOD = 0.002


@pytest.fixture
def wire(monkeypatch: pytest.MonkeyPatch) -> Iterator[DiyWire]:
    """A board on a clock of its own, to which every port leads."""
    with DiyWire(clock=VirtualClock()) as board:
        monkeypatch.setattr(haply_2diy, "SerialPort", lambda path: Line(board))
        yield board


def connect(wire: DiyWire, **settings):
    return driver("haply-2diy").connect(**{"timeout": 0.001, **wire.settings, **settings})


def read_often(device, count: int) -> list[float]:
    """Read once a period; give the times."""
    times = []
    for _ in range(count):
        device.port.sleep(PERIOD)
        times.append(device.read()[2])
    return times


def test_golden_frames() -> None:
    setup = "01 05 03 01 01 03 01 01 00 00 00 00 40 41 00 80 98 45 00 00 28 43 00 80 98 45"
    assert setup_frame(5, (168.0, 12.0), 4880).hex(" ") == setup
    (torque,) = struct.unpack("<f", bytes.fromhex("c7 03 62 3b"))
    assert torque == pytest.approx(0.0034487, rel=1e-5)
    assert torque_frame(5, torque, -torque).hex(" ") == "02 05 c7 03 62 bb c7 03 62 3b"
    answer = bytes.fromhex("05 00 00 40 41 00 00 28 43")
    assert angles_in(answer, 5) == (168.0, 12.0)
    assert angles_in(answer, 4) is None and angles_in(answer[:-1], 5) is None and angles_in(answer + b"\0", 5) is None
    assert angles_in(bytes.fromhex("05 00 00 c0 7f 00 00 28 43"), 5) is None  # a number that is none


@pytest.mark.parametrize("distance", [0.0, 0.02, 0.038])
def test_the_linkage_closes_and_its_jacobian_is_its_derivative(distance: float) -> None:
    linkage = FiveBar((0.07, 0.09), distance, 0.005)
    rng = np.random.default_rng(0)
    for _ in range(50):
        q = np.radians(rng.uniform((110.0, 20.0), (150.0, 70.0)))
        (x, y), J = linkage.handle(*q)
        for side, angle in ((-0.5, q[0]), (0.5, q[1])):
            tip = side * distance + 0.07 * math.cos(angle), 0.07 * math.sin(angle)
            assert math.hypot(x - tip[0], y - tip[1]) == pytest.approx(0.09, abs=1e-15)
        h = 1e-6
        for j, step in enumerate(h * np.eye(2)):
            slope = (np.array(linkage.handle(*(q + step))[0]) - linkage.handle(*(q - step))[0]) / (2.0 * h)
            assert np.allclose(J[:, j], slope, atol=1e-8)
    with pytest.raises(DeviceError, match="end of its reach"):
        FiveBar((0.09, 0.07), distance, 0.005).handle(math.pi, 0.0)


def test_positions_and_forces_are_those_of_the_handle(wire: DiyWire) -> None:
    with connect(wire) as device:
        device.open(PERIOD)
        assert np.allclose(device.read()[0], wire.position, atol=1e-7)
        force = np.array([[0.2, -0.3]])
        device.write(force)
        device.read()  # answered: the board has acted
        assert np.allclose(wire.force, force, atol=1e-6)
        wire.place(np.array([166.0, 13.0]))
        read_often(device, 40)  # longer than the window of the velocity
        position, velocity, _ = device.read()
        assert np.allclose(position, wire.position, atol=1e-7) and not velocity.any()
        device.write(1e3 * force)
        device.read()
        assert np.abs(wire.torque).max() == pytest.approx(0.1)
        ratio = wire.force / force
        assert ratio[0, 0] == pytest.approx(ratio[0, 1], rel=1e-5) and ratio[0, 0] > 1.0
        norm = np.linalg.norm(wire.force)
        assert norm >= device.largest_force[0] * (1.0 - 1e-6)
        with pytest.raises(DeviceError, match="cannot be displayed"):
            device.write(np.array([[np.nan, 0.0]]))
        device.read()
        assert not wire.torque.any()


def test_an_answer_to_the_last_close_is_not_the_first_sample(wire: DiyWire) -> None:
    with connect(wire) as device:
        device.open(PERIOD)
        wire.place(np.array([166.0, 13.0]))
        read_often(device, 10)
        wire.fail("late", 0.0008)
        device.write(np.zeros((1, 2)))
        device.port.sleep(0.0004)
        device.close()
        wire.heal()
        device.open(PERIOD)  # the board takes it that the handle is at home
        assert np.allclose(np.degrees(device.raw), (168.0, 12.0), atol=1e-4)


def test_a_frame_leaves_in_one_piece() -> None:
    """A board that waits for the rest of a frame holds its torques for a second: each frame is one `write`."""
    master, slave = pty.openpty()
    port = SerialPort(os.ttyname(slave))
    sizes, write = [], os.write

    def count(descriptor: int, data: bytes) -> int:
        sizes.append(len(data))
        return write(descriptor, data)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "write", count)
        port.open()
        port.send(torque_frame(5, 0.1, 0.1))
        port.send(setup_frame(5, (168.0, 12.0), 4880))
    assert sizes == [10, 26]
    port.close()
    os.close(master)
    os.close(slave)


@pytest.mark.parametrize("kind", ["drop", "cut", "garbage", "wrong-id", "late"])
def test_a_bad_answer_holds_the_last_sample_and_the_next_one_is_asked_for(wire: DiyWire, kind) -> None:
    with connect(wire) as device:
        device.open(PERIOD)
        read_often(device, 1)
        place, _, before = device.read()
        place = place.copy()
        wire.fail(kind, 0.003 if kind == "late" else None)
        times = [before]
        for _ in range(12):
            device.port.sleep(PERIOD)
            position, _, now = device.read()
            times.append(now)
            assert np.abs(position - place).max() < 1e-9  # never zero, never anything else
        assert len(set(times)) < len(times) and times == sorted(times)
        wire.heal()
        assert read_often(device, 2)[-1] > times[-1]


def test_a_board_that_says_nothing_is_a_fault_and_is_told_zero(wire: DiyWire) -> None:
    with connect(wire) as device:
        device.open(PERIOD)
        device.write(np.array([[0.3, 0.0]]))
        wire.fail("drop", 1)
        read_often(device, 20)
        assert wire.torque.any()
        with pytest.raises(DeviceError, match="did not answer 21 readings"):
            read_often(device, 1)
        assert not wire.torque.any()


def test_an_angle_that_no_link_can_have_turned_to_is_not_taken(wire: DiyWire) -> None:
    with connect(wire) as device:
        device.open(PERIOD)
        place, _, before = device.read()
        place = place.copy()
        wire.place(np.array([100.0, 80.0]))  # 68 degrees in a sample, as a bit in a float does
        (now,) = read_often(device, 1)
        assert np.array_equal(device.read()[0], place) and now == before
        wire.home()
        assert read_often(device, 1)[0] > now


@pytest.mark.parametrize("period", [0.0005, 0.001])
def test_flipped_bits_move_the_handle_no_further_than_a_hand_does(
    wire: DiyWire, monkeypatch: pytest.MonkeyPatch, period: float
) -> None:
    """The line has no checksum: every bit of an answer is changed once, at rest and on the way at 0.5 m/s.

    A link is accelerated by 5000 rad/s^2 at most, so that a bit moves the handle by
    0.12 (5000 T^2 + 4 counts) at most, with 0.12 m of lever. Without that bound it was 2.3 mm at 1 ms.
    """
    answers, bit = Line.receive, [-1]

    def receive(line: Line, deadline: float) -> bytes:
        data = bytearray(answers(line, deadline))
        if bit[0] >= 0 and len(data) == 9:
            data[bit[0] // 8] ^= 1 << bit[0] % 8
        return bytes(data)

    monkeypatch.setattr(Line, "receive", receive)
    taken = worst = 0.0
    with connect(wire) as device:
        device.open(period)
        for speed in (0.0, 7.0):  # [rad/s]
            for k in range(4 * 72):
                turned = math.degrees(0.1 * (1.0 - math.cos(speed / 0.1 * k * period)))
                wire.place(np.array([168.0 - turned, 12.0 + turned]))
                bit[0] = k // 4 if k % 4 == 0 else -1
                device.port.sleep(period)
                before = device._time
                position = device.read()[0].copy()
                if bit[0] >= 0 and device._time > before:
                    taken += 1
                    worst = max(worst, float(np.linalg.norm(position - wire.position)))
    assert taken > 0
    assert worst < 0.12 * (5000.0 * period**2 + 4.0 * math.tau / 4880)


def test_a_cut_frame_blocks_the_board_with_its_torques_on_and_quench_takes_them_away(wire: DiyWire) -> None:
    """A program dies between two bytes of a frame; the board takes what comes next for the rest of it."""
    module = driver("haply-2diy")
    assert isinstance(module, QuenchableDriver)
    device = connect(wire)
    device.open(PERIOD)
    device.write(np.array([[0.3, 0.2]]))
    for cut in range(1, 10):
        device.port.send(torque_frame(5, 0.05, 0.05)[:cut])
        device.port.sleep(0.01)
        assert wire.torque.any()
        device.port.close()  # all that a program that dies does
        module.quench(**wire.settings)
        assert not wire.torque.any(), cut
        device.port.open()
        device.write(np.array([[0.3, 0.2]]))
    device.close()
    assert not wire.torque.any()


def test_a_blocked_board_keeps_its_torques_for_a_second_and_then_begins_afresh(wire: DiyWire) -> None:
    with connect(wire) as device:
        device.open(PERIOD)
        device.write(np.array([[0.3, 0.2]]))
        torque = wire.torque
        device.port.send(torque_frame(5, 0.0, 0.0)[:7])
        for _ in range(19):
            device.port.sleep(0.05)
            assert np.array_equal(wire.torque, torque)
        assert wire.exchange(b"") == b""
        device.port.sleep(0.06)
        before = device._time
        assert device.read()[2] > before and np.array_equal(wire.torque, torque)


def test_a_port_is_closed_to_programs_without_the_lock() -> None:
    """TIOCEXCL is set, which refuses every other `open` that is not root's."""
    fcntl, termios = pytest.importorskip("fcntl"), pytest.importorskip("termios")
    master, slave = pty.openpty()
    port = SerialPort(os.ttyname(slave))
    exclusive = getattr(termios, "TIOCGEXCL", 0x80045440)
    states = []
    port.open()
    states.append(fcntl.ioctl(slave, exclusive, b"\0" * 4) != b"\0" * 4)
    port.close()
    states.append(fcntl.ioctl(slave, exclusive, b"\0" * 4) != b"\0" * 4)
    os.close(master)
    os.close(slave)
    assert states == [True, False]


def test_the_rate_of_a_port_is_set() -> None:
    termios = pytest.importorskip("termios")
    master, slave = pty.openpty()
    for baud in (9600, 115200):
        port = SerialPort(os.ttyname(slave), baud)
        port.open()
        assert termios.tcgetattr(slave)[4:6] == [getattr(termios, f"B{baud}")] * 2
        port.close()
    with pytest.raises(DeviceError, match="does not support 12345 bit/s"):
        SerialPort(os.ttyname(slave), 12345).open()
    os.close(master)
    os.close(slave)


def test_a_board_that_is_none_does_not_open(wire: DiyWire) -> None:
    device = connect(wire)
    wire.fail("blocked")
    with pytest.raises(DeviceError, match="does not answer"):
        device.open(PERIOD)
    assert not device.port.is_open
    with pytest.raises(DeviceError, match="does not answer: disconnect its power"):
        driver("haply-2diy").quench(**wire.settings)


@pytest.mark.parametrize(("port", "text"), [("/nowhere/port", "cannot be opened"), (os.devnull, "not a serial port")])
def test_a_port_that_is_none_does_not_open(port: str, text: str) -> None:
    with pytest.raises(DeviceError, match=text):
        driver("haply-2diy").connect(port=port).open(PERIOD)


def test_settings_are_refused_by_name() -> None:
    for settings, name in (
        ({"port": ""}, "port"),
        ({"port": "x", "torque_limit": 1.0}, "torque_limit"),
        ({"port": "x", "links": (0.09, 0.07)}, "home"),
        ({"port": "x", "device": 300}, "device"),
        ({"port": "x", "margin": 1.0}, "margin"),
        ({"port": "x", "links": (0.07,)}, "links"),
        ({"port": "x", "velocity_window": 0}, "velocity_window"),
    ):
        with pytest.raises(InputError) as error:
            driver("haply-2diy").connect(**settings)
        assert error.value.name == name
