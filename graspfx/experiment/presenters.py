"""Presentation of an interval: a run that starts at rest, in real time or as fast as it computes."""

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

LOOK = 0.01  # between two looks at a run, at the most [s]


class Showing(NamedTuple):
    """An interval that was shown.

    Attributes:
        recording: its file.
        zero: of its first tick, of `time.monotonic` [s].
        end: when its forces had faded, likewise.
        fault: in words; empty for none.
        is_whole: whether it was shown to its end, or ended by an answer, and not broken off.
    """

    recording: Path
    zero: float
    end: float
    fault: str
    is_whole: bool


class Watcher(Protocol):
    """Who looks on while a run is shown: a page, a stream."""

    def attach(self, run: LiveRun) -> None:
        """Look at a run from now on."""
        ...

    def detach(self) -> None:
        """Look at it no more: it is about to end."""
        ...


class Presenter(Protocol):
    """A way to show intervals."""

    has_hardware: bool

    def show(
        self, values: Mapping[str, Any], folder: Path, begin: Callable[[float], object],
        is_answered: Callable[[], bool], stop: Callable[[], bool],
    ) -> Showing:  # fmt: skip
        """Show an interval.

        Args:
            values: of the scene, by dotted key.
            folder: of its recording.
            begin: is told the time of the first tick.
            is_answered: whether it may end before its time.
            stop: whether to break it off.

        Raises:
            RecordingError: the disk does not take the recording: nobody knows what was shown.
        """
        ...


class RealTime:
    """Runs on the wall's clock, through the process and the safety chain of every run in real time.

    Each interval is a run of its own, that starts at rest; before it ends every force fades, and no gain changes while
    it goes on.

    Args:
        scene: with the values of all trials.
        duration: of an interval [s].
        watchers: who looks on.
    """

    def __init__(self, scene: Scene, duration: float, watchers: Sequence[Watcher] = ()) -> None:
        from graspfx.assembly.resolve import resolve

        self._scene, self._duration, self._watchers = scene, duration, tuple(watchers)
        self.has_hardware = bool(resolve(scene).hardware)

    def show(
        self, values: Mapping[str, Any], folder: Path, begin: Callable[[float], object],
        is_answered: Callable[[], bool], stop: Callable[[], bool],
    ) -> Showing:  # fmt: skip
        """Show an interval, by the wall's clock; whatever keeps hardware from its work is a fault."""
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
    """Runs as fast as they compute, for simulated observers.

    Args:
        scene: with the values of all trials; without hardware.
        duration: of an interval [s].
    """

    has_hardware = False

    def __init__(self, scene: Scene, duration: float) -> None:
        self._scene, self._duration = scene, duration

    def show(
        self, values: Mapping[str, Any], folder: Path, begin: Callable[[float], object],
        is_answered: Callable[[], bool], stop: Callable[[], bool],
    ) -> Showing:  # fmt: skip
        """Compute an interval; its time is the run's own."""
        from graspfx.assembly.run import run

        zero = time.monotonic()
        begin(zero)
        recording = run(self._scene.replace(values), duration=self._duration, out=folder, stop=stop)
        fault = str(recording.faults[0]) if recording.faults else ""
        return Showing(folder / NAME, zero, time.monotonic(), fault, bool(recording.outcome.complete))


def _zero(run: LiveRun) -> float:
    """Give when a run's first tick was, of `time.monotonic`."""
    now, row, columns = time.monotonic(), run.row(), run.layout.columns
    if row is None or "wall" not in columns:
        return now
    return now - float(row[columns["wall"].where][0])
