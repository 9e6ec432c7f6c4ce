"""Presentation of intervals; each interval is a run from rest, in real time or as fast as possible."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from graspfx.errors import GraspFXError, RecordingError
from graspfx.recording.files import NAME

if TYPE_CHECKING:
    from graspfx.live.live_run import LiveRun
    from graspfx.scene.model import Scene

LOOK = 0.01  # longest wait between two checks of a run [s]


class Showing(NamedTuple):
    """Presented interval.

    Attributes:
        recording: File of the recording.
        zero: Time of the first tick on the clock of `time.monotonic` [s].
        end: Time at which the forces had faded out, on the clock of `time.monotonic` [s].
        fault: Description of a fault; empty for none.
        is_whole: Whether the interval reached its end or was ended by an answer.
    """

    recording: Path
    zero: float
    end: float
    fault: str
    is_whole: bool


class Watcher(Protocol):
    """Observer of runs, such as a page or a stream."""

    def attach(self, run: LiveRun) -> None:
        """Start watching a run."""
        ...

    def detach(self) -> None:
        """Stop watching the run, which is about to end."""
        ...


class Presenter(Protocol):
    """Method of presenting intervals."""

    has_hardware: bool

    def show(
        self, values: Mapping[str, Any], folder: Path, begin: Callable[[float], object],
        is_answered: Callable[[], bool], stop: Callable[[], bool],
    ) -> Showing:  # fmt: skip
        """Present an interval.

        Args:
            values: Values of the scene, by dotted key.
            folder: Folder of the recording.
            begin: Function called with the time of the first tick on the clock of `time.monotonic` [s].
            is_answered: Function that returns whether an answer has ended the interval.
            stop: Function that returns whether to abort the interval.

        Raises:
            RecordingError: If the recording cannot be written, so that the presented stimulus is unknown.
        """
        ...


class RealTime:
    """Real-time presentation, with the process and the safety chain of every real-time run.

    Each interval is a separate run that starts at rest. No gain changes during a run, and all forces fade before the
    run ends.

    Args:
        scene: Scene with the values that all trials share.
        duration: Duration of an interval [s].
        watchers: Observers of the runs.
    """

    def __init__(self, scene: Scene, duration: float, watchers: Sequence[Watcher] = ()) -> None:
        from graspfx.assembly.resolve import resolve

        self._scene, self._duration, self._watchers = scene, duration, tuple(watchers)
        self.has_hardware = bool(resolve(scene).hardware)

    def show(
        self, values: Mapping[str, Any], folder: Path, begin: Callable[[float], object],
        is_answered: Callable[[], bool], stop: Callable[[], bool],
    ) -> Showing:  # fmt: skip
        """Present an interval in real time.

        Every error of GraspFX except a RecordingError becomes the fault of the interval.
        """
        from graspfx.live.live_run import LiveRun

        scene = self._scene.replace(values)
        zero, is_whole, fault = time.monotonic(), False, ""
        try:
            with ExitStack() as stack:
                run = stack.enter_context(LiveRun(scene, out=folder))
                run.await_row(-1, 1.0)
                zero = _zero(run)
                begin(zero)
                for watcher in self._watchers:
                    watcher.attach(run)
                    stack.callback(watcher.detach)
                is_whole = self._wait(run, is_answered, stop)
                if run.state != "ended":
                    run.rest()
                fault = "" if run.fault is None else str(run.fault)
                if not fault and run.cause and not is_whole:
                    fault = run.cause
                if isinstance(run.error, RecordingError):
                    raise run.error
        except RecordingError as error:
            if fault and fault not in str(error):
                raise RecordingError(f"{error}; before that: {fault}") from error
            raise
        except GraspFXError as error:
            fault = fault or " ".join(str(error).split())
        return Showing(folder / NAME, zero, time.monotonic(), fault, is_whole)

    def _wait(self, run: LiveRun, is_answered: Callable[[], bool], stop: Callable[[], bool]) -> bool:
        while run.time < self._duration:
            if stop() or run.state == "ended" or run.fault is not None:
                return False
            if is_answered():
                return True
            run.await_row(run.tick, LOOK)
        return True


class Simulated:
    """Presentation as fast as possible, for simulated observers.

    Args:
        scene: Scene with the values that all trials share, without hardware.
        duration: Duration of an interval [s].
    """

    has_hardware = False

    def __init__(self, scene: Scene, duration: float) -> None:
        self._scene, self._duration = scene, duration

    def show(
        self, values: Mapping[str, Any], folder: Path, begin: Callable[[float], object],
        is_answered: Callable[[], bool], stop: Callable[[], bool],
    ) -> Showing:  # fmt: skip
        """Simulate an interval as fast as possible."""
        from graspfx.assembly.run_scene import run

        zero = time.monotonic()
        begin(zero)
        recording = run(self._scene.replace(values), duration=self._duration, out=folder, stop=stop)
        fault = str(recording.faults[0]) if recording.faults else ""
        return Showing(folder / NAME, zero, time.monotonic(), fault, bool(recording.outcome.complete))


def _zero(run: LiveRun) -> float:
    """Return the time of a run's first tick on the clock of `time.monotonic` [s]."""
    now, row, columns = time.monotonic(), run.row(), run.layout.columns
    if row is None or "wall" not in columns:
        return now
    return now - float(row[columns["wall"].where][0])
