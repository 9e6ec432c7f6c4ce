"""Opening of hardware, and its end: every device is stopped and closed, whatever another one raises."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from graspfx import log
from graspfx.errors import DeviceError
from graspfx.loop.device_exchange import DeviceExchange
from graspfx.progress import waiting


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
