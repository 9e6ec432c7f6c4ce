"""A touch screen as fingers without force feedback: a page in a browser, where each touch moves the nearest finger.

The driver is intended for users without haptic hardware; the page shows the forces. A separate process serves the page,
on this computer only or, with `lan`, to a tablet that has scanned a QR code. The driver needs the package websockets.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from graspfx.devices._inputs.pointer import box
from graspfx.devices._settings import number, whole
from graspfx.devices.touch_screen.touch_fingers import TouchFingers
from graspfx.protocols import SMALLEST, InputError, TouchScreen, finite

__all__ = ["TouchFingers", "connect"]

MOST_FINGERS = 10


def connect(
    *,
    port: int = 8765,
    fingers: int = 2,
    dimensions: int = 2,
    workspace: Sequence[Sequence[float]] | None = None,
    start: Sequence[Sequence[float]] | None = None,
    lag: float = 0.01,
    speed: float = 0.5,
    lan: bool = False,
) -> TouchFingers:
    """Connect a touch screen.

    Args:
        port: Port of the page, whose default address is http://127.0.0.1:8765.
        fingers: Number of fingers, one channel each.
        dimensions: Number of dimensions of the scene, 1 or 2.
        workspace: Corners of the workspace (2, d) [m]; -0.1 to 0.1 m along every axis if None.
        start: Positions of the fingers when the device is opened (k, d) [m]; evenly spaced along x, in the middle of
            the other axis, if None.
        lag: Time constant of a finger, which lags a steady touch by twice this time [s].
        speed: Largest speed of a finger [m/s].
        lan: Whether a tablet in the local network may connect by scanning a printed QR code.

    Raises:
        MissingPackageError: Raised by `open` if websockets is not installed; `pip install graspfx[touch]` installs it.
    """
    if dimensions not in (1, 2) or isinstance(dimensions, bool):
        raise InputError("dimensions", dimensions, "1 or 2: a screen has no depth")
    count, corners = whole("fingers", fingers, 1, MOST_FINGERS), box(workspace, 0.1, dimensions)
    if not isinstance(lan, bool):
        raise InputError("lan", lan, "true or false")
    low, high = corners
    if start is None:
        places = np.tile(0.5 * (low + high), (count, 1))
        places[:, 0] = low[0] + (high[0] - low[0]) * (np.arange(count) + 1.0) / (count + 1.0)
    else:
        expected = f"positions of {count} fingers with {dimensions} coordinates within the workspace [m]"
        places = finite("start", start, expected)
        if places.shape != (count, dimensions) or not ((low <= places) & (places <= high)).all():
            raise InputError("start", start, expected)
    bottom, top = (low[1], high[1]) if dimensions == 2 else (-0.25 * (high[0] - low[0]), 0.25 * (high[0] - low[0]))
    screen = TouchScreen(fingers=count, port=whole("port", port, 0, 65535), box=(low[0], bottom, high[0], top), lan=lan)
    return TouchFingers(screen, corners, places, number("lag", lag, 1e-4, 1.0), number("speed", speed, SMALLEST, 5.0))
