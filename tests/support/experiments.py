"""Experiments of tests: short, on a scene on a line."""

from __future__ import annotations

from pathlib import Path

from graspfx.experiment.design import Experiment
from graspfx.experiment.experiment_file import read

PLAIN = """
name = "plain"
scene = "reference-1dof"
duration = 0.05
order = "random"
repetitions = 2
seed = 3
set = { engine = "interpreted" }

[question]
text = "How is it?"
keys = { s = "soft", h = "hard" }

[[condition]]
name = "low"
set = { "coupling.internal.stiffness" = 40.0 }
answer = "soft"

[[condition]]
name = "high"
set = { "coupling.internal.stiffness" = 70.0 }
answer = "hard"
"""
COMPARED = """
name = "compared"
scene = "reference-1dof"
duration = 0.05
gap = 0.0
repetitions = 4
set = { engine = "interpreted" }

[question]
text = "Which one was stiffer?"
keys = { 1 = "first", 2 = "second" }

[[condition]]
name = "internal"
compare = { key = "coupling.internal.stiffness", reference = 50.0 }

[[condition]]
name = "external"
compare = { key = "coupling.external.stiffness", reference = 20.0 }

[staircase]
increments = { least = 0.05, most = 0.5, count = 12 }
threshold = { least = 0.05, most = 0.5, count = 12 }

[practice]
trials = 1

[observer]
kind = "psychometric"
threshold = { internal = 0.2, external = 0.3 }
"""


def experiment(text: str, *changes: tuple[str, str]) -> Experiment:
    """Read an experiment, with pieces of its text replaced."""
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    return read(text, "test.toml")


def table_of(folder: Path) -> Path:
    """Find the one table of trials in a study."""
    (path,) = folder.glob("sub-*/ses-*/beh/*_beh.tsv")
    return path
