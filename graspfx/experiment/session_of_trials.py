"""Execution of a session: each trial is written to disk before the next trial, and each event when it occurs."""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from graspfx.errors import InputError, RecordingError
from graspfx.experiment.answering import INTERRUPTION, Answerer, Stopped
from graspfx.experiment.presenters import Presenter, Showing
from graspfx.experiment.session_files import RowFile, SessionFiles, cell, place_file
from graspfx.experiment.trial import FIRST, SECOND, Presentation, Row, Trial
from graspfx.experiment.trial_table import cells_of
from graspfx.live.lsl_outlet import MarkerStream

if TYPE_CHECKING:
    from graspfx.experiment.experiment_table import ExperimentTable
    from graspfx.experiment.session_plan import SessionPlan

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
            "resume": "the interrupted session was resumed",
        },
    },
    "interval": {"Description": "interval of a comparison, from 1"},
    "value": {"Description": "condition, answer, or another detail of the event"},
}
FILE = "events.tsv"  # beside a recording


class Event(NamedTuple):
    """Event of a session.

    Attributes:
        clock: Time on the clock of `time.monotonic` [s].
        trial: Number of the trial; 0 outside trials.
        name: Name of the event, a level of `EVENTS["event"]`.
        interval: Interval of a comparison, 1 or 2; 0 for other trials and for events of the whole trial.
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
        started: Start of the session, as POSIX time [s].
        resume: Whether to append to the table of events if it exists. If False, the table must not exist.
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
        """Convert a time on the clock of `time.monotonic` to the time since the session began [s]."""
        return clock - self._zero

    def mark(self, event: Event) -> None:
        """Send an event to the listeners, and write it to the table."""
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
    """Write the events of a trial beside a recording, with times relative to the recording's first tick.

    Args:
        recording: Path of the recording's file.
        zero: Time of the recording's first tick on the clock of `time.monotonic` [s].
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


PLACES = (FIRST, SECOND)  # folders of the two intervals
FORCES = "hold the device; it exerts forces after you press Enter"


