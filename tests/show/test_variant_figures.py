"""Figures of measures over keys: growth over powers of ten stands on an axis of powers of ten."""

from __future__ import annotations

import numpy as np
import pytest

from graspfx.show.variant_figures import Surface, variants_sheet

KEY = {"object.mass": np.array([0.1, 0.2, 0.3])}


@pytest.mark.parametrize(("name", "scale"), [("finger_force.growth", "log"), ("finger_force.peak", "linear")])
def test_growth_over_many_powers_has_a_logarithmic_axis(name: str, scale: str) -> None:
    values = np.array([0.5, 20.0, 1e6])
    sheet = variants_sheet(KEY, [Surface(name, "", values)], np.zeros(3, bool), "scene")
    ax = sheet.panels[0, 0]
    assert ax.get_yscale() == scale
    if scale == "log":
        assert ax.get_ylim()[0] < values.min() and ax.get_ylim()[1] > values.max()
