"""Frames: rows of runs as what is drawn, in space, the same one by one and all together, also where columns lack."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import graspfx as gx
from graspfx.live.frame import STATES, Frames, frame_of, quaternions
from graspfx.recording.header import Outcome
from graspfx.recording.record import Recording
from graspfx.show.style import CONTACTS, EXTERNAL, INTERNAL
from tests.support.optional import require
from tests.support.played import SECONDS, played
from tests.support.recordings import layout, recording, waving


@pytest.mark.parametrize("name", SECONDS)
def test_a_row_alone_gives_the_frame_that_it_has_among_all(name: str) -> None:
    run = played(name)
    frames = Frames(run, 0.001)
    for k in (0, len(run) // 3, -1):
        whole, k = frames[k], k % len(run)
        alone = frame_of(run.rows[k].copy(), run.layout, run.header, changes=run.outcome.changes, tick=k, apart=0.001)
        assert (alone.time, alone.tick, alone.states) == (whole.time, whole.tick, whole.states) == (
            run.time[k], k, whole.states
        )  # fmt: skip
        for part in ("fingertips", "contact_position", "touching", "force", "internal", "external"):
            assert np.array_equal(getattr(alone, part), getattr(whole, part), equal_nan=True), part
        for thing, pose in alone.objects.items():
            assert np.array_equal(pose.position, whole.objects[thing].position)
            assert np.array_equal(pose.wxyz, whole.objects[thing].wxyz)


@pytest.mark.parametrize("name", SECONDS)
def test_frames_have_the_numbers_of_the_recording(name: str) -> None:
    run, d = played(name), played(name).layout.dimensions
    frame = Frames(run)[-1]
    assert np.array_equal(frame.fingertips[:, :d], require(run.true_position)[-1])
    assert not frame.fingertips[:, d:].any()
    assert np.array_equal(
        require(frame.external)[:, :d], np.where(run.touching[-1][:, None], run.external_force[-1], 0)
    )
    assert np.allclose(require(frame.internal) + require(frame.external), require(frame.force), rtol=0.0, atol=1e-15)
    assert np.array_equal(np.isfinite(frame.contact_position).all(axis=1), run.touching[-1])
    status = run.status
    expected = [("touch" if status is None else ("free", "stick", "slide")[status[-1, i]]) if touching else "free"
                for i, touching in enumerate(run.touching[-1])]  # fmt: skip
    assert list(frame.states) == expected
    for thing, pose in frame.objects.items():
        assert np.array_equal(pose.position[:d], run.described_pose(thing)[0][-1])
        assert np.linalg.norm(pose.wxyz) == pytest.approx(1.0, abs=1e-12)


def test_a_finger_at_its_limit_says_so() -> None:
    made = layout(2, 2, limits=True, slips=True)
    ones = np.ones((1, 2))
    run = recording({"touching": ones, "status": 2 * ones, "saturated": np.array([[0.0, 1.0]])}, made)
    assert Frames(run)[0].states == ("slide", "limit")
    assert list(require(Frames(run)[0].limited)) == [False, True]


def test_states_have_colours_that_forces_have_not() -> None:
    assert tuple(CONTACTS) == STATES
    assert not {INTERNAL, EXTERNAL} & set(CONTACTS.values())
    assert len({CONTACTS[state] for state in ("free", "stick", "slide", "limit")}) == 4


@pytest.mark.parametrize(
    ("columns", "missing"),
    [
        (("finger_position", "touching"), {"internal", "external", "force"}),
        (("finger_force", "touching"), {"internal", "external"}),
        (("objects",), {"internal", "external", "force"}),
        (("internal_force", "true_position", "touching"), set()),
    ],
)
def test_a_recording_without_columns_gives_frames_without_these(columns: tuple[str, ...], missing: set[str]) -> None:
    scene = gx.load("paper-waving").replace(
        {"duration": 0.05, "engine": "interpreted", "record.columns": list(columns)}
    )
    run = gx.run(scene)
    frame = Frames(run)[4]
    assert {part for part in ("internal", "external", "force") if getattr(frame, part) is None} == missing
    assert np.isfinite(frame.fingertips).all() == bool({"finger_position", "true_position"} & set(columns))
    assert len(frame.states) == 2
    assert Frames(run).modes == {} or not missing


def test_a_lost_row_draws_nothing_and_harms_nothing() -> None:
    run = waving(N=3)
    rows = run.rows.copy()
    rows[1] = np.nan
    frames = Frames(Recording(rows, run.layout, run.header))
    assert frames[1].states == ("free", "free")
    assert np.isnan(frames[1].fingertips[:, :2]).all()
    assert np.array_equal(require(frames[1].force), np.zeros((2, 3)))


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
        now = frame_of(run.rows[tick].copy(), run.layout, run.header, changes=changes, tick=tick)
        assert np.array_equal(require(now.external), run.external_force[tick])
        before = frame_of(run.rows[tick].copy(), run.layout, run.header, tick=tick)
        assert np.array_equal(require(now.external), require(before.external)) == is_same


def test_fingers_on_a_line_stand_apart() -> None:
    frames = Frames(played("reference-1dof"), 0.002)
    assert frames[3].fingertips[:, 1].tolist() == [0.001, -0.001]
    assert frames[3].contact_position[:, 1].tolist() == [0.001, -0.001]


def test_turns_are_quaternions() -> None:
    angle = np.array([0.0, 0.5, -3.0])
    assert np.allclose(quaternions(angle, 3), np.stack([np.cos(angle / 2), 0 * angle, 0 * angle, np.sin(angle / 2)], 1))
    assert quaternions(np.array([[0.1, 0.2, 0.3, 0.9]]), 1).tolist() == [[0.9, 0.1, 0.2, 0.3]]
    assert quaternions(None, 2).tolist() == [[1, 0, 0, 0]] * 2


def test_a_row_of_fewer_rows_than_ticks_has_its_time() -> None:
    run = waving(N=4)
    thin = Recording(run.rows.copy(), run.layout, replace(run.header, every=5), Outcome())
    frame = frame_of(run.rows[2].copy(), run.layout, thin.header, tick=10)
    assert (frame.tick, frame.time) == (10, thin.time[2])
