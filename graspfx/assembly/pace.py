"""Pace of a run: as fast as it can, or on the wall's clock, with hardware or without, here or in another process."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol

from graspfx.assembly.build import build
from graspfx.assembly.hardware import Hardware, at_hardware
from graspfx.assembly.process.servo_process import servo_process
from graspfx.assembly.run_header import header_of
from graspfx.loop.realtime import pacing
from graspfx.loop.realtime.pacing import Clock, Pacer, WallClock
from graspfx.system.child_process import is_possible

if TYPE_CHECKING:
    from graspfx.assembly.resolve import Parts
    from graspfx.loop.columns import Layout
    from graspfx.loop.servo import Servo
    from graspfx.recording.header import Header
    from graspfx.recording.recorder import Recorder


class Pace(Protocol):
    """A servo that is ready to run at the pace that its scene is run at."""

    @property
    def layout(self) -> Layout:
        """Columns of its rows."""
        ...

    @property
    def header(self) -> Header:
        """Header of its recording."""
        ...

    @property
    def ticks(self) -> int:
        """Ticks so far."""
        ...

    def run(self, ticks: int, recorder: Recorder, stop: Callable[[], bool] | None) -> None:
        """Run that many ticks, fewer if `stop` says so."""

    @property
    def outcome(self) -> dict[str, Any]:
        """Entries of the run's `Outcome`."""
        ...


class OwnPace:
    """Runs a servo in this process.

    Args:
        servo: that is ready to tick.
        header: of its recording.
        hardware: of its scene, open and at rest; None for simulations alone.
        pacer: of its ticks; None for as fast as they can.
    """

    def __init__(self, servo: Servo, header: Header, hardware: Hardware | None, pacer: Pacer | None) -> None:
        self._servo, self._hardware, self._pacer = servo, hardware, pacer
        self.layout = servo.layout
        if hardware is not None:
            header = replace(hardware.header(header), scheduling={"loop": "inline"})
        self.header = header

    @property
    def ticks(self) -> int:
        """Ticks so far."""
        return self._servo.ticks

    def run(self, ticks: int, recorder: Recorder, stop: Callable[[], bool] | None) -> None:
        """Run that many ticks."""
        if self._hardware is None:
            self._servo.run(ticks, recorder, stop, self._pacer)
        else:
            self._hardware.run(ticks, recorder, stop)

    @property
    def outcome(self) -> dict[str, Any]:
        """Entries of the run's `Outcome`."""
        entries = {"engine": self._servo.engine.name, **self._servo.coupling}
        if self._hardware is not None:
            return entries | self._hardware.outcome
        return entries if self._pacer is None else entries | self._pacer.outcome


def pace_of(
    stack: ExitStack, parts: Parts, layout: Layout, ticks: int, *, real_time: bool, clock: Clock | None = None
) -> Pace:
    """Make ready to run a scene: its hardware is open from here on, and closed at the end of the stack.

    With hardware the servo runs in a process of its own, unless the clock is not the machine's.

    Args:
        stack: that closes it.
        parts: of the scene.
        layout: of rows, with the columns that the scene asks for.
        ticks: to run.
        real_time: whether it runs on the wall's clock.
        clock: instead of the machine's.

    Raises:
        DeviceError, InputError, KeyboardInterrupt: as of `at_hardware` and `servo_process`.
    """
    scene, clock = parts.scene, clock or WallClock()
    if real_time and parts.hardware and isinstance(clock, pacing.WallClock) and is_possible():
        return stack.enter_context(servo_process(parts, layout, scene.record.every, ticks=ticks, selected=True))
    servo = stack.enter_context(build(scene, selected=True, real_time=real_time))
    header = header_of(parts, servo.objects)
    if not real_time:
        return OwnPace(servo, header, None, None)
    if not servo.hardware:
        return OwnPace(servo, header, None, Pacer(servo.period, clock))
    hardware = stack.enter_context(at_hardware(servo, parts, clock))
    return OwnPace(servo, header, hardware, hardware.pacer)
