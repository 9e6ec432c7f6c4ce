"""Experiments with people: trials in a planned order, answers, recordings, a table of trials, and thresholds."""

from __future__ import annotations

from graspfx.experiment.design import Experiment
from graspfx.experiment.experiment_file import load, names
from graspfx.experiment.session_plan import williams_square
from graspfx.experiment.simulated_observers import displayed_stiffness
from graspfx.experiment.staircase import Threshold, thresholds
from graspfx.experiment.trial import Presentation, Row, Trial
from graspfx.experiment.trial_table import read_table

__all__ = [
    "Experiment",
    "Presentation",
    "Row",
    "Threshold",
    "Trial",
    "displayed_stiffness",
    "load",
    "names",
    "read_table",
    "thresholds",
    "williams_square",
]


def __dir__() -> list[str]:
    return sorted(__all__)
