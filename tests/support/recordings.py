"""Recordings made by hand, for the tests of what is done with recordings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.columns import Layout
from graspfx.recording.header import Header, Outcome
from graspfx.recording.record import Recording
from graspfx.recording.recorder import Recorder

FloatArray = NDArray[np.float64]

PERIOD = 0.005
GAINS = {"coupling": {"external": {"stiffness": 30.0}, "internal": {"stiffness": 70.0}}}


def layout(d: int = 2, n: int = 2, objects: int = 1, **changes: Any) -> Layout:
    names = tuple(f"object{k}" for k in range(objects))
    given: dict[str, Any] = {
        "dimensions": d,
        "fingers": tuple(f"finger{i}" for i in range(n)),
        "objects": names,
        "finger_objects": tuple(i % objects for i in range(n)),
    }
    return Layout(**(given | changes))


def header(**changes: Any) -> Header:
    given: dict[str, Any] = {
        "period": PERIOD,
        "scene": "by-hand",
        "scene_text": "# ünïcode\ndimensions = 2\n",
        "scene_table": GAINS,
        "overrides": {"coupling.internal.stiffness": 70.0},
        "title": "By hand",
        "created": "2026-01-01T00:00:00+00:00",
        "versions": {"python": "3.11"},
        "machine": {"platform": "paper"},
    }
    return Header(**(given | changes))


def put(recorder: Recorder, row: Any) -> None:
    """Records one row."""
    block, r, _ = recorder.space()
    block[r] = row
    recorder.take(1)


def rows(made: Layout, N: int, seed: int = 0) -> FloatArray:
    """Random rows, with touching of 0 or 1."""
    values = np.random.default_rng(seed).normal(size=(N, made.width))
    where = made.columns["touching"].where
    values[:, where] = values[:, where] > 0.0
    return values


def recording(
    columns: Mapping[str, FloatArray], made: Layout, outcome: Outcome | None = None, **head: Any
) -> Recording:
    """A recording that is zero except for the columns given."""
    N = len(next(iter(columns.values())))
    values = np.zeros((N, made.width))
    for name, column in columns.items():
        where = made.columns[name].where
        values[:, where] = np.reshape(column, (N, where.stop - where.start))
    return Recording(values, made, header(**head), outcome)


def waving(k: float = 70.0, d: int = 2, n: int = 2, N: int = 2000) -> Recording:
    """n fingers about a body of radius 25 mm that waves along x (0.5 Hz, 50 mm), each 200/k mm deep, all 3 mm ahead."""
    t = np.arange(N) * PERIOD
    angle = np.pi - 2.0 * np.pi * np.arange(n) / n
    out = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)[:, :d]  # (n, d)
    x = np.zeros((N, d))
    x[:, 0] = 0.05 * np.sin(np.pi * t)
    ahead = np.zeros(d)
    ahead[0] = 0.003
    c = x[:, None] + 0.025 * out
    depth = 0.2 / k
    p = c - depth * out + ahead
    gap = np.full((N, n), -depth)
    columns = {
        "finger_position": p,
        "contact_position": c,
        "finger_force": k * (p - c),
        "touching": np.ones((N, n)),
        "gap": gap,
        "objects/object0/position": x,
    }
    return recording(columns, layout(d, n), Outcome(wall_time=0.2))
