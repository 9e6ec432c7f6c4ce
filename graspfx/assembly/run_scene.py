"""Runs of a scene, to the end or tick by tick as a session."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, overload

from graspfx import log, plugins
from graspfx.assembly.hardware import Hardware, at_hardware
from graspfx.assembly.provenance import header_of, source_name
from graspfx.assembly.resolve import Parts
from graspfx.assembly.session import Session
from graspfx.errors import InputError
from graspfx.loop.realtime import pacing
from graspfx.loop.realtime.pacing import Clock, Pacer, WallClock
from graspfx.numeric import number
from graspfx.progress import waiting
from graspfx.recording.header import Header
from graspfx.recording.record import Recording
from graspfx.recording.recorder import Recorder
from graspfx.scene.tables.reading import Readable
from graspfx.system.child_process import is_possible

if TYPE_CHECKING:
    from graspfx.assembly.process.servo_process import ServoProcess
    from graspfx.assembly.real_time_session import RealTimeSession
    from graspfx.scene.model import Scene


@overload
def open(
    scene: Scene | str | PathLike[str],
    overrides: Mapping[str, Any] | None = None,
    *,
    live: Iterable[str] = (),
    out: str | PathLike[str] | None = None,
    overwrite: bool = False,
    real_time: Literal[False] = False,
) -> Session: ...


@overload
def open(
    scene: Scene | str | PathLike[str],
    overrides: Mapping[str, Any] | None = None,
    *,
    live: Iterable[str] = (),
    out: str | PathLike[str] | None = None,
    overwrite: bool = False,
    real_time: Literal[True],
) -> RealTimeSession: ...


def open(
    scene: Scene | str | PathLike[str],
    overrides: Mapping[str, Any] | None = None,
    *,
    live: Iterable[str] = (),
    out: str | PathLike[str] | None = None,
    overwrite: bool = False,
    real_time: bool = False,
) -> Session:
    """Open a scene as a session that runs tick by tick: `with gx.open("paper-waving") as session: session.step(100)`.

    The recording is bit-identical to that of `gx.run`, for any division into steps.

    If `real_time` is True, the result is a `RealTimeSession`, which runs in real time in another process until it is
    closed. Its scene may have hardware, whose forces act as soon as the session is open.

    Args:
        scene: `Scene`, or name or path of a scene.
        overrides: Values by dotted key that replace values of the scene; none if None.
        live: Keys whose values `Session.set` may change during the run, such as "coupling.internal.stiffness"; `*`
            stands for all entries of a list.
        out: Folder for recording.h5, which is created if it does not exist; None to keep the recording in memory. While
            the session is open, its rows are in recording.h5.part.
        overwrite: Whether to replace an existing recording, or the recording.h5.part of a killed run.
        real_time: Whether ticks follow the wall clock.

    Raises:
        InputError, UnknownNameError: If the scene does not exist; the value of a live key cannot change during a run;
            `out` is not a path; the scene has hardware and `real_time` is False; or a finger on hardware is inside its
            object.
        SceneError: If the scene has faults; the message lists all faults.
        DeviceError: If a device does not open, or is not stationary.
        RecordingError: If `out` already has a recording, another run is writing to `out`, or `out` is not writable.
    """
    if not isinstance(real_time, bool):
        raise InputError("real_time", real_time, "True for the wall clock, or False for steps in simulated time")
    scene_ = _loaded(scene, overrides)
    if not real_time:
        return Session(scene_, live=live, out=out, overwrite=overwrite)
    from graspfx.assembly.real_time_session import RealTimeSession

    return RealTimeSession(scene_, live=live, out=out, overwrite=overwrite)


def run(
    scene: Scene | str | PathLike[str],
    overrides: Mapping[str, Any] | float | None = None,
    *,
    duration: float | None = None,
    out: str | PathLike[str] | None = None,
    overwrite: bool = False,
    stop: Callable[[], bool] | None = None,
    real_time: bool = False,
) -> Recording:
    """Run a scene in simulated time or in real time, and return its recording.

    In simulated time, tick k is at the time k x period, and repeated runs are bit-identical. A scene with hardware runs
    in real time only, and its fingers must be stationary for a fifth of a second before the start. At the end of such a
    run, also after an error, forces are set to zero, then files are closed, and finally the hardware is closed. In the
    main thread, SIGINT, SIGTERM and SIGHUP end the run in this way, and are handled afterwards.

    Args:
        scene: `Scene`, name of a built-in scene, or path of a .toml or .py file.
        overrides: Values by dotted key that replace values of the scene, as for `load`; none if None. (A number is
            interpreted as the duration, with a FutureWarning.)
        duration: Duration [s], rounded to whole periods; the scene's duration if None.
        out: Folder for recording.h5, which is created if it does not exist; None to keep the recording in memory.
            During the run, rows are in recording.h5.part, which `Recording.load` can read, also after the run was
            killed.
        overwrite: Whether to replace an existing recording, or the recording.h5.part of a killed run.
        stop: Function that is called before every tick or, for compiled ticks, once before every 64 ticks; None without
            one. When it returns True, the run ends, and the recording is marked as incomplete.
        real_time: Whether each tick waits for its time on the wall clock; a late tick skips whole periods. The results
            of a simulation do not depend on this argument.

    Raises:
        InputError: If the duration is not a positive time, or too long for memory or disk; `out` is not a path; `stop`
            is not callable; the scene has hardware and `real_time` is False; or a finger on hardware is inside its
            object.
        UnknownNameError, PluginError: If the scene cannot be loaded.
        SceneError: If the scene has faults, or a finger starts outside the workspace of its device.
        DeviceError: If a device does not open, or is not stationary before the run.
        RecordingError: If `out` already has a recording, another run is writing to `out`, or `out` is not writable. If
            rows have been written, the message states their file.
    """
    if isinstance(overrides, int | float):
        if duration is not None:
            raise InputError("overrides", overrides, "values by dotted key", "the duration is given as `duration`")
        note = (
            "a number as second argument (overrides) is interpreted as the duration, which is deprecated: "
            f"write run(scene, duration={overrides})"
        )
        log.warn(note, FutureWarning)
        overrides, duration = None, overrides
    if not isinstance(real_time, bool):
        raise InputError("real_time", real_time, "True for the wall clock, or False for simulated time")
    if stop is not None and not callable(stop):
        raise InputError("stop", stop, "a function without arguments that returns whether to stop, or None")
    scene_ = scene if isinstance(scene, Readable) and not overrides else _loaded(scene, overrides)
    host: Any = getattr(scene_, "host", None)
    if host is not None and not real_time:
        raise InputError(
            "real_time", False, f"True, because the scene has a host, {host.name!r}, which needs real time",
            "use `graspfx run SCENE --real-time`, or gx.open(scene) for a host in the same program",
        )  # fmt: skip
    log.info("scene %s; objects: %d, fingers: %d", scene_.source.name, len(scene_.object), len(scene_.finger))
    ticks = ticks_of(scene_.duration if duration is None else duration, scene_.period)
    kind = RealTimeRun if real_time else WholeRun
    with plugins.unchanged(), kind(scene_, out=out, overwrite=overwrite, ticks=ticks, selected=True) as session:
        session.finish(ticks, stop)
    finished = session.recording
    if out is not None:
        log.info("wrote %s", session.place)
    how = finished.outcome
    log.info("%d ticks in %.3g s, %s; faults: %d", finished.ticks, session.spent, how.engine, len(how.faults))
    return finished


class WholeRun(Session):
    """A run of all ticks, as `run` performs it, whose rows have only the columns that the scene's `record` selects."""

    is_repeated = True

    def finish(self, ticks: int, stop: Callable[[], bool] | None) -> None:
        """Run the ticks until the last one or until `stop` returns True, and close the recording."""
        text = f"running {source_name(self.scene.source)}"

        def done() -> int:
            if self._recorder.faults:  # in real time the run goes on to its end, with nothing to feel
                wait.text = f"{text}, zero force after a fault"
            return self._recorder.ticks

        with waiting(text, ticks, "ticks", done) as wait:
            self._advance(ticks, stop)
        self._close(complete=self._recorder.ticks == ticks)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            self._stack.__exit__(kind, error, trace)  # the recording states the error as its cause

    @property
    def place(self) -> Path | None:
        """Path of the recording's file; None for a recording in memory."""
        return self._place

    @property
    def spent(self) -> float:
        """Time that the run's ticks took [s]."""
        return self._spent


