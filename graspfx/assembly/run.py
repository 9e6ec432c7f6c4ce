"""Run a scene, at once or opened as a session: both are sessions, and one steps to the end."""

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
from graspfx.assembly.process.servo_process import ServoProcess, servo_process
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
    """Open a scene as a run that goes on tick by tick: `with gx.open("paper-waving") as session: session.step(100)`.

    For any division into steps the recording is that of `gx.run`, bit by bit.

    With `real_time` it goes on by itself, on the wall's clock and in a process of its own, from here on until it is
    closed: a `RealTimeSession`, whose scene may have hardware. Forces come as soon as it is open.

    Args:
        scene: a scene, its name or its path.
        overrides: values by dotted key.
        live: keys that `Session.set` may change in mid-run, such as "coupling.internal.stiffness"; `*` stands for
            all of a list.
        out: a folder in which recording.h5 is written; it may exist. While the session is open its rows are there in
            recording.h5.part too.
        overwrite: whether a recording that is there already, or the part of a run that was killed, is replaced.
        real_time: whether ticks come by the wall's clock.

    Raises:
        InputError, UnknownNameError: no scene; a live key that cannot change in mid-run; an `out` that is no path;
            hardware without `real_time`, or with a finger inside its object.
        SceneError: with every fault of the scene at once.
        DeviceError: a device that does not open, or is not at rest.
        RecordingError: `out` has a recording already, another run is writing there, or it cannot be written.
    """
    if not isinstance(real_time, bool):
        raise InputError("real_time", real_time, "True for the wall's clock, or False for steps")
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
    """Run a scene: simulated on its own clock (time = tick x period), two runs bit-identical; or in real time.

    A scene with hardware runs in real time only. Its fingers are held still for a fifth of a second before it starts,
    and whatever ends it, zero force comes first, files are closed after that, and the hardware last. In the main thread
    SIGINT, SIGTERM and SIGHUP end it in this order, and are passed on when it is over.

    Args:
        scene: a name on the shelf, the path of a .toml or .py file, or a Scene.
        overrides: values by dotted key, as `load` takes them. (A bare number is taken for the duration, with a
            FutureWarning.)
        duration: instead of the scene's own [s]; rounded to whole periods.
        out: a folder in which recording.h5 is written; it may exist. While the run goes on its rows are only there, in
            recording.h5.part, which `Recording.load` reads also after the run was killed.
        overwrite: whether a recording that is there already, or the part of a run that was killed, is replaced.
        stop: asked again and again, before every tick or, where ticks run compiled, before 64 of them; the first True
            ends the run there, and what was recorded is marked as incomplete.
        real_time: whether each tick waits for its time on the wall's clock; a tick that comes too late leaves out whole
            periods. What a simulation computes is the same.

    Raises:
        InputError: a duration that is not a positive time, or more ticks than there is room for; an `out` that is no
            path, a `stop` that cannot be called; hardware without `real_time`, or with a finger inside its object.
        UnknownNameError, PluginError: of a scene that is loaded.
        SceneError: a scene with faults; a finger that starts out of its device's reach.
        DeviceError: a device that does not open, or is not at rest before the run.
        RecordingError: `out` has a recording already, another run is writing there, or it cannot be written; where
            rows were written already, the error says where they are.
    """
    if isinstance(overrides, int | float):
        if duration is not None:
            raise InputError("overrides", overrides, "values by dotted key", "the duration has been given by its name")
        note = f"a number after the scene is taken for its duration: write run(scene, duration={overrides})"
        log.warn(note, FutureWarning)
        overrides, duration = None, overrides
    if not isinstance(real_time, bool):
        raise InputError("real_time", real_time, "True for the wall's clock, or False for the scene's own")
    if stop is not None and not callable(stop):
        raise InputError("stop", stop, "a function without arguments that says whether to stop, or None")
    scene_ = scene if isinstance(scene, Readable) and not overrides else _loaded(scene, overrides)
    host: Any = getattr(scene_, "host", None)
    if host is not None and not real_time:
        raise InputError(
            "real_time", False, f"True for the scene of a host, {host.name!r}, whose clock is the wall's",
            "`graspfx run SCENE --real-time`; gx.open(scene) steps it beside a host in the same program",
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
    """A run of all its ticks, whose rows have only what the scene records."""

    is_repeated = True

    def finish(self, ticks: int, stop: Callable[[], bool] | None) -> None:
        """Run to the end, or until `stop` says so."""
        text = f"running {source_name(self.scene.source)}"
        with waiting(text, ticks, "ticks", lambda: self._recorder.ticks):
            self._advance(ticks, stop)
        self._close(complete=self._recorder.ticks == ticks)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            self._stack.__exit__(kind, error, trace)  # the recording has it as its cause

    @property
    def place(self) -> Path | None:
        """File of the recording."""
        return self._place

    @property
    def spent(self) -> float:
        """Time that its ticks have taken [s]."""
        return self._spent


class RealTimeRun(WholeRun):
    """A run on the wall's clock: its hardware is open from here on, and closed at its end.

    With hardware the servo runs in a process of its own, unless the clock is not the machine's.
    """

    is_paced = True
    is_repeated = False

    def _start(self, stack: ExitStack, parts: Parts, keys: Sequence[str]) -> Header:
        servo = self.servo
        clock: Clock = WallClock()
        self._runner: ServoProcess | Hardware | None = None
        if parts.hardware and isinstance(clock, pacing.WallClock) and is_possible():
            assert self._ticks is not None
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
    from graspfx.scene.load import to_scene  # loads what checks a scene, which one from the cache does without

    return to_scene(scene, overrides)


def ticks_of(duration: float, period: float) -> int:
    """Count the whole periods in a time.

    Raises:
        InputError: a time that is none, or shorter than a period.
    """
    expected = f"a time of at least one period, {period} s"
    ratio = number("duration", duration, expected) / period
    if ratio <= 0.5:
        raise InputError("duration", duration, expected)
    return round(ratio)
