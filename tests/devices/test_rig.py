"""The rig: golden frames, its firmware on this machine, its faults, and one program at a time."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from shutil import which
from typing import Any

import numpy as np
import pytest

from graspfx.devices import rig
from graspfx.devices.rig import controller
from graspfx.devices.rig.controller import (
    FAULTS,
    Controller,
    Kind,
    Mode,
    framed,
    long_frame,
    run_frame,
    short_frame,
    state_in,
    unframed,
)
from graspfx.devices.rig.emulator import RigWire
from graspfx.devices.two_link import connect as two_link
from graspfx.errors import DeviceError, InputError
from graspfx.protocols import AskedDevice, LimitedDevice, QuenchableDriver, SpringHand
from graspfx.testing import driver
from graspfx.testing.wire import STRICT, compiler
from tests.support.hardware import Line, VirtualClock
from tests.support.rooms import ROOT

FIRMWARE = ROOT / "devices" / "rig" / "firmware"
PERIOD = 0.001
SLOW = 4.0  # a watchdog of 20 ms, for a line that loses many commands

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")

GOLDEN = {
    "02 01 01 07 78 56 34 12 55 99 00": long_frame(Kind.HELLO, 0x12345678),
    "02 02 01 07 78 56 34 12 d7 41 00": long_frame(Kind.ARM, 0x12345678),
    "02 03 01 03 cc 95 00": short_frame(Kind.STOP),
    "03 11 07 03 58 21 00": short_frame(Kind.POLL, 7),
    "03 10 01 07 78 56 34 12 e8 03 01 05 18 fc ff ff 01 01 01 01 01 01 01 03 6f c7 00": run_frame(
        1, 0x12345678, (0.001, -0.001, 0.0, 0.0)
    ),
}


@pytest.mark.parametrize("golden", GOLDEN)
def test_golden_frames(golden: str) -> None:
    frame = GOLDEN[golden]
    assert frame.hex(" ") == golden
    assert 0 not in frame[:-1]


def test_frames_come_back_and_damage_is_seen() -> None:
    rng = np.random.default_rng(1)
    for size in range(3, 60):
        message = rng.integers(0, 3, size, dtype=np.uint8).tobytes()
        frame = framed(message)[:-1]
        assert unframed(frame) == message
        for cut in range(len(frame)):
            assert unframed(frame[:cut]) is None
        for bit in range(8 * len(frame)):
            damaged = bytearray(frame)
            damaged[bit // 8] ^= 1 << bit % 8
            assert b"\0" in damaged or unframed(bytes(damaged)) is None
    assert controller.binascii.crc_hqx(b"123456789", 0xFFFF) == 0x29B1  # the check value of CRC-16/CCITT-FALSE


@needs_compiler
def test_the_firmware_builds_without_a_warning_and_without_a_library(tmp_path: Path) -> None:
    program = str(compiler())
    alone = [program, *STRICT, "-ffreestanding", "-c", "rig.c", "-o", str(tmp_path / "rig.o")]
    whole = [program, *STRICT, "host.c", "rig.c", "-lm", "-o", str(tmp_path / "host")]
    for call in (alone, whole):
        answer = subprocess.run(call, cwd=FIRMWARE, capture_output=True, text=True, check=False)
        assert (answer.returncode, answer.stderr) == (0, "")


BOARD = """
#pragma once
#include <stddef.h>
#include <stdint.h>
enum { LOW, HIGH, OUTPUT, INPUT_PULLUP };
uint32_t micros();
void pinMode(int pin, int mode);
void digitalWrite(int pin, int level);
int digitalRead(int pin);
void digitalToggle(int pin);
void analogWrite(int pin, int value);
void analogWriteResolution(int bits);
void analogWriteFrequency(int pin, float hertz);
template <class T> T constrain(T x, T low, T high) { return x < low ? low : x > high ? high : x; }
struct Port {
    void begin(long baud);
    int available();
    int availableForWrite();
    int read();
    size_t write(const uint8_t *bytes, size_t count);
    void send_now();
};
extern Port Serial;
"""
ENCODER = """
#pragma once
#include <stdint.h>
struct QuadEncoder {
    QuadEncoder(int channel, int a, int b);
    void setInitConfig();
    void init();
    int32_t read();
};
"""


@pytest.mark.skipif(which("g++") is None, reason="no compiler of C++")
def test_the_port_to_the_teensy_is_whole_but_for_its_libraries(tmp_path: Path) -> None:
    """Its board's own functions are stood in for by their declarations: it says what rig.h asks for, and no more."""
    (tmp_path / "board.h").write_text(BOARD)
    (tmp_path / "QuadEncoder.h").write_text(ENCODER)
    call = [
        "g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-I", str(tmp_path), "-I", str(FIRMWARE),
        "-include", "board.h", "-x", "c++", "teensy/teensy.ino",
    ]  # fmt: skip
    answer = subprocess.run(call, cwd=FIRMWARE, capture_output=True, text=True, check=False)
    assert (answer.returncode, answer.stderr) == (0, "")


