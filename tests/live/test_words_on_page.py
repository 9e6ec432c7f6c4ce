"""The verdict on the page: green as long as the object is held, and what it says when it was dropped."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.live.frame import Frames
from graspfx.live.live_run import LiveRun
from graspfx.live.stability_verdict import MarginRow, Verdict
from graspfx.live.view.words_on_page import AMBER, GREEN, RED, margins
from tests.support.recordings import layout, recording
from tests.support.waiting import wait_until

ROWS = tuple(MarginRow("internal", name, 70.0, 700.0, 10.0, 31.0) for name in ("cup", "lid"))
STABLE = Verdict(is_provisional=False, is_stable=True, spectral_radius=0.99, rows=ROWS, stage=2)
UNSTABLE = replace(STABLE, is_stable=False, spectral_radius=1.01)
UNKNOWN = Verdict(is_provisional=False, error="a device does not tell its mass", stage=2)


def test_a_stable_grasp_is_green_while_it_is_held() -> None:
    text = margins(STABLE, {})
    assert text.count(GREEN) == 1 + 2 * len(ROWS) and AMBER not in text
    assert "NOT HELD" not in text


@pytest.mark.parametrize("verdict", [STABLE, UNSTABLE, UNKNOWN, None])
def test_what_nobody_holds_is_not_green(verdict: Verdict | None) -> None:
    text = margins(verdict, {"cup": 0.0127, "lid": 44.1})
    assert GREEN not in text and AMBER in text
    assert "NOT HELD: no finger touches cup (the nearest is 12.7 mm away), lid (the nearest is 44.1 m away)" in text
    assert (RED in text) == (verdict is UNSTABLE)
    assert ("stable once it is held" in text) == (verdict is STABLE)


def test_of_two_objects_the_margins_of_the_one_that_is_held_stay_green() -> None:
    text = margins(STABLE, {"cup": float("nan")})
    assert text.count(GREEN) == 2
    assert "NOT HELD: no finger touches cup<" in text
    assert "<cup" not in margins(STABLE, {"<cup": 0.1})


def test_an_object_is_loose_that_none_of_its_fingers_touches_in_any_row() -> None:
    made = layout(2, 4, objects=3, finger_objects=(0, 0, 1, 1))  # no finger is on the last
    touching = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]])
    gap = np.array([[-0.001, 0.01, 0.01, 0.02], [0.001, 0.01, 0.04, 0.03]])
    run = recording({"touching": touching, "gap": gap}, made)
    assert Frames(run).loose == {"object1": 0.03}
    assert Frames(run.part(1, 2)).loose == {"object0": 0.001, "object1": 0.03}
    assert Frames(run.part(1, 1)).loose == {}


@pytest.mark.parametrize(
    ("columns", "expected"), [(("touching",), {"object": pytest.approx(np.nan, nan_ok=True)}), (("gap",), {})]
)
def test_what_is_not_recorded_is_not_told(columns: tuple[str, ...], expected: dict[str, Any]) -> None:
    changes = {"duration": 0.05, "engine": "interpreted", "record.columns": list(columns)}
    assert Frames(gx.run(gx.load("pick-and-place").replace(changes))).loose == expected


def test_a_view_is_not_green_while_an_object_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("viser", reason="the page needs viser: pip install 'graspfx[view]'")
    from graspfx.live.view import live_view

    monkeypatch.setattr(live_view, "TEXTS", 0.05)
    scene = gx.load("paper-waving").replace({"engine": "interpreted"})
    with (
        LiveRun(scene, guide="hands", paused=True) as run,
        live_view.LiveView(run, [], Path, port=0, tell=lambda _: None) as view,
    ):
        view.certificate._margins = SimpleNamespace(latest=lambda: STABLE, close=lambda: None)  # type: ignore[assignment]

        def shown(way: float) -> str:
            for number, sign in enumerate((-1.0, 1.0)):
                run.guide(number, [sign * way, 0.0])
            last = run.tick + 40
            run.step(40)
            wait_until(lambda: run.tick == last)
            view._texts(None)
            return str(view._margins.content)

        assert GREEN in shown(0.0)
        dropped = shown(0.03)
        assert "NOT HELD: no finger touches object (the nearest is " in dropped
        assert "stable once it is held" in dropped
        assert GREEN in (again := shown(0.0)) and "NOT HELD" not in again
