"""Conformance of devices: checks of the observable part of the protocol, and a report of what cannot be observed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from os import PathLike
from types import ModuleType
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx import plugins
from graspfx.errors import DeviceError, InputError
from graspfx.loop.device import Device, Features, LimitedDevice, SimulatedDevice
from graspfx.loop.hand import Hand
from graspfx.loop.plant import Plant
from graspfx.testing.promise import (
    ALWAYS,
    FORCELESS,
    HARDWARE,
    NO_LIMIT,
    NOT_NEWTONS,
    ONE_DEVICE,
    PERSON,
    SIMULATED,
    BlindSpot,
    DeviceReport,
    Promise,
    Promises,
)
from graspfx.testing.wire_promises import check_second, check_wire, displays, unseen

if TYPE_CHECKING:
    from graspfx.testing.wire import Wire

FloatArray = NDArray[np.float64]

TICKS = 20
PULL = 1e-3  # displacement by which a hand pulls a simulated finger [m]
ROUNDING = 1e-9  # tolerance of positions [m]; relative tolerance of other quantities


def driver(name: str | PathLike[str]) -> ModuleType:
    """Import a driver: a module with a function `connect(**settings)` that returns a `graspfx.protocols.Device`.

    Args:
        name: Name of a built-in or installed driver, or path of a .py file.

    Raises:
        UnknownNameError: If there is no driver with the given name.
        InputError: If there is no file with the given path.
        PluginError: If the file cannot be imported.
    """
    return plugins.load_blaming("devices", name)


def check_device(
    device: Device | Callable[[], Device],
    wire: Wire | None = None,
    *,
    period: float = 0.005,
    force: float = 0.1,
    start: ArrayLike | None = None,
) -> DeviceReport:
    """Check the observable promises of a `graspfx.protocols.Device`.

    For every device, the function checks

    - the features before `open`, where unknown features are None,
    - that positions and velocities have the right shape, are finite, and are the device's own arrays,
    - that the time does not decrease,
    - that forces are accepted, and that a non-finite force raises DeviceError,
    - `stop`, repeated `close`, and the context manager.

    The function cannot observe the actuators or the units of numbers. A driver of hardware passes even if it does not
    limit the force, does not remove the force in `stop`, or reports positions in millimetres.

    For a simulated device, the function also checks

    - that each force acts on its own finger and moves the finger in the force's direction,
    - that the force limit holds, if the device reports one,
    - that no force remains after a non-finite force, `stop` or `close`,
    - that the device does not move without a force or a hand, and that a hand moves it,
    - that two runs are identical,
    - if `device` is a function and `wire` is None, that two devices in one process are independent.

    If a wire, which is an emulator of the hardware, is given, the function also checks

    - that the motors have zero force after `stop`, `close`, an exception or a non-finite force,
    - the force limit,
    - that times are in seconds and, if the emulator knows the mechanism, that positions are in metres and forces in
      newtons,
    - that a watchdog or the driver's `quench` removes the force after the program is killed,
    - the response of the driver to each failure of the wire,
    - if `device` is a function, that hardware in use is refused to a second device.

    These checks take some seconds.

    Args:
        device: Device that is not open, or a function without arguments that creates such a device. The device is
            closed afterwards.
        wire: Emulator from `graspfx.testing.wire`, inside its `with` block, to which the device connects by the
            emulator's `settings`; None to check without an emulator.
        period: Sampling period [s].
        force: Magnitude of the written forces [N], reduced to half the reported peak force if it is larger. Only
            simulated devices and emulators also receive larger forces.
        start: Initial positions of the fingers of a simulated device (k, d) or (d,) [m]; by default the middle of the
            workspace, or zero for a device without a workspace.

    Returns:
        Report that lists for each promise whether it is kept, cannot be observed, or needs a person.

    Raises:
        ConformanceError: If the device breaks a promise.
    """
    promises = Promises("device")
    factory = not hasattr(device, "open") or isinstance(device, type)
    if factory and not callable(device):
        raise InputError("device", device, "a device, or a function that creates one")
    make = cast("Callable[[], Device]", device)
    bench = _check_one(make() if factory else cast("Device", device), promises, period, force, start)
    if factory and wire is None:
        _check_two(make(), make(), promises, period, force, start)
    if wire is not None:
        check_wire(bench.device, wire, promises, period, force)
        if factory:
            check_second(make(), make(), promises, period)
    seen = () if wire is None else unseen(wire, bench.features)
    hidden = [*_blind_spots(bench, factory=factory or wire is not None), *seen]
    return DeviceReport(
        tuple(promises.texts),
        tuple(each for each in hidden if each.promise not in promises.texts),
        () if bench.plant is not None else PERSON if displays(bench.features) else PERSON[1:2],
    )


def _blind_spots(bench: _Bench, *, factory: bool) -> Iterator[BlindSpot]:
    if bench.plant is None:
        yield from HARDWARE if displays(bench.features) else FORCELESS
    else:
        yield from SIMULATED
        if bench.features.peak_force is None:
            yield NO_LIMIT
        if not bench.newtons:
            yield NOT_NEWTONS
    if not factory:
        yield ONE_DEVICE
    yield from ALWAYS


class _Bench:
    """A device under test; the plant of a simulated device is created and placed at the initial positions."""

    def __init__(self, device: Device, promises: Promises, period: float, start: ArrayLike | None) -> None:
        self.device, self.promises, self.period = device, promises, period
        self.features = _check_features(device, promises)
        self.shape = self.features.fingers, self.features.dimensions
        self.start = _start(self.features, start)
        self.plant: Plant | None = None
        self.newtons = True  # whether efforts are forces, as far as known
        if isinstance(device, SimulatedDevice):
            with promises(
                "a simulated device has `plant(devices)`, which moves its fingertips from where they are placed"
            ):
                self.plant = type(device).plant([device])
                self.plant.place(self.start)

    @property
    def effort(self) -> FloatArray:
        return np.array(cast("SimulatedDevice", self.device).effort, dtype=float)

    def hand(self, stiffness: float = 0.0, damping: float = 0.0, pull: float = 0.0) -> Hand:
        return Hand(self.start + pull, stiffness, damping)

    def tick(self, forces: FloatArray, hand: Hand | None = None) -> None:
        self.device.read()
        self.device.write(forces)
        if self.plant is not None:
            self.plant.advance(self.effort, hand or self.hand(), self.period)

    def hold(self, forces: FloatArray) -> FloatArray:
        """Write forces for as many samples as the device's delay plus one, and return the actuators' efforts."""
        for _ in range((self.features.delay or 0) + 1):
            self.device.write(forces)
        return self.effort

    def push(self, size: float, finger: int | None = None) -> FloatArray:
        """Return forces of magnitude `size` [N] along the first axis, on one finger or, if it is None, on all."""
        f = np.zeros(self.shape)
        f[slice(None) if finger is None else finger, 0] = size
        return f


def _check_features(device: Device, promises: Promises) -> Features:
    """Check and return the features of a device that is not open."""
    with promises("features are reported before `open`, and unknown ones are None, never zero") as promise:
        features = device.features
        k, d = features.fingers, features.dimensions
        promise.holds(_whole(k) and k >= 1, f"fingers = {k!r}, expected a positive integer")
        promise.holds(_whole(d) and 1 <= d <= 3, f"dimensions = {d!r}, expected 1, 2 or 3")
        for name in ("continuous_force", "peak_force", "stiffness", "mass", "resolution", "watchdog", "rate"):
            value = getattr(features, name)
            nothing = name == "continuous_force" and value == 0.0 and features.peak_force is None
            good = value is None or nothing or (math.isfinite(value) and value > 0.0)
            promise.holds(good, f"{name} = {value!r}")
        for name in ("damping", "friction", "latency", "lateness"):
            value = getattr(features, name)
            promise.holds(value is None or (math.isfinite(value) and value >= 0.0), f"{name} = {value!r}")
        delay = features.delay
        promise.holds(
            delay is None or (_whole(delay) and delay >= 0), f"delay = {delay!r}, expected a number of samples or None"
        )
        if features.continuous_force is not None and features.peak_force is not None:
            finding = f"continuous_force {features.continuous_force} N above peak_force {features.peak_force} N"
            promise.holds(features.continuous_force <= features.peak_force, finding)
        if features.workspace is not None:
            lower, upper = (np.asarray(corner, dtype=float) for corner in features.workspace)
            promise.holds(
                lower.shape == upper.shape == (d,) and np.isfinite((lower, upper)).all() and (lower < upper).all(),
                f"workspace = {features.workspace!r}, expected a lower and an upper corner ({d},)",
            )
    return features


def _whole(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _check_one(device: Device, promises: Promises, period: float, force: float, start: ArrayLike | None) -> _Bench:
    bench = _Bench(device, promises, period, start)
    if bench.features.peak_force is not None:
        force = min(force, 0.5 * bench.features.peak_force)
    with bench.promises("`with device` returns the device itself") as promise:
        promise.holds(device.__enter__() is device, "another object")
    same = False
    try:
        with bench.promises("`open(period)` makes the device ready"):
            device.open(period)
        _check_reading(bench)
        _check_ticks(bench)
        if bench.plant is not None:
            _check_efforts(bench, force)
            _check_motion(bench, force)
        _check_stop(bench, force)
        _check_not_finite(bench, force)
        _check_close(bench)
        same = True
    finally:
        if not same:
            with suppress(Exception):  # the broken promise is reported instead
                device.close()
    return bench


def _check_reading(bench: _Bench) -> None:
    with bench.promises("`read` returns finite positions and velocities (fingers, dimensions), and a time") as promise:
        reading: Any = bench.device.read()
        promise.holds(isinstance(reading, tuple) and len(reading) == 3, f"{reading!r}, expected a tuple of three")
        for name, value in zip(("positions", "velocities"), reading[:2], strict=True):
            promise.holds(isinstance(value, np.ndarray), f"{name} of type {type(value).__name__}, expected an array")
            promise.holds(value.shape == bench.shape, f"{name} of shape {value.shape}, expected {bench.shape}")
            promise.holds(value.dtype == np.float64, f"{name} of type {value.dtype}, expected float64")
            promise.holds(np.isfinite(value).all(), f"non-finite {name}")
        time: Any = reading[2]
        promise.holds(isinstance(time, float) and math.isfinite(time), f"the time {time!r}")
    with bench.promises("positions and velocities are the device's own arrays") as promise:
        promise.holds(not np.shares_memory(reading[0], reading[1]), "both are in one array")
        if bench.plant is not None:
            true = bench.plant.position, bench.plant.velocity
            shared = any(np.shares_memory(ours, its) for ours in reading[:2] for its in true)
            promise.holds(not shared, "arrays of the plant's true motion, so that a caller could change the motion")

    if isinstance(bench.device, LimitedDevice):
        with Promise("`largest_force` is a positive force for each finger at its last reading") as promise:
            largest = np.asarray(bench.device.largest_force, dtype=float)
            promise.holds(largest.shape == bench.shape[:1], f"shape {largest.shape}, expected {bench.shape[:1]}")
            promise.holds((largest > 0.0).all(), f"{largest.tolist()} N")


def _check_ticks(bench: _Bench) -> None:
    with bench.promises("`read` and `write` work once per period, and the time never decreases") as promise:
        last = -math.inf
        for _ in range(TICKS):
            bench.tick(np.zeros(bench.shape))
            p, v, time = bench.device.read()
            promise.holds(np.isfinite(p).all() and np.isfinite(v).all(), "non-finite positions or velocities")
            promise.holds(time >= last, f"the time {time} s after the time {last} s")
            last = time
    if bench.plant is not None:
        with bench.promises("the time of a simulated device is the number of ticks times the period") as promise:
            bench.plant.place(bench.start)
            for k in range(TICKS):
                time = bench.device.read()[2]
                promise.holds(abs(time - k * bench.period) <= ROUNDING * bench.period, f"{time} s at tick {k}")
                bench.tick(np.zeros(bench.shape))


def _check_efforts(bench: _Bench, force: float) -> None:
    k, limit = bench.features.fingers, bench.features.peak_force
    with bench.promises("a zero force causes no effort, and a non-zero force causes an effort") as promise:
        promise.holds(not bench.hold(np.zeros(bench.shape)).any(), "an effort for zero force")
        effort = bench.hold(bench.push(force))
        promise.holds(effort.shape == bench.shape, f"efforts of shape {effort.shape}, expected {bench.shape}")
        promise.holds(effort.any(axis=1).all(), f"no effort on a finger with {force} N")
        bench.newtons = np.allclose(effort, bench.push(force), rtol=ROUNDING, atol=0.0)
    with bench.promises("each finger receives its own force, even if the forces sum to zero") as promise:
        for i in range(k):
            effort = bench.hold(bench.push(force, i))
            others = np.delete(effort, i, axis=0)
            promise.holds(
                effort[i].any() and not others.any(), f"efforts {effort.tolist()} for a force on finger {i} alone"
            )
        if k > 1:
            squeeze = bench.push(force, 0) + bench.push(-force, 1)
            effort = bench.hold(squeeze)
            promise.holds(effort[0].any() and effort[1].any(), "no effort for a symmetric squeeze")
    if limit is not None:
        with bench.promises("the device applies the force limit last") as promise:
            effort, more = bench.hold(bench.push(10.0 * limit)), bench.hold(bench.push(100.0 * limit))
            finding = f"efforts {effort.tolist()} for ten times the peak force and {more.tolist()} for a hundred times"
            promise.holds(np.allclose(effort, more, rtol=ROUNDING, atol=0.0), finding)
            norm = float(np.linalg.norm(effort, axis=1).max())
            promise.holds(
                not bench.newtons or norm <= limit * (1.0 + ROUNDING), f"{norm} N, above the limit of {limit} N"
            )
    bench.device.stop()


def _check_motion(bench: _Bench, force: float) -> None:
    plant = cast("Plant", bench.plant)
    with bench.promises("`place` of the plant sets positions, sets zero velocities, and keeps the arrays") as promise:
        position, velocity = plant.position, plant.velocity
        promise.holds(position.shape == velocity.shape == bench.shape, f"shape {position.shape}, not {bench.shape}")
        bench.tick(bench.push(force))
        plant.place(bench.start)
        promise.holds(plant.position is position and plant.velocity is velocity, "`place` has replaced the arrays")
        away = float(np.abs(position - bench.start).max())
        promise.holds(away <= ROUNDING and not velocity.any(), f"positions off by {away} m, velocities {velocity} m/s")
    with bench.promises("positions are read to the reported resolution") as promise:
        error = float(np.abs(bench.device.read()[0] - plant.position).max())
        promise.holds(error <= 2.0 * (bench.features.resolution or 0.0) + ROUNDING, f"positions are {error} m off")
    with bench.promises("without a force or a hand, the device does not move") as promise:
        _run(bench, TICKS, np.zeros(bench.shape))
        away = float(np.abs(plant.position - bench.start).max())
        promise.holds(away <= ROUNDING, f"the device moved by {away} m; set `start` to an equilibrium position")
    with bench.promises("a force moves its own finger, in its direction") as promise:
        for i in range(bench.features.fingers):
            _run(bench, TICKS + (bench.features.delay or 0), bench.push(force, i))
            motion = plant.position - bench.start
            promise.holds(motion[i, 0] > 0.0, f"finger {i} moved by {motion[i, 0]} m under {force} N")
            away = float(np.abs(np.delete(motion, i, axis=0)).max(initial=0.0))
            promise.holds(away <= ROUNDING, f"fingers other than {i} moved by {away} m")
    with bench.promises("a hand pulls the fingertips to their intended positions") as promise:
        for stiffness in (50.0, 500.0, 5000.0):  # a spring in the device resists a soft hand
            hand = bench.hand(stiffness, 0.1 * stiffness, PULL)
            _run(bench, round(1.0 / bench.period), np.zeros(bench.shape), hand)
            left = float(np.abs(plant.position - bench.start - PULL).max())
            if left < 0.5 * PULL:
                break
        finding = f"{left} m of {PULL} m remain after 1 s with a hand of {stiffness:g} N/m"
        promise.holds(left < 0.5 * PULL, finding)
    with bench.promises("two runs are identical, bit for bit") as promise:
        runs = [_run(bench, TICKS, bench.push(force), bench.hand(50.0, 1.0, PULL)) for _ in range(2)]
        promise.holds(
            np.array_equal(runs[0], runs[1]),
            "the second run moves differently: reset all state in `open`, and give random numbers a fixed seed",
        )


def _run(bench: _Bench, ticks: int, forces: FloatArray, hand: Hand | None = None) -> FloatArray:
    """Place the plant, open the device, and simulate it with constant forces.

    Returns:
        All positions and velocities that were read, and the final true position and velocity, in one array.
    """
    plant, rows = cast("Plant", bench.plant), []
    bench.device.close()
    plant.place(bench.start)
    bench.device.open(bench.period)
    hand = hand or bench.hand()
    for _ in range(ticks):
        bench.tick(forces, hand)
        p, v, _ = bench.device.read()
        rows.append((p.copy(), v.copy()))
    return np.concatenate([np.ravel(rows), plant.position.ravel(), plant.velocity.ravel()])


def _check_not_finite(bench: _Bench, force: float) -> None:
    promise_ = "is displayed as zero and raises" if bench.plant is not None else "raises"
    with bench.promises(f"a non-finite force {promise_} DeviceError") as promise:
        for bad in (math.nan, math.inf, -math.inf):
            for i in range(bench.features.fingers):
                _refused(bench.device, bench.push(force))  # a force that must not persist; a fault may refuse it
                forces = bench.push(force)
                forces[i, -1] = bad
                for _ in range((bench.features.delay or 0) + 1):
                    promise.holds(_refused(bench.device, forces), f"{bad} on finger {i} was accepted")
                if bench.plant is not None:
                    promise.holds(not bench.effort[i].any(), f"the effort {bench.effort[i].tolist()} after {bad}")
                bench.device.stop()


def _refused(device: Device, forces: FloatArray) -> bool:
    try:
        device.write(forces)
    except DeviceError:
        return True
    return False


def _check_stop(bench: _Bench, force: float) -> None:
    promise_ = "sets zero force at once, even when" if bench.plant is not None else "returns, even when"
    with bench.promises(f"`stop` {promise_} called again") as promise:
        bench.device.write(bench.push(force))
        for _ in range(2):
            bench.device.stop()
            promise.holds(bench.plant is None or not bench.effort.any(), "an effort after `stop`")


def _check_close(bench: _Bench) -> None:
    promise_ = "removes the force, and returns even when" if bench.plant is not None else "returns, even when"
    with bench.promises(f"`close` {promise_} called again") as promise:
        bench.device.close()
        promise.holds(bench.plant is None or not bench.effort.any(), "an effort after `close`")
        bench.device.close()
    with bench.promises("the end of `with device` propagates exceptions") as promise:
        error = DeviceError("an error inside `with`")
        promise.holds(not bench.device.__exit__(DeviceError, error, None), "`__exit__` suppressed the exception")  # type: ignore[func-returns-value]


def _check_two(a: Device, b: Device, promises: Promises, period: float, force: float, start: ArrayLike | None) -> None:
    simulated = isinstance(a, SimulatedDevice)
    promise_ = "are independent" if simulated else "share no arrays, and one still reads after the other is closed"
    with promises(f"two devices of one kind in one process {promise_}") as promise:
        promise.holds(a is not b, "the factory returned the same device twice")
        one, two = _Bench(a, promises, period, start), _Bench(b, promises, period, start)
        try:
            a.open(period)
            b.open(period)
            arrays = a.read()[:2], b.read()[:2]
            shared = any(np.shares_memory(x, y) for x in arrays[0] for y in arrays[1])
            promise.holds(not shared, "`read` of both devices returns the same arrays")
            if one.plant is not None and two.plant is not None:
                _check_two_moving(promise, one, two, force)
            a.close()
            two.tick(np.zeros(two.shape))
            promise.holds(np.isfinite(b.read()[0]).all(), "one device has no reading after the other was closed")
        finally:
            a.close()
            b.close()


def _check_two_moving(promise: Promise, one: _Bench, two: _Bench, force: float) -> None:
    if one.features.peak_force is not None:
        force = min(force, 0.5 * one.features.peak_force)
    promise.holds(
        one.hold(one.push(force)).any() and not two.effort.any(),
        "a force on one device causes an effort of the other device, or no effort of its own device",
    )
    _run(one, TICKS, one.push(force))
    away = float(np.abs(cast("Plant", two.plant).position - two.start).max())
    promise.holds(away <= ROUNDING, f"a force on one device moved the other by {away} m")


def _start(features: Features, start: ArrayLike | None) -> FloatArray:
    shape = features.fingers, features.dimensions
    if start is None:
        middle = 0.0 if features.workspace is None else 0.5 * (features.workspace[0] + features.workspace[1])
        return np.array(np.broadcast_to(middle, shape))
    at = np.array(start, dtype=float)
    if at.shape not in (shape, shape[1:]) or not np.isfinite(at).all():
        raise InputError("start", start, f"finite positions [m] of shape {shape}, or {shape[1:]} for all fingers")
    return np.array(np.broadcast_to(at, shape))
