"""A finger that smoothly follows a target, which an input device moves."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray

from graspfx.devices._inputs.events import DROPPED, KEY, REPORT, SYNC, Event, EventPort, is_down
from graspfx.protocols import DeviceError, Features, Follower, InputError, approach, finite

FloatArray = NDArray[np.float64]

LONGEST = 0.1  # longest time between two readings during which the target continues to move [s]
AXES = 3


class Pointer(ABC):
    """One finger without force feedback: forces are checked but not displayed.

    Events move a target within the workspace, at most at `speed`. The finger follows the target with critical damping,
    so that events at 60 to 1000 Hz give a smooth motion for a loop of any rate. Without events, the target comes to
    rest, unless a subclass moves its goal.

    Args:
        port: Port of the device's events.
        workspace: Corners of the workspace (2, d) [m].
        start: Position of the finger when the device is opened (d,) [m].
        lag: Time constant of the finger, which lags a target of constant velocity by twice this time [s].
        speed: Largest speed of the target [m/s].
        buttons: Codes of the device's switches; the first switch is bit 0.
    """

    def __init__(
        self,
        port: EventPort,
        workspace: FloatArray,
        start: FloatArray,
        lag: float,
        speed: float,
        buttons: Sequence[int],
    ) -> None:
        self.port, self.speed = port, speed
        self._box, self._start, self._buttons = workspace, start, tuple(buttons)
        self._goal, self._target = start.copy(), start.copy()
        self._follower = Follower(lag, start[None, :])
        self._position, self._velocity = self._follower.position, self._follower.velocity
        self._switches = 0
        self._is_open = False

    @property
    def features(self) -> Features:
        d = len(self._start)
        return Features(
            fingers=1,
            dimensions=d,
            workspace=(self._box[0].copy(), self._box[1].copy()),
            continuous_force=0.0,
            switches=len(self._buttons),
        )

    @property
    def switches(self) -> int:
        """Buttons pressed at the last reading, as bits."""
        return self._switches

    def open(self, period: float) -> None:
        self.close()
        self.port.open()
        self._goal[:] = self._target[:] = self._start
        self._follower.place(self._start)
        self._events: list[Event] = []  # events since the last report
        self._is_lost = False  # whether events of this report were lost
        self._begin()
        self._look_at_keys()
        self._began = self._time = self.port.now()
        self._is_open = True

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        """Return position (1, d) [m], velocity (1, d) [m/s] and time [s]."""
        self._opened()
        self._take(self.port.events())
        now = self.port.now()
        duration, self._time = min(now - self._time, LONGEST), now
        self._move(self._goal, duration)
        np.clip(self._goal, *self._box, out=self._goal)
        approach(self._target, self._goal, self.speed * duration)
        self._follower.follow(self._target, duration)
        return self._position, self._velocity, now - self._began

    def write(self, forces: FloatArray) -> None:
        """Check the forces without displaying them."""
        self._opened()
        if np.shape(forces) != self._position.shape:
            raise InputError("forces", forces, f"an array of shape {self._position.shape}: one finger")
        if not np.isfinite(forces).all():
            raise DeviceError(f"a force of {np.asarray(forces).tolist()} N is not finite")

    def stop(self) -> None:  # noqa: B027 (every device has it)
        """Do nothing, because there is no force."""

    def close(self) -> None:
        self._is_open = False
        self._switches = 0
        self.port.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _begin(self) -> None:  # noqa: B027 (not every device has axes that stand somewhere)
        """Read the axes, when the device is opened and after lost events."""

    @abstractmethod
    def _act(self, event: Event) -> None:
        """Process an event of a complete report that is not a key event."""

    def _move(self, goal: FloatArray, duration: float) -> None:  # noqa: B027 (nor sticks)
        """Move the goal without events, for example while a stick is deflected."""

    def _take(self, events: Iterable[Event]) -> None:
        """Process complete reports; after lost events, use only the state that can be queried."""
        for event in events:
            if event.kind != SYNC:
                self._events.append(event)
            elif event.code == DROPPED:
                self._is_lost = True
                self._switches = 0  # events of released buttons may have been lost
            elif event.code == REPORT:
                report, self._events = self._events, []
                if self._is_lost:
                    self._is_lost = False
                    self._begin()
                    self._look_at_keys()
                else:
                    for each in report:
                        self._press(each) if each.kind == KEY else self._act(each)
            del self._events[:-1000]  # limits the memory for a device that never ends a report

    def _press(self, event: Event) -> None:
        if event.code in self._buttons:
            bit = 1 << self._buttons.index(event.code)
            self._switches = self._switches | bit if event.value else self._switches & ~bit

    def _look_at_keys(self) -> None:
        keys = self.port.keys()
        if keys is not None:
            self._switches = sum(1 << i for i, code in enumerate(self._buttons) if is_down(keys, code))

    def _opened(self) -> None:
        if not self._is_open:
            raise DeviceError("the input device is not open: call open(period) first")


def box(workspace: object, size: float, dimensions: object) -> FloatArray:
    """Return the corners of a workspace (2, d) [m]; by default, those of the cube of half-width `size` about zero."""
    if isinstance(dimensions, bool) or not isinstance(dimensions, int) or not 1 <= dimensions <= AXES:
        raise InputError("dimensions", dimensions, "1, 2 or 3")
    if workspace is None:
        return np.array([[-size] * dimensions, [size] * dimensions])
    expected = f"two corners of {dimensions} coordinates [m], each of the first corner below that of the second"
    corners = finite("workspace", workspace, expected)
    if corners.shape != (2, dimensions) or not (corners[0] < corners[1]).all():
        raise InputError("workspace", workspace, expected)
    return corners


def place(start: object, workspace: FloatArray) -> FloatArray:
    """Return the initial position of a finger (d,) [m]; the middle of its workspace if `start` is None."""
    if start is None:
        middle: FloatArray = workspace.mean(axis=0)
        return middle
    point = finite("start", start, "coordinates within the workspace [m]")
    if point.shape != workspace.shape[1:] or not ((workspace[0] <= point) & (point <= workspace[1])).all():
        raise InputError("start", start, "coordinates within the workspace [m]")
    return point
