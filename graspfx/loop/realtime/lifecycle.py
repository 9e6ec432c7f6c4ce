"""Life cycle of hardware in a run: choice of the loop, opening, the check that fingers are at rest, and closing."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from graspfx import log
from graspfx.compile.kernel_checks import foreign_kernels
from graspfx.errors import DeviceError, InputError
from graspfx.loop.arena import Arena
from graspfx.loop.device import CallsDevice, DrivingDevice, LimitedDevice, RawDevice, is_hardware
from graspfx.loop.device_exchange import DeviceExchange, DevicePort, device_name
from graspfx.loop.realtime.pacing import Clock, Pacer
from graspfx.loop.realtime.process import Interruption
from graspfx.loop.servo_parts import DeviceWiring
from graspfx.progress import waiting

FloatArray = NDArray[np.float64]

DURATION = 0.2  # shortest time during which devices are read before a run [s]
LEAST = 20  # smallest number of readings before a run
FRESH = 0.95  # fraction of the readings that must contain a new sample
STILL = 0.1  # largest speed of a finger at rest, from reported velocities and from positions [m/s]
SPAN = 0.01  # shortest time between two compared positions, which are at least four new samples apart [s]
DRIFT = 0.001  # largest displacement of a finger while a recording is opened [m]
SAME = 1e-6  # tolerance of the product of rate and period
HAS_NATIVE = sys.platform.startswith("linux")  # whether the system supports the loop without Python
DO = "hold the device still inside its workspace, and start again"


def require_simulations(hardware: Sequence[str]) -> None:
    """Raise InputError if a scene that is not run in real time has hardware.

    Args:
        hardware: Names of the devices in the scene that are not simulated.
    """
    if hardware:
        raise InputError(
            "real_time", False, "True: this scene has hardware, which needs real time",
            f"use graspfx run SCENE --real-time, or gx.run(scene, real_time=True); hardware: {', '.join(hardware)}",
        )  # fmt: skip


# Which loop -----------------------------------------------------------------------------------------------------------


def why_python(
    stations: Sequence[DeviceWiring], fingers: Sequence[str], engine: str, period: float, arena: Arena | None
) -> str:  # fmt: skip
    """Return the reason why Python runs between the ticks of a real-time run; empty if only machine code runs.

    Args:
        stations: Devices of the scene.
        fingers: Names of the fingers.
        engine: Name of the engine.
        period: Sampling period T [s].
        arena: Arena of the scene; None to consider only the devices.
    """
    hardware = [each for each in stations if is_hardware(each.device)]
    if not hardware:
        return "its devices are simulated"
    if not HAS_NATIVE:
        return f"the native loop needs Linux, and this system is {sys.platform}"
    if engine == "interpreted":
        return "the engine is 'interpreted'"
    if find_spec("llvmlite") is None:
        return "llvmlite is not installed"
    for station in hardware:
        why = _why_device(station, period)
        if why:
            return f"{device_name(station, fingers)} {why}"
    if len({each.device.thread for each in hardware if isinstance(each.device, DrivingDevice)}) > 1:
        return "two of its devices are called by the threads of different vendors' libraries"
    return "" if arena is None else _why_arena(arena, stations, fingers)


def _why_device(station: DeviceWiring, period: float) -> str:
    device, fitting = station.device, station.fitting
    if not isinstance(device, CallsDevice):
        return "offers no C functions (`calls`)"
    if isinstance(device, LimitedDevice):
        return "has a force limit that depends on position, which C functions cannot report"
    if fitting.deadman is not None or fitting.every > 1:
        return "has a deadman switch or a rate below that of the scene, which C functions do not support"
    if isinstance(device, RawDevice) or device.features.switches:
        return "reports switches or raw values, which C functions cannot report"
    rate = device.features.rate
    if isinstance(device, DrivingDevice) and (rate is None or abs(rate * period - 1.0) > SAME):
        return f"calls the loop itself, {rate or 0.0:g} times a second, but the scene's period is {period:g} s"
    return ""


def _why_arena(arena: Arena, stations: Sequence[DeviceWiring], fingers: Sequence[str]) -> str:
    for port in arena.ports:
        if not is_hardware(stations[port.station].device):
            return f"{device_name(stations[port.station], fingers)} is simulated in plain Python"
    for part, plain in (
        ("a hand", arena.tables), ("a plant", arena.plants), ("a body", arena.bodies), ("a body", arena.guests)
    ):  # fmt: skip
        if plain:
            return f"{part} is moved by plain Python or other software"
    if foreign_kernels({str(i): each.kernel for i, each in enumerate(arena.foreign)}):
        return "third-party kernels are interpreted and checked in the first ticks"
    return ""


def loop_text(why: str, stations: Sequence[DeviceWiring]) -> str:
    """Return the kind of the loop of a real-time run, and the reason why this kind is used.

    Args:
        why: Reason why Python runs between the ticks; empty if only machine code runs.
        stations: Devices of the scene.
    """
    if why:
        return f"process: Python runs between two ticks, because {why}"
    if any(isinstance(each.device, DrivingDevice) for each in stations):
        return "driven: the thread of a device's vendor calls the loop, because every device offers C functions"
    return "native: machine code only, because every device offers C functions"


# Open -----------------------------------------------------------------------------------------------------------------


@contextmanager
def opened(devices: DeviceExchange, period: float) -> Iterator[None]:
    """Open the devices one after another; on exit, first stop all devices, then close all devices.

    If a device cannot be closed, a warning is issued.

    Raises:
        DeviceError: If a device cannot be opened; this device and all devices that are open are stopped and closed.
    """
    begun = DeviceExchange([])
    begun.exits = devices.exits
    try:
        for each in devices.ports:
            begun.ports.append(each)
            devices.exits.inside = True
            try:
                with waiting(f"opening {each.name}"):
                    text = each.open(period)
            finally:
                devices.exits.inside = False
            if text:
                raise DeviceError(text)
        yield
    finally:
        try:
            begun.stop()
        finally:
            for text in begun.close():
                log.warn(text)


# Rest -----------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Rest:
    """State of hardware whose fingers are at rest.

    Attributes:
        positions: Position (d,) [m] of each finger that hardware moves, by the index of the finger in the scene.
        round_trip: Median of the time to read and write all devices [s].
        fresh: Fraction of readings that contain a new sample, of the device for which it is smallest.
    """

    positions: dict[int, FloatArray]
    round_trip: float
    fresh: float


def settle(devices: DeviceExchange, period: float, clock: Clock) -> Rest:
    """Read the devices at zero force for at least 0.2 s and 20 readings, and check that all fingers are at rest.

    Raises:
        DeviceError: If a device cannot be read or written, a finger moves or is outside its workspace, too few readings
            contain a new sample, or a deadman switch is released.
        Interruption: If a signal arrives.
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
    return Rest(positions(devices), float(np.median(trips)), min(fresh))


