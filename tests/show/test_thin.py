"""Figures of long recordings are drawn from some of their rows, which keep the envelope of every line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import graspfx as gx
from graspfx.show import run_figures
from graspfx.show.run_figures import sheet


@pytest.mark.parametrize("every", [1, 3])
def test_a_long_recording_is_thinned_to_its_envelope(
    every: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_figures, "MOST", 1000)
    monkeypatch.setattr(run_figures, "SPANS", 10)
    whole = gx.run("paper-waving", {"record.every": every}, duration=3.0, out=tmp_path)
    some = run_figures.thinned(whole)
    assert 10 <= len(some) < len(whole)
    assert some.end == whole.end
    places = np.searchsorted(whole.time, some.time)
    assert np.array_equal(whole.time[places], some.time) and (np.diff(places) > 0).all()
    assert some.rows.tobytes() == whole.rows[places].tobytes()
    step = -(-len(whole) // 10)
    assert np.isin(np.arange(0, len(whole), step), places).all()
    for quantity in ("finger_position", "finger_force", "object_position", "external_force", "internal_displacement"):
        values, drawn = (getattr(each, quantity).reshape(len(each), -1) for each in (whole, some))
        for first in range(0, len(whole), step):
            span, own = values[first : first + step], drawn[(places >= first) & (places < first + step)]
            assert np.array_equal(span.min(axis=0), own.min(axis=0)), quantity
            assert np.array_equal(span.max(axis=0), own.max(axis=0)), quantity


def test_others_are_drawn_as_they_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stored = gx.run("reference-1dof", duration=0.5, out=tmp_path)
    assert run_figures.thinned(stored) is stored  # short
    monkeypatch.setattr(run_figures, "MOST", 10)
    memory = gx.run("reference-1dof", duration=0.5)
    assert run_figures.thinned(memory) is memory


def test_the_figure_has_the_times_of_the_thinned_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_figures, "MOST", 1000)
    monkeypatch.setattr(run_figures, "SPANS", 20)
    whole = gx.run("paper-waving", duration=3.0, out=tmp_path)
    drawn = sheet([whole]).panels[0, 0]
    line = drawn.get_lines()[0]
    assert len(line.get_xdata()) == len(run_figures.thinned(whole)) < len(whole)
    assert drawn.get_xlim()[1] == pytest.approx(whole.end)
