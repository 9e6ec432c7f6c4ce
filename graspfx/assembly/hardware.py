"""A run's hardware, in the order that keeps it safe: open, settle, arm, run, rest, close."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.build import meet
from graspfx.errors import InputError
from graspfx.loop.device_exchange import DeviceExchange
from graspfx.loop.realtime.lifecycle import Rest, look_again, opened, settle
from graspfx.loop.realtime.pacing import Clock, Pacer
from graspfx.loop.realtime.process import Exits, Interruption, frozen_memory, signals_end
from graspfx.progress import waiting

if TYPE_CHECKING:
    from graspfx.assembly.resolve import Parts
    from graspfx.loop.columns import RowTaker
    from graspfx.loop.servo import Servo
    from graspfx.recording.header import Header

FloatArray = NDArray[np.float64]

TOUCH = 1e-3  # a finger this deep in an object is called touching [m]


class Hardware:
    """Hardware that is open and at rest, at zero force.

    Args:
        servo: that is ready to tick.
        parts: of its scene.
        devices: that are open.
        clock: of the run.
        exits: signals that ask the run to end.

    Attributes:
        pacer: of the run's ticks.
    """

    def __init__(self, servo: Servo, parts: Parts, devices: DeviceExchange, clock: Clock, exits: Exits) -> None:
        self._servo, self._parts, self._devices, self._clock, self._exits = servo, parts, devices, clock, exits
        self.pacer = Pacer(servo.period, clock, machine=servo.engine.name == "compiled")
        self._rest: Rest = settle(devices, servo.period, clock)
        self._time = clock.now()
        self._offset = self._meet(self._rest.positions)

    def header(self, header: Header) -> Header:
        """Add to a header where the fingers are."""
        names = self._servo.layout.fingers
        settled = {
            names[f]: {"position": p.tolist(), "offset": self._offset[f].tolist()}
            for f, p in self._rest.positions.items()
        }
        return replace(header, settled=settled, round_trip=self._rest.round_trip)

    def run(self, ticks: int, recorder: RowTaker, stop: Callable[[], bool] | None) -> None:
        """Arm and run; whatever happens, zero force is the first that comes after it.

        A signal ends the run like `stop`.
        """
        try:
            self._arm()
            self._servo.run(ticks, recorder, self._stops(stop), self.pacer)
        except Interruption:
            pass  # of a driver's call, by a signal
        finally:
            self._servo.rest(recorder)

    @property
    def has_unstopped(self) -> bool:
        """Whether the force of a device may still be there, as it did not let itself be stopped."""
        return self._devices.has_unstopped

    @property
    def outcome(self) -> dict[str, Any]:
        """Entries of the run's `Outcome`: what ended it early, readings without a new sample, and lateness."""
        cause = self._servo.hang or self._exits.cause
        return {"cause": cause, "repeats": self._devices.repeats, **self.pacer.outcome}

    def _stops(self, stop: Callable[[], bool] | None) -> Callable[[], bool]:
        return Stops(self._exits, stop)

    def _arm(self) -> None:
        """Look once more where the fingers are, and let those in gradually that are inside an object."""
        periods = 1 + int((self._clock.now() - self._time) / self._servo.period)
        look_again(self._devices, self._rest, periods)
        for each in self._devices.ports:
            if each.port.misses is not None:
                each.port.misses[0] = 0.0  # counted from the first tick on
            offset = np.array([self._offset[f] if f >= 0 else 0.0 * self._offset[0] for f in each.channels])
            if offset.any():
                step = self._servo.period * each.fitting.every
                each.readings.let_in(offset, self._servo.guards.soft_start, step)

    def _meet(self, positions: dict[int, FloatArray]) -> FloatArray:
        """Let the fingers meet their objects where they are; give by how much each is deeper, (n, d) [m].

        Raises:
            InputError: a finger that is inside its object, unless `coupling.enter` lets it in.
        """
        servo = self._servo
        offset = meet_hardware(servo, self._parts, positions)
        if self._parts.scene.coupling.enter == "refuse":
            for part in servo.objects:
                for f in part.fingers.tolist():
                    if np.linalg.norm(offset[f]) > TOUCH:
                        raise _refusal(self._devices, servo.layout.fingers[f], f, part.name, offset[f], servo)
        return offset


class Stops:
    """Tells whether a run is to stop: a signal has come, or who runs it says so.

    Args:
        exits: the signals.
        stop: of who runs it.
    """

    def __init__(self, exits: Exits, stop: Callable[[], bool] | None) -> None:
        self._numbers, self._stop = exits.numbers, stop

    @property
    def has_news(self) -> bool:
        """Whether who runs it has something to write into the memories of the run."""
        return bool(getattr(self._stop, "has_news", False))

    def __call__(self) -> bool:
        return bool(self._numbers) or (self._stop is not None and self._stop())


def meet_hardware(servo: Servo, parts: Parts, positions: Mapping[int, FloatArray]) -> FloatArray:
    """Let fingers that hardware has at these positions meet their objects there, or a depth above, (n, d) [m].

    Returns:
        By how much each of them is deeper than where it meets its object, (n, d) [m].
    """
    start = parts.start.copy()
    for f, position in positions.items():
        start[f] = position
    meet(parts, servo.objects, servo.movers, start)
    offset = np.zeros_like(start)
    for part in servo.objects:
        depth = part.grasped.depths(start[part.fingers])
        for f, each in zip(part.fingers.tolist(), depth, strict=True):
            if f in positions:
                offset[f] = each
    if offset.any():
        meet(parts, servo.objects, servo.movers, start - offset)
    servo.watch.note()
    return offset


@contextmanager
def at_hardware(
    servo: Servo, parts: Parts, clock: Clock, *, ready: Callable[[Exits], None] | None = None
) -> Iterator[Hardware]:
    """Open a scene's hardware, and close it in the end: all that takes time has been done before.

    Args:
        servo: that is ready to tick.
        parts: of its scene.
        clock: of the run.
        ready: called when all is there but the hardware, which is opened after it.

    Raises:
        DeviceError: a device that does not open or is not at rest.
        InputError: a finger that is inside its object.
        KeyboardInterrupt: a signal came before the run, or within it, where its own handler let the process go on.
    """
    with waiting("preparing ticks"):
        devices = servo.prepare()
    with frozen_memory(), signals_end() as exits:
        devices.exits = exits
        hardware = devices.hardware
        if ready is not None:
            ready(exits)
        with opened(hardware, servo.period):
            yield Hardware(servo, parts, hardware, clock, exits)


def _refusal(devices: DeviceExchange, finger: str, f: int, thing: str, depth: FloatArray, servo: Servo) -> InputError:
    name, deep = next(each.name for each in devices.ports if f in each.channels), 1e3 * np.linalg.norm(depth)
    return InputError(
        "coupling.enter", "refuse", f"fingers outside of their objects: {finger} is {deep:.1f} mm inside "
        f"{thing}, read by {name}",
        f"move it out and start again; 'ramp' lets it in within {servo.guards.soft_start:g} s",
    )  # fmt: skip
