"""The conformance kit passes devices that keep their promises and names the promise that a broken one breaks."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import count
from typing import Any

import numpy as np
import pytest

from graspfx.devices.simulated import PointDevice, connect
from graspfx.devices.simulated.point_device import PointDeviceState
from graspfx.devices.simulated.points import PointPlant
from graspfx.errors import DeviceError, GraspFXError, InputError
from graspfx.loop.device import Features
from graspfx.testing import ConformanceError, check_device

CORNERS = [-0.1, -0.1], [0.2, 0.1]
SETTINGS = {
    "mass": 0.15,
    "damping": 0.2,
    "fingers": 2,
    "dimensions": 2,
    "resolution": 1e-5,
    "velocity_window": 8,
    "delay": 0,
    "force_limit": 3.0,
    "workspace": (np.array(CORNERS[0]), np.array(CORNERS[1])),
}


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"fingers": 5, "dimensions": 3, "delay": 2, "damping": 0.2},
        {"dimensions": 2, "fingers": 2, "resolution": 1e-5, "force_limit": 3.0, "workspace": CORNERS},
        {"resolution": 1e-3, "delay": 1, "force_limit": 0.05},
    ],
)
def test_simulated_devices_conform(settings):
    settings = {"mass": 0.15, "dimensions": 1, **settings}
    check_device(connect(**settings))
    check_device(partial(connect, **settings), period=0.001)


class Hardware:
    """A device without a plant: a finger that nobody moves, one channel, on a clock of its own."""

    def __init__(self):
        self.features = Features(fingers=1, dimensions=2, peak_force=0.1)
        self.displayed, self.ticks, self.latched = np.zeros((1, 2)), count(), False

    def open(self, period):
        self.period = period

    def read(self):
        return np.zeros((1, 2)), np.zeros((1, 2)), next(self.ticks) * self.period

    def write(self, forces):
        if self.latched or not np.isfinite(forces).all():
            self.stop()
            self.latched = True
            raise DeviceError("a force that is not finite")
        self.displayed = forces.copy()
        assert np.abs(forces).max() <= 0.05  # half of its peak force at most, and never more than asked

    def stop(self):
        self.displayed = np.zeros((1, 2))

    def close(self):
        self.stop()

    def __enter__(self):
        return self

    def __exit__(self, *exc):
        self.close()


def test_hardware_conforms_is_moved_gently_and_left_without_force():
    device = Hardware()
    check_device(device)
    assert device.latched  # also one that stays shut after a fault
    assert not device.displayed.any()
    check_device(Hardware, force=0.01)


class Careless(Hardware):
    """Never limits its force, never lets go of it, and reports millimetres: `wire` is what the motors hold."""

    def __init__(self):
        super().__init__()
        self.wire = np.zeros((1, 2))

    def read(self):
        return np.full((1, 2), 20.0), np.zeros((1, 2)), next(self.ticks) * self.period  # 20 mm

    def write(self, forces):
        self.wire = 1000.0 * forces
        if not np.isfinite(forces).all():
            raise DeviceError("a force that is not finite")

    def stop(self):
        pass


def test_report_names_promises_that_it_cannot_see_in_hardware():
    """Such a driver passes; the report must not say that it keeps what nobody has looked at."""
    device = Careless()
    report = check_device(device)
    assert not np.isfinite(device.wire).all()  # still on the wire after `close`
    unseen = [each.promise for each in report.not_visible]
    for promise in (
        "`stop` and `close` set zero force",
        "a non-finite force is displayed as zero",
        "the force limit is applied last",
        "positions are in metres, velocities in metres per second, each for its own finger and axis",
        "a force reaches its own finger, in its direction, in newtons",
    ):
        assert promise in unseen
    assert not any(word in each for each in report.checks for word in ("zero force", "no force", "limit", "metres"))
    head, _, tail = str(report).partition("not visible:\n")
    assert head.startswith("passed:\n  - features are reported")
    assert all(f"- {each.promise} ({each.reason})" in tail for each in report.not_visible)


def test_report_on_a_simulated_device_leaves_out_what_its_plant_shows():
    seen, unseen = (check_device(connect(mass=0.15, dimensions=1, **more)) for more in ({"force_limit": 3.0}, {}))
    assert "the device applies the force limit last" in seen.checks
    assert "a force limit" in [each.promise for each in unseen.not_visible]
    assert "`stop` sets zero force at once, even when called again" in seen.checks
    for report in (seen, unseen):
        assert "two devices of one kind are independent" in [each.promise for each in report.not_visible]
        assert not any("metres" in each.promise for each in report.not_visible)
    both = check_device(partial(connect, mass=0.15, dimensions=1, force_limit=3.0))
    assert "two devices of one kind in one process are independent" in both.checks
    assert len(both.not_visible) == len(seen.not_visible) - 1


class UnknownAsZero(PointDevice):
    features = property(lambda self: replace(super().features, mass=0.0))


class WorkspaceUpsideDown(PointDevice):
    features = property(lambda self: replace(super().features, workspace=(np.ones(2), np.zeros(2))))


class FeaturesAfterOpen(PointDevice):
    features = property(lambda self: self._opened() and super().features)


class FlatPositions(PointDevice):
    def read(self):
        p, v, time = super().read()
        return p.ravel(), v, time


class NoForceLeft(PointDevice):
    @property
    def largest_force(self):
        return np.array([1.0, 0.0])


class NoVelocity(PointDevice):
    def read(self):
        p, v, time = super().read()
        return p, np.full_like(v, np.nan), time


class TrueMotion(PointDevice):
    def read(self):
        _, v, time = super().read()
        return self._true, v, time


class FailedReadIsZero(PointDevice):
    def read(self):
        p, v, time = super().read()
        return 0.0 * p, v, time


class WallClock(PointDevice):
    ticks = count(5, -1)

    def read(self):
        p, v, _ = super().read()
        return p, v, float(next(self.ticks))


class HalfTime(PointDevice):
    def read(self):
        p, v, time = super().read()
        return p, v, 0.5 * time


class AveragedForces(PointDevice):
    def write(self, forces):
        super().write(np.broadcast_to(forces.mean(axis=0), forces.shape))


class FirstFingerOnly(PointDevice):
    def write(self, forces):
        super().write(forces * [[1.0], [0.0]])


class NoLimit(PointDevice):
    def write(self, forces):
        PointDeviceState(self.state).limited = False
        super().write(forces)


class LimitPerComponentTwice(PointDevice):
    def write(self, forces):
        PointDeviceState(self.state).limited = False
        twice = 2.0 * self.features.peak_force
        super().write(np.clip(forces, -twice, twice) if np.isfinite(forces).all() else forces)


class WrongSign(PointDevice):
    def write(self, forces):
        super().write(-forces)


class ClippedNaN(PointDevice):
    def write(self, forces):
        limit = self.features.peak_force
        self._effort[...] = np.clip(forces, -limit, limit)


class SilencedNaN(PointDevice):
    def write(self, forces):
        super().write(np.nan_to_num(forces, posinf=0.0, neginf=0.0))


class LastForceKept(PointDevice):
    def write(self, forces):
        if not np.isfinite(forces).all():
            raise DeviceError("a force that is not finite")
        super().write(forces)


class StopsLater(PointDevice):
    def stop(self):
        self.stopped = True

    def write(self, forces):
        if self.stopped:
            super().stop()
        super().write(forces)
        self.stopped = False


class ClosesOnce(PointDevice):
    closed = False

    def close(self):
        if self.closed:
            raise OSError("the port is closed")
        super().close()
        self.closed = True

    def open(self, period):
        self.closed = False
        super().open(period)


class KeepsForceWhenClosed(PointDevice):
    def close(self):
        effort = self._effort.copy()
        super().close()
        self._effort[...] = effort + 1.0


class SomebodyElse(PointDevice):
    def __enter__(self):
        return PointDevice(**SETTINGS)


class SwallowsErrors(PointDevice):
    def __exit__(self, *exc):
        self.close()
        return True


class Noisy(PointDevice):
    def read(self):
        p, v, time = super().read()
        return p, v + np.random.default_rng().normal(0.0, 1e-6, v.shape), time


@pytest.mark.parametrize(
    ("kind", "promise", "found"),
    [
        (UnknownAsZero, "None, never zero", "mass = 0.0"),
        (WorkspaceUpsideDown, "features", "lower and an upper corner"),
        (FeaturesAfterOpen, "features are reported before `open`", "DeviceError: .*not open"),
        (FlatPositions, "`read` returns", r"positions of shape \(4,\), expected \(2, 2\)"),
        (NoForceLeft, "`largest_force` is a positive force", r"\[1.0, 0.0\] N"),
        (NoVelocity, "`read` returns", "non-finite velocities"),
        (TrueMotion, "the device's own arrays", "true motion"),
        (FailedReadIsZero, "read to the reported resolution", "m off"),
        (WallClock, "the time never decreases", "the time"),
        (HalfTime, "number of ticks", "s at tick 1"),
        (AveragedForces, "its own force", "finger 0 alone"),
        (FirstFingerOnly, "a non-zero force causes an effort", "no effort on a finger"),
        (NoLimit, "force limit", "hundred times"),
        (LimitPerComponentTwice, "force limit", "6.0 N, above the limit of 3.0 N"),
        (WrongSign, "in its direction", "finger 0 moved by -"),
        (ClippedNaN, "non-finite", "nan on finger 0 was accepted"),
        (SilencedNaN, "non-finite", "nan on finger 0 was accepted"),
        (LastForceKept, "non-finite", r"the effort \[0.1, 0.0\] after nan"),
        (StopsLater, "`stop` sets zero force", "an effort after `stop`"),
        (ClosesOnce, "`close` removes the force", "OSError: the port is closed"),
        (KeepsForceWhenClosed, "`close` removes the force", "an effort after `close`"),
        (SomebodyElse, "the device itself", "another object"),
        (SwallowsErrors, "propagates exceptions", "suppressed"),
        (Noisy, "identical, bit for bit", "moves differently"),
    ],
)
def test_a_broken_promise_is_named(kind, promise, found):
    with pytest.raises(ConformanceError, match=found) as error:
        check_device(kind(**SETTINGS))
    assert promise in error.value.promise
    assert isinstance(error.value, AssertionError)
    assert isinstance(error.value, GraspFXError)


class Rounding(PointPlant):
    """Puts its fingers where the last digits of a posture let it, as a mechanism does."""

    def place(self, position):
        super().place(position)
        self.position += 1e-13


class OnAMechanism(PointDevice):
    @staticmethod
    def plant(devices):
        (device,) = devices
        plant = Rounding([device.mass] * 2, [device.damping] * 2, 2)
        device._plant, device._true = plant, plant.position
        return plant


def test_a_plant_may_round_where_it_is_placed():
    check_device(lambda: OnAMechanism(**SETTINGS))


class SharedPlant(PointDevice):
    everybodys: Any = None

    @classmethod
    def plant(cls, devices):
        (device,) = devices
        plant = cls.everybodys = cls.everybodys or PointDevice.plant(devices)
        device._plant, device._true = plant, plant.position
        return plant


class SharedArrays(PointDevice):
    places = np.zeros((2, 2))

    def read(self):
        p, v, time = super().read()
        self.places[...] = p
        return self.places, v, time


class SharedEffort(PointDevice):
    held = np.zeros((2, 2))
    effort = property(lambda self: self.held)

    def write(self, forces):
        try:
            super().write(forces)
        finally:
            self.held[...] = self._effort

    def stop(self):
        super().stop()
        self.held[...] = 0.0


class OnlyOneAtATime(PointDevice):
    users = 0

    def open(self, period):
        if self._estimator is None:
            type(self).users += 1
        if self.users > 1:
            raise OSError("the device is busy")
        super().open(period)

    def close(self):
        if self._estimator is not None:
            type(self).users -= 1
        super().close()


@pytest.mark.parametrize(
    ("kind", "found"),
    [
        (SharedArrays, "the same arrays"),
        (SharedPlant, "a force on one device moved the other by .* m"),
        (SharedEffort, "effort of the other"),
        (OnlyOneAtATime, "OSError: the device is busy"),
    ],
)
def test_two_that_are_not_independent(kind, found):
    check_device(kind(**SETTINGS))  # one alone keeps its promises
    with pytest.raises(ConformanceError, match=found) as error:
        check_device(lambda: kind(**SETTINGS))
    assert "two devices of one kind" in error.value.promise


def test_a_factory_that_gives_one_device_twice():
    device = PointDevice(**SETTINGS)
    with pytest.raises(ConformanceError, match="the same device twice"):
        check_device(lambda: device)


def test_what_is_no_device():
    with pytest.raises(InputError, match="device"):
        check_device(3)  # type: ignore[arg-type] # no device
    with pytest.raises(InputError, match=r"start.*\(2, 2\)"):
        check_device(connect(mass=0.1, dimensions=2, fingers=2), start=[0.0])
