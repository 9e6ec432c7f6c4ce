"""Trials: what is shown in each interval, and what would be the right answer."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from graspfx.recording.record import Recording

FIRST, SECOND = "first", "second"  # answers to the question in which of two intervals there was more


@dataclass(frozen=True)
class Trial:
    """One trial as it is planned.

    Attributes:
        number: from 1 on, in the order of the session.
        condition: its name; "all" where the experiment has none.
        repetition: of the condition, from 1 on.
        levels: of each factor, by its name.
        intervals: values of the scene in each, by dotted key; one interval, or two that are compared.
        answer: that is right; empty where none is.
        reference: the smaller value of a comparison; nan of none.
        increment: by which the larger one is larger, relative; nan of none.
        is_practice: whether it counts for nothing.
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
        """Whether it has two intervals."""
        return len(self.intervals) == 2


@dataclass(frozen=True)
class Presentation:
    """A trial as it was shown, for whoever answers.

    Attributes:
        trial: as planned.
        recordings: the file of each interval.
        faults: of the runs, in words.
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
    """A trial as it stands in the table.

    Attributes:
        trial: as planned.
        response: that was given; empty where none was.
        response_time: since the question could be answered [s]; nan without a response.
        onset: of the first interval since the session began [s].
        duration: from there to the response [s].
        fault: of the runs, in words; empty for none.
        path: of the folder with its recordings, from the table's.
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
        """Whether the response is the right one; None where there is none."""
        return self.response == self.trial.answer if self.trial.answer and self.response else None
