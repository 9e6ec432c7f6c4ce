"""The conformance kit on a wire: it passes the drivers of the shelf, and no driver that breaks a promise there."""

from __future__ import annotations

import os
import struct
from functools import partial
from typing import Any

import numpy as np
import pytest

from graspfx.devices import haply_2diy
from graspfx.devices.force_dimension import Delta
from graspfx.devices.force_dimension.emulator import ForceDimensionWire
from graspfx.devices.haply_2diy import Haply2Diy
from graspfx.devices.haply_2diy.emulator import DiyWire
from graspfx.devices.rig.emulator import RigWire
from graspfx.errors import DeviceError, InputError
from graspfx.loop.device import Features
from graspfx.protocols import SerialPort
from graspfx.testing import ConformanceError, check_device, driver
from graspfx.testing.promise import Promises
from graspfx.testing.wire import FAILURES, Damage, SerialWire, compiler
from graspfx.testing.wire_promises import check_second
from tests.support.hardware import Line, LookedAtClock, VirtualClock
from tests.support.waiting import wait_until

SEEN_ON_WIRES = (
    "the motion of a finger is read",
    "positions are in metres, velocities in metres per second, each for its own finger and axis",
    "the time is that of the reading, in seconds",
    "a force reaches its own finger, in its direction, in newtons",
    "the force limit is applied last",
    "`stop` and `close` set zero force",
    "an exception inside `with device` sets zero force",
    "a non-finite force is displayed as zero",
    "the device's force ends without further writes",
    "open hardware is refused to a second program, and the first one continues",
)


needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")


@pytest.mark.alone
@needs_compiler
def test_force_dimension_conforms() -> None:
    with ForceDimensionWire(slowness=20.0) as wire:  # watchdogs of 0.6 s: this machine may be busy
        passed(wire, driver("force-dimension").connect, 0.001)


@needs_compiler
def test_force_dimension_conforms_on_a_clock_of_its_own() -> None:
    clock = LookedAtClock()

    def connect(**settings):
        device = driver("force-dimension").connect(**settings)
        device.now = clock.now
        return device

    with ForceDimensionWire(clock=clock) as wire:
        passed(wire, connect, 0.001)


@pytest.mark.alone
def test_the_haply_2diy_conforms() -> None:
    with DiyWire() as wire:
        report = passed(wire, driver("haply-2diy").connect, 0.002, timeout=0.02)
    assert "a transmission error never moves a finger" in [each.promise for each in report.not_visible]


@pytest.mark.alone
@needs_compiler
def test_the_rig_conforms() -> None:
    with RigWire(slowness=25.0) as wire:
        passed(wire, driver("rig").connect, 0.001, timeout=0.0025)


def passed(wire, connect, period, **settings):
    report = check_device(partial(connect, **wire.settings, **settings), wire=wire, period=period)
    assert set(SEEN_ON_WIRES) <= set(report.checks)
    kinds = [kind for kind in FAILURES if any(f"({kind})" in each for each in report.checks)]
    assert set(kinds) == wire.kinds and not {each.promise for each in report.not_visible} & set(report.checks)
    text = str(report)
    assert text.startswith("passed:\n") and "\nnot visible:\n" in text and "\nneeds a person:\n" in text
    assert any("force gauge" in each.reason for each in report.needs_person)
    assert not wire.torque.any()
    return report


class NeverReads(Delta):
    def read(self):
        return np.array([[0.01, -0.02, 0.03]]), np.zeros((1, 3)), self.now() - self._began


class Millimetres(Delta):
    def read(self):
        p, v, now = super().read()
        return 1e3 * p, 1e3 * v, now


class NoVelocity(Delta):
    def read(self):
        p, v, now = super().read()
        return p, 0.0 * v, now


class Milliseconds(Delta):
    def read(self):
        p, v, now = super().read()
        return p, v, 1e3 * now


class MillionTimes(Delta):
    """Sends 10^6 times the force past its own limit."""

    def write(self, forces):
        super().write(forces)
        self._dhd.call("dhdSetForce", *(1e6 * forces[0]).tolist(), self._id)


class Clamped(Delta):
    """Sends 10^6 times the force, within its limit: small forces look as large ones do."""

    def write(self, forces):
        super().write(1e6 * forces)


class OtherWay(Delta):
    def write(self, forces):
        super().write(-forces)


class NoLimit(Delta):
    def write(self, forces):
        super().write(forces)
        if np.abs(forces).max() < 1e6:
            self._dhd.call("dhdSetForce", *forces[0].tolist(), self._id)


