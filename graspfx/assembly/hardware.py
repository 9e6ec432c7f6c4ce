"""Use of hardware in a run, in a safe order: open, settle, arm, run, set forces to zero, close."""

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

TOUCH = 1e-3  # depth up to which a finger counts as touching [m]


class Hardware:
    """Hardware that is open, stationary and at zero force, and its run.

    Args:
        servo: Servo that is ready to run.
        parts: Parts of the servo's scene.
        devices: Open devices.
        clock: Clock of the run.
        exits: Signals that end the run.

    Attributes:
        pacer: Pacer of the run's ticks.
    """

    def __init__(self, servo: Servo, parts: Parts, devices: DeviceExchange, clock: Clock, exits: Exits) -> None:
        self._servo, self._parts, self._devices, self._clock, self._exits = servo, parts, devices, clock, exits
        self.pacer = Pacer(servo.period, clock, machine=servo.engine.name == "compiled")
        self._rest: Rest = settle(devices, servo.period, clock)
        self._time = clock.now()
        self._offset = self._meet(self._rest.positions)

    def header(self, header: Header) -> Header:
        """Return a header with positions and depths of the fingers on hardware, and the devices' round-trip time."""
        names = self._servo.layout.fingers
        settled = {
            names[f]: {"position": p.tolist(), "offset": self._offset[f].tolist()}
            for f, p in self._rest.positions.items()
        }
        return replace(header, settled=settled, round_trip=self._rest.round_trip)

    def run(self, ticks: int, recorder: RowTaker, stop: Callable[[], bool] | None) -> None:
        """Arm the devices and run the ticks; at the end, also after an error, set all forces to zero.

        A signal ends the run, and so does `stop` when it returns True.
        """
        try:
            self._arm()
            self._servo.run(ticks, recorder, self._stops(stop), self.pacer)
        except Interruption:
            pass  # a signal interrupted a driver's call
        finally:
            self._servo.rest(recorder)

    @property
    def has_unstopped(self) -> bool:
        """Whether a device could not be stopped, so that the device's force may persist."""
        return self._devices.has_unstopped

    @property
    def outcome(self) -> dict[str, Any]:
        """Items of the run's `Outcome`: cause of an early end, number of repeated samples, and lateness of ticks."""
        cause = self._servo.hang or self._exits.cause
        return {"cause": cause, "repeats": self._devices.repeats, **self.pacer.outcome}

    def _stops(self, stop: Callable[[], bool] | None) -> Callable[[], bool]:
        return Stops(self._exits, stop)

    def _arm(self) -> None:
        """Check again that the devices are stationary, and let forces of fingers inside an object grow gradually."""
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
        """Compute the contacts of the fingers at `positions`; return their depths in the objects, (n, d) [m].

        Raises:
            InputError: If a finger is more than 1 mm inside its object, and `coupling.enter` is "refuse".
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
    """Stop condition of a run: True after a signal, or if the caller's function returns True.

    Args:
        exits: Signals that end the run.
        stop: Function of the caller; None without one.
    """

    def __init__(self, exits: Exits, stop: Callable[[], bool] | None) -> None:
        self._numbers, self._stop = exits.numbers, stop

    @property
    def has_news(self) -> bool:
        """Whether the caller's function has data to write into the memories of the run."""
        return bool(getattr(self._stop, "has_news", False))

    def __call__(self) -> bool:
        return bool(self._numbers) or (self._stop is not None and self._stop())


def meet_hardware(servo: Servo, parts: Parts, positions: Mapping[int, FloatArray]) -> FloatArray:
    """Compute the contacts of fingers on hardware at their positions; a contact is never inside an object.

    Args:
        servo: Servo of the run.
        parts: Parts of the servo's scene.
        positions: Position (d,) [m] of each finger on hardware, by index of the finger.

    Returns:
        Vectors from the contact points to the positions of fingers inside an object, (n, d) [m]; zero for others.
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
    """Open a scene's hardware, wait until it is stationary, and close it on exit.

    Slow preparations must be finished before this function is called.

    Args:
        servo: Servo that is ready to run.
        parts: Parts of the servo's scene.
        clock: Clock of the run.
        ready: Function that is called when the ticks are prepared, before the hardware is opened; None without one.

    Raises:
        DeviceError: If a device does not open or is not stationary.
        InputError: If a finger is more than 1 mm inside its object, and `coupling.enter` is "refuse".
        KeyboardInterrupt: If a signal arrived while devices were opened or settled, and its handler did not end the
            process.
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
        "coupling.enter", "refuse", f"fingers outside their objects: {finger} is {deep:.1f} mm inside "
        f"{thing}, read by {name}",
        f"move the finger out and start again, or set 'ramp' to increase its force over {servo.guards.soft_start:g} s",
    )  # fmt: skip
