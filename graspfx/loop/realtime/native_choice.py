"""The choice between a loop of machine code alone and one of Python."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.util import find_spec

from graspfx.compile.kernel_checks import foreign_kernels
from graspfx.loop.arena import Arena
from graspfx.loop.device import LimitedDevice, RawDevice, is_hardware
from graspfx.loop.device_calls import CallsDevice, DrivingDevice
from graspfx.loop.device_exchange import device_name
from graspfx.loop.parts import DeviceWiring

SAME = 1e-6  # of a period and a rate


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
    if not sys.platform.startswith("linux"):
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
