"""Round trips of hardware: opened at zero force, read and written for a second, closed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from graspfx.errors import DeviceError, GraspFXError, message
from graspfx.loop.device import LimitedDevice
from graspfx.loop.device_exchange import DeviceExchange, DevicePort, Port
from graspfx.loop.parts import DeviceWiring
from graspfx.loop.realtime.lifecycle import opened, settle
from graspfx.loop.realtime.pacing import Clock, Pacer, WallClock
from graspfx.loop.realtime.readings import GUARDS
from graspfx.machine.finding import Finding

DURATION = 1.0  # [s], and
LEAST = 100  # exchanges
SHARE = 0.5  # of a period that an exchange may take at the 99th percentile
FRESH = 0.95  # of the readings that bring a new sample


def round_trip_findings(
    stations: Sequence[DeviceWiring], names: Sequence[str], period: float, clock: Clock | None = None
) -> Iterator[Finding]:
    """Open hardware at zero force, exchange with all of it as a run does, and close it.

    Args:
        stations: devices that are connected, none of them a simulation.
        names: of the fingers.
        period: of the exchanges [s].
        clock: instead of the machine's.
    """
    clock = clock or WallClock()
    devices = DeviceExchange([_port(i, each, names, period) for i, each in enumerate(stations)])
    labels = ", ".join(each.name for each in devices.ports)
    trips: list[float] = []
    try:
        with opened(devices, period):
            rest = settle(devices, period, clock)
            first = [each.readings.samples for each in devices.ports]
            count = max(LEAST, math.ceil(DURATION / period))
            _exchange(devices, period, clock, count, trips)
            fresh = [each.readings.samples - n for each, n in zip(devices.ports, first, strict=True)]
    except GraspFXError as error:
        yield Finding(labels, message(error), "see to it, and try again")
        return
    yield Finding(labels, f"at rest; a round trip of {1e6 * rest.round_trip:.0f} us at zero force")
    middle, most = (float(np.percentile(trips, share)) for share in (50.0, 99.0))
    text = f"p50 {1e6 * middle:.0f} us, p99 {1e6 * most:.0f} us, max {1e6 * max(trips):.0f} us"
    slow = most > SHARE * period
    remedy = f"take a period of {1e3 * most / SHARE:.1f} ms or more, or a faster line" if slow else ""
    yield Finding("round trip", f"{text}, at a period of {1e3 * period:g} ms", remedy)
    for each, samples in zip(devices.ports, fresh, strict=True):
        part = samples * each.fitting.every / count
        few = part < FRESH
        remedy = "take a longer period, or give its table a `rate`" if few else ""
        yield Finding(f"samples of {each.name}", f"{min(part, 1.0):.1%} of the readings were new", remedy)


def _exchange(devices: DeviceExchange, period: float, clock: Clock, count: int, trips: list[float]) -> None:
    """Read and write at zero force; collect what each exchange took [s]."""
    pacer = Pacer(period, clock)
    for _ in range(count):
        skipped = pacer.wait()
        began = clock.now()
        faults = [*devices.read(1 + skipped), devices.write()]
        trips.append(clock.now() - began)
        text = next((each for each in faults if each), "")
        if text:
            raise DeviceError(text)


def _port(i: int, station: DeviceWiring, names: Sequence[str], period: float) -> DevicePort:
    """Make a port of its own for a device, as a tick would have it; its forces are zero."""
    features = station.device.features
    shape = features.fingers, features.dimensions
    size = shape[0] * shape[1]
    memory = np.zeros(1 + 3 * size + shape[0])
    position, velocity, command = memory[1 : 1 + 3 * size].reshape(3, *shape)
    limit = memory[1 + 3 * size :] if isinstance(station.device, LimitedDevice) else None
    return DevicePort(Port(i, position, velocity, command, memory, limit), station, names, period, GUARDS)
