"""Touch and Phantom devices by OpenHaptics: one finger in space each, in the scheduler of the maker's library.

Tested against an emulator only (`graspfx.testing.wire.OpenHapticsWire`); written from the names and numbers of the
library's interface. The library, libHD, comes with the maker's SDK: nothing of it is here, and it is loaded at `open`.
"""

from __future__ import annotations

from graspfx.devices._libraries import check_library
from graspfx.devices._settings import number, whole
from graspfx.devices.open_haptics.hd import check_unit
from graspfx.devices.open_haptics.stylus import Stylus
from graspfx.protocols import SMALLEST, WINDOW

__all__ = ["Stylus", "connect", "quench"]

MOST_FORCE = 40.0  # [N]
MOST_SAMPLES = 1_000_000  # of a window
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
        unit: its name in the maker's setup tool; None for the default device.
        library: path of libHD; None for its usual names.
        force_limit: largest force at the handle [N].
        resolution: of a position [m].
        velocity_window: the longest window of the velocity estimate [samples].
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
    """Take the force from a device whose program has died: open it afresh, display zero force, close it.

    Args:
        unit, library: as of `connect`; other settings do not matter.

    Raises:
        DeviceError: it cannot be opened, or its scheduler does not run.
    """
    with Stylus(unit=unit, library=library, force_limit=1.0, resolution=1e-5, velocity_window=1) as device:
        device.open(PERIOD)
        device.read()
        device.stop()