@needs_compiler
def test_arms_of_the_emulator_move_as_the_simulated_ones_do(tmp_path: Path) -> None:
    """Two arms under constant torques for 0.1 s: host.c steps by 10 us, so 1e-4 rad of difference at most."""
    call = [str(compiler()), *STRICT, "host.c", "rig.c", "-lm", "-o", str(tmp_path / "host")]
    subprocess.run(call, cwd=FIRMWARE, check=True)
    torques = [0.01, -0.004, -0.006, 0.01]
    answer = subprocess.run(
        [tmp_path / "host", "--motion", *map(str, torques), "0.1"], capture_output=True, text=True, check=True
    )
    motion = [float(line.split()[0]) for line in answer.stdout.splitlines()]
    for i, (elbow, start) in enumerate((("left", (2.2, 0.7)), ("right", (0.9, 2.4)))):
        device = two_link(elbow=elbow)
        plant = type(device).plant([device])
        place = np.array([device.arm.tip(*start)])
        plant.place(place)
        for _ in range(1000):
            plant.advance(15.0 * np.array([torques[2 * i : 2 * i + 2]]), SpringHand(place, 0.0, 0.0), 1e-4)
        assert np.allclose(motion[2 * i : 2 * i + 2], list(plant.angles(i if i < 1 else 0))[:2], atol=1e-4)


@pytest.fixture
def wire(monkeypatch: pytest.MonkeyPatch) -> Iterator[RigWire]:
    """The controller on a clock of its own, to which every port leads."""
    if compiler() is None:
        pytest.skip("no C compiler")
    monkeypatch.setattr(VirtualClock, "time", 1000.0)  # whatever other tests have waited
    with RigWire(clock=VirtualClock()) as board:
        monkeypatch.setattr(rig, "SerialPort", lambda path: Line(board))
        yield board


@pytest.fixture
def device(wire: RigWire) -> Iterator[Any]:
    with driver("rig").connect(**wire.settings) as opened:
        opened.open(PERIOD)
        yield opened


def tick(device, force: Any = None, count: int = 1) -> Any:
    """Run samples as the servo does; give the last reading."""
    for _ in range(count):
        device.controller.port.sleep(PERIOD)
        device.ask()
        reading = device.read()
        if force is not None:
            device.write(np.full((2, 2), 1.0) * force)
    return reading


def test_positions_and_forces_are_those_of_the_arms(wire: RigWire, device) -> None:
    assert all(isinstance(device, kind) for kind in (AskedDevice, LimitedDevice))
    forces = np.array([[0.4, -0.3], [-0.2, 0.5]])
    position, velocity, _ = tick(device, forces, 300)  # until the hands hold still
    assert np.abs(position - wire.position).max() < 2.0 * device.features.resolution
    assert np.abs(velocity).max() < 0.05
    assert np.abs(wire.force - forces).max() < 0.002  # of a micronewton metre, and the time since the reading
    tick(device, 100.0 * forces)
    assert np.abs(wire.torque).max() == wire.limit
    ratio = wire.force / forces
    assert np.abs(ratio - ratio[:, :1]).max() < 0.05 * np.abs(ratio).max()  # in their own directions
    device.close()
    assert not wire.torque.any() and not wire.page.enabled


def test_a_force_that_is_not_finite_stops_both_arms(wire: RigWire, device) -> None:
    tick(device, 0.2)
    assert wire.torque.any()
    with pytest.raises(DeviceError, match="cannot be displayed"):
        device.write(np.array([[0.2, 0.2], [np.nan, 0.0]]))
    assert not wire.torque.any()


@pytest.mark.parametrize("health", [3, 4, 5])
def test_a_fault_of_the_controller_is_told_in_words(wire: RigWire, device, health: int) -> None:
    tick(device, 0.2)
    wire.page.health = health
    with pytest.raises(DeviceError, match=FAULTS[health].partition(":")[0]):
        tick(device)
    assert wire.page.state == Mode.FAULT
    assert not wire.torque.any() and not wire.page.enabled
    device.close()
    with pytest.raises(DeviceError, match="does not arm"):
        device.open(PERIOD)


def test_a_joint_that_turns_too_fast_switches_the_motors_off(wire: RigWire, device) -> None:
    tick(device, 0.2)
    wire.page.rest[0] += 2.0  # a hand that jerks: 40 N m/rad on 2.5e-3 kg m^2
    with pytest.raises(DeviceError, match="overspeed"):
        tick(device, 0.2, 100)
    assert wire.page.state == Mode.FAULT
    assert not wire.torque.any() and not wire.page.enabled