class NeverZero(Delta):
    def stop(self):
        pass


class BrakesAlone(Delta):
    """Leaves the last force behind the brakes."""

    _dhd: Any

    def close(self):
        if self._dhd is not None:
            self._dhd.call("dhdStop", self._id)
            self._dhd.call("dhdClose", self._id)
            self._dhd = None


class NeverClosed(Delta):
    def __exit__(self, *exc):
        pass


class KeptWhenNotFinite(Delta):
    def write(self, forces):
        if not np.isfinite(forces).all():
            raise DeviceError("not finite")
        super().write(forces)


class Alone(Delta):
    """Has no watchdog, and no `quench` in its module."""

    def _watch(self):
        pass


class BoastsOfAWatchdog(Alone):
    @property
    def features(self):
        return Features(fingers=1, dimensions=3, peak_force=self.force_limit, resolution=1e-5, watchdog=0.03)


class ZeroWhenItFails(Delta):
    """Takes a failed reading for the position zero."""

    def _refresh(self):
        fresh = super()._refresh()
        if not fresh:
            self._xyz[:] = [0.0] * 3
        return True


class FreshWhenItFails(Delta):
    """Takes a failed reading for a new one at the same place."""

    def _refresh(self):
        super()._refresh()
        return True


class FailsInItsOwnWords(Delta):
    def read(self):
        code = self._dhd._functions["dhdGetPosition"](*self._places, self._id)
        if code < 0:
            raise ValueError(f"code {code}")
        return super().read()


class NeverNoticed(Delta):
    """Adds up return codes, so that no new data hides an error; and asks nothing else."""

    def read(self):
        sum(self._dhd._functions[name](*args) for name, args in (("dhdGetPosition", (*self._places, self._id)),))
        if np.isfinite(self._xyz).all():
            self._follow()
        return self._position, self._velocity, self.now() - self._began

    def write(self, forces):
        if not np.isfinite(forces).all():
            super().write(forces)
        size = max(1.0, float(np.linalg.norm(forces)) / self.force_limit)
        self._dhd._functions["dhdSetForce"](*(forces[0] / size).tolist(), self._id)


@needs_compiler
@pytest.mark.parametrize(
    ("kind", "promise", "finding"),
    [
        (NeverReads, "the motion of a finger is read", "the reading is still"),
        (Millimetres, "in metres", "m, but the fingers are at"),
        (NoVelocity, "velocities in metres per second", "integral of the velocities is off"),
        (Milliseconds, "in seconds", "readings advance by"),
        (MillionTimes, "half the force|in newtons|limit", "."),
        (Clamped, "half the force gives half the torque", "for half the force"),
        (OtherWay, "in its direction", "N were written"),
        (NoLimit, "the force limit", "above its limit|at ten times"),
        (NeverZero, "`stop` and `close` set zero force", "after `stop`"),
        (BrakesAlone, "`stop` and `close` set zero force", "after `close`"),
        (NeverClosed, "zero force", "after the end of `with`"),
        (KeptWhenNotFinite, "non-finite force is displayed as zero", "after nan N"),
        (Alone, "without further writes", "no watchdog, and the driver has no `quench"),
        (BoastsOfAWatchdog, "without further writes", "did not remove the force after 0.03 s"),
        (ZeroWhenItFails, "failing wire", "at rest is off by"),
        (FreshWhenItFails, "failing wire", "although the board sends nothing"),
        (FailsInItsOwnWords, r"failing wire \(unplugged\)", "ValueError"),
        (NeverNoticed, "failing wire", "sends nothing|no DeviceError in"),
    ],
)
def test_a_promise_that_is_broken_on_the_wire_is_named(kind: type[Delta], promise: str, finding: str) -> None:
    clock = LookedAtClock()
    with ForceDimensionWire(clock=clock) as wire:
        device = kind(
            serial=101, library=wire.library, force_limit=3.0, resolution=1e-5, velocity_window=16, now=clock.now
        )
        with pytest.raises(ConformanceError, match=finding) as error:
            check_device(device, wire=wire, period=0.001)
        assert any(part in error.value.promise for part in promise.replace("\\", "").split("|"))
        wire.devices[0].owner = 0


class UnknownMechanism(DiyWire):
    """A board whose emulator knows torques alone."""

    position = force = None