def look_again(devices: DeviceExchange, rest: Rest, periods: int) -> dict[int, FloatArray]:
    """Read the devices again, and return the positions of their fingers, by index.

    Args:
        devices: Devices, whose fingers were at rest.
        rest: Result of `settle`.
        periods: Number of sampling periods since the last reading.

    Raises:
        DeviceError: If a reading is invalid, a deadman switch is released, or a finger has moved by more than 1 mm.
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
    """Return the last position (d,) [m] of each finger in the scene's coordinates, by the index of the finger."""
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
    """Compute the largest speed along an axis [m/s] from pairs of positions and times [periods]."""
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
        f"{device.name} had a new sample in {fresh:.0%} of its readings, expected at least {FRESH:.0%}; use a "
        "longer period or a faster device"
    )


def _up(device: DevicePort) -> str:
    if not device.is_up:
        return ""
    return f"{device.name} has its deadman switch {device.fitting.deadman} released: hold it down and start again"


def _outside(device: DevicePort) -> str:
    if device.workspace is None:
        return ""
    lower, upper = device.workspace
    position = device.readings.position
    if ((lower <= position) & (position <= upper)).all():
        return ""
    corners = f"{lower.tolist()} to {upper.tolist()} m"
    return f"{device.name} is outside its workspace, {corners}, at {position.tolist()} m; {DO}"
