"""Removal of the force of hardware whose program has died, by each driver's `quench`."""

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
    """A device that a person may hold, and the method to remove its force if its program dies.

    Attributes:
        name: Name of the device in messages.
        quench: Function without arguments; None if the hardware's own watchdog must suffice.
        watchdog: Timeout of the hardware's watchdog [s]; None if it has none.
    """

    name: str
    quench: Callable[[], object] | None
    watchdog: float | None

    def act(self) -> str:
        """Remove the force; return a report."""
        if self.quench is None:
            return f"the watchdog of {self.name} removes its force within {self.watchdog:g} s"
        began = time.monotonic()
        try:
            self.quench()
        except BaseException as error:  # noqa: BLE001 - also SystemExit: the others are quenched, and the end is told
            text = f"{type(error).__name__}: {message(error)}"
            if self.watchdog is not None:
                return f"the force of {self.name} could not be removed ({text}); its watchdog removes it"
            return f"the force of {self.name} could not be removed and may persist: switch it off: {text}"
        return f"the force of {self.name} was removed in {1e3 * (time.monotonic() - began):.1f} ms"

    @property
    def silence(self) -> str:
        """Return the message for an `act` that has not returned."""
        if self.watchdog is not None:
            return f"the force of {self.name} could not be removed within {PATIENCE:g} s; its watchdog removes it"
        return f"the force of {self.name} is still being removed and may persist: switch it off"


def quenchers(parts: Parts) -> list[Quencher]:
    """Return a quencher for each real device of a scene that displays forces, and import its driver.

    Raises:
        InputError: If the hardware has no watchdog and its driver has no `quench`.
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
                "without either the force persists after the program is killed: docs/how-to/device.md",
            )  # fmt: skip
        quenchers_.append(Quencher(name, quench, watchdog))
    return quenchers_


def quench_all(each: Sequence[Quencher]) -> list[str]:
    """Remove the forces of devices in parallel, within `PATIENCE`; return a report on each device."""
    texts = [one.silence for one in each]

    def act(i: int) -> None:
        texts[i] = each[i].act()

    threads = list[Thread]()
    for i in range(len(each)):
        thread = Thread(target=act, args=(i,), daemon=True)
        try:
            thread.start()
        except RuntimeError:  # the system grants no more threads
            act(i)
        else:
            threads.append(thread)
    end = time.monotonic() + PATIENCE
    for thread in threads:
        thread.join(max(0.0, end - time.monotonic()))
    return list(texts)


def _call(module: QuenchableDriver, settings: dict[str, Any]) -> Callable[[], object]:
    return lambda: module.quench(**settings)
