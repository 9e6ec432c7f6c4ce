"""A mouse as one finger without force feedback: its motion moves the finger, and its wheel is the third axis.

The driver is intended for users without haptic hardware. It was tested only against an emulator
(`graspfx.testing.wire.EventWire`). It reads /dev/input/event*, which only Linux has, and needs no further packages. The
desktop's pointer also moves unless `grab` is set.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from graspfx.devices._inputs import RELATIVE, Event, Pointer
from graspfx.devices._settings import number

__all__ = ["Mouse", "connect"]

INCH = 0.0254  # [m]
RIGHT, DOWN, WHEEL = 0, 1, 8  # codes of relative axes
BUTTONS = 0x110, 0x111, 0x112  # left, right, middle
MOST_COUNTS = 10_000  # largest count of one event


class Mouse(Pointer):  # type: ignore[misc] # mypy does not see devices from inside the package
    """A mouse as one finger, with x to the right, y away from the user, and z moved by the wheel.

    Args:
        counts: Motion of the finger per count of the mouse [m].
        notch: Motion of the finger along z per notch of the wheel [m].
        settings: Settings of `Pointer`.
    """

    def __init__(self, counts: float, notch: float, **settings: Any) -> None:
        super().__init__(BUTTONS, **settings)
        self._steps = {RIGHT: (0, counts), DOWN: (1, -counts), WHEEL: (2, notch)}

    def _act(self, event: Event) -> None:
        axis, step = self._steps.get(event.code, (len(self._goal), 0.0))
        if event.kind == RELATIVE and axis < len(self._goal):
            self._goal[axis] += step * max(-MOST_COUNTS, min(event.value, MOST_COUNTS))
            np.clip(self._goal, *self._box, out=self._goal)


def connect(
    *,
    port: str,
    dimensions: int = 2,
    dpi: float = 1000.0,
    wheel: float = 0.002,
    workspace: Sequence[Sequence[float]] | None = None,
    start: Sequence[float] | None = None,
    lag: float = 0.01,
    speed: float = 1.0,
    grab: bool = False,
) -> Mouse:
    """Connect a mouse.

    Args:
        port: Event file, such as /dev/input/by-id/usb-Maker_Mouse-event-mouse; `graspfx devices` lists these files.
        dimensions: Number of dimensions d of the scene.
        dpi: Resolution of the mouse [counts/inch]; doubling this value halves the finger's motion.
        wheel: Motion along the third axis per notch of the wheel [m].
        workspace: Lower and upper corner of the workspace (2, d) [m]; if None, -0.1 and 0.1 m along every axis.
        start: Position of the finger when the device is opened (d,) [m]; the middle of the workspace if None.
        lag: Time constant of the filter of the finger's motion [s]; at constant speed, the delay is twice this time.
        speed: Largest speed of the finger [m/s].
        grab: Whether to withhold the events from the desktop.
    """
    return Mouse(
        INCH / number("dpi", dpi, 1.0), number("wheel", wheel, 0.0, 1.0), port=port, dimensions=dimensions,
        workspace=workspace, start=start, lag=lag, speed=speed, grab=grab,
    )  # fmt: skip
