"""A study: the tables of an experiment, its scene, and where it came from."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from graspfx.experiment.experiment_table import ExperimentTable
    from graspfx.scene.model import Scene
    from graspfx.scene.source import Source


class Study:
    """The parts that an experiment is made of.

    Args:
        table: its tables.
        scene: with the values of all trials.
        source: where it came from.
    """

    def __init__(self, table: ExperimentTable, scene: Scene, source: Source) -> None:
        self.table, self.scene, self.source = table, scene, source
