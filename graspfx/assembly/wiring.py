"""Connection of a scene's devices, which are not opened, and comparison of their features with the scene."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from inspect import signature
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx import plugins
from graspfx.assembly.hands import is_operated
from graspfx.compile.memory import within
from graspfx.errors import DeviceError, InputError, abbreviate
from graspfx.loop.device import Device, Features, OperatedDevice, SimulatedDevice
from graspfx.loop.device_mount import PLAIN, Fitting, frame
from graspfx.scene.keys import Finding, Key

if TYPE_CHECKING:
    from graspfx.assembly.bodies import Stock
    from graspfx.scene.tables.part_tables import Device as DeviceTable
    from graspfx.scene.tables.part_tables import Finger
    from graspfx.scene.tables.scene_table import SceneTable


KEYS = ("frame", "deadman", "rate")
OF_RUNS = ("jitter", "round_trip")  # measures that are not features
MOST = 4  # largest number of ticks between calls of a device; more would be felt as steps
SLACK = 1e-6  # relative tolerance of a rate, for rounding of the period


def fitting_of(table: DeviceTable, scene: SceneTable) -> Fitting:
    """Make the `Fitting` that a valid table of a device describes."""
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


def fitting_faults(scene: SceneTable, at: Key, table: DeviceTable, device: Device) -> Iterator[Finding]:
    """Find faults of a connected device's frame, deadman switch and rate."""
    from graspfx.scene.tables.fields import NotValid

    with suppress(NotValid):
        if isinstance(device, SimulatedDevice):
            for key in KEYS:
                if getattr(table, key) is not None:
                    yield (*at, key), f"only hardware has this setting: remove {key!r} from the simulated device"
            return
    with suppress(NotValid):
        yield from _frame_faults(scene, at, table)
    with suppress(NotValid):
        yield from _deadman_faults(at, table, device)
    with suppress(NotValid):
        yield from _rate_faults(scene, at, table)


def _frame_faults(scene: SceneTable, at: Key, table: DeviceTable) -> Iterator[Finding]:
    place = table.frame
    if place is not None:
        try:
            frame(scene.dimensions, place.origin, place.axes, place.scale)
        except InputError as error:
            yield (*at, "frame", error.name), str(error).removeprefix(f"{error.name}: ")


def _deadman_faults(at: Key, table: DeviceTable, device: Device) -> Iterator[Finding]:
    deadman, switches = table.deadman, device.features.switches
    if deadman is not None and deadman >= switches:
        has = f"{table.name!r} has {switches or 'no'} switch{'' if switches == 1 else 'es'}"
        yield (*at, "deadman"), f"expected the index of a switch of the device, from 0: {has}; given {deadman}"


def _rate_faults(scene: SceneTable, at: Key, table: DeviceTable) -> Iterator[Finding]:
    rate = table.rate
    if rate is not None and _ticks(rate, scene.period) > MOST:
        least = 1.0 / (MOST * scene.period)
        yield (*at, "rate"), f"expected at least {least:g} Hz, one call in {MOST} ticks; given {rate:g} Hz"


def _ticks(rate: float, period: float) -> int:
    """Return the number of ticks from one call of a device to the next, for a rate of calls [Hz]."""
    return max(1, math.ceil((1.0 - SLACK) / (rate * period)))


FloatArray = NDArray[np.float64]
Connected = Mapping[Key, Device]
AUTOMATIC = "dimensions"  # argument for drivers that accept it, from the scene's key


@dataclass(frozen=True)
class Wire:
    """A connected device, and its relation to the scene.

    Attributes:
        at: Location of the device's table in the scene.
        device: Device, which is not opened.
        fingers: Index of the finger on each channel of the device; -1 for a channel without a finger.
        features: Features that the device reports, in axes and units of the scene.
        fitting: Axes, deadman switch, rate and measured properties of the device in the scene.
    """

    at: Key
    device: Device
    fingers: NDArray[np.intp]
    features: Features
    fitting: Fitting = PLAIN

    @property
    def used(self) -> NDArray[np.intp]:
        """Indices of the fingers on the device."""
        return self.fingers[self.fingers >= 0]


def connect(driver: ModuleType, table: DeviceTable, dimensions: int) -> Device:
    """Call a driver's `connect` with the settings in a table; `dimensions` is added if `connect` accepts it."""
    settings = table.settings
    if AUTOMATIC in signature(driver.connect).parameters:
        settings.setdefault(AUTOMATIC, dimensions)
    device: Device = driver.connect(**settings)
    return device


def table_at(scene: SceneTable, i: int) -> tuple[Key, DeviceTable]:
    """Return the location and the table of the device of finger i."""
    device = scene.finger[i].device
    if not isinstance(device, str):
        return ("finger", i, "device"), device
    k, table = next((k, each) for k, each in enumerate(scene.device) if each.label == device)
    return ("device", k), table


def fitted(
    at: Key, device: Device, fingers: NDArray[np.intp], table: DeviceTable, scene: SceneTable
) -> Wire:  # fmt: skip
    """Make the `Wire` of a connected device, with the fitting in the device's table."""
    fitting = fitting_of(table, scene)
    return Wire(at, device, fingers, fitting.features(device.features), fitting)


def wires(scene: SceneTable, stock: Stock) -> tuple[Wire, ...]:
    """Return all devices of a valid scene, in the order of their first fingers.

    Devices that are not yet in the stock are connected and added to the stock.
    """
    with within(stock.memory):
        return tuple(_wires(scene, stock.folder, stock.devices))


