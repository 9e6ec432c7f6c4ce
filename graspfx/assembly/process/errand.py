"""Errand of a process that runs a scene's servo: all that it is told, as data."""

from __future__ import annotations

import os
import pickle
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from graspfx import log
from graspfx.environment import is_granted
from graspfx.errors import InputError

if TYPE_CHECKING:
    from graspfx.scene.model import Scene


@dataclass(frozen=True)
class Errand:
    """The errand of a servo's process.

    The process is a fresh interpreter with this one's `sys.path` and folder; it imports the modules of drivers and
    hands by their names, and never the program that has begun it.

    Attributes:
        scene: to be run.
        ticks: to run.
        width: numbers of a row.
        selected: whether rows have the columns and ticks alone that the scene asks for.
        live: keys that may change in mid-run.
        goals: numbers of the goals of guided hands.
        trust: whether files outside of the scene's folder may be read.
        verbosity: of messages that somebody listens to; None for none.
        path: where modules are looked for.
        parent: number of the process that records.
    """

    scene: Scene
    ticks: int
    width: int
    selected: bool = True
    live: Sequence[str] = ()
    goals: int = 0
    trust: bool = field(default_factory=is_granted)
    verbosity: int | None = field(default_factory=lambda: _verbosity())
    path: Sequence[str] = field(default_factory=lambda: list(sys.path))
    parent: int = field(default_factory=os.getpid)

    def text(self) -> bytes:
        """Write it for the other process.

        Raises:
            InputError: the scene holds an object that cannot be carried over.
        """
        self.scene.to_dict()  # which names the key of an object that is no data
        try:
            return pickle.dumps(self)
        except Exception as error:
            raise InputError(
                "scene", self.scene, "numbers, texts, lists and tables, which another process can be told",
                f"a scene with hardware runs in a process of its own: {error}; put what makes the object into a driver "
                "of your own",
            ) from error  # fmt: skip


def _verbosity() -> int | None:
    return next((level for level in (log.DEBUG, log.INFO) if log.is_heard(level)), None)
