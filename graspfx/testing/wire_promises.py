"""Promises of a device that can be checked with a wire: an emulator that reports torques and simulates failures."""

from __future__ import annotations

import math
import os
import select
import signal
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import DeviceError
from graspfx.loop.device import Device, Features, LimitedDevice, QuenchableDriver
from graspfx.testing.promise import (
    ALONE,
    LIMIT,
    METRES,
    NEWTONS,
    NOT_FINITE,
    SECONDS,
    ZERO,
    BlindSpot,
    Promise,
    Promises,
)

if TYPE_CHECKING:
    from graspfx.testing.wire import Failure, Wire

FloatArray = NDArray[np.float64]

PATIENCE = 0.3  # time for an emulator to react [s]
LOOKS = 10  # smallest number of checks, so that a pause of the machine is not mistaken for waiting
MOTION = 2.0  # time for a finger to reach its position [s]
LONGEST = 20.0  # time for another process to open the device [s]
TICKS = 40  # ticks of a failure
NEAR = 1e-3  # tolerance of a resting finger's position while its wire fails [m]
SHARE = 0.03  # relative tolerance of a force, for rounding and the finger's own motion
SMALL = 2e-3  # [N], absolute tolerance of a force
AT_ONCE = 2  # ticks after which an unplugged cable must be a fault
QUICK = 0.1  # longest `close` with the cable unplugged [s]
RECKONING = 0.5  # relative tolerance of time or velocity, to distinguish seconds from milliseconds


def check_wire(device: Device, wire: Wire, promises: Promises, period: float, force: float) -> None:
    """Check the promises of a device that can be observed by an emulator.

    Args:
        device: Device, which must not be open; it is closed afterwards.
        wire: Emulator to which the device connects.
        promises: Record of the promises that are kept.
        period: Sampling period [s].
        force: Magnitude of the written forces [N].

    Raises:
        ConformanceError: If the device breaks a promise.
    """
    bench = _Bench(device, wire, period, force)
    try:
        _check_motion(bench, promises)
        if displays(bench.features):
            _check_forces(bench, promises)
            _check_zero(bench, promises)
            _check_alone(bench, promises)
        for kind in sorted(wire.kinds, key=lambda kind: (kind == "unplugged", kind)):
            _check_failure(bench, promises, kind)
    finally:
        wire.heal()
        with suppress(Exception):  # the broken promise is reported instead
            device.close()


def check_second(one: Device, two: Device, promises: Promises, period: float) -> None:
    """Check that a second device cannot be opened while another device uses the same hardware."""
    with promises("open hardware is refused to a second program, and the first one continues") as promise:
        promise.holds(one is not two, "the factory returned the same device twice")
        try:
            one.open(period)
            try:
                two.open(period)
            except DeviceError:
                pass
            else:
                promise.holds(False, "both devices have opened the hardware, and each sends its own forces")
            promise.holds(np.isfinite(one.read()[0]).all(), "no reading after the second device was refused")
        finally:
            two.close()
            one.close()


# lengths of sampling intervals: one period, time differences rounded to multiples of the period, or time differences
INTERVALS = ("periods", "whole periods", "times")


def displays(features: Features) -> bool:
    """Return whether a device with the given features displays forces."""
    return features.continuous_force != 0.0


def unseen(wire: Wire, features: Features) -> Iterator[BlindSpot]:
    """Yield the promises of a device with the given features that cannot be checked with this emulator."""
    if wire.force is None and displays(features):
        yield BlindSpot(NEWTONS, "the emulator knows torques, but not the mechanism between motors and finger")
    if wire.position is None:
        yield BlindSpot(METRES, "the emulator does not know the mechanism: the kit checks only that motion is read")
    if "flip" in wire.kinds and not wire.checksum:
        yield BlindSpot(
            "a transmission error never moves a finger",
            "the line has no checksum: an error that is a plausible motion is accepted",
        )


