"""Event markers of a session: written to its event table and beside each recording, and sent to listeners."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from graspfx.experiment.session_files import RowFile, SessionFiles, cell, place_file
from graspfx.live.lsl_outlet import MarkerStream

EVENTS = {
    "onset": {"Description": "time since the start of the session", "Units": "s"},
    "duration": {"Description": "not applicable: events are instants", "Units": "s"},
    "trial_number": {"Description": "number of the trial"},
    "event": {
        "Description": "what happened",
        "Levels": {
            "trial": "the trial began",
            "stimulus": "first tick of an interval's run",
            "end": "the run's forces had faded",
            "question": "the question could be answered",
            "response": "the question was answered",
            "break": "a pause began",
            "resume": "the session was resumed, in another process",
        },
    },
    "interval": {"Description": "interval of the trial, from 1"},
    "value": {"Description": "condition, answer, or another detail of the event"},
}
FILE = "events.tsv"  # beside a recording


class Event(NamedTuple):
    """Event of a session.

    Attributes:
        clock: Time on the clock of `time.monotonic` [s].
        trial: Number of the trial; 0 outside trials.
        name: Name of the event.
        interval: Interval of the trial, from 1; 0 for none.
        value: Detail of the event, such as the condition or the answer.
    """

    clock: float
    trial: int
    name: str
    interval: int = 0
    value: str = ""


class Markers:
    """Writer of a session's events.

    Args:
        files: Files of the session.
        started: Start of the session, time of day [s].
        resume: Whether to append to an existing table.
        listeners: Functions called with every event, such as an LSL stream.
    """

    def __init__(
        self, files: SessionFiles, started: float, *, resume: bool = False,
        listeners: Sequence[Callable[[Event], object]] = (),
    ) -> None:  # fmt: skip
        self._zero = time.monotonic() - (time.time() - started)
        self._listeners = tuple(listeners)
        goes_on = resume and files.events.exists()
        if not files.events_description.exists():
            place_file(files.events_description, json.dumps(EVENTS, indent=2) + "\n")
        self._file = RowFile(files.events, list(EVENTS), resume=goes_on)

    def onset(self, clock: float) -> float:
        """Return the time since the session began [s]."""
        return clock - self._zero

    def mark(self, event: Event) -> None:
        """Send an event to the listeners, and write it."""
        for listen in self._listeners:
            listen(event)
        self._file.write({
            "onset": cell(round(self.onset(event.clock), 6)), "duration": "0", "trial_number": cell(event.trial or ""),
            "event": cell(event.name), "interval": cell(event.interval or ""), "value": cell(event.value),
        })  # fmt: skip

    def close(self) -> None:
        """Close the table of events."""
        self._file.close()


def write_beside(recording: Path, zero: float, events: Sequence[Event]) -> None:
    """Write the events of a trial beside a recording, with times relative to its first tick.

    Args:
        recording: Recording's file.
        zero: Time of the first tick on the clock of `time.monotonic` [s].
        events: Events of the trial.
    """
    lines = ["onset\tduration\tevent\tinterval\tvalue"]
    lines += [
        "\t".join([cell(round(each.clock - zero, 6)), "0", each.name, cell(each.interval or ""), cell(each.value)])
        for each in events
    ]
    place_file(recording.with_name(FILE), "\n".join(lines) + "\n")


class LslMarkers(MarkerStream):
    """LSL stream of a session's events, as texts such as "3 stimulus 1": trial, event, interval, value."""

    def mark(self, event: Event) -> None:
        """Send an event with its time."""
        words = [event.trial or "", event.name, event.interval or "", event.value]
        self.send(" ".join(str(word) for word in words if word != ""), event.clock)
