"""Settling of hardware: a fifth of a second at zero force, in which all that a run relies on is seen to be so."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import median

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import DeviceError
from graspfx.loop.device_exchange import DeviceExchange, DevicePort
from graspfx.loop.realtime.exits import Interruption
from graspfx.loop.realtime.pacing import Clock, Pacer

FloatArray = NDArray[np.float64]

DURATION = 0.2  # [s], and
LEAST = 20  # readings
FRESH = 0.95  # part of the readings that bring a new sample
STILL = 0.1  # the fastest that a finger at rest is, by its velocity and by its positions [m/s]
SPAN = 0.01  # from one of these positions to the next, and four new readings at least [s]
DRIFT = 0.001  # the farthest that one goes while a recording is opened [m]
DO = "hold the device still within its workspace, and start again"


@dataclass(frozen=True)
class Rest:
    """Hardware at rest.

    Attributes:
        positions: of each finger that hardware moves, by its number in the scene, (d,) [m].
        round_trip: of a reading and a writing of all devices, the median [s].
        fresh: part of the readings that brought a new sample, the least of the devices.
    """

    positions: dict[int, FloatArray]
    round_trip: float
    fresh: float


def settle(devices: DeviceExchange, period: float, clock: Clock) -> Rest:
    """Read devices at zero force until they are known to be at rest.

    Raises:
        DeviceError: a reading that is a fault, a finger that moves or is outside its workspace, or too few samples.
    """
    pacer, trips = Pacer(period, clock), list[float]()
    count = max(LEAST, math.ceil(DURATION / period))
    fastest = [0.0] * len(devices.ports)
    now, tracks = 0, [list[tuple[int, FloatArray]]() for _ in devices.ports]
    first = [each.readings.samples for each in devices.ports]
    for each in devices.ports:
        each.port.command[...] = 0.0
        each.watches = False
    for _ in range(count):
        skipped = pacer.wait(lambda: bool(devices.exits.numbers))
        if devices.exits.numbers:
            raise Interruption(devices.exits.cause)
        began = clock.now()
        _require(devices.read(1 + skipped))
        _require([devices.write()])
        trips.append(clock.now() - began)
        now += 1 + skipped
        for i, each in enumerate(devices.ports):
            fastest[i] = max(fastest[i], float(np.abs(each.readings.velocity).max()))
            if each.readings.is_fresh:
                tracks[i].append((now, each.readings.position.copy()))
    fresh = [
        (each.readings.samples - n) * each.fitting.every / count for each, n in zip(devices.ports, first, strict=True)
    ]
    for each, speed, track, part in zip(devices.ports, fastest, tracks, fresh, strict=True):
        _require([_moving(each, max(speed, _speed(track, period))), _outside(each), _late(each, part), _up(each)])
        each.watches = True
    return Rest(positions(devices), median(trips), min(fresh))


def look_again(devices: DeviceExchange, rest: Rest, periods: int) -> dict[int, FloatArray]:
    """Read devices once more, so many periods after they settled; give where their fingers are.

    Raises:
        DeviceError: a finger has gone elsewhere.
    """
    _require(devices.read(periods))
    _require([_up(each) for each in devices.ports])
    current = positions(devices)
    for each in devices.ports:
        for finger in each.fingers:
            away = float(np.linalg.norm(current[finger] - rest.positions[finger]))
            if away > DRIFT:
                _require([f"{each.name} was moved by {1e3 * away:.1f} mm before the run began; {DO}"])
    return current


def positions(devices: DeviceExchange) -> dict[int, FloatArray]:
    """Give the last position of each finger, by its number."""
    return {
        finger: each.places[channel].copy()
        for each in devices.ports
        for channel, finger in enumerate(each.channels)
        if finger >= 0
    }


def _require(faults: list[str]) -> None:
    for text in faults:
        if text:
            raise DeviceError(text)


def _speed(track: list[tuple[int, FloatArray]], period: float) -> float:
    """Find the fastest motion along an axis by positions at their periods, whatever velocity a driver tells [m/s]."""
    pairs = zip(track, track[max(4, math.ceil(SPAN / period)) :], strict=False)
    return max((float(np.abs(q - p).max()) / ((m - k) * period) for (k, p), (m, q) in pairs), default=0.0)


def _moving(device: DevicePort, speed: float) -> str:
    if speed <= STILL:
        return ""
    return f"{device.name} moves at {speed:.3g} m/s before the run, expected at most {STILL:g} m/s; {DO}"


def _late(device: DevicePort, fresh: float) -> str:
    if fresh >= FRESH:
        return ""
    return (
        f"{device.name} had a new sample in {fresh:.0%} of its readings, expected at least {FRESH:.0%}; make the "
        "period longer, or the device faster"
    )


def _up(device: DevicePort) -> str:
    if not device.is_up:
        return ""
    return f"{device.name} has its deadman, switch {device.fitting.deadman}, up: keep it down, and start again"


def _outside(device: DevicePort) -> str:
    if device.workspace is None:
        return ""
    lower, upper = device.workspace
    position = device.readings.position
    if ((lower <= position) & (position <= upper)).all():
        return ""
    corners = f"{lower.tolist()} to {upper.tolist()} m"
    return f"{device.name} is outside its workspace, {corners}, at {position.tolist()} m; {DO}"
