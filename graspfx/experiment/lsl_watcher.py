"""Streams of a session by LSL: its events as markers, and the rows of each run while it is shown."""

from __future__ import annotations

from typing import TYPE_CHECKING

from graspfx.experiment.markers import Event
from graspfx.live.lsl_outlet import MarkerStream, RowStream, load_lsl

if TYPE_CHECKING:
    from graspfx.live.live_run import LiveRun


class LslMarkers:
    """A stream of a session's events, as texts such as "3 stimulus 1": trial, event, interval, value.

    Args:
        name: of the stream.

    Raises:
        MissingPackageError: no pylsl, or no library.
    """

    def __init__(self, name: str) -> None:
        self.stream = MarkerStream(name)

    def mark(self, event: Event) -> None:
        """Send an event with its time."""
        words = [event.trial or "", event.name, event.interval or "", event.value]
        self.stream.send(" ".join(str(word) for word in words if word != ""), event.clock)


class LslRows:
    """A stream of rows that follows runs, a watcher; one whose rows have other columns has a stream of its own.

    Args:
        name: of the stream.

    Raises:
        MissingPackageError: no pylsl, or no library.
    """

    def __init__(self, name: str) -> None:
        load_lsl()  # what is missing is said before the first trial
        self._name = name
        self.stream: RowStream | None = None
        self._columns = ""

    def attach(self, run: LiveRun) -> None:
        """Stream a run from now on."""
        columns = f"{list(run.layout.columns)} {run.layout.fingers} {run.period}"
        if self.stream is None or columns != self._columns:
            self.close()
            self.stream, self._columns = RowStream(self._name, run.layout, run.period), columns
        self.stream.attach(run)

    def detach(self) -> None:
        """Stream it no more."""
        if self.stream is not None:
            self.stream.detach()

    def close(self) -> None:
        """End the stream."""
        if self.stream is not None:
            self.stream.close()
            self.stream = None