@dataclass
class SessionOfTrials:
    """Session that runs the remaining trials of its plan.

    Attributes:
        table: Content of the experiment file.
        files: Files of the session.
        plan: Plan of the session.
        rows: Table of trials.
        markers: Writer of events.
        presenter: Presenter of intervals.
        answerer: Source of answers.
        tell: Function that shows a text.
        stop: Function that returns whether to end the session.
        is_paced: Whether the session keeps the gaps, breaks and waits before trials, and measures response times.
        reason: Reason why the session ended before its last trial; empty otherwise.
    """

    table: ExperimentTable
    files: SessionFiles
    plan: SessionPlan
    rows: RowFile
    markers: Markers
    presenter: Presenter
    answerer: Answerer
    tell: Callable[[str], object]
    stop: Callable[[], bool]
    is_paced: bool = True
    reason: str = ""
    _events: list[Event] = field(default_factory=list)

    def trials(self) -> Iterator[Row]:
        """Run the trials and yield their rows; each row is on the disk before it is yielded.

        The session ends after the last trial, or when it is stopped. With hardware, it also ends after a fault, and the
        hardware is not armed again.

        Raises:
            InputError: If a trial with hardware ended in a fault, or if a function returned an unknown answer.
            RecordingError: If the disk cannot be written. The trial then has no row, and will be repeated.
        """
        if self.plan.done:
            self.markers.mark(Event(time.monotonic(), 0, "resume"))
        while (trial := self.plan.trial()) is not None:
            try:
                self._pause_before(trial)
                row = self._run(trial)
                self.rows.write({name: cell(value) for name, value in cells_of(row).items()})
            except Stopped as stopped:
                self.reason = str(stopped)
                return
            except RecordingError as error:
                done = "the trials before it are in the table" if self.plan.done else "no trial is in the table yet"
                do = f"check the disk; --resume continues with trial {trial.number}"
                raise RecordingError(f"{error}. Trial {trial.number} has no row, {done}: {do}") from error
            self.plan.take(row)
            yield row
            if row.fault and self.presenter.has_hardware:
                do = "check the device, then continue with --resume"
                raise InputError(
                    "trial",
                    f"{trial.number}, which ended in a fault: {row.fault}",
                    "a trial without a fault of the hardware",
                    do,
                )

    def _pause_before(self, trial: Trial) -> None:
        breaks = self.table.breaks
        if breaks is None or trial.is_practice or not self.is_paced:
            return
        count = trial.number - 1 - sum(slot.is_practice for slot in self.plan.slots)
        if count > 0 and count % breaks.every == 0:
            self._mark(trial, "break", value=breaks.text)
            self.answerer.ready(f"{breaks.text}; press Enter to continue")

    def _run(self, trial: Trial) -> Row:
        self._events = []
        question = self.table.question
        during = question is not None and question.when == "during"
        if self.table.ready and not self.presenter.has_hardware and self.is_paced:
            self.answerer.ready(f"trial {trial.number} of {len(self.plan.slots)}: press Enter")
        self._mark(trial, "trial", value=trial.condition)
        home = self.files.trial_folder(trial.number)
        showings: list[Showing] = []
        for place in range(len(trial.intervals)):
            showings.append(self._show(trial, place, home, showings, during=during))
            if not showings[-1].is_whole and not showings[-1].fault:
                raise Stopped(INTERRUPTION if self.stop() else "a run ended early, without a fault")
            if showings[-1].fault:
                break
        fault = next((each.fault for each in showings if each.fault), "")
        response, clock, seconds = "", showings[-1].end, math.nan
        if question is not None and not fault:
            since = showings[-1].zero if during else self._ask(trial)
            answer = self.answerer.answer(Presentation(trial, [each.recording for each in showings]))
            response, clock = answer.response, answer.clock
            seconds = clock - since if self.is_paced else math.nan
            self._mark(trial, "response", value=response, clock=clock)
        zero = showings[0].zero
        for each in showings:
            if each.recording.is_file():
                write_beside(each.recording, each.zero, self._events)
        path = Path(os.path.relpath(home, self.files.folder)).as_posix()
        return Row(trial, response, seconds, self.markers.onset(zero), clock - zero, fault, path)

    def _show(self, trial: Trial, place: int, home: Path, before: Sequence[Showing], *, during: bool) -> Showing:
        """Present an interval; with hardware, wait for the person before every interval."""
        question, number = self.table.question, place + 1 if trial.is_comparison else 0
        if self.presenter.has_hardware:
            label = f"trial {trial.number} of {len(self.plan.slots)}" + (f", interval {number}" if number else "")
            self.answerer.ready(f"{label}: {FORCES}")
        if before and self.is_paced:
            while (left := before[-1].end + self.table.gap - time.monotonic()) > 0.0:
                if self.stop():
                    raise Stopped(INTERRUPTION)
                time.sleep(min(left, 0.05))
        if trial.is_comparison:
            self.tell(PLACES[place])

        def begin(zero: float) -> None:
            self._mark(trial, "stimulus", number, clock=zero)
            if during and question is not None:
                self._mark(trial, "question", value=question.text, clock=zero)
                self.tell(_prompt(question.text, question.keys))
                self.answerer.listen(question.keys)

        folder = home / PLACES[place] if trial.is_comparison else home
        answered = self.answerer.has_answered if during else lambda: False
        showing = self.presenter.show(trial.intervals[place], folder, begin, answered, self.stop)
        self._mark(trial, "end", number, clock=showing.end)
        return showing

    def _ask(self, trial: Trial) -> float:
        """Ask the question; return the time from which it can be answered, on the clock of `time.monotonic` [s]."""
        question = self.table.question
        assert question is not None
        self.answerer.listen(question.keys)
        self.tell(_prompt(question.text, question.keys))
        since = time.monotonic()
        self._mark(trial, "question", value=question.text, clock=since)
        return since

    def _mark(self, trial: Trial, name: str, interval: int = 0, value: str = "", clock: float | None = None) -> None:
        event = Event(time.monotonic() if clock is None else clock, trial.number, name, interval, value)
        self._events.append(event)
        self.markers.mark(event)


def _prompt(text: str, keys: dict[str, str]) -> str:
    return f"{text}  {'   '.join(f'[{key}] {answer}' for key, answer in keys.items())}"
