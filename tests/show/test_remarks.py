"""Runs made by hand in which something has gone wrong, and what is remarked about them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from graspfx.recording.record import Recording
from graspfx.show.summary_table import remarks
from tests.support.recordings import layout, recording

N = 400  # ticks of 5 ms


def run(touching: Any, *, gap: Any = 0.0, drop: float = 0.0, status: int = 1, **head: Any) -> Recording:
    """Two fingers on an object that sinks along y by `drop` [m] in the second half of the run."""
    made = layout(gaps=True, slips=True)
    touching = np.broadcast_to(np.asarray(touching, dtype=float), (N, 2))
    position = np.zeros((N, 2))
    position[N // 2 :, 1] = -drop * np.linspace(0.0, 1.0, N - N // 2)
    columns = {
        "touching": touching,
        "status": status * touching,
        "gap": np.broadcast_to(np.asarray(gap, dtype=float), (N, 2)),
        "objects/object0/position": position,
    }
    return recording(columns, made, scene_table={"gravity": [0.0, -9.81]} | head)


def until(tick: int) -> np.ndarray:
    return np.repeat(np.arange(N)[:, None] < tick, 2, axis=1)


def test_a_run_in_which_all_hold_is_passed_over() -> None:
    assert remarks(run(True)) == []


def test_a_finger_that_never_touches_is_named_with_its_distance() -> None:
    gap = np.zeros((N, 2))
    gap[:, 1] = np.linspace(0.3, 0.246, N)
    assert remarks(run([True, False], gap=gap)) == ["finger1 never touches object0: smallest gap 246 mm"]


@pytest.mark.parametrize(
    ("drop", "status", "said"),
    [
        (0.0, 1, []),  # put down and let go
        (0.04, 1, ["object0 falls by 40 mm: no finger touches it after 0.995 s"]),
        (0.0, 2, ["object0 slides out of the fingers: no finger touches it after 0.995 s"]),
        (0.04, 2, ["object0 slides out of the fingers and falls by 40 mm: no finger touches it after 0.995 s"]),
    ],
)
def test_an_object_that_is_lost(drop: float, status: int, said: list[str]) -> None:
    assert remarks(run(until(N // 2), drop=drop, status=status)) == said


def test_without_gravity_nothing_falls() -> None:
    assert remarks(run(until(N // 2), drop=0.04, gravity=None)) == []


def test_contacts_that_chatter() -> None:
    often = np.stack([np.arange(N) % 20 < 10, np.ones(N)], axis=1)  # 19 touches after the first, in 2 s
    assert remarks(run(often)) == [
        "finger0 touches and lets go up to 19 times: contacts chatter if stiffness and period are too large"
    ]


def test_attached_contacts_and_empty_runs_are_passed_over() -> None:
    assert remarks(recording({"touching": np.zeros((5, 2))}, layout(gaps=False))) == []
    assert remarks(recording({"gap": np.zeros((0, 2))}, layout(gaps=True))) == []
