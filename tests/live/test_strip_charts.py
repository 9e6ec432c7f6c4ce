"""Strip charts of the page: the last seconds of a run, the friction margin of the grip among them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.live.frame import Frames, history_of
from graspfx.live.view.strip_charts import StripCharts


class Page:
    """A page that keeps its charts."""

    def __init__(self) -> None:
        self.charts: list[SimpleNamespace] = []
        self.gui = self

    def add_uplot(self, data: Any, series: Any, **_: Any) -> SimpleNamespace:
        self.charts.append(SimpleNamespace(data=data, labels=[each["label"] for each in series]))
        return self.charts[-1]


@pytest.mark.parametrize(("friction", "drawn"), [(0.8, True), ("stick", False)])
def test_the_margin_is_drawn_where_fingers_have_a_coefficient(friction: float | str, drawn: bool) -> None:
    rec = gx.run("mug", {"coupling.friction": friction}, duration=0.6)
    page: Any = Page()
    charts = StripCharts(page, rec.layout.fingers, rec.layout)
    shown = []
    for k in range(len(rec)):
        if charts.wants(float(rec.time[k])):
            charts.add(Frames(history_of(rec.rows[k : k + 1], rec.layout, rec.header, tick=k)))
            shown.append(k)
    charts.draw()
    forces = page.charts[0]
    assert ("grip margin [N]" in forces.labels) == drawn
    assert len(forces.labels) == len(forces.data) == 5 + drawn  # time, squeeze, push along x, y, z
    if drawn:
        np.testing.assert_allclose(forces.data[-1][-5:], rec.grip_margin[shown[-5:]], rtol=0.0, atol=1e-12)
