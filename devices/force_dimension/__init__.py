"""Force Dimension devices (delta, omega, sigma, lambda): one finger in space, through the vendor's library.

The driver was written from the function names and constants of the vendor's interface. It was tested only against an
emulator (`graspfx.testing.wire.ForceDimensionWire`). The library, libdrd, is part of the vendor's SDK; it is not
included, and is loaded at `open`.
"""

from __future__ import annotations

from graspfx.devices._libraries import check_library
from graspfx.devices._settings import number, whole
from graspfx.devices.force_dimension.delta import Delta, PlainDelta
from graspfx.devices.force_dimension.dhd import is_of_c
from graspfx.protocols import SMALLEST, WINDOW

__all__ = ["Delta", "connect", "quench"]

MOST_FORCE = 40.0  # [N]
MOST_SAMPLES = 1_000_000  # largest window [samples]
PERIOD = 0.001  # arbitrary, because `quench` reads only once [s]


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
        serial: Serial number, printed on the device and shown by the vendor's tools, whose device ids change between
            starts; None for the first free device.
        library: Path of libdrd; None for its usual names.
        force_limit: Largest force at the handle, also set in the vendor's library [N].
        resolution: Resolution of a position [m].
        velocity_window: Longest window of the velocity estimate [samples].
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
    """Remove the force from a device whose program has died: reopen it, set zero force, apply the brakes, close.

    Args:
        serial, library: Same as for `connect`; other settings are ignored.

    Raises:
        DeviceError: If the device cannot be opened, or rejects zero force.
    """
    device = PlainDelta(serial=serial, library=library, force_limit=1.0, resolution=1e-5, velocity_window=1)
    with device:
        device.open(PERIOD)
        device.stop()
