"""The life of hardware in a run: which loop it has, how it is opened, how it is known to be at rest, and its end."""

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
from graspfx.loop.device import LimitedDevice, RawDevice, is_hardware
from graspfx.loop.device_calls import CallsDevice, DrivingDevice
from graspfx.loop.device_exchange import DeviceExchange, DevicePort, device_name
from graspfx.loop.parts import DeviceWiring
from graspfx.loop.realtime.pacing import Clock, Pacer
from graspfx.loop.realtime.process import Interruption
from graspfx.progress import waiting

FloatArray = NDArray[np.float64]

DURATION = 0.2  # [s], and
LEAST = 20  # readings
FRESH = 0.95  # part of the readings that bring a new sample
STILL = 0.1  # the fastest that a finger at rest is, by its velocity and by its positions [m/s]
SPAN = 0.01  # from one of these positions to the next, and four new readings at least [s]
DRIFT = 0.001  # the farthest that one goes while a recording is opened [m]
SAME = 1e-6  # of a period and a rate
HAS_NATIVE = sys.platform.startswith("linux")  # whether the system has what the loop without Python asks of it
DO = "hold the device still within its workspace, and start again"


def require_simulations(hardware: Sequence[str]) -> None:
    """Refuse hardware in a run that is not on the wall's clock.

    Args:
        hardware: the scene's devices that are no simulations, by name.

    Raises:
        InputError: there is one.
    """
    if hardware:
        raise InputError(
            "real_time", False, "True: this scene has hardware; its clock is the wall's",
            f"run it with graspfx run SCENE --real-time, or gx.run(scene, real_time=True); it is {', '.join(hardware)}",
        )  # fmt: skip


# Which loop -----------------------------------------------------------------------------------------------------------


def why_python(
    stations: Sequence[DeviceWiring], fingers: Sequence[str], engine: str, period: float, arena: Arena | None
) -> str:  # fmt: skip
    """Say why Python runs between two ticks of a scene on the wall's clock; nothing if machine code runs alone.

    Args:
        stations: the scene's devices.
        fingers: by name.
        engine: by name.
        period: T [s].
        arena: of the scene; None for what the devices say alone.
    """
    hardware = [each for each in stations if is_hardware(each.device)]
    if not hardware:
        return "its devices are simulated"
    if not HAS_NATIVE:
        return f"a loop of machine code alone is for Linux, and this is {sys.platform}"
    if engine == "interpreted":
        return "the engine is 'interpreted'"
    if find_spec("llvmlite") is None:
        return "llvmlite is not installed"
    for station in hardware:
        why = _why_device(station, period)
        if why:
            return f"{device_name(station, fingers)} {why}"
    if len({each.device.thread for each in hardware if isinstance(each.device, DrivingDevice)}) > 1:
        return "two of its devices have clocks of their own"
    return "" if arena is None else _why_arena(arena, stations, fingers)


def _why_device(station: DeviceWiring, period: float) -> str:
    device, fitting = station.device, station.fitting
    if not isinstance(device, CallsDevice):
        return "offers no C functions (`calls`)"
    if isinstance(device, LimitedDevice):
        return "has a largest force that depends on where it stands, which C functions do not tell"
    if fitting.deadman is not None or fitting.every > 1:
        return "has a deadman or a rate in the scene, which C functions do not know"
    if isinstance(device, RawDevice) or device.features.switches:
        return "tells switches or raw numbers, which C functions do not"
    rate = device.features.rate
    if isinstance(device, DrivingDevice) and (rate is None or abs(rate * period - 1.0) > SAME):
        return f"has the clock and calls {rate or 0.0:g} times a second, and the scene's period is {period:g} s"
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
        return "kernels of others are checked in the first ticks"
    return ""


def loop_text(why: str, stations: Sequence[DeviceWiring]) -> str:
    """Say which loop a run on the wall's clock has, and why.

    Args:
        why: Python runs in it; empty if it does not.
        stations: the scene's devices.
    """
    if why:
        return f"process: Python runs between two ticks, because {why}"
    if any(isinstance(each.device, DrivingDevice) for each in stations):
        return "driven: in the thread of a device's maker, which has the clock; every device offers C functions"
    return "native: machine code alone, because every device offers C functions"


# Open -----------------------------------------------------------------------------------------------------------------


@contextmanager
def opened(devices: DeviceExchange, period: float) -> Iterator[None]:
    """Open devices one after another; in the end stop them all, then close them all.

    A device that cannot be closed is told by a warning: what it displayed was zero by then.

    Raises:
        DeviceError: a device that does not open; those before it are closed.
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
    return Rest(positions(devices), float(np.median(trips)), min(fresh))


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
