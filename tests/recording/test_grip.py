"""Friction margin of recorded grips, in every place that shows a recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import graspfx as gx
from graspfx.show.panels import rows, views
from graspfx.show.style import finger_strokes

SCENE = "sphere-three-fingers"


def margin_by_hand(rec: gx.Recording, mu: float) -> np.ndarray:
    """mu f_n - |f_t| of each finger, then the least of those that touch; NaN where none does."""
    out = np.full(len(rec), np.nan)
    for k in range(len(rec)):
        for i in np.flatnonzero(rec.touching[k]):
            n, f = rec.array("contact_normal")[k, i], rec.finger_force[k, i]
            out[k] = np.fmin(out[k], mu * (n @ f) - np.linalg.norm(f - (n @ f) * n))
    return out


@pytest.fixture(scope="module")
def recording() -> gx.Recording:
    return gx.run(SCENE, {"coupling.friction": 0.5}, duration=0.4)


def test_the_margin_is_that_of_its_definition(recording: gx.Recording) -> None:
    margin = margin_by_hand(recording, 0.5)
    np.testing.assert_allclose(recording.grip_margin, margin, rtol=0.0, atol=1e-14)
    assert recording.summary()["grip_margin"] == pytest.approx(np.nanmin(margin), abs=1e-14)


def test_the_coefficient_needed_is_where_the_margin_is_zero(recording: gx.Recording) -> None:
    needed = recording.summary()["friction_needed"]
    assert 0.0 < needed < 0.5
    assert np.nanmin(margin_by_hand(recording, needed)) == pytest.approx(0.0, abs=1e-12)


def test_exports_and_figures_have_it(recording: gx.Recording, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    recording.to_csv(path)
    names, *lines = path.read_text(encoding="utf-8").splitlines()
    column = next(k for k, name in enumerate(names.split(",")) if name.startswith("grip_margin"))
    read = np.array([float(line.split(",")[column]) for line in lines])
    np.testing.assert_array_equal(read, recording.grip_margin)
    np.testing.assert_array_equal(recording.to_xarray()["grip_margin"].values, recording.grip_margin)
    columns = views([recording])
    [row] = [
        each for each in rows(columns, finger_strokes([v.names for v in columns])) if each.label.startswith("grip")
    ]
    np.testing.assert_array_equal(row.panels[0][0].values, recording.grip_margin)


def test_a_batch_measures_it_with_the_coefficient_of_each_variant() -> None:
    values = [0.3, 0.6]
    batch = gx.run_batch(gx.load(SCENE, {"duration": 0.2}), {"coupling.friction": values}, measure=["grip_margin"])
    for k, mu in enumerate(values):
        one = gx.run(SCENE, {"coupling.friction": mu}, duration=0.2).grip_margin
        assert batch["grip_margin"]["min"][k] == one.min()
        assert batch["grip_margin"]["last"][k] == one[-1]


@pytest.mark.parametrize("friction", [0.0, "stick"])
def test_without_a_coefficient_there_is_none(friction: float | str) -> None:
    rec = gx.run(SCENE, {"coupling.friction": friction}, duration=0.1)
    assert np.isnan(rec.grip_margin).all() and rec.summary()["grip_margin"] is None
    assert "grip_margin" not in [column.name for column in rec.layout.derived]


def test_a_finger_that_slides_has_no_margin_rather_than_one_of_rounding() -> None:
    rec = gx.run("carry-bar", {"coupling.friction": 0.3})
    assert rec.status is not None
    sliding = (rec.status == 2).any(axis=1) & (np.abs(rec.finger_force).max(axis=(1, 2)) > 1e-9)
    by_hand = margin_by_hand(rec, 0.3)[sliding]
    assert (by_hand != 0.0).any() and np.abs(by_hand).max() < 1e-15  # [N]
    assert (rec.grip_margin[sliding] == 0.0).all()