def test_the_watchdog_of_the_controller_lets_go_when_the_program_says_nothing_more(wire: RigWire, device) -> None:
    """Torques stand for 5 ms, then decay within 20 ms; a RUN after that does nothing, and HELLO begins anew."""
    tick(device, 0.3)
    full, seen = np.abs(wire.torque).max(), []
    assert full > 0.0
    for _ in range(30):
        device.controller.port.sleep(0.001)
        seen.append(np.abs(wire.torque).max())
    assert seen[:5] == [full] * 5
    assert all(b < a for a, b in pairwise(seen[5:24]))
    assert seen[15] == pytest.approx(0.5 * full, rel=0.1)  # a decay, not a step
    assert not any(seen[26:])
    taken = wire.page.good
    device.controller.run((0.01,) * 4)
    assert wire.page.good > taken
    assert wire.page.state == Mode.FAULT and not wire.torque.any()
    with pytest.raises(DeviceError, match="watchdog"):
        device.read()
    device.open(PERIOD)
    tick(device, 0.3)
    assert wire.torque.any()


def test_an_old_or_repeated_command_never_acts(wire: RigWire) -> None:
    port = Line(wire)
    controller = Controller(port, 0.0005)
    controller.open(0.06, 0.005)
    for number, torque, expected in ((5, 0.01, 0.01), (5, 0.02, 0.01), (4, 0.03, 0.01), (6, 0.04, 0.04)):
        taken = wire.page.good
        port.send(run_frame(number, controller._session, (torque,) * 4))
        assert wire.page.good > taken
        assert wire.torque.tolist() == pytest.approx([expected] * 4)
    controller.close()
    assert not wire.torque.any()


def test_recorded_frames_never_act_again(wire: RigWire, monkeypatch: pytest.MonkeyPatch) -> None:
    """All that a program sent, sent once more as it was: the controller has another session by then."""
    port, sent = Line(wire), list[bytes]()
    send, controller = port.send, Controller(port, 0.0005)

    def note(frame: bytes) -> None:
        sent.append(frame)
        send(frame)

    monkeypatch.setattr(port, "send", note)
    controller.open(0.06, 0.005)
    for _ in range(5):
        controller.run((0.02,) * 4)
        assert wire.torque.tolist() == [0.02] * 4
    controller.close()
    port.open()
    for frame in sent:
        taken = wire.page.good
        send(frame)
        assert wire.page.good > taken or not frame.strip(b"\0")
        assert not wire.torque.any() and not wire.page.enabled
    assert wire.page.state == Mode.IDLE


@pytest.mark.parametrize("fault", [1, 6], ids=["late", "noisy"])
def test_a_joint_that_turns_too_fast_in_a_decay_switches_the_motors_off(wire: RigWire, device, fault: int) -> None:
    """The decay goes on for 20 ms; a hand lets go and the arm is flung round: off at once, and the fault says so."""
    tick(device, 0.3)
    if fault == 6:
        for _ in range(10):
            device.controller.port.send(b"\x05\x01\x02\x03\x00")
    else:
        device.controller.port.sleep(0.0052)
    assert wire.page.state == Mode.FAULT and wire.page.fault == fault and wire.torque.any()
    wire.page.speed[0] = 60.0
    device.controller.port.sleep(0.001)
    assert FAULTS[wire.page.fault].startswith("overspeed")
    assert not wire.torque.any() and not wire.page.enabled


def test_motors_that_were_switched_on_for_nothing_go_off_after_5_s(wire: RigWire) -> None:
    port = Line(wire)
    controller = Controller(port, 0.0005)
    controller.open(0.06, 0.005)
    port.sleep(4.9)
    assert wire.page.state == Mode.ARMED and wire.page.enabled
    port.sleep(0.2)
    assert wire.page.state == Mode.FAULT and not wire.page.enabled
    with pytest.raises(DeviceError, match="5 s after the motors were switched on"):
        controller.answer()


@pytest.mark.parametrize("step", [1e-5, 0.002, 3.0])
def test_a_clock_that_steps_back_is_a_fault(wire: RigWire, device, step: float) -> None:
    """Microseconds modulo 2^32 were 4295 s forward, and velocities none; the controller is late for that, too."""
    tick(device, 0.3, 5)
    now = device._time
    VirtualClock.time -= step
    device.ask()
    with pytest.raises(DeviceError, match="ran backwards by"):
        device.read()
    assert device._time == now
    device.controller.port.sleep(0.03)
    assert wire.page.state == Mode.FAULT and not wire.page.enabled and not wire.torque.any()


def test_many_questions_do_not_make_the_next_command_old(wire: RigWire, device) -> None:
    device.controller._question = 0x7FFF + 0xFFFF  # as many were asked, and the number goes round
    assert tick(device, 0.2)[2] > 0.0
    assert wire.torque.any()