class _Bench:
    """A device under test and the emulator to which it connects."""

    def __init__(self, device: Device, wire: Wire, period: float, force: float) -> None:
        self.device, self.wire, self.period = device, wire, period
        self.features: Features = device.features
        self.shape = self.features.fingers, self.features.dimensions
        peak = self.features.peak_force
        self.size = force if peak is None else min(force, 0.5 * peak)
        self.forces: FloatArray = np.full(self.shape, self.size / math.sqrt(self.shape[1]))

    def open(self) -> None:
        """Close the device, move the fingers to their initial positions, and open the device again."""
        self.device.close()
        self.wire.home()
        self.device.open(self.period)

    def tick(self, forces: FloatArray | None = None) -> tuple[FloatArray, FloatArray, float]:
        p, v, now = self.device.read()
        p, v = p.copy(), v.copy()
        self.device.write(np.zeros(self.shape) if forces is None else forces)
        return p, v, now

    @property
    def patience(self) -> float:
        """Time within which the emulator must react, at most half the time of the hardware's watchdog [s]."""
        watchdog = self.device.features.watchdog
        return PATIENCE if watchdog is None else min(PATIENCE, 0.5 * watchdog * self.wire.slowness)

    def push(self) -> None:
        """Write a small force until the motors have a torque."""
        there = self.becomes(lambda: bool(self.wire.torque.any()), lambda: self.tick(self.forces))
        if not there:
            raise DeviceError(f"{self.size} N are written, but the motors have no torque")

    def becomes(
        self, state: Callable[[], bool], act: Callable[[], Any] | None = None, within: float | None = None
    ) -> bool:
        """Return whether the emulator reaches a state within a time.

        Args:
            state: Function that returns whether the state is reached.
            act: Function that is called before each check, usually to tick the device; None for no calls.
            within: Time [s]; by default `PATIENCE` if `act` is given, and otherwise `patience`.
        """
        wait = within if within is not None else PATIENCE if act is not None else self.patience
        deadline, looks = self.wire.clock.now() + wait, 0
        while True:
            if act is not None:
                act()
            if state():
                return True
            looks += 1
            if self.wire.clock.now() > deadline and looks >= LOOKS:
                return False
            self.wire.clock.sleep(min(self.period, 1e-3))

    def place_error(self, seen: FloatArray) -> float:
        """Return the largest difference between the positions `seen` and the emulator's true positions [m]."""
        return float(np.abs(seen - np.asarray(self.wire.position, dtype=float)).max())

    def force_error(self, forces: FloatArray) -> float:
        """Return the largest difference between the emulator's forces and the written forces [N]."""
        return float(np.abs(np.asarray(self.wire.force, dtype=float) - forces).max())

    def is_quiet(self) -> bool:
        return not self.wire.torque.any()

    def falls_silent(self) -> bool:
        """Return whether all torques become zero within `patience`, and are still zero 5 ms later."""
        if not self.becomes(self.is_quiet, within=self.patience):
            return False
        self.wire.clock.sleep(0.005)
        return self.is_quiet()


def _check_motion(bench: _Bench, promises: Promises) -> None:
    device, wire = bench.device, bench.wire
    with promises("the motion of a finger is read") as promise:
        bench.open()
        least = 10.0 * (bench.features.resolution or 1e-5)
        start, _, began = bench.tick()
        readings: list[tuple[FloatArray, FloatArray, float]] = []
        wire.move()

        def look() -> None:
            readings.append(bench.tick())

        came = bench.becomes(lambda: bool((np.abs(readings[-1][0] - start).max(axis=1) > least).all()), look, MOTION)
        promise.holds(came, f"fingers were moved, but the reading is still {readings[-1][0].tolist()} m")
        position = wire.position
        if position is not None:
            bench.becomes(lambda: bench.place_error(readings[-1][0]) < least, look, MOTION)
    if position is not None:
        with promises(METRES) as promise:
            look()
            seen = readings[-1][0]
            promise.holds(
                bench.place_error(seen) <= NEAR,
                f"the reading is {seen.tolist()} m, but the fingers are at {np.asarray(wire.position).tolist()} m",
            )
            off = min(_reckoning(readings, began, bench.period, each, seen - start) for each in INTERVALS)
            promise.holds(off <= RECKONING, f"the integral of the velocities is off by {100 * off:.0f} %")
    with promises(SECONDS) as promise:
        first, began = bench.tick()[2], wire.clock.now()
        elapsed = 0.0
        while elapsed < 0.2:
            last, elapsed = bench.tick()[2], wire.clock.now() - began
            wire.clock.sleep(min(bench.period, 1e-3))
        ratio = (last - first) / elapsed
        off = min(abs(ratio - 1.0), abs(ratio * wire.slowness - 1.0))  # by the system's clock or by the hardware's
        promise.holds(off <= RECKONING, f"readings advance by {last - first} s in {elapsed:.3f} s")
    device.close()


