"""Fittings of a scene's devices: frame, deadman and rate of their tables, and what is wrong with them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING

from graspfx.errors import InputError
from graspfx.loop.device import Device, SimulatedDevice
from graspfx.loop.device_frame import frame
from graspfx.loop.fitting import PLAIN, Fitting

if TYPE_CHECKING:
    from graspfx.scene.tables.part_tables import Device as DeviceTable
    from graspfx.scene.tables.scene_table import SceneTable

Location = tuple[str | int, ...]
Finding = tuple[Location, str]

KEYS = ("frame", "deadman", "rate")
OF_RUNS = ("jitter", "round_trip")  # measures that are no features
MOST = 4  # ticks from one call of a device to the next: more would be felt as steps
SLACK = 1e-6  # of a rate, relative: a period has rounding


def fitting_of(table: DeviceTable, scene: SceneTable) -> Fitting:
    """Give the fitting of a device's table without faults."""
    place, deadman, rate = table.frame, table.deadman, table.rate
    if place is None and deadman is None and rate is None and table.measures is None:
        return PLAIN
    figures = {} if table.measures is None else table.measures.model_dump(exclude_none=True)
    return Fitting(
        None if place is None else frame(scene.dimensions, place.origin, place.axes, place.scale),
        deadman,
        1 if rate is None else _ticks(rate, scene.period),
        {name: value for name, value in figures.items() if name not in OF_RUNS},
        figures.get("jitter"),
        figures.get("round_trip", 0.0),
    )


def fitting_faults(scene: SceneTable, at: Location, table: DeviceTable, device: Device) -> Iterator[Finding]:
    """Find what is wrong with a connected device's frame, deadman and rate."""
    from graspfx.scene.tables.fields import NotValid

    with suppress(NotValid):
        if isinstance(device, SimulatedDevice):
            for key in KEYS:
                if getattr(table, key) is not None:
                    yield (*at, key), "for hardware; a simulated device stands in the scene's axes, and is always there"
            return
    with suppress(NotValid):
        yield from _frame_faults(scene, at, table)
    with suppress(NotValid):
        yield from _deadman_faults(at, table, device)
    with suppress(NotValid):
        yield from _rate_faults(scene, at, table)


def _frame_faults(scene: SceneTable, at: Location, table: DeviceTable) -> Iterator[Finding]:
    place = table.frame
    if place is not None:
        try:
            frame(scene.dimensions, place.origin, place.axes, place.scale)
        except InputError as error:
            yield (*at, "frame", error.name), str(error).removeprefix(f"{error.name}: ")


def _deadman_faults(at: Location, table: DeviceTable, device: Device) -> Iterator[Finding]:
    deadman, switches = table.deadman, device.features.switches
    if deadman is not None and deadman >= switches:
        has = f"{table.name!r} tells {switches or 'no'} switch{'' if switches == 1 else 'es'}"
        yield (*at, "deadman"), f"expected the number of a switch of the device, counted from 0: {has}; given {deadman}"


def _rate_faults(scene: SceneTable, at: Location, table: DeviceTable) -> Iterator[Finding]:
    rate = table.rate
    if rate is not None and _ticks(rate, scene.period) > MOST:
        least = 1.0 / (MOST * scene.period)
        yield (*at, "rate"), f"expected at least {least:g} Hz, a call in {MOST} ticks; given {rate:g}"


def _ticks(rate: float, period: float) -> int:
    """Count the ticks from one call of a device to the next."""
    return max(1, math.ceil((1.0 - SLACK) / (rate * period)))