def test_one_answer_in_fifty_is_lost_and_the_others_stand(wire: RigWire, device) -> None:
    wire.fail("drop", 50)
    times = [tick(device)[2] for _ in range(500)]
    assert sum(a == b for a, b in pairwise(times)) == 10


def test_garbage_before_a_question_is_no_harm_and_ten_bad_frames_are_a_fault(wire: RigWire, device) -> None:
    device.controller.port.send(bytes(range(1, 60)) * 3 + b"\0")
    assert tick(device, 0.2)[2] > 0.0
    for _ in range(10):
        assert wire.page.state == Mode.RUNNING
        device.controller.port.send(b"\x05\x01\x02\x03\x00")
    with pytest.raises(DeviceError, match="noise"):
        device.read()


def test_a_command_that_is_cut_at_any_byte_does_not_act_and_the_next_question_is_answered(
    wire: RigWire, device
) -> None:  # fmt: skip
    line = device.controller.port
    frame = run_frame(1, device.controller._session, (0.01, -0.02, 0.03, 0.04))
    for cut in range(1, len(frame) - 1):
        line.send(frame[:cut] + b"\0")
        before = device._time
        assert tick(device)[2] > before and not wire.torque.any()
        device.open(PERIOD)  # damaged frames are counted, and ten in a row are a fault of a run
        frame = run_frame(1, device.controller._session, (0.01, -0.02, 0.03, 0.04))
    line.send(frame)
    assert wire.torque.tolist() == pytest.approx([0.01, -0.02, 0.03, 0.04])


@pytest.mark.parametrize("ticks", [400, pytest.param(60_000, marks=pytest.mark.stress)])
def test_flipped_bits_move_no_finger_and_no_torque(wire: RigWire, device, ticks: int) -> None:
    """One frame in ten has a changed bit, in both directions: a sample stands, a torque stands, nothing jumps."""
    wire.page.slowness = SLOW
    device.open(PERIOD)
    place, last, held = device.read()[0].copy(), 0.0, 0
    wire.fail("flip", 0.1)
    for _ in range(ticks):
        position, velocity, now = tick(device, 0.05)
        held += device._silent > 0
        assert now >= last and (now == last or device._silent == 0)
        last = now
        assert np.abs(position - place).max() < 1e-3 and np.abs(velocity).max() < 0.5
        assert np.abs(wire.force).max() < 0.06
    assert 0.05 * ticks < held < 0.3 * ticks and wire.page.bad > 0.01 * ticks


def test_quench_switches_the_motors_off(wire: RigWire, device) -> None:
    module = driver("rig")
    assert isinstance(module, QuenchableDriver)
    tick(device, 0.3)
    assert wire.torque.any()
    device.controller.port.close()  # a program that dies does that, and nothing else
    module.quench(**wire.settings)
    assert not wire.torque.any() and not wire.page.enabled


def test_settings_are_refused_by_name() -> None:
    connect_ = driver("rig").connect
    for settings, name in (
        ({"port": ""}, "port"),
        ({"port": 3}, "port"),
        ({"port": "x", "timeout": 1.0}, "timeout"),
        ({"port": "x", "arms": []}, "arms"),
        ({"port": "x", "arms": [{"base": (0.0, 0.0), "links": 3}]}, "arms.0"),
        ({"port": "x", "torque_limit": -1.0}, "torque_limit"),
    ):
        with pytest.raises(InputError) as error:
            connect_(**settings)
        assert error.value.name == name
    with pytest.raises(InputError, match="watchdog"):
        connect_(port="x").open(0.005)
    with pytest.raises(DeviceError, match="not open"):
        connect_(port="x").read()


class Pouring(Line):
    """A port at which another program's bytes never end."""

    def __init__(self, data: bytes) -> None:
        super().__init__(RigWire.__new__(RigWire))
        self.wire.clock, self.wire.failure, self.data, self.reads = VirtualClock(), None, data, 0

    def send(self, frame: bytes) -> None:
        pass

    def receive(self, deadline: float) -> bytes:
        self.reads += 1
        assert self.reads < 10_000
        self.wire.clock.sleep(0.001)
        return self.data


@pytest.mark.parametrize("data", [b"\0", b"\1\0", b"no frame", short_frame(Kind.STOP)])
def test_a_port_whose_bytes_never_end_is_no_rig(data: bytes) -> None:
    with pytest.raises(DeviceError, match="has answered 5 messages HELLO"):
        Controller(Pouring(data), 0.0025).open(0.06, 0.005)


def test_a_message_of_another_length_is_none() -> None:
    assert state_in(b"\x90" + bytes(40)) is not None and state_in(b"\x90" + bytes(39)) is None
    assert state_in(b"\x91" + bytes(40)) is None