def _reckoning(
    readings: Sequence[tuple[FloatArray, FloatArray, float]], began: float, period: float, intervals: str,
    way: FloatArray,
) -> float:  # fmt: skip
    """Integrate the velocities of readings; return the relative error of the displacement.

    Args:
        readings: Positions, velocities and times that were read.
        began: Time of the sample before the first reading [s].
        period: Sampling period [s].
        intervals: Length of the intervals, an entry of `INTERVALS`.
        way: True displacement [m].
    """
    path, before = np.zeros_like(way), began
    for _, velocity, now in readings:
        if now != before:
            since = period
            if intervals != "periods":
                since = now - before if intervals == "times" else period * max(1, round((now - before) / period))
            path = path + velocity * since
        before = now
    return float(np.linalg.norm(path - way) / np.linalg.norm(way))


def _check_forces(bench: _Bench, promises: Promises) -> None:
    device, wire = bench.device, bench.wire
    bench.open()
    with promises("a force reaches the wire, and half the force gives half the torque") as promise:
        bench.push()
        whole = _level(bench, bench.forces)
        half = _level(bench, 0.5 * bench.forces)
        off = float(np.abs(half - 0.5 * whole).max())
        promise.holds(
            off <= 2.0 * SHARE * np.abs(whole).max(),
            f"torques {whole.tolist()}, and {half.tolist()} for half the force",
        )
    if wire.force is not None:
        with promises(NEWTONS) as promise:
            for i in range(bench.shape[0]):
                for axis in range(bench.shape[1]):
                    f = np.zeros(bench.shape)
                    f[i, axis] = bench.size
                    near = max(SMALL, SHARE * bench.size)
                    same = bench.becomes(partial(_is_near, bench, f, near), partial(bench.tick, f))
                    finding = np.round(np.asarray(wire.force, dtype=float), 6).tolist()
                    promise.holds(same, f"the forces are {finding} N, but {f.tolist()} N were written")
    with promises(LIMIT) as promise:
        peak = bench.features.peak_force or 1.0
        levels = []
        for factor in (10.0, 1000.0):
            levels.append(_level(bench, factor * peak * bench.forces / bench.size))
            most = float(np.abs(levels[-1]).max())
            promise.holds(
                most <= wire.limit * (1.0 + 1e-6),
                f"a torque [N m] or force [N] of {most} on the wire, above its limit of {wire.limit}",
            )
        off = float(np.abs(levels[1] - levels[0]).max())
        promise.holds(
            off <= 0.1 * np.abs(levels[0]).max(),
            f"torques {levels[0].tolist()} at ten times the peak force and {levels[1].tolist()} at a thousand times",
        )
        if wire.force is not None and bench.features.peak_force is not None and not isinstance(device, LimitedDevice):
            norm = float(np.linalg.norm(wire.force, axis=1).max())
            promise.holds(norm <= peak * (1.0 + SHARE), f"a force of {norm} N, above its limit of {peak} N")
    device.close()


def _is_near(bench: _Bench, forces: FloatArray, most: float) -> bool:
    return bench.force_error(forces) <= most


def _level(bench: _Bench, forces: FloatArray) -> FloatArray:
    """Write constant forces for some samples, and return the torques of the motors [N m]."""
    for _ in range(5):
        bench.device.read()
        bench.device.write(forces)
        bench.wire.clock.sleep(min(bench.period, 1e-3))
    bench.wire.clock.sleep(min(0.01, 0.2 * bench.patience))
    return bench.wire.torque


def _check_zero(bench: _Bench, promises: Promises) -> None:
    device = bench.device
    with promises(ZERO) as promise:
        bench.open()
        bench.push()
        device.stop()
        promise.holds(bench.falls_silent(), f"torques {bench.wire.torque.tolist()} after `stop`")
        for name, leave in (
            ("`close`", device.close),
            ("the end of `with`", lambda: device.__exit__(None, None, None)),
        ):
            bench.open()
            bench.push()
            leave()
            promise.holds(bench.falls_silent(), f"torques {bench.wire.torque.tolist()} after {name}")
    with promises("an exception inside `with device` sets zero force") as promise:
        with suppress(_Interruption), device:
            bench.open()
            bench.push()
            raise _Interruption
        promise.holds(bench.falls_silent(), f"torques {bench.wire.torque.tolist()} after the exception")
    with promises(NOT_FINITE) as promise:
        for bad in (math.nan, math.inf, -math.inf):
            bench.open()
            bench.push()
            forces = bench.forces.copy()
            forces[0, 0] = bad
            with suppress(DeviceError):
                device.write(forces)
            promise.holds(bench.falls_silent(), f"torques {bench.wire.torque.tolist()} after {bad} N")
            device.close()


class _Interruption(Exception):
    """An exception in the program that uses the device."""


