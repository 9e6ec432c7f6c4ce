"""Devices of Force Dimension (delta, omega, sigma, lambda): one finger in space, by the maker's library.

Tested against an emulator only (`graspfx.testing.wire.ForceDimensionWire`); written from the names and numbers of the
maker's interface. The library, libdrd, comes with the maker's SDK: nothing of it is here, and it is loaded at `open`.
"""

from __future__ import annotations

from graspfx.devices._libraries import check_library
from graspfx.devices._settings import number, whole
from graspfx.devices.force_dimension.delta import Delta, PlainDelta
from graspfx.devices.force_dimension.dhd import is_of_c
from graspfx.protocols import SMALLEST, WINDOW

__all__ = ["Delta", "connect", "quench"]

MOST_FORCE = 40.0  # [N]
MOST_SAMPLES = 1_000_000  # of a window
PERIOD = 0.001  # of no account where nothing is read twice [s]


def connect(
    *,
    serial: int | None = None,
    library: object = None,
    force_limit: float = 3.0,
    resolution: float = 1e-5,
    velocity_window: int = WINDOW,
) -> PlainDelta:
    """Connect a device.

    Args:
        serial: its number, printed on it and told by the maker's tools; ids change from start to start. None for the
            first that is free.
        library: path of libdrd; None for its usual names.
        force_limit: largest force at the handle; the maker's library is told it too [N].
        resolution: of a position [m].
        velocity_window: the longest window of the velocity estimate [samples].
    """
    check_library(library, "Force Dimension's library")
    return (Delta if is_of_c(library) else PlainDelta)(
        serial=None if serial is None else whole("serial", serial, 0, 2**31 - 1),
        library=library,
        force_limit=number("force_limit", force_limit, SMALLEST, MOST_FORCE),
        resolution=number("resolution", resolution, SMALLEST),
        velocity_window=whole("velocity_window", velocity_window, 1, MOST_SAMPLES),
    )


def quench(*, serial: int | None = None, library: object = None, **_: object) -> None:
    """Take the force from a device whose program has died: open it afresh, zero force, brakes, close.

    Args:
        serial, library: as of `connect`; other settings do not matter.

    Raises:
        DeviceError: it cannot be opened or takes no force of zero.
    """
    device = PlainDelta(serial=serial, library=library, force_limit=1.0, resolution=1e-5, velocity_window=1)
    with device:
        device.open(PERIOD)
        device.stop()
