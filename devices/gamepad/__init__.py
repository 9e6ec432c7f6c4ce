"""A gamepad as one finger without force feedback: its sticks set the position or the velocity of the finger.

The driver is intended for users without haptic hardware. It was tested only against an emulator
(`graspfx.testing.wire.EventWire`). It reads /dev/input/event*, which only Linux has, and needs no further packages.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from graspfx.devices._inputs import ABSOLUTE, Event, FloatArray, Pointer, Range
from graspfx.devices._settings import number, whole
from graspfx.protocols import InputError

__all__ = ["Gamepad", "connect"]

STICKS = {"x": 0, "y": 1, "z": 2, "rx": 3, "ry": 4, "rz": 5}  # codes of absolute axes; y axes point down
BUTTONS = tuple(range(0x130, 0x13F))
RANGE = Range(0, -32768, 32767)  # range assumed for an axis that reports no range
MODES = "position", "rate"


class Gamepad(Pointer):  # type: ignore[misc] # mypy does not see devices from inside the package
    """A gamepad as one finger, whose coordinates are controlled by one axis of a stick each.

    Args:
        sticks: For each coordinate of the finger, the code of the stick axis and the sign of the motion.
        rate: Whether a stick sets the velocity of the finger instead of the position.
        dead: Deflection up to which a stick counts as centred, as a fraction of the largest deflection.
    """

    def __init__(self, sticks: Sequence[tuple[int, float]], rate: bool, dead: float, **settings: Any) -> None:
        super().__init__(BUTTONS, **settings)
        self._sticks, self._rate, self._dead = sticks, rate, dead
        self._ranges = [RANGE] * len(sticks)
        self._deflection = np.zeros(len(sticks))

    def _look(self) -> None:
        """Query the axes and the keys."""
        self._deflection[:] = 0.0
        for i, (code, _) in enumerate(self._sticks):
            state = self.source.axis(code)
            if state is not None and state.most > state.least:
                self._ranges[i] = state
                self._deflect(i, state.value)
        super()._look()

    def _act(self, event: Event) -> None:
        if event.kind == ABSOLUTE:
            for i, (code, _) in enumerate(self._sticks):
                if code == event.code:
                    self._deflect(i, event.value)

    def _deflect(self, i: int, value: int) -> None:
        """Store the deflection of stick axis i, from -1 to 1 and zero in the dead zone, for a reported value."""
        _, least, most = self._ranges[i]
        part = max(-1.0, min((2.0 * value - least - most) / (most - least), 1.0))
        size = max(0.0, (abs(part) - self._dead) / (1.0 - self._dead))
        self._deflection[i] = self._sticks[i][1] * (size if part > 0.0 else -size)

    def _move(self, goal: FloatArray, duration: float) -> None:
        if self._rate:
            most = max(1.0, float(np.linalg.norm(self._deflection)))
            goal += self.speed * duration / most * self._deflection
        else:
            low, high = self._box
            [start] = self._start
            outward = np.where(self._deflection > 0.0, high - start, start - low)
            goal[:] = start + outward * self._deflection


def connect(
    *,
    port: str,
    dimensions: int = 2,
    mode: str = "position",
    sticks: Sequence[str] = ("x", "-y", "-ry"),
    workspace: Sequence[Sequence[float]] | None = None,
    start: Sequence[float] | None = None,
    dead: float = 0.1,
    lag: float = 0.02,
    speed: float = 0.2,
    grab: bool = False,
) -> Gamepad:
    """Connect a gamepad.

    Args:
        port: Event file, such as /dev/input/by-id/usb-Maker_Pad-event-joystick; `graspfx devices` lists these files.
        dimensions: Number of dimensions d of the scene.
        mode: "position": a stick sets the position between `start` and the limits of the workspace. "rate": a stick
            sets the velocity, and the finger stops when the stick is released.
        sticks: Stick axis (x, y, z, rx, ry or rz) for each coordinate, with a minus sign to reverse the direction;
            names beyond the first d are ignored.
        workspace: Lower and upper corner of the workspace (2, d) [m]; if None, -0.1 and 0.1 m along every axis.
        start: Position of the finger when the device is opened (d,) [m]; the middle of the workspace if None.
        dead: Deflection up to which a stick counts as centred, as a fraction of the largest deflection.
        lag: Time constant of the filter of the finger's motion [s]; at constant speed, the delay is twice this time.
        speed: Largest speed of the finger [m/s].
        grab: Whether to withhold the events from other programs.
    """
    if mode not in MODES:
        raise InputError("mode", mode, "'position' or 'rate'")
    return Gamepad(
        _sticks(sticks, whole("dimensions", dimensions, 1, 3)), mode == "rate", number("dead", dead, 0.0, 0.9),
        port=port, dimensions=dimensions, workspace=workspace, start=start, lag=lag, speed=speed, grab=grab,
    )  # fmt: skip


def _sticks(names: object, dimensions: int) -> list[tuple[int, float]]:
    if not isinstance(names, list | tuple) or len(names) < dimensions:
        raise InputError("sticks", names, f"a stick for each of {dimensions} axes, such as 'x' and '-y'")
    codes = []
    for name in names[:dimensions]:
        stick = name.removeprefix("-") if isinstance(name, str) else ""
        if stick not in STICKS:
            raise InputError("sticks", name, f"one of {', '.join(STICKS)}, with or without a minus sign")
        codes.append((STICKS[stick], -1.0 if name.startswith("-") else 1.0))
    return codes
