"""The Haply 2DIY: golden frames, its linkage, a board that fails, and torques that stay when a program dies."""

from __future__ import annotations

import math
import os
import pty
import struct
import time

import numpy as np
import pytest

from graspfx.devices.haply_2diy.diy_frames import angles_in, setup_frame, torque_frame
from graspfx.devices.haply_2diy.five_bar import FiveBar
from graspfx.errors import DeviceError, InputError
from graspfx.protocols import QuenchableDriver, SerialPort
from graspfx.testing import driver
from graspfx.testing.wire import DiyWire

pytestmark = pytest.mark.alone

PERIOD = 0.002
PATIENT = 0.05  # for an answer: this machine may be busy


def connect(wire: DiyWire, **settings):
    return driver("haply-2diy").connect(**{"timeout": PATIENT, **wire.settings, **settings})


def read_often(device, count: int) -> None:
    for _ in range(count):
        device.read()


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


def test_positions_and_forces_are_those_of_the_handle() -> None:
    with DiyWire() as wire, connect(wire) as device:
        device.open(PERIOD)
        assert np.allclose(device.read()[0], wire.position, atol=1e-7)
        force = np.array([[0.2, -0.3]])
        device.write(force)
        device.read()  # answered: the board has acted
        assert np.allclose(wire.force, force, atol=1e-6)
        wire.place(np.array([166.0, 13.0]))
        for _ in range(40):  # longer than the window of the velocity
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
def test_a_bad_answer_holds_the_last_sample_and_the_next_one_is_asked_for(kind) -> None:
    with DiyWire() as wire, connect(wire, timeout=0.01) as device:
        device.open(PERIOD)
        place = device.read()[0].copy()
        wire.fail(kind, 0.03 if kind == "late" else None)
        times = []
        for _ in range(12):
            try:
                position, _, now = device.read()
            except DeviceError:
                break
            times.append(now)
            assert np.abs(position - place).max() < 1e-9  # never zero, never anything else
        assert len(set(times)) < len(times)
        wire.heal()
        began = time.monotonic()
        while now == times[-1] and time.monotonic() - began < 5.0:
            _, _, now = device.read()
        assert now > times[-1]


def test_a_board_that_says_nothing_is_a_fault_and_is_told_zero() -> None:
    with DiyWire() as wire, connect(wire, timeout=0.005) as device:
        device.open(PERIOD)
        device.write(np.array([[0.3, 0.0]]))
        wire.fail("drop", 1)
        with pytest.raises(DeviceError, match="no answer to 21 readings"):
            read_often(device, 50)
        time.sleep(0.02)
        assert not wire.torque.any()


def test_an_angle_that_no_link_can_have_turned_to_is_not_taken() -> None:
    with DiyWire() as wire, connect(wire) as device:
        device.open(PERIOD)
        place, _, before = device.read()
        place = place.copy()
        wire.place(np.array([100.0, 80.0]))  # 68 degrees in a sample, as a bit in a float does
        position, _, now = device.read()
        assert np.array_equal(position, place) and now == before
        wire.home()
        assert device.read()[2] > now


def test_a_cut_frame_blocks_the_board_with_its_torques_on_and_quench_takes_them_away() -> None:
    """A program dies between two bytes of a frame; the board takes what comes next for the rest of it."""
    module = driver("haply-2diy")
    assert isinstance(module, QuenchableDriver)
    with DiyWire() as wire:
        device = connect(wire)
        device.open(PERIOD)
        device.write(np.array([[0.3, 0.2]]))
        device.read()
        for cut in range(1, 10):
            device.port.send(torque_frame(5, 0.05, 0.05)[:cut])
            time.sleep(0.01)
            assert wire.torque.any()
            device.port.close()  # all that a program that dies does
            module.quench(**wire.settings)
            assert not wire.torque.any(), cut
            device.port.open()
            device.write(np.array([[0.3, 0.2]]))
            device.read()
        device.close()
        time.sleep(0.02)
        assert not wire.torque.any()


def test_a_blocked_board_keeps_its_torques_for_a_second_and_then_begins_afresh() -> None:
    with DiyWire() as wire, connect(wire) as device:
        device.open(PERIOD)
        device.write(np.array([[0.3, 0.2]]))
        device.read()
        torque, began = wire.torque, time.monotonic()
        device.port.send(torque_frame(5, 0.0, 0.0)[:7])
        while time.monotonic() - began < 0.9:
            assert np.array_equal(wire.torque, torque)
            time.sleep(0.05)
        time.sleep(0.3)
        before = device._time
        assert device.read()[2] > before and np.array_equal(wire.torque, torque)


def test_unplugged_is_a_fault_at_once_and_close_returns() -> None:
    with DiyWire() as wire, connect(wire) as device:
        device.open(PERIOD)
        wire.fail("unplugged")
        with pytest.raises(DeviceError, match="is gone"):
            device.read()
        began = time.perf_counter()
        device.close()
        assert time.perf_counter() - began < 0.1
        wire.heal()
        device.open(PERIOD)
        device.read()


def test_a_second_program_is_refused() -> None:
    with DiyWire() as wire, connect(wire) as first, connect(wire) as second:
        first.open(PERIOD)
        with pytest.raises(DeviceError, match="taken by another program"):
            second.open(PERIOD)
        with pytest.raises(DeviceError, match="taken by another program"):
            driver("haply-2diy").quench(**wire.settings)
        first.read()
        first.close()
        second.open(PERIOD)


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
    with pytest.raises(DeviceError, match="no rate of 12345 bits"):
        SerialPort(os.ttyname(slave), 12345).open()
    os.close(master)
    os.close(slave)


def test_a_board_that_is_none_does_not_open() -> None:
    master, slave = pty.openpty()
    device = driver("haply-2diy").connect(port=os.ttyname(slave))
    with pytest.raises(DeviceError, match="does not answer"):
        device.open(PERIOD)
    assert not device.port.is_open
    os.close(master)
    os.close(slave)
    with pytest.raises(DeviceError, match="does not open"):
        driver("haply-2diy").connect(port="/nowhere/port").open(PERIOD)
    with pytest.raises(DeviceError, match="no serial port"):
        driver("haply-2diy").connect(port=os.devnull).open(PERIOD)


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
