"""Trials: planned intervals with the correct answer, presentations, and rows of the table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from graspfx.recording.record import Recording

FIRST, SECOND = "first", "second"  # answers to the question which interval had the larger value


@dataclass(frozen=True)
class Trial:
    """Planned trial.

    Attributes:
        number: Number in the session, from 1.
        condition: Name of the condition; "all" if the experiment has none.
        repetition: Repetition of the condition with these levels, from 1; in practice, number of the practice trial.
        levels: Level of each factor, by the factor's name.
        intervals: Values of the scene in each interval, by dotted key; a comparison has two intervals.
        answer: Correct answer; empty if there is none.
        reference: Smaller value of a comparison; NaN without a comparison.
        increment: Relative increment of the larger value; NaN without a comparison.
        is_practice: Whether the trial is practice, which is not evaluated.
    """

    number: int
    condition: str
    repetition: int
    levels: Mapping[str, Any]
    intervals: Sequence[Mapping[str, Any]]
    answer: str = ""
    reference: float = math.nan
    increment: float = math.nan
    is_practice: bool = False

    @property
    def is_comparison(self) -> bool:
        """Whether the trial has two intervals."""
        return len(self.intervals) == 2


@dataclass(frozen=True)
class Presentation:
    """Presented trial, as passed to the answerer.

    Attributes:
        trial: Planned trial.
        recordings: File of each interval's recording.
        faults: Descriptions of faults in the runs; empty in a session, which asks no question after a fault.
    """

    trial: Trial
    recordings: Sequence[Path]
    faults: Sequence[str] = ()

    def load(self) -> list[Recording]:
        """Load the recordings of the intervals."""
        from graspfx.recording.record import Recording

        return [Recording.load(path) for path in self.recordings]


@dataclass(frozen=True)
class Row:
    """Trial as a row of the table.

    Attributes:
        trial: Planned trial.
        response: Response; empty if there is none.
        response_time: Time from the question to the response [s]; NaN without a response, or if the session is not in
            real time.
        onset: Time from the start of the session to the first tick of the first interval [s].
        duration: Time from the onset to the response, or, without a response, to the end of the last interval [s].
        fault: Description of a fault in the runs; empty for none.
        path: Folder of the recordings, relative to the folder of the table.
    """

    trial: Trial
    response: str = ""
    response_time: float = math.nan
    onset: float = math.nan
    duration: float = math.nan
    fault: str = ""
    path: str = ""

    @property
    def is_correct(self) -> bool | None:
        """Whether the response is correct; None without a response or a correct answer."""
        return self.response == self.trial.answer if self.trial.answer and self.response else None
