"""Runs of a scene by an engine of one's choice, and whether two of them are the same bits."""

from __future__ import annotations

import numpy as np

import graspfx as gx
from graspfx.build.build import build
from graspfx.loop.recording.header import Header
from graspfx.loop.recording.record import Recording
from graspfx.loop.recording.recorder import Recorder

TICKS = 60


def recorded(scene: gx.Scene, engine: str, calls: int = 1, ticks: int = TICKS) -> Recording:
    """A run in so many calls."""
    with build(scene, engine=engine) as servo, Recorder(servo.layout, Header(scene.period), block=ticks) as recorder:
        for count in np.diff(np.linspace(0, ticks, calls + 1).astype(int)).tolist():
            servo.run(count, recorder)
        return recorder.finish(engine=servo.engine.name)


def same(one: Recording, other: Recording) -> bool:
    return one.rows.tobytes() == other.rows.tobytes() and one.faults == other.faults
