"""Pace of a run: as fast as it can, or on the wall's clock, with hardware or without."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from graspfx.build.hardware import Hardware, at_hardware
from graspfx.loop.realtime.pacing import Clock, Pacer, WallClock

if TYPE_CHECKING:
    from graspfx.build.resolve import Parts
    from graspfx.loop.recording.header import Header
    from graspfx.loop.recording.recorder import Recorder
    from graspfx.loop.servo import Servo


class Pace:
    """Runs a servo at the pace that its scene is run at.

    Args:
        servo: that is ready to tick.
        hardware: of its scene, open and at rest; None for simulations alone.
        pacer: of its ticks; None for as fast as they can.
    """

    def __init__(self, servo: Servo, hardware: Hardware | None, pacer: Pacer | None) -> None:
        self._servo, self._hardware, self._pacer = servo, hardware, pacer

    def header(self, header: Header) -> Header:
        """Add to a header what it says of hardware."""
        return header if self._hardware is None else self._hardware.header(header)

    def run(self, ticks: int, recorder: Recorder, stop: Callable[[], bool] | None) -> None:
        """Run that many ticks."""
        if self._hardware is None:
            self._servo.run(ticks, recorder, stop, self._pacer)
        else:
            self._hardware.run(ticks, recorder, stop)

    @property
    def outcome(self) -> dict[str, Any]:
        """Entries of the run's `Outcome`."""
        skipped = {} if self._pacer is None else {"skipped": self._pacer.skipped}
        return skipped if self._hardware is None else skipped | self._hardware.outcome


def pace_of(stack: ExitStack, servo: Servo, parts: Parts, *, real_time: bool, clock: Clock | None = None) -> Pace:
    """Make ready to run a servo: its hardware is open from here on, and closed at the end of the stack.

    Args:
        stack: that closes it.
        servo: that is ready to tick.
        parts: of its scene.
        real_time: whether it runs on the wall's clock.
        clock: instead of the machine's.

    Raises:
        DeviceError, InputError, KeyboardInterrupt: as of `at_hardware`.
    """
    if not real_time:
        return Pace(servo, None, None)
    clock = clock or WallClock()
    if not servo.hardware:
        return Pace(servo, None, Pacer(servo.period, clock))
    hardware = stack.enter_context(at_hardware(servo, parts, clock))
    return Pace(servo, hardware, hardware.pacer)
