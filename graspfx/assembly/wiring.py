"""The devices of a scene connected, not opened: what they tell of themselves against what the scene asks of them."""

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
from graspfx.loop.device_frame import frame
from graspfx.loop.fitting import PLAIN, Fitting

if TYPE_CHECKING:
    from graspfx.assembly.bodies import Stock
    from graspfx.scene.tables.part_tables import Device as DeviceTable
    from graspfx.scene.tables.part_tables import Finger
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


FloatArray = NDArray[np.float64]
Connected = Mapping[Location, Device]
AUTOMATIC = "dimensions"  # given to a driver that takes it, from the scene's own key


@dataclass(frozen=True)
class Wire:
    """A connected device and what it tells of itself before it is opened.

    Attributes:
        at: where its table stands.
        device: not opened.
        fingers: the finger of each of its channels, -1 for none.
        features: as the device tells them, in the axes and units of the scene.
        fitting: to the scene.
    """

    at: Location
    device: Device
    fingers: NDArray[np.intp]
    features: Features
    fitting: Fitting = PLAIN

    @property
    def used(self) -> NDArray[np.intp]:
        """The fingers of its channels that have one."""
        return self.fingers[self.fingers >= 0]


def connect(driver: ModuleType, table: DeviceTable, dimensions: int) -> Device:
    """Connect a driver with the settings of a table; one whose `connect` takes `dimensions` is given the scene's."""
    settings = table.settings
    if AUTOMATIC in signature(driver.connect).parameters:
        settings.setdefault(AUTOMATIC, dimensions)
    device: Device = driver.connect(**settings)
    return device


def table_at(scene: SceneTable, i: int) -> tuple[Location, DeviceTable]:
    """Find the table of finger i's device, and where it stands."""
    device = scene.finger[i].device
    if not isinstance(device, str):
        return ("finger", i, "device"), device
    k, table = next((k, each) for k, each in enumerate(scene.device) if each.label == device)
    return ("device", k), table


def fitted(
    at: Location, device: Device, fingers: NDArray[np.intp], table: DeviceTable, scene: SceneTable
) -> Wire:  # fmt: skip
    """Give a connected device with what its table says of its place in the scene."""
    fitting = fitting_of(table, scene)
    return Wire(at, device, fingers, fitting.features(device.features), fitting)


def wires(scene: SceneTable, stock: Stock) -> tuple[Wire, ...]:
    """Give every device of a scene without faults, in the order of the first finger that names it.

    Those that are not in the stock yet are connected, and stay there.
    """
    with within(stock.memory):
        return tuple(_wires(scene, stock.folder, stock.devices))


def wires_anew(scene: SceneTable, folder: Path | None) -> tuple[Wire, ...]:
    """Connect every device of a scene once more: two runs share none."""
    return tuple(_wires(scene, folder, {}))


def _wires(scene: SceneTable, folder: Path | None, devices: dict[Location, Device]) -> Iterator[Wire]:
    channels: dict[Location, dict[int, int]] = {}
    tables: dict[Location, DeviceTable] = {}
    for i, finger in enumerate(scene.finger):
        at, tables[at] = table_at(scene, i)
        channels.setdefault(at, {})[finger.channel] = i
    for at, table in tables.items():
        if at not in devices:
            devices[at] = connect(plugins.load("devices", table.name, folder), table, scene.dimensions)
        fingers = [channels[at].get(c, -1) for c in range(devices[at].features.fingers)]
        yield fitted(at, devices[at], np.array(fingers), table, scene)


def wiring_faults(scene: SceneTable, connected: Connected) -> Iterator[Finding]:
    """Find faults between the fingers and the devices that could be connected."""
    from graspfx.scene.tables.fields import NotValid

    channels: dict[Location, list[int]] = {at: [] for at in connected}
    kinds: dict[str, type] = {}
    for i, finger in enumerate(scene.finger):
        with suppress(NotValid, StopIteration):  # what is not valid, or names no device, has its own fault
            at, table = table_at(scene, i)
            if at in connected:
                device, k = connected[at], connected[at].features.fingers
                channels[at].append(k)  # until it is known, none that the device has
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
        sound = used and max(used) < k and len(set(used)) == len(used)  # else that is the fault
        yield from fitting_faults(scene, at, _table(scene, at), device)
        if free and sound and isinstance(device, SimulatedDevice):
            yield at, f"no finger has its channel {free[0]}: a simulated device needs one for each of its channels"


def _table(scene: SceneTable, at: Location) -> DeviceTable:
    first, number = at[:2]
    part = getattr(scene, str(first))[number]
    table: DeviceTable = part.device if first == "finger" else part
    return table


def _hand_table(scene: SceneTable, finger: Finger) -> object:
    """Find the table of the hand that holds a finger."""
    if isinstance(finger.hand, str):
        return next((table for table in scene.hand if table.name == finger.hand), None)
    return finger.hand


def _hand_faults(
    scene: SceneTable, at: Location, finger: Finger, device: Device, kinds: dict[str, type]
) -> Iterator[Finding]:
    if finger.hand is None:
        return
    if not isinstance(device, SimulatedDevice):
        yield at, "a real device is held by the operator's own hand: leave it out"
    elif is_operated(_hand_table(scene, finger)) and not isinstance(device, OperatedDevice):
        yield at, f"{type(device).__name__} is moved by a spring and a damper alone; take the device 'simulated'"
    elif isinstance(finger.hand, str):
        first = kinds.setdefault(finger.hand, type(device))
        if type(device) is not first:
            names = f"{first.__name__} and {type(device).__name__}"
            yield at, f"a hand holds devices of one kind; {finger.hand!r} would hold {names}"


def placing_faults(start: FloatArray, wired: Iterable[Wire]) -> list[Finding]:
    """Find the fingers of simulated devices, in a scene without other faults, that cannot be put where they start.

    Not looked for when a scene is loaded: to place a plant may take the packages that move it.

    Args:
        start: of all fingers of the scene (n, d) [m].
        wired: devices that are nobody else's: each is given a plant.
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
    """Find the fingers of a simulated device that start outside its workspace."""
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