def test_what_an_emulator_without_a_mechanism_cannot_show_is_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "fork")  # no program can be killed that meets an emulator in this thread
    with UnknownMechanism(clock=LookedAtClock()) as wire:
        monkeypatch.setattr(haply_2diy, "SerialPort", lambda path: Line(wire))
        report = check_device(driver("haply-2diy").connect(**wire.settings), wire=wire, period=0.002)
    unseen = [each.promise for each in report.not_visible]
    assert SEEN_ON_WIRES[1] in unseen and SEEN_ON_WIRES[3] in unseen
    assert "a force reaches the wire, and half the force gives half the torque" in report.checks
    assert "the motion of a finger is read" in report.checks


class CutFrames(Haply2Diy):
    """Writes a frame in two pieces, of which the second never comes: the board waits with its torques on."""

    def stop(self):
        self.port.send(struct.pack("<BB", 2, self.device))


class Unlocked(Haply2Diy):
    def open(self, period):
        import fcntl

        super().open(period)
        fcntl.flock(self.port._descriptor, fcntl.LOCK_UN)


def diy(kind, wire, port) -> Any:
    plain = driver("haply-2diy").connect(**wire.settings)
    return kind(
        port,
        plain.linkage,
        device=5,
        home=plain.home,
        counts=plain.counts,
        torque_limit=0.1,
        velocity_window=16,
        timeout=0.02,
    )


def test_a_board_that_waits_for_the_rest_of_a_frame_is_no_zero_force() -> None:
    with DiyWire(clock=LookedAtClock()) as wire, pytest.raises(ConformanceError, match="after `stop`"):
        check_device(diy(CutFrames, wire, Line(wire)), wire=wire, period=0.002)


def test_two_programs_that_both_have_the_hardware() -> None:
    import termios

    with DiyWire() as wire, pytest.MonkeyPatch.context() as patch:
        patch.setattr(termios, "TIOCEXCL", termios.TIOCNXCL)
        one, two = (diy(Unlocked, wire, SerialPort(wire.port)) for _ in range(2))
        with pytest.raises(ConformanceError, match="each sends its own forces"):
            check_second(one, two, Promises("device"), 0.002)


@needs_compiler
def test_failures_are_those_of_the_hardware() -> None:
    with ForceDimensionWire() as wire:
        with pytest.raises(InputError, match="kind: given 'flip', expected one of blocked, drop"):
            wire.fail("flip")
        wire.fail("drop")
        assert wire.failure == "drop"
        wire.heal()
        assert wire.failure is None


def test_damage_cuts_at_every_byte_and_repeats() -> None:
    def pieces(kind, number, count=20):
        damage = Damage(seed=3)
        damage.kind, damage.number = kind, number
        return [list(damage.apply(bytes(range(10)))) for _ in range(count)]

    lengths = [len(part) for ((_, part),) in pieces("cut", -1.0)]
    assert set(lengths) == set(range(10))
    assert [len(each) for each in pieces("drop", 4.0, 8)] == [1, 1, 1, 0, 1, 1, 1, 0]
    assert pieces("flip", 0.5) == pieces("flip", 0.5) != pieces("flip", 1.0)
    flipped = [int.from_bytes(part) ^ int.from_bytes(bytes(range(10))) for ((_, part),) in pieces("flip", 1.0)]
    assert all(each.bit_count() == 1 for each in flipped)
    assert all(part[0] != 0 and part[1:] == bytes(range(1, 10)) for ((_, part),) in pieces("wrong-id", 0.0))
    assert all(delay == 0.5 for ((delay, _),) in pieces("late", 0.5))
    assert not any(pieces("blocked", 0.0))


class Echo(SerialWire):
    """A board that answers what it hears, and counts its ticks."""

    limit, torque, ticks = 1.0, np.zeros(1), 0

    def receive(self, data):
        yield data

    def tick(self):
        self.ticks += 1

    def move(self):
        pass

    def home(self):
        pass


def test_a_wire_of_ones_own() -> None:
    with Echo() as wire:
        port = SerialPort(wire.port)
        port.open()
        port.send(b"hello")
        assert port.receive(port.now() + 60.0) == b"hello"
        assert wait_until(lambda: wire.ticks > 10)
        port.close()
    wire.close()


def test_a_wire_of_ones_own_on_a_clock_of_its_own() -> None:
    with Echo(clock=VirtualClock()) as wire:
        line = Line(wire)
        line.open()
        wire.fail("late", 0.05)
        began = line.now()
        line.send(b"x")
        assert line.receive(began + 2.0) == b"x" and line.now() - began == pytest.approx(0.05, abs=0.001)
        wire.fail("blocked")
        line.send(b"y")
        assert line.receive(line.now() + 0.02) == b""
        wire.heal()
        assert line.receive(line.now()) == b"y"
        assert wire.ticks > 10