class RealTimeRun(WholeRun):
    """A real-time run, as `run` performs it, with or without hardware.

    In a scene with hardware, the servo runs in a separate process if the operating system supports this and the clock
    is the machine's clock.
    """

    is_paced = True
    is_repeated = False

    def _start(self, stack: ExitStack, parts: Parts, keys: Sequence[str]) -> Header:
        servo = self.servo
        clock: Clock = WallClock()
        self._runner: ServoProcess | Hardware | None = None
        if parts.hardware and isinstance(clock, pacing.WallClock) and is_possible():
            assert self._ticks is not None
            from graspfx.assembly.process.servo_process import servo_process

            process = servo_process(parts, servo.layout, servo.every, ticks=self._ticks, selected=True)
            self._runner = remote = stack.enter_context(process)
            return remote.header
        header = header_of(parts, servo.objects)
        if not parts.hardware:
            self._pacer = Pacer(servo.period, clock)
            return header
        self._runner = hardware = stack.enter_context(at_hardware(servo, parts, clock))
        return replace(hardware.header(header), scheduling={"loop": "inline"})

    def _tick(self, ticks: int, recorder: Recorder, stop: Callable[[], bool] | None) -> None:
        if self._runner is None:
            self.servo.run(ticks, recorder, stop, self._pacer)
        else:
            self._runner.run(ticks, recorder, stop)

    def _outcome(self, complete: bool) -> dict[str, Any]:
        how = self._pacer if self._runner is None else self._runner
        return super()._outcome(complete) | how.outcome


def _loaded(scene: Scene | str | PathLike[str], overrides: Mapping[str, Any] | None) -> Scene:
    from graspfx.scene.load import to_scene  # imports the checks of a scene, which a cached scene does not need

    return to_scene(scene, overrides)


def ticks_of(duration: float, period: float) -> int:
    """Return the number of ticks in a duration [s], rounded to a whole number.

    Raises:
        InputError: If the duration is at most half a period.
    """
    expected = f"a time of at least one period, {period} s"
    ratio = number("duration", duration, expected) / period
    if ratio <= 0.5:
        raise InputError("duration", duration, expected)
    return round(ratio)
