"""A gamepad as one finger without force: its sticks say where the finger is, or how fast it goes.

For people without hardware. Tested against an emulator only (`graspfx.testing.wire.EventWire`). Read on Linux, from
/dev/input/event*, with no package besides.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from graspfx.devices._inputs.events import ABSOLUTE, Event, EventPort, Range
from graspfx.devices._inputs.pointer import FloatArray, Pointer, box, place
from graspfx.devices._settings import number, port_name
from graspfx.protocols import SMALLEST, InputError

__all__ = ["Gamepad", "connect"]

STICKS = {"x": 0, "y": 1, "z": 2, "rx": 3, "ry": 4, "rz": 5}  # codes of absolute axes, whose y go down
BUTTONS = tuple(range(0x130, 0x13F))
RANGE = Range(0, -32768, 32767)  # where the device tells none
MODES = "position", "rate"


class Gamepad(Pointer):  # type: ignore[misc] # mypy does not see the shelf from inside the package
    """A gamepad: a stick for each axis of the finger.

    Args:
        sticks: code and sign for each axis.
        rate: whether a stick says how fast the finger goes, and not where it is.
        dead: of a stick's way that counts as none.
    """

    def __init__(
        self, port: EventPort, workspace: FloatArray, start: FloatArray, lag: float, speed: float,
        sticks: Sequence[tuple[int, float]], rate: bool, dead: float,
    ) -> None:  # fmt: skip
        super().__init__(port, workspace, start, lag, speed, BUTTONS)
        self._sticks, self._rate, self._dead = sticks, rate, dead
        self._ranges = [RANGE] * len(sticks)
        self._deflection = np.zeros(len(sticks))

    def _begin(self) -> None:
        self._deflection[:] = 0.0
        for i, (code, _) in enumerate(self._sticks):
            state = self.port.axis(code)
            if state is not None and state.most > state.least:
                self._ranges[i] = state
                self._deflect(i, state.value)

    def _act(self, event: Event) -> None:
        if event.kind == ABSOLUTE:
            for i, (code, _) in enumerate(self._sticks):
                if code == event.code:
                    self._deflect(i, event.value)

    def _deflect(self, i: int, value: int) -> None:
        """Note how far a stick is from its middle, from -1 to 1; within the dead way it is there."""
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
            outward = np.where(self._deflection > 0.0, high - self._start, self._start - low)
            goal[:] = self._start + outward * self._deflection


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
        port: its file of events, such as /dev/input/by-id/usb-Maker_Pad-event-joystick; `graspfx devices` lists them.
        dimensions: of the scene.
        mode: "position": a stick says where the finger is between `start` and the workspace's ends; "rate": how fast
            it goes, and where it is left it stays.
        sticks: for each axis one of x, y, z, rx, ry, rz, with a minus where they go the other way; more are left out.
        workspace: corners in which the finger stays, (2, d) [m]; 0.1 m to every side if not given.
        start: of the finger when it is opened, (d,) [m]; the middle of the workspace if not given.
        dead: part of a stick's way that counts as none.
        lag: of the finger behind the sticks; twice that where it moves steadily [s].
        speed: the largest of the finger [m/s].
        grab: whether other programs have no events meanwhile.
    """
    corners = box(workspace, 0.1, dimensions)
    if mode not in MODES:
        raise InputError("mode", mode, "'position' or 'rate'")
    if not isinstance(grab, bool):
        raise InputError("grab", grab, "true or false")
    return Gamepad(
        EventPort(port_name(port), grab=grab),
        corners,
        place(start, corners),
        number("lag", lag, 1e-4, 1.0),
        number("speed", speed, SMALLEST, 5.0),
        _sticks(sticks, dimensions),
        mode == "rate",
        number("dead", dead, 0.0, 0.9),
    )


def _sticks(names: object, dimensions: int) -> list[tuple[int, float]]:
    if not isinstance(names, list | tuple) or len(names) < dimensions:
        raise InputError("sticks", names, f"a stick for each of {dimensions} axes, such as 'x' and '-y'")
    codes = []
    for name in names[:dimensions]:
        stick = name.removeprefix("-") if isinstance(name, str) else ""
        if stick not in STICKS:
            raise InputError("sticks", name, f"one of {', '.join(STICKS)}, with or without a minus")
        codes.append((STICKS[stick], -1.0 if name.startswith("-") else 1.0))
    return codes
