"""Fingers that follow touches on a screen, and move out of the object when they are lifted."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Self

import numpy as np
from numpy.typing import NDArray

from graspfx.protocols import DeviceError, Features, Follower, InputError, TouchScreen, approach

FloatArray = NDArray[np.float64]

LONGEST = 0.1  # longest time between two readings during which the target continues to move [s]
BACK = 0.1  # speed at which a lifted finger yields to its force [m/s]


class TouchFingers:
    """Fingers without force feedback: forces are checked and shown on the page.

    A touch is a goal. The target moves to the goal at most at `speed`, and the finger follows the target with critical
    damping. When the finger is lifted or the screen is lost, the finger stays in place, or yields to its displayed
    force until this force is zero. The switch of a finger is closed while the finger is touched.

    Args:
        screen: Touch screen, whose touches move the fingers.
        workspace: Corners of the workspace (2, d) [m].
        start: Positions of the fingers when the device is opened (k, d) [m].
        lag: Time constant of a finger, which lags a target of constant velocity by twice this time [s].
        speed: Largest speed of a target [m/s].
        now: Function that returns the time of a reading [s].
    """

    def __init__(
        self, screen: TouchScreen, workspace: FloatArray, start: FloatArray, lag: float, speed: float,
        now: Callable[[], float] = time.perf_counter,
    ) -> None:  # fmt: skip
        self.screen, self.speed, self.now = screen, speed, now
        self._box, self._start = workspace, start
        self._target = start.copy()
        self._follower = Follower(lag, start)
        self._position, self._velocity = self._follower.position, self._follower.velocity
        self._forces = np.zeros_like(start)
        self._raw: FloatArray = np.zeros(5 + 3 * len(start))
        self._switches = 0
        self._is_open = False

    @property
    def features(self) -> Features:
        k, d = self._start.shape
        return Features(
            fingers=k,
            dimensions=d,
            workspace=(self._box[0].copy(), self._box[1].copy()),
            continuous_force=0.0,
            switches=k,
        )

    @property
    def switches(self) -> int:
        """Fingers on the screen, as bits."""
        return self._switches

    @property
    def raw(self) -> FloatArray:
        """Counts of the page, and touches (5 + 3 k,).

        The first five are the numbers of accepted, dropped and lost messages, the sequence number of the last message,
        and the number of screens. Then each finger has three: whether it is touched, and x, y [m].
        """
        return self._raw

    def open(self, period: float) -> None:
        self.close()
        self.screen.open()
        self._target[:] = self._start
        self._follower.place(self._start)
        self._forces[:] = 0.0
        self._began = self._time = self.now()
        self._is_open = True

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        """Return positions (k, d) [m], velocities (k, d) [m/s] and time [s]."""
        self._opened()
        touches = self.screen.touches()
        now = self.now()
        duration, self._time = min(now - self._time, LONGEST), now
        d = self._start.shape[1]
        self._switches = 0
        for i, (is_down, x, y, _) in enumerate(touches.fingers.tolist()):
            if is_down:
                self._switches |= 1 << i
                approach(self._target[i], np.clip((x, y)[:d], *self._box), self.speed * duration)
            else:
                self._give_way(i, duration)
        self._follower.follow(self._target, duration)
        self._raw[:5], self._raw[5:] = touches.counts, touches.fingers[:, :3].ravel()
        return self._position, self._velocity, now - self._began

    def write(self, forces: FloatArray) -> None:
        """Check the forces, and show them on the page."""
        self._opened()
        if np.shape(forces) != self._position.shape:
            raise InputError("forces", forces, f"an array of shape {self._position.shape}, one row per finger")
        if not np.isfinite(forces).all():
            self.stop()
            raise DeviceError(f"a force of {np.asarray(forces).tolist()} N is not finite")
        self._forces[:] = forces
        self.screen.show(self._position, self._forces)

    def stop(self) -> None:
        """Show zero force."""
        self._forces[:] = 0.0
        self.screen.show(self._position, self._forces)

    def close(self) -> None:
        self._is_open = False
        self._switches = 0
        self.screen.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _give_way(self, i: int, duration: float) -> None:
        """Move a finger's target along the force that it would display."""
        size = float(np.linalg.norm(self._forces[i]))
        if size:
            away = self._target[i] + self._forces[i] / size
            approach(self._target[i], np.clip(away, *self._box), BACK * duration)

    def _opened(self) -> None:
        if not self._is_open:
            raise DeviceError("the touch screen is not open: call open(period) first")
