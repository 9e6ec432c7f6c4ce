"""Touch and Phantom devices with OpenHaptics: one finger in space each, in the scheduler of the vendor's library.

The driver was written from the function names and constants of the library's interface. It was tested only against an
emulator (`graspfx.testing.wire.OpenHapticsWire`). The library, libHD, is part of the vendor's SDK; it is not included,
and is loaded at `open`.
"""

from __future__ import annotations

from graspfx.devices._libraries import check_library
from graspfx.devices._settings import number, whole
from graspfx.devices.open_haptics.hd import check_unit
from graspfx.devices.open_haptics.stylus import Stylus
from graspfx.protocols import SMALLEST, WINDOW

__all__ = ["Stylus", "connect", "quench"]

MOST_FORCE = 40.0  # [N]
MOST_SAMPLES = 1_000_000  # largest window [samples]
PERIOD = 0.001  # [s]


def connect(
    *,
    unit: str | None = None,
    library: object = None,
    force_limit: float = 3.0,
    resolution: float = 5.5e-5,
    velocity_window: int = WINDOW,
) -> Stylus:
    """Connect a device.

    Args:
        unit: Name of the device in the vendor's setup tool; None for the default device.
        library: Path of libHD; None for its usual names.
        force_limit: Largest force at the handle [N].
        resolution: Resolution of a position [m].
        velocity_window: Longest window of the velocity estimate [samples].
    """
    check_library(library, "libHD")
    check_unit(unit)
    return Stylus(
        unit=unit,
        library=library,
        force_limit=number("force_limit", force_limit, SMALLEST, MOST_FORCE),
        resolution=number("resolution", resolution, SMALLEST),
        velocity_window=whole("velocity_window", velocity_window, 1, MOST_SAMPLES),
    )


def quench(*, unit: str | None = None, library: object = None, **_: object) -> None:
    """Remove the force from a device whose program has died: reopen it, display zero force, close it.

    Args:
        unit, library: Same as for `connect`; other settings are ignored.

    Raises:
        DeviceError: If the device cannot be opened, or its scheduler does not run.
    """
    with Stylus(unit=unit, library=library, force_limit=1.0, resolution=1e-5, velocity_window=1) as device:
        device.open(PERIOD)
        device.read()
        device.stop()
