"""Changes of keys in mid-run: recorded with their ticks, in the part, in the file and in the summary."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import graspfx as gx
from graspfx.recording.files import NAME, part_of
from graspfx.recording.header import KeyChange, Outcome
from graspfx.recording.record import Recording
from graspfx.recording.recorder import Recorder
from graspfx.recording.sink import FileSink
from graspfx.show.summary_table import MOST_CHANGES, print_summary
from tests.support.recordings import header, layout, put, rows, waving

CHANGES = [KeyChange(3, "coupling.internal.stiffness", 50.0), KeyChange(7, "coupling.fade", [0.002, 0.01])]


def recorded(folder: Path) -> tuple[Recorder, FileSink]:
    """Ten rows in blocks of four, with changes before the third and the seventh."""
    sink = FileSink(folder / NAME, layout(), header())
    recorder = Recorder(layout(), header(), [sink], block=4)
    for k, row in enumerate(rows(layout(), 10)):
        for change in CHANGES:
            if change.tick == k:
                recorder.change(k, {change.key: tuple(change.value) if k == 7 else change.value})
        put(recorder, row)
        recorder.drain()
    return recorder, sink


def test_changes_come_back_from_the_file(tmp_path: Path) -> None:
    recorder, _ = recorded(tmp_path)
    rec = recorder.finish()
    assert rec.changes == tuple(CHANGES)  # a tuple is a list, as it comes back
    for loaded in (Recording.load(tmp_path), Recording.load(tmp_path)):
        assert (loaded.changes, loaded.outcome) == (rec.changes, rec.outcome)
        assert loaded.header.scene_table == header().scene_table
    rec.save(tmp_path / "copy.h5")
    assert Recording.load(tmp_path / "copy.h5").changes == rec.changes


def test_changes_are_in_the_part_before_the_rows_that_they_hold_in(tmp_path: Path) -> None:
    recorder, _ = recorded(tmp_path)
    recorder._courier.end()  # which has two blocks of four rows
    part = Recording.load(part_of(tmp_path / NAME))
    assert len(part) == 8 and part.changes == tuple(CHANGES) and not part.outcome.complete
    so_far = recorder.recording(complete=False)
    assert len(so_far) == 10 and so_far.changes == tuple(CHANGES)
    assert np.array_equal(so_far.rows, rows(layout(), 10))
    put(recorder, rows(layout(), 1)[0])
    assert len(so_far) == 10  # a copy
    recorder.finish()


def test_a_change_without_a_row_after_it_is_kept_too(tmp_path: Path) -> None:
    sink = FileSink(tmp_path / NAME, layout(), header())
    with Recorder(layout(), header(), [sink]) as recorder:
        recorder.change(0, {"object.mass": 0.2})
    assert Recording.load(tmp_path).changes == (KeyChange(0, "object.mass", 0.2),)


def test_a_recording_without_changes_has_none() -> None:
    assert waving().changes == () and waving().summary()["changes"] is None
    assert gx.run(gx.load("reference-1dof"), duration=0.01).changes == ()


def test_a_summary_shows_changes(capsys: pytest.CaptureFixture[str]) -> None:
    some = [KeyChange(100 * k, "coupling.internal.stiffness", 50.0 + k) for k in range(MOST_CHANGES + 3)]
    wave = waving(N=2000)
    rec = Recording(wave.rows, wave.layout, wave.header, Outcome(changes=tuple(some)))
    assert rec.summary()["changes"] == MOST_CHANGES + 3
    print_summary([rec])
    text = capsys.readouterr().out
    assert "values changed during the run" in text
    assert "note: from 0.5 s on coupling.internal.stiffness = 51.0\n" in text
    assert "note: and 3 more changes" in text and text.count("note: from") == MOST_CHANGES
    print_summary([wave])
    assert "changed during the run" not in capsys.readouterr().out
