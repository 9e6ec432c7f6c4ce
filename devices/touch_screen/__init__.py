"""A touch screen as fingers without force feedback: a page in a browser, where each touch moves the nearest finger.

The driver is intended for users without haptic hardware; the page shows the forces. A separate process serves the page
to this computer only or, if `lan` is set, also to a tablet that has scanned a QR code. The driver needs the package
websockets.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graspfx.devices._inputs import FollowingFingers, area, inside
from graspfx.devices._settings import flag, whole
from graspfx.protocols import InputError, TouchScreen, approach

__all__ = ["TouchFingers", "connect"]

FloatArray = NDArray[np.float64]

MOST_FINGERS = 10
BACK = 0.1  # speed of a lifted finger in the direction of its force [m/s]


class TouchFingers(FollowingFingers):  # type: ignore[misc] # mypy does not see devices from inside the package
    """Fingers that follow touches on a screen; the page shows their forces.

    A finger that is lifted, or whose screen is disconnected, moves in the direction of the force shown for the finger
    until this force is zero, and then stays in place. The switch of a finger is closed while the finger is touched.
    """

    def __init__(
        self, source: TouchScreen, workspace: FloatArray, start: FloatArray, lag: object, speed: object
    ) -> None:  # fmt: skip
        super().__init__(source, workspace, start, lag, speed, len(start))
        self._forces = np.zeros_like(start)
        self._raw: FloatArray = np.zeros(5 + 3 * len(start))

    @property
    def raw(self) -> FloatArray:
        """Message counts of the page, and the touches of the k fingers (5 + 3 k,).

        The first five entries are the numbers of accepted, dropped and lost messages, the sequence number of the last
        message, and the number of screens. Then each finger has three entries: whether the finger is touched, and x, y
        [m].
        """
        return self._raw

    def _begin(self) -> None:
        self._forces[:] = 0.0

    def _take(self) -> None:
        touches = self.source.touches()
        self._raw[:5], self._raw[5:] = touches.counts, touches.fingers[:, :3].ravel()

    def _aim(self, duration: float) -> None:
        d = self._start.shape[1]
        self._switches = 0
        for i, (is_down, x, y) in enumerate(self._raw[5:].reshape(-1, 3).tolist()):
            if is_down:
                self._switches |= 1 << i
                approach(self._target[i], np.clip((x, y)[:d], *self._box), self.speed * duration)
            else:
                self._give_way(i, duration)

    def _give_way(self, i: int, duration: float) -> None:
        """Move a finger's target in the direction of the force shown for the finger."""
        size = float(np.linalg.norm(self._forces[i]))
        if size:
            away = self._target[i] + self._forces[i] / size
            approach(self._target[i], np.clip(away, *self._box), BACK * duration)

    def _show(self, forces: FloatArray) -> None:
        self._forces[:] = forces
        self.source.show(self._position, self._forces)


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
        port: TCP port of the page; with the default, the address of the page is http://127.0.0.1:8765.
        fingers: Number k of fingers, one channel each.
        dimensions: Number of dimensions d of the scene, 1 or 2.
        workspace: Lower and upper corner of the workspace (2, d) [m]; if None, -0.1 and 0.1 m along every axis.
        start: Positions of the fingers when the device is opened (k, d) [m]; if None, the fingers are evenly spaced
            along x, in the middle of the other axis.
        lag: Time constant of the filter of a finger's motion [s]; at constant speed, the delay is twice this time.
        speed: Largest speed of a finger [m/s].
        lan: Whether a tablet in the local network may connect by scanning a printed QR code.

    Raises:
        MissingPackageError: Raised by `open` if websockets is not installed; `pip install graspfx[touch]` installs it.
    """
    if dimensions == 3:
        raise InputError("dimensions", dimensions, "1 or 2: a screen has no depth")
    whole("dimensions", dimensions, 1, 2)
    count, corners = whole("fingers", fingers, 1, MOST_FINGERS), area(workspace, dimensions)
    low, high = corners
    if start is None:
        places = np.tile(0.5 * (low + high), (count, 1))
        places[:, 0] = low[0] + (high[0] - low[0]) * (np.arange(count) + 1.0) / (count + 1.0)
    else:
        places = inside(corners, start, (count, dimensions))
    bottom, top = (low[1], high[1]) if dimensions == 2 else (-0.25 * (high[0] - low[0]), 0.25 * (high[0] - low[0]))
    box = low[0], bottom, high[0], top
    screen = TouchScreen(fingers=count, port=whole("port", port, 0, 65535), box=box, lan=flag("lan", lan))
    return TouchFingers(screen, corners, places, lag, speed)
