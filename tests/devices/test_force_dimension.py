"""Force Dimension's devices behind a fake library: each return code judged by itself, zero force on every way out."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pytest

from graspfx.devices.force_dimension.emulator import FUNCTIONS, ForceDimensionWire
from graspfx.errors import DeviceError, InputError
from graspfx.testing import driver
from graspfx.testing.wire import compiler
from tests.support.hardware import VirtualClock

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")
PERIOD = 0.001


@pytest.fixture
def wire() -> Iterator[ForceDimensionWire]:
    with ForceDimensionWire(clock=VirtualClock()) as bench:
        yield bench


def connect(wire: ForceDimensionWire, **settings):
    return driver("force-dimension").connect(**{**wire.settings, **settings})


def test_a_device_is_opened_by_its_serial_number_and_left_as_it_was(wire: ForceDimensionWire) -> None:
    wire.devices[2].watchdog = 7
    wire.place(np.array([0.1, 0.2, 0.3]), 2)
    with connect(wire, serial=103) as device:
        assert device.features.watchdog is None
        device.open(PERIOD)
        assert wire.devices[2].owner == os.getpid() and not wire.devices[0].owner
        assert wire.devices[2].enabled and wire.devices[2].max_force == 3.0
        assert device.features.watchdog == pytest.approx(0.031875) and wire.devices[2].watchdog == 255
        assert device.read()[0].tolist() == [[0.1, 0.2, 0.3]]
        assert not wire.calls("dhdSetTimeGuard", 2)
    bench = wire.devices[2]
    assert (bench.owner, bench.watchdog, bench.braking, bench.enabled) == (0, 7, 1, 0)
    with connect(wire, serial=999) as device, pytest.raises(DeviceError, match=r"dhdOpenSerial .* returned -1"):
        device.open(PERIOD)


def test_two_devices_in_one_process_know_nothing_of_one_another(wire: ForceDimensionWire) -> None:
    with connect(wire, serial=None) as one, connect(wire, serial=None) as two:
        one.open(PERIOD)
        two.open(PERIOD)
        wire.place(np.array([0.5, 0.0, 0.0]), 1)
        one.write(np.array([[1.0, 0.0, 0.0]]))
        assert [wire.devices[k].force0 for k in range(2)] == [1.0, 0.0]
        assert one.read()[0][0, 0] == 0.01 and two.read()[0][0, 0] == 0.5
        one.close()
        two.read()


def test_a_second_device_that_does_not_open_leaves_the_first_alone(wire: ForceDimensionWire) -> None:
    for k in range(1, 4):
        wire.devices[k].owner = os.getpid()  # somebody has the others
    with connect(wire, serial=None) as one, connect(wire, serial=None) as two:
        one.open(PERIOD)
        one.write(np.ones((1, 3)))
        with pytest.raises(DeviceError, match="dhdOpen"):
            two.open(PERIOD)
        one.read()
        assert wire.torque.tolist() == [1.0, 1.0, 1.0]
    assert not wire.torque.any()


def test_no_new_data_is_the_last_sample_and_no_error(wire: ForceDimensionWire) -> None:
    with connect(wire) as device:
        device.open(PERIOD)
        place, _, before = device.read()
        place = place.copy()
        wire.move()
        wire.answer("dhdGetPosition", 1)
        for _ in range(3):
            position, _, now = device.read()
            assert now == before
        wire.answer("dhdGetPosition", 0)
        position, velocity, now = device.read()
        assert now > before and np.allclose(position - place, 0.003)
        assert np.allclose(velocity, 0.003 / (4.0 * PERIOD))  # 3 mm in four samples, not in one


@pytest.mark.parametrize("function", ["dhdGetPosition", "dhdSetForce", "dhdGetStatus"])
def test_no_new_data_never_hides_an_error_of_another_call(wire: ForceDimensionWire, function: str) -> None:
    with connect(wire) as device:
        device.open(PERIOD)
        for other in ("dhdGetPosition", "dhdSetForce", "dhdGetStatus"):
            wire.answer(other, 1)
        device.read()
        device.write(np.ones((1, 3)))
        call = device.write if function == "dhdSetForce" else lambda _: device.read()
        for code in (-1, -2, -1000):
            wire.answer(function, code)
            with pytest.raises(DeviceError, match=f"{function} .* returned {code}: communication error"):
                call(np.ones((1, 3)))


def test_positive_codes_are_no_errors(wire: ForceDimensionWire) -> None:
    for function in FUNCTIONS:
        wire.answer(function, 2)  # the motors are saturated
    with connect(wire) as device:
        device.open(PERIOD)
        assert device.read()[2] >= 0.0
        device.write(np.ones((1, 3)))
        assert wire.torque.tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize(
    "function", ["dhdOpenSerial", "dhdSetForce", "dhdSetMaxForce", "dhdEnableForce", "dhdGetPosition"]
)
def test_an_opening_that_fails_leaves_nothing_open(wire: ForceDimensionWire, function: str) -> None:
    wire.answer(function, -1)
    device = connect(wire)
    with pytest.raises(DeviceError, match=function):
        device.open(PERIOD)
    assert not wire.devices[0].owner and not wire.torque.any()


@pytest.mark.parametrize("function", ["dhdEnableExpertMode", "dhdGetWatchdog", "dhdSetWatchdog"])
def test_a_device_that_takes_no_watchdog_has_none(wire: ForceDimensionWire, function: str) -> None:
    wire.answer(function, -1)
    with connect(wire) as device:
        device.open(PERIOD)
        assert device.features.watchdog is None


def test_force_is_zero_before_the_brakes_on_every_way_out(wire: ForceDimensionWire) -> None:
    for fault in ("dhdSetForce", "dhdStop", "dhdSetWatchdog", "dhdClose", None):
        calls = wire.calls("dhdClose")
        with pytest.raises(KeyError):
            end_by_an_exception(wire, fault)
        assert wire.calls("dhdClose") == calls + 1
        assert fault == "dhdSetForce" or not wire.torque.any()
        for function in FUNCTIONS:
            wire.answer(function, 0)
        wire.devices[0].owner = 0


def end_by_an_exception(wire: ForceDimensionWire, fault: str | None) -> None:
    with connect(wire) as device:
        device.open(PERIOD)
        device.write(np.ones((1, 3)))
        if fault:
            wire.answer(fault, -1)
        raise KeyError


@pytest.mark.parametrize(
    ("cause", "words"), [(1, "button"), (2, "velocity"), (3, "watchdog"), (6, "deadman"), (9, "cause 9")]
)
def test_a_device_that_switches_its_force_off_says_why(wire: ForceDimensionWire, cause: int, words: str) -> None:
    with connect(wire) as device:
        device.open(PERIOD)
        wire.switch_off(cause)
        with pytest.raises(DeviceError, match=words):
            device.read()


def test_a_force_that_is_not_finite_or_too_large(wire: ForceDimensionWire) -> None:
    with connect(wire, force_limit=2.0) as device:
        device.open(PERIOD)
        device.write(np.array([[30.0, 40.0, 0.0]]))
        assert wire.torque == pytest.approx([1.2, 1.6, 0.0])
        for bad in (np.nan, np.inf, -np.inf):
            device.write(np.ones((1, 3)))
            with pytest.raises(DeviceError, match="cannot be displayed"):
                device.write(np.array([[0.1, bad, 0.0]]))
            assert not wire.torque.any()
        wire.fail("garbage")
        with pytest.raises(DeviceError, match="returned the position"):
            device.read()


def test_quench_reaches_a_device_whose_program_was_killed() -> None:
    """Two programs meet the devices of one library, which only a linked one can be."""
    code = (
        "import sys, time, numpy as np\nfrom graspfx.testing import driver\n"
        "device = driver('force-dimension').connect(serial=101, library=sys.argv[1])\n"
        "device.open(0.001); device.write(np.ones((1, 3))); print('on', flush=True); time.sleep(60)\n"
    )
    with ForceDimensionWire() as wire:
        for function in ("dhdSetWatchdog", "dhdEnableExpertMode"):
            wire.answer(function, -1)
        call = [sys.executable, "-c", code, str(wire.library)]
        with subprocess.Popen(call, stdout=subprocess.PIPE, text=True) as program:
            assert program.stdout is not None and program.stdout.readline() == "on\n"
            assert wire.torque.tolist() == [1.0, 1.0, 1.0]
            quench = driver("force-dimension").quench
            with pytest.raises(DeviceError, match="dhdOpenSerial"):  # while that program lives
                quench(**wire.settings)
            program.kill()
            program.wait()
            assert wire.torque.any()
            quench(**wire.settings)
            assert not wire.torque.any() and wire.devices[0].owner == 0


def test_a_library_that_is_none() -> None:
    connect_ = driver("force-dimension").connect
    with pytest.raises(DeviceError, match="install the vendor's SDK"):
        connect_(library="/nowhere/libdrd.so").open(PERIOD)
    with pytest.raises(DeviceError, match="has no function dhd"):
        connect_(library=ctypes.CDLL(None)).open(PERIOD)
    for settings, name in (
        ({"library": ""}, "library"),
        ({"library": object()}, "library"),
        ({"velocity_window": 2.5}, "velocity_window"),
        ({"serial": -1}, "serial"),
        ({"force_limit": 0}, "force_limit"),
    ):
        with pytest.raises(InputError) as error:
            connect_(**settings)
        assert error.value.name == name
    with pytest.raises(DeviceError, match="not open"):
        connect_(velocity_window=np.int64(8)).read()
