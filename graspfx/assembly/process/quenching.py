"""Removal of the force of hardware after its program has died, by the `quench` functions of drivers."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from inspect import signature
from threading import Thread
from typing import TYPE_CHECKING, Any

from graspfx import plugins
from graspfx.assembly.device_limits import is_forceless
from graspfx.assembly.wiring import AUTOMATIC, table_at
from graspfx.errors import InputError, message
from graspfx.loop.device import QuenchableDriver, is_hardware
from graspfx.loop.device_exchange import device_name
from graspfx.loop.servo_parts import DeviceWiring

if TYPE_CHECKING:
    from graspfx.assembly.resolve import Parts

PATIENCE = 2.0  # time for all devices [s]


@dataclass(frozen=True)
class Quencher:
    """Method to remove the force of a device after its program has died.

    Attributes:
        name: Name of the device in messages.
        quench: Function that removes the force; None if only the hardware's watchdog removes it.
        watchdog: Timeout of the hardware's watchdog [s]; None if the hardware has no watchdog.
    """

    name: str
    quench: Callable[[], object] | None
    watchdog: float | None

    def act(self) -> str:
        """Remove the force, and return a text that reports the result."""
        if self.quench is None:
            return f"the watchdog of {self.name} removes its force within {self.watchdog:g} s"
        began = time.monotonic()
        try:
            self.quench()
        except BaseException as error:  # noqa: BLE001 - also SystemExit: the others are quenched, and the end is told
            text = f"{type(error).__name__}: {message(error)}"
            if self.watchdog is not None:
                return f"the force of {self.name} could not be removed ({text}); the device's watchdog removes it"
            return f"the force of {self.name} could not be removed and may persist: switch the device off ({text})"
        return f"the force of {self.name} was removed in {1e3 * (time.monotonic() - began):.1f} ms"

    @property
    def silence(self) -> str:
        """Report for the case that `act` does not return within `PATIENCE`."""
        what = f"the force of {self.name} could not be removed within {PATIENCE:g} s"
        if self.watchdog is not None:
            return f"{what}; the device's watchdog removes it"
        return f"{what} and may persist: switch the device off"


def quenchers(parts: Parts) -> list[Quencher]:
    """Return a quencher for each real device of a scene that displays forces; drivers are imported.

    Raises:
        InputError: If a device's hardware has no watchdog, and its driver has no function `quench`.
    """
    scene, quenchers_ = parts.scene, list[Quencher]()
    for wire in parts.wires:
        if not is_hardware(wire.device) or is_forceless(wire):
            continue
        _, table = table_at(scene, int(wire.used[0]))
        module = plugins.load("devices", table.name, parts.folder)
        name = device_name(DeviceWiring(wire.device, wire.fingers), scene.finger_names)
        quench = None
        if isinstance(module, QuenchableDriver):
            settings: dict[str, Any] = dict(table.settings)
            if AUTOMATIC in signature(module.connect).parameters:
                settings.setdefault(AUTOMATIC, scene.dimensions)
            quench = _call(module, settings)
        watchdog = wire.features.watchdog
        if quench is None and watchdog is None:
            raise InputError(
                "features.watchdog", None, "time after which the hardware removes its force [s], or a function "
                f"quench(**settings) in the driver of {name}",
                "otherwise, the force persists after the program is killed: docs/how-to/device.md",
            )  # fmt: skip
        quenchers_.append(Quencher(name, quench, watchdog))
    return quenchers_


def quench_all(each: Sequence[Quencher]) -> list[str]:
    """Remove the forces of devices in parallel, and return a report on each device after at most `PATIENCE`.

    Devices for which the system grants no thread follow one after the other, and may take longer.
    """
    texts = [one.silence for one in each]

    def act(i: int) -> None:
        texts[i] = each[i].act()

    end, threads, left = time.monotonic() + PATIENCE, list[Thread](), list[int]()
    for i in range(len(each)):
        thread = Thread(target=act, args=(i,), daemon=True)
        try:
            thread.start()
        except RuntimeError:  # the system grants no more threads
            left.append(i)
        else:
            threads.append(thread)
    for i in left:  # after the others, because a device may take long
        act(i)
    for thread in threads:
        thread.join(max(0.0, end - time.monotonic()))
    return list(texts)


def _call(module: QuenchableDriver, settings: dict[str, Any]) -> Callable[[], object]:
    return lambda: module.quench(**settings)