def _check_alone(bench: _Bench, promises: Promises) -> None:
    """Kill a process that displays a force, and check that the force is removed."""
    if not hasattr(os, "fork"):
        return
    with promises(ALONE) as promise:
        watchdog = _killed(bench, promise)
        _drop(bench, promise, watchdog)


def _drop(bench: _Bench, promise: Promise, watchdog: float | None) -> None:
    """Check that the force is removed after the driver has stopped writing: by a watchdog, or by `quench`.

    Args:
        watchdog: Time of the watchdog [s]; None if the hardware has none.
    """
    wait = PATIENCE if watchdog is None else PATIENCE + 2.0 * watchdog * bench.wire.slowness
    if bench.becomes(bench.is_quiet, within=wait):
        return
    promise.holds(watchdog is None, f"the watchdog did not remove the force after {watchdog} s")
    module = _driver(bench.device)
    promise.holds(
        module is not None,
        "the hardware has no watchdog, and the driver has no `quench(**settings)`: the force persists",
    )
    if module is not None:
        module.quench(**bench.wire.settings)
        promise.holds(bench.falls_silent(), f"torques {bench.wire.torque.tolist()} after `quench`")


def _killed(bench: _Bench, promise: Promise) -> float | None:
    """Start a process that opens the device and displays a force, and kill the process.

    Returns:
        Time of the device's watchdog [s]; None if the device has none.
    """
    bench.wire.home()
    ours, theirs = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # threads that the other process does not need
        process = os.fork()
    if process == 0:  # pragma: no cover (killed: nothing is counted)
        try:
            bench.device.open(bench.period)
            for _ in range(3):
                bench.tick(bench.forces)
            os.write(theirs, repr(bench.device.features.watchdog).encode())
            while True:
                bench.tick(bench.forces)
                bench.wire.clock.sleep(min(bench.period, 1e-3))
        finally:
            os._exit(1)
    os.close(theirs)
    try:
        answer = os.read(ours, 100).decode() if select.select([ours], [], [], LONGEST)[0] else ""
        promise.holds(answer, "the device cannot be opened and written to in another process")
        promise.holds(bench.becomes(lambda: not bench.is_quiet(), within=PATIENCE), "the motors have no torque")
    finally:
        os.close(ours)
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)
    return None if answer == "None" else float(answer)


def _driver(device: Device) -> QuenchableDriver | None:
    """Return the module of the device's class, or the innermost enclosing package, that has a function `quench`.

    None if there is no such function.
    """
    name = type(device).__module__
    while name:
        module: object = sys.modules.get(name)
        if isinstance(module, QuenchableDriver):
            return module
        name = name.rpartition(".")[0]
    return None


def _check_failure(bench: _Bench, promises: Promises, kind: Failure) -> None:
    device, wire = bench.device, bench.wire
    with promises(
        f"a failing wire ({kind}) yields the previous sample or DeviceError, never a wrong position"
    ) as promise:
        bench.open()
        for _ in range(5):
            place, _, before = bench.tick(bench.forces)
        wire.fail(kind)
        ticks, error = 0, None
        try:
            while ticks < TICKS:
                ticks += 1
                position, velocity, now = bench.tick(bench.forces)
                finite = np.isfinite(position).all() and np.isfinite(velocity).all()
                promise.holds(finite, f"position {position.tolist()} m, velocity {velocity.tolist()} m/s")
                away = float(np.abs(position - place).max())
                exact = wire.checksum or kind != "flip"
                promise.holds(not exact or away <= NEAR, f"the reading of a finger at rest is off by {away} m")
                promise.holds(
                    kind != "blocked" or now == before, f"the new time {now} s, although the board sends nothing"
                )
                most = float(np.abs(wire.torque).max())
                promise.holds(
                    most <= wire.limit * (1.0 + 1e-6),
                    f"a torque [N m] or force [N] of {most} on the wire, above its limit of {wire.limit}",
                )
        except DeviceError as trouble:
            error = trouble
        if kind == "unplugged":
            promise.holds(error is not None and ticks <= AT_ONCE, f"no DeviceError in {ticks} samples")
        began = wire.clock.now()
        device.close()
        spent = wire.clock.now() - began
        promise.holds(kind != "unplugged" or spent < QUICK, f"`close` took {spent:.3f} s")
        wire.heal()
        _drop(bench, promise, device.features.watchdog)
        bench.open()
        position, _, now = bench.tick()
        promise.holds(np.isfinite(position).all(), "no finite reading after the failure")
        device.close()
