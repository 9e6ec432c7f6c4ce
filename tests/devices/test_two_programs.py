"""One piece of hardware, one program: ports and locks refuse the second, and go with a program that is killed."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from graspfx.devices.haply_2diy.emulator import DiyWire
from graspfx.errors import DeviceError
from graspfx.protocols import ProgramLock, SerialPort
from graspfx.testing import driver

WAIT = "\nprint('open', flush=True)\nimport time\ntime.sleep(60)"


@contextmanager
def other(code: str) -> Iterator[subprocess.Popen[str]]:
    """Run code in another program until it says that it has what it wants, and kill it in the end."""
    process = subprocess.Popen([sys.executable, "-c", code + WAIT], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "open\n"
        yield process
    finally:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


def test_a_port_that_another_program_has_is_refused_until_that_is_killed() -> None:
    with DiyWire() as wire:
        code = f"from graspfx.protocols import SerialPort\nport = SerialPort({wire.port!r})\nport.open()"
        with other(code):
            port = SerialPort(wire.port)
            with pytest.raises(DeviceError, match="is taken by another program"):
                port.open()
            assert not port.is_open
        port.open()  # the lock went with the program
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        assert "is taken by another program" in done.stderr
        second = SerialPort(wire.port)
        with pytest.raises(DeviceError, match="is taken by another program"):
            second.open()
        second.close()  # and takes nothing from the first
        port.send(b"\0\0")
        port.close()


@pytest.mark.parametrize("name", ["haply-2diy", "rig"])
def test_a_device_and_its_quench_are_refused_a_port_that_is_taken(name: str) -> None:
    with DiyWire() as wire:
        port, device = SerialPort(wire.port), driver(name).connect(**wire.settings)
        port.open()
        for act in (lambda: device.open(0.001), lambda: driver(name).quench(**wire.settings)):
            for _ in range(2):
                with pytest.raises(DeviceError, match="taken by another program"):
                    act()
        port.send(b"\0\0")
        port.close()


def test_a_lock_that_another_program_has_is_refused_until_that_is_killed() -> None:
    name = "a device of this test's own, äöü/.."
    code = f"from graspfx.protocols import ProgramLock\nlock = ProgramLock({name!r})\nlock.take()"
    lock = ProgramLock(name)
    with other(code), pytest.raises(DeviceError, match=r"own, äöü/\.\. is taken by another program"):
        lock.take()
    lock.take()
    lock.take()  # again, by the same
    second = ProgramLock(name)
    with pytest.raises(DeviceError, match="is taken"):
        second.take()
    second.release()
    assert subprocess.run([sys.executable, "-c", code], capture_output=True).returncode == 1
    lock.release()
    lock.release()
    second.take()
    second.release()
