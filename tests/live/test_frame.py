"""Frames: rows of runs as what is drawn, in space, the same one by one and all together, also where columns lack."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.live.frame import STATES, Frames, history_of, quaternions
from graspfx.recording.header import KeyChange, Outcome
from graspfx.recording.record import Recording
from graspfx.show.style import CONTACTS, EXTERNAL, INTERNAL
from tests.support.optional import require
from tests.support.played import SECONDS, played
from tests.support.recordings import layout, recording, waving


def alone(run: Recording, k: int, changes: Sequence[KeyChange] = (), apart: float = 0.0) -> Frames:
    """Give the frame of one row, as a live run has it."""
    return Frames(history_of(run.rows[k][None].copy(), run.layout, run.header, changes=changes, tick=k), apart)


def names(states: Any) -> list[str]:
    return [STATES[state] for state in states]


@pytest.mark.parametrize("name", SECONDS)
def test_a_row_alone_gives_the_frame_that_it_has_among_all(name: str) -> None:
    run = played(name)
    frames = Frames(run, 0.001)
    for k in (0, len(run) // 3, len(run) - 1):
        own = alone(run, k, run.outcome.changes, 0.001)
        assert own.time[0] == frames.time[k] == run.time[k]
        for part in ("fingertips", "contacts", "touching", "states", "force"):
            assert np.array_equal(getattr(own, part)[0], getattr(frames, part)[k], equal_nan=True), part
        for one, whole in zip(require(own.parts), require(frames.parts), strict=True):
            assert np.array_equal(one[0], whole[k])
        for thing, pose in own.poses.items():
            assert all(np.array_equal(one[0], whole[k]) for one, whole in zip(pose, frames.poses[thing], strict=True))


@pytest.mark.parametrize("name", SECONDS)
def test_frames_have_the_numbers_of_the_recording(name: str) -> None:
    run, d = played(name), played(name).layout.dimensions
    frames = Frames(run)
    assert np.array_equal(frames.fingertips[-1, :, :d], require(run.true_position)[-1])
    assert not frames.fingertips[-1, :, d:].any()
    internal, external = require(frames.parts)
    assert np.array_equal(external[-1, :, :d], np.where(run.touching[-1][:, None], run.external_force[-1], 0))
    assert np.allclose(internal[-1] + external[-1], require(frames.force)[-1], rtol=0.0, atol=1e-15)
    assert np.array_equal(np.isfinite(frames.contacts[-1]).all(axis=1), run.touching[-1])
    status = run.status
    expected = [("touch" if status is None else ("free", "stick", "slide")[status[-1, i]]) if touching else "free"
                for i, touching in enumerate(run.touching[-1])]  # fmt: skip
    assert names(frames.states[-1]) == expected
    for thing, (position, wxyz) in frames.poses.items():
        assert np.array_equal(position[-1, :d], run.described_pose(thing)[0][-1])
        assert np.linalg.norm(wxyz[-1]) == pytest.approx(1.0, abs=1e-12)


def test_a_finger_at_its_limit_says_so() -> None:
    made = layout(2, 2, limits=True, slips=True)
    ones = np.ones((1, 2))
    run = recording({"touching": ones, "status": 2 * ones, "saturated": np.array([[0.0, 1.0]])}, made)
    assert names(Frames(run).states[0]) == ["slide", "limit"]
    assert require(Frames(run).limited)[0].tolist() == [False, True]


def test_states_have_colours_that_forces_have_not() -> None:
    assert tuple(CONTACTS) == STATES
    assert not {INTERNAL, EXTERNAL} & set(CONTACTS.values())
    assert len({CONTACTS[state] for state in ("free", "stick", "slide", "limit")}) == 4


@pytest.mark.parametrize(
    ("columns", "missing"),
    [
        (("finger_position", "touching"), {"parts", "force"}),
        (("finger_force", "touching"), {"parts"}),
        (("objects",), {"parts", "force"}),
        (("internal_force", "true_position", "touching"), set()),
    ],
)
def test_a_recording_without_columns_gives_frames_without_these(columns: tuple[str, ...], missing: set[str]) -> None:
    scene = gx.load("paper-waving").replace(
        {"duration": 0.05, "engine": "interpreted", "record.columns": list(columns)}
    )
    run = gx.run(scene)
    frames = Frames(run)
    assert {part for part in ("parts", "force") if getattr(frames, part) is None} == missing
    assert np.isfinite(frames.fingertips[4]).all() == bool({"finger_position", "true_position"} & set(columns))
    assert len(frames.states[4]) == 2
    assert Frames(run).modes == {} or not missing


def test_a_lost_row_draws_nothing_and_harms_nothing() -> None:
    run = waving(N=3)
    rows = run.rows.copy()
    rows[1] = np.nan
    frames = Frames(Recording(rows, run.layout, run.header))
    assert names(frames.states[1]) == ["free", "free"]
    assert np.isnan(frames.fingertips[1, :, :2]).all()
    assert np.array_equal(require(frames.force)[1], np.zeros((2, 3)))


def test_the_split_follows_its_changes() -> None:
    """Arms between which rotations are external change in mid-run: so do the parts from that tick on, as recorded."""
    with gx.open(gx.load("mug").replace({"duration": 1.25}), live=["coupling.blend"]) as session:
        session.step(200)
        session.set({"coupling.blend": [0.1, 0.2]})
        session.step(50)
        run = session.recording
    changes = run.outcome.changes
    assert [change.tick for change in changes if change.key == "split"] == [200]
    for tick, is_same in ((199, True), (249, False)):
        now, before = (require(alone(run, tick, each).parts)[1][0] for each in (changes, ()))
        assert np.array_equal(now, run.external_force[tick])
        assert np.array_equal(now, before) == is_same


def test_fingers_on_a_line_stand_apart() -> None:
    frames = Frames(played("reference-1dof"), 0.002)
    assert frames.fingertips[3, :, 1].tolist() == [0.001, -0.001]
    assert frames.contacts[3, :, 1].tolist() == [0.001, -0.001]


def test_turns_are_quaternions() -> None:
    angle = np.array([0.0, 0.5, -3.0])
    assert np.allclose(quaternions(angle, 3), np.stack([np.cos(angle / 2), 0 * angle, 0 * angle, np.sin(angle / 2)], 1))
    assert quaternions(np.array([[0.1, 0.2, 0.3, 0.9]]), 1).tolist() == [[0.9, 0.1, 0.2, 0.3]]
    assert quaternions(None, 2).tolist() == [[1, 0, 0, 0]] * 2


def test_a_row_of_fewer_rows_than_ticks_has_its_time() -> None:
    run = waving(N=4)
    thin = Recording(run.rows.copy(), run.layout, replace(run.header, every=5), Outcome())
    one = history_of(run.rows[2][None].copy(), run.layout, thin.header, tick=10)
    assert one.start == 2 and Frames(one).time[0] == thin.time[2]