def wires_anew(scene: SceneTable, folder: Path | None) -> tuple[Wire, ...]:
    """Connect all devices of a scene again, because two runs cannot share a device."""
    return tuple(_wires(scene, folder, {}))


def _wires(scene: SceneTable, folder: Path | None, devices: dict[Key, Device]) -> Iterator[Wire]:
    channels: dict[Key, dict[int, int]] = {}
    tables: dict[Key, DeviceTable] = {}
    for i, finger in enumerate(scene.finger):
        at, tables[at] = table_at(scene, i)
        channels.setdefault(at, {})[finger.channel] = i
    for at, table in tables.items():
        if at not in devices:
            devices[at] = connect(plugins.load("devices", table.name, folder), table, scene.dimensions)
        fingers = [channels[at].get(c, -1) for c in range(devices[at].features.fingers)]
        yield fitted(at, devices[at], np.array(fingers), table, scene)


def wiring_faults(scene: SceneTable, connected: Connected) -> Iterator[Finding]:
    """Find inconsistencies between the fingers of a scene and its connected devices."""
    from graspfx.scene.tables.fields import NotValid

    channels: dict[Key, list[int]] = {at: [] for at in connected}
    kinds: dict[str, type] = {}
    for i, finger in enumerate(scene.finger):
        with suppress(NotValid, StopIteration):  # invalid tables and missing devices have their own faults
            at, table = table_at(scene, i)
            if at in connected:
                device, k = connected[at], connected[at].features.fingers
                channels[at].append(k)  # stands for an unknown channel, until the finger's channel is known
                channels[at][-1] = finger.channel
                if finger.channel >= k:
                    has = "1 finger" if k == 1 else f"{k} fingers"
                    text = f"expected less than {k}: {table.name!r} has {has}; given {finger.channel}"
                    yield ("finger", i, "channel"), text
                yield from _hand_faults(scene, ("finger", i, "hand"), finger, device, kinds)
    for at, device in connected.items():
        k, used = device.features.fingers, channels[at]
        if device.features.dimensions != scene.dimensions:
            actual = device.features.dimensions
            yield (*at, "name"), f"expected a device of {scene.dimensions} dimensions; this one has {actual}"
        free = sorted(set(range(k)) - set(used))
        sound = used and max(used) < k and len(set(used)) == len(used)  # otherwise the channels are the fault
        yield from fitting_faults(scene, at, _table(scene, at), device)
        if free and sound and isinstance(device, SimulatedDevice):
            yield at, f"expected a finger on each channel of a simulated device: no finger uses channel {free[0]}"


def _table(scene: SceneTable, at: Key) -> DeviceTable:
    first, number = at[:2]
    part = getattr(scene, str(first))[number]
    table: DeviceTable = part.device if first == "finger" else part
    return table


def _hand_table(scene: SceneTable, finger: Finger) -> object:
    """Return the table of the hand that holds a finger; None without a hand."""
    if isinstance(finger.hand, str):
        return next((table for table in scene.hand if table.name == finger.hand), None)
    return finger.hand


def _hand_faults(
    scene: SceneTable, at: Key, finger: Finger, device: Device, kinds: dict[str, type]
) -> Iterator[Finding]:
    if finger.hand is None:
        return
    if not isinstance(device, SimulatedDevice):
        yield at, "a person's hand holds a real device: remove the simulated hand of this finger"
    elif is_operated(_hand_table(scene, finger)) and not isinstance(device, OperatedDevice):
        yield at, f"{type(device).__name__} supports only a spring and a damper; use the device 'simulated'"
    elif isinstance(finger.hand, str):
        first = kinds.setdefault(finger.hand, type(device))
        if type(device) is not first:
            names = f"{first.__name__} and {type(device).__name__}"
            yield at, f"a hand holds devices of one kind; {finger.hand!r} would hold {names}"


def placing_faults(start: FloatArray, wired: Iterable[Wire]) -> list[Finding]:
    """Find the fingers on simulated devices that cannot be placed at their start positions, in a valid scene.

    This check is not part of loading a scene, because the placement of a plant may import the packages that simulate
    it.

    Args:
        start: Start positions of all fingers of the scene, (n, d) [m].
        wired: Devices that no other run uses.
    """
    faults: list[Finding] = []
    for wire in wired:
        if not isinstance(wire.device, SimulatedDevice):
            continue
        try:
            type(wire.device).plant([wire.device]).place(start[wire.fingers])
        except DeviceError as error:
            faults.append((("finger", int(wire.fingers[0]), "start"), str(error)))
        else:
            faults += outside_faults(wire, start)
    return faults


def outside_faults(wire: Wire, start: FloatArray) -> Iterator[Finding]:
    """Find the fingers on a simulated device that start outside the workspace of the device."""
    workspace = wire.features.workspace
    if workspace is None or not isinstance(wire.device, SimulatedDevice):
        return
    lower, upper = workspace
    for i in wire.fingers.tolist():
        if not ((lower <= start[i]) & (start[i] <= upper)).all():
            corners = f"{abbreviate(lower.tolist())} to {abbreviate(upper.tolist())} m"
            yield (
                ("finger", i, "start"),
                f"outside the device's workspace, {corners}; given {abbreviate(start[i].tolist())}",
            )
